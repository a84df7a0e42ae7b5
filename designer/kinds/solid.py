"""A body of one's own: rings on the flat faces of a convex mesh."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar

from designer.base.errors import InputError
from designer.base.units import UNITS_MM
from designer.kinds.faceted import AskedFaceted, FacetedSpec, Fit
from designer.spec.kind import Kind
from designer.spec.options import Option
from designer.spec.spec import Line, Spec, SpecValue

if TYPE_CHECKING:
    from designer.base.solid import Faceted
    from designer.kinds.mesh_file import ReadMesh


@dataclass(frozen=True)
class SolidOfFaces(FacetedSpec):
    """A convex body, its corners and faces as they are."""

    kind: ClassVar[str] = "solid"
    extent: ClassVar[tuple[str, ...]] = ("vertices", "faces", "bare_faces")

    vertices_mm: tuple[tuple[float, float, float], ...]
    faces: tuple[tuple[int, ...], ...]  # with rings
    bare_faces: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        self.shape()  # which raises ValueError where faces do not close a convex body

    def shape(self) -> "Faceted":
        """See `FacetedSpec.shape`."""
        return _body(self.vertices_mm, self.faces, self.bare_faces)

    @property
    def words(self) -> str:
        """As in `solid of 8 faces, 80 x 70 x 40 mm`."""
        bare = f" and {len(self.bare_faces)} bare ones" if self.bare_faces else ""
        return f"solid of {len(self.faces)} faces{bare}, {self.size_words}"

    @property
    def size_words(self) -> str:
        """The box around it."""
        axes = tuple(zip(*self.vertices_mm, strict=True))
        return f"{' x '.join(f'{max(axis) - min(axis):.4g}' for axis in axes)} mm"

    def options(self) -> dict[str, SpecValue]:
        """Corners, faces and lattice."""
        return {
            "vertices": self.vertices_mm, "faces": self.faces, "bare_faces": self.bare_faces, "lattice": self.lattice,
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class AskedSolidOfFaces(AskedFaceted):
    """A body as asked for: in a mesh, or by its corners and faces."""

    is_partly_bare: ClassVar[bool] = True
    read_into: ClassVar[tuple[str, ...]] = ("mesh", "unit")

    mesh: Annotated[str | None, Option("mesh", "a convex mesh, closed or open: STL, OBJ, PLY, OFF or GLB")] = None
    unit: Annotated[str | None, Option("unit", f"of the mesh's numbers: {', '.join(UNITS_MM)}")] = None
    vertices: Annotated[
        tuple[tuple[float, float, float], ...] | None, Option("corners", "corners of the body, in mm, without a mesh")
    ] = None
    faces: Annotated[
        tuple[tuple[int, ...], ...] | None, Option("polygons", "its faces with rings, as numbers of corners")
    ] = None
    bare_faces: Annotated[tuple[tuple[int, ...], ...] | None, Option("polygons", "its other faces")] = None

    @cached_property
    def read(self) -> "ReadMesh | None":
        """What the mesh holds; None: no mesh is given.

        Raises:
            InputError: there is nothing that can carry rings, or the unit is not known.
        """
        of_faces = (self.vertices, self.faces, self.bare_faces)
        if self.mesh is not None and any(of_faces):
            raise InputError(
                f"{self.mesh}: a mesh, and vertices or faces beside it, are given; leave out the one or the other"
            )
        if self.mesh is None:
            if self.unit is not None:
                raise InputError(
                    f"unit {self.unit}: is a mesh's, and no mesh is given; vertices are in mm: leave it out"
                )
            if self.vertices is None or self.faces is None:
                raise InputError("solid: neither a mesh nor vertices and faces are given; give `design solid MESH.stl`")
            return None
        from designer.kinds.mesh_file import faces_of

        return faces_of(self.mesh, None if self.unit is None else UNITS_MM[self.unit])

    def body(self) -> "Faceted":
        """See `AskedFaceted.body`."""
        if self.read is not None:
            return self.read.body
        try:
            return _body(self.vertices or (), self.faces or (), self.bare_faces or ())
        except ValueError as error:
            raise InputError(f"solid: {error}") from None

    def spec_of(self, fit: Fit, body: "Faceted") -> SolidOfFaces:
        """See `AskedFaceted.spec_of`."""
        vertices = tuple((float(x), float(y), float(z)) for x, y, z in body.vertices_mm)
        return SolidOfFaces(**vars(fit), vertices_mm=vertices, faces=body.faces, bare_faces=body.bare)

    def sized(self, line: Line) -> tuple[FacetedSpec, str]:
        """See `Asked.sized`."""
        spec, remark = super().sized(line)
        return spec, "; ".join((*(() if self.read is None else self.read.remarks), remark))

    def larger(self, factor: float) -> str:
        """See `AskedFaceted.larger`."""
        return f"a body at least {factor:.2f} times as large"

    def size_name(self, spec: Spec) -> str:
        """The mesh's name."""
        from pathlib import Path
        from re import sub

        return sub(r"[^A-Za-z0-9._-]+", "-", Path(self.mesh or "of-faces").stem).strip("-._")[:40] or "mesh"


def _body(
    vertices_mm: tuple[tuple[float, float, float], ...], faces: tuple[tuple[int, ...], ...],
    bare: tuple[tuple[int, ...], ...],
) -> "Faceted":  # fmt: skip
    import numpy as np

    from designer.base.solid import Faceted

    return Faceted(np.array(vertices_mm), faces, bare)


KIND = Kind("a solid of one's own, with rings on the flat faces of a mesh", AskedSolidOfFaces, SolidOfFaces)
