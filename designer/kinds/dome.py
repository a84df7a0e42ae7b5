"""A half dome for turntables: an icosahedron without its bottom cap, which stands on a flat base and hides no face."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from designer.kinds.of_edge import AskedOfEdge, OfEdgeSpec
from designer.spec.kind import Kind

if TYPE_CHECKING:
    from designer.base.solid import Faceted


@cache
def dome() -> "Faceted":
    """The icosahedron's faces from its top vertex to its lower ring of vertices, about its centre; a bare base.

    Its lowest faces lean out by 11 degrees: print needs no supports.
    """
    from designer.base.solid import Faceted
    from designer.kinds.ico import icosahedron

    whole = icosahedron()
    upper = tuple(tuple(face) for face in whole.faces.tolist() if max(face) < len(whole.vertices) - 1)
    return Faceted(whole.vertices[:-1], upper, ((10, 9, 8, 7, 6),))


@dataclass(frozen=True)
class DomeSpec(OfEdgeSpec):
    """A half dome."""

    kind: ClassVar[str] = "dome"
    name: ClassVar[str] = "dome"
    of_unit_edge = staticmethod(dome)

    def codes(self) -> tuple[int, ...]:
        """Its own, of triangles; squares are shared with bodies of any faces."""
        from designer.base.codes import MANY_SQUARES, OF_FIVE

        return tuple(OF_FIVE[:15] if self.lattice == "triangular" else MANY_SQUARES)


KIND = Kind(
    "a half dome with rings on the fifteen upper faces of an icosahedron, on a flat base",
    AskedOfEdge.of(DomeSpec),
    DomeSpec,
)
