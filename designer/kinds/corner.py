"""An open corner of three square faces that look inward at right angles, for cameras that see all three at once."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.of_edge import AskedOfEdge, OfEdgeSpec
from designer.spec.build import Form
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Faceted

WALL = 0.05
"""Thickness of the walls, as a share of the edge."""


@cache
def corner() -> "Faceted":
    """Three walls about the middle of the cube whose three lower faces they show; z is the diagonal out of it, y up.

    It stands on the outside of a wall: print needs no supports.
    """
    import numpy as np

    from designer.base.solid import Faceted

    low, high, out = -0.5, 0.5, -0.5 - WALL
    # Of each wall's face, its outside, and the rim that its two neighbours end in, from the corner that bends inward.
    face = ((low, low, low), (low, high, low), (low, high, high), (low, low, high))
    outside = ((out, out, out), (out, out, high), (out, high, high), (out, high, out))
    rim = ((high, low, low), (high, low, high), (high, out, high), (high, out, out), (high, high, out),
           (high, high, low))  # fmt: skip
    every = [tuple(tuple(np.roll(at, axis)) for at in shape) for shape in (face, outside, rim) for axis in range(3)]
    vertices = sorted({at for shape in every for at in shape})
    rows = [tuple(vertices.index(at) for at in shape) for shape in every]
    x_axis, z_axis = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2), np.ones(3) / np.sqrt(3)
    axes = np.stack([x_axis, np.cross(z_axis, x_axis), z_axis], axis=1)
    return Faceted(np.array(vertices) @ axes, tuple(rows[:3]), tuple(rows[3:]), is_inward=True)


@dataclass(frozen=True)
class CornerSpec(OfEdgeSpec):
    """An open corner."""

    kind: ClassVar[str] = "corner"
    name: ClassVar[str] = "corner"
    form: ClassVar[Form] = "trihedron"
    of_unit_edge = staticmethod(corner)

    @property
    def depth_mm(self) -> float:
        """The walls' thickness."""
        return WALL * self.edge_mm

    def codes(self) -> "tuple[int, ...] | None":
        """Its own, of squares; triangles are shared with bodies of any faces."""
        from designer.base.codes import OWN_SQUARES

        return tuple(OWN_SQUARES[:3]) if self.lattice == "square" else None


KIND = Kind(
    "an open corner with rings on three faces that look inward", AskedOfEdge.of(CornerSpec, "square"), CornerSpec
)
