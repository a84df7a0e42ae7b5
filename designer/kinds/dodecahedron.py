"""A dodecahedron with a triangular lattice, or a square one, clipped to each of its twelve pentagons."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.of_edge import AskedOfEdge, OfEdgeSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Faceted


@cache
def dodecahedron() -> "Faceted":
    """The solid of edge length 1: three rectangles in golden proportion and a cube's corners."""
    import numpy as np

    from designer.base.solid import Faceted

    golden = (1 + math.sqrt(5)) / 2
    cube = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    flat = [(0.0, a / golden, b * golden) for a in (-1, 1) for b in (-1, 1)]
    vertices = np.array([*cube, *(np.roll(corner, turn) for turn in range(3) for corner in flat)]) * golden / 2
    out = [np.roll((0.0, a * golden, float(b)), turn) for turn in range(3) for a in (-1, 1) for b in (-1, 1)]
    faces = []
    for normal in sorted(out, key=lambda one: tuple(-one[::-1])):
        own = np.flatnonzero(vertices @ normal > (vertices @ normal).max() - 1e-6)
        x_axis = vertices[own[0]] - vertices[own].mean(axis=0)
        y_axis = np.cross(normal / np.linalg.norm(normal), x_axis)
        faces.append(tuple(sorted(own.tolist(), key=lambda k: math.atan2(vertices[k] @ y_axis, vertices[k] @ x_axis))))
    return Faceted(vertices, tuple(faces))


@dataclass(frozen=True)
class DodecahedronSpec(OfEdgeSpec):
    """A dodecahedron."""

    kind: ClassVar[str] = "dodecahedron"
    name: ClassVar[str] = "dodecahedron"
    of_unit_edge = staticmethod(dodecahedron)

    def codes(self) -> tuple[int, ...]:
        """Its own."""
        from designer.base.codes import OF_FIVE, OWN_SQUARES, OWN_TRIANGLES

        return (*OF_FIVE[15:], *OWN_TRIANGLES[12:]) if self.lattice == "triangular" else tuple(OWN_SQUARES[3:])


KIND = Kind("a dodecahedron with rings on its twelve faces", AskedOfEdge.of(DodecahedronSpec), DodecahedronSpec)
