"""A dodecahedron with a triangular lattice, or a square one, clipped to each of its twelve pentagons."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.units import format_mm
from designer.kinds.faceted import AskedFaceted, FacetedSpec, Fit, scaled
from designer.spec.kind import Kind
from designer.spec.options import Option
from designer.spec.spec import Spec, SpecValue

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
class DodecahedronSpec(FacetedSpec):
    """A dodecahedron."""

    kind: ClassVar[str] = "dodecahedron"
    extent: ClassVar[tuple[str, ...]] = ("edge",)

    edge_mm: float

    def codes(self) -> tuple[int, ...]:
        """Its own."""
        from designer.base.codes import OF_FIVE, OWN_SQUARES, OWN_TRIANGLES

        return (*OF_FIVE[15:], *OWN_TRIANGLES[12:]) if self.lattice == "triangular" else tuple(OWN_SQUARES[3:])

    def shape(self) -> "Faceted":
        """See `FacetedSpec.shape`."""
        return scaled(dodecahedron(), self.edge_mm)

    @property
    def words(self) -> str:
        """As in `dodecahedron of edge 60 mm`."""
        return f"dodecahedron of edge {self.edge_mm:g} mm"

    @property
    def size_words(self) -> str:
        """The edge."""
        return f"edge {format_mm(self.edge_mm)}"

    def options(self) -> dict[str, SpecValue]:
        """Edge and lattice."""
        return {"edge": format_mm(self.edge_mm), "lattice": self.lattice}


@dataclass(frozen=True, kw_only=True)
class AskedDodecahedron(AskedFaceted):
    """A dodecahedron as asked for."""

    edge: Annotated[float, Option("length above 0", "edge length, such as 60mm")]

    def body(self) -> "Faceted":
        """See `AskedFaceted.body`."""
        return scaled(dodecahedron(), self.edge)

    def spec_of(self, fit: Fit, ratio: float, body: "Faceted") -> DodecahedronSpec:
        """See `AskedFaceted.spec_of`."""
        return DodecahedronSpec(
            fit.ring_diameter_mm, ratio, fit.pitch_mm, fit.border_mm, fit.margin_mm, fit.lattice, self.edge
        )

    def larger(self, factor: float) -> str:
        """See `AskedFaceted.larger`."""
        return f"an edge of at least {math.ceil(10 * self.edge * factor) / 10:g}mm"

    def size_name(self, spec: Spec) -> str:
        """The edge."""
        return format_mm(self.edge)


KIND = Kind("a dodecahedron with rings on its twelve faces", AskedDodecahedron, DodecahedronSpec)
