"""Bodies of flat faces that one edge length tells: what they are called, and how large they must be."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.units import format_mm
from designer.kinds.faceted import AskedFaceted, FacetedSpec, Fit, scaled
from designer.spec.options import Option
from designer.spec.spec import Lattice, Spec, SpecValue

if TYPE_CHECKING:
    from designer.base.solid import Faceted


@dataclass(frozen=True)
class OfEdgeSpec(FacetedSpec):
    """A body of an edge."""

    extent: ClassVar[tuple[str, ...]] = ("edge",)
    name: ClassVar[str]
    """What it is called."""

    edge_mm: float

    @staticmethod
    @abstractmethod
    def of_unit_edge() -> "Faceted":
        """The body of edge length 1."""

    def shape(self) -> "Faceted":
        """See `FacetedSpec.shape`."""
        return scaled(self.of_unit_edge(), self.edge_mm)

    @property
    def words(self) -> str:
        """As in `dodecahedron of edge 60 mm`."""
        return f"{self.name} of edge {self.edge_mm:g} mm"

    @property
    def size_words(self) -> str:
        """The edge."""
        return f"edge {format_mm(self.edge_mm)}"

    def options(self) -> Mapping[str, SpecValue]:
        """Edge and lattice."""
        return {"edge": format_mm(self.edge_mm), "lattice": self.lattice}


@dataclass(frozen=True, kw_only=True)
class AskedOfEdge(AskedFaceted):
    """A body of an edge as asked for."""

    spec_type: ClassVar[type[OfEdgeSpec]]

    @classmethod
    def of(cls, spec: type[OfEdgeSpec], lattice: Lattice = "triangular") -> "type[AskedOfEdge]":
        """What is asked for of a kind, of which this lattice is the usual one."""
        return type(f"Asked{spec.__name__}", (cls,), {"spec_type": spec, "usual_lattice": lattice})

    edge: Annotated[float, Option("length above 0", "edge length, such as 60mm")]

    def body(self) -> "Faceted":
        """See `AskedFaceted.body`."""
        return scaled(self.spec_type.of_unit_edge(), self.edge)

    def spec_of(self, fit: Fit, body: "Faceted") -> OfEdgeSpec:
        """See `AskedFaceted.spec_of`."""
        return self.spec_type(**vars(fit), edge_mm=self.edge)

    def larger(self, factor: float) -> str:
        """See `AskedFaceted.larger`."""
        return f"an edge of at least {math.ceil(10 * self.edge * factor) / 10:g}mm"

    def size_name(self, spec: Spec) -> str:
        """The edge."""
        return format_mm(self.edge)
