"""What a target file holds, or one of points that others made: `calib target`."""

from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Key
from designer.base.options import argument, option
from designer.base.words import printable
from designer.page.capability import capability, written_to
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.page.blocks import Page
    from designer.page.output import Output
    from designer.target import TargetGeometry

SUFFIX = ".target.json"


@dataclass(frozen=True, eq=False)
class TargetContents(Result, kind="target", title="Target", doing="reading the target", is_written=False):
    """What a target holds: `target("board.target.json").rings`."""

    geometry: Annotated["TargetGeometry", NOT_IN_FILE]
    file: Annotated[str, NOT_IN_FILE]
    is_made: Annotated[bool, NOT_IN_FILE]  # of a table of points
    target_id: str
    layout_id: str
    kind_of_target: Annotated[str | None, Key("kind")]  # None: made elsewhere
    source: str
    faces: int
    rings: int
    dots: int
    farthest_corner_mm: float
    remarks: tuple[str, ...] = ()  # on the table of points

    def page(self) -> "Page":
        """Marks, sizes and ids."""
        from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Section
        from designer.page.terminal import quoted

        geometry = self.geometry
        if not geometry.has_marks:
            marks = f"points without marks on {self.faces} plane{'s' if not geometry.is_planar else ''}"
        elif not geometry.is_planar:
            marks = f"{self.faces} faces {'with' if (geometry.face_code >= 0).all() else 'without'} codes"
        else:
            marks = "one face with an origin mark" if self.dots else "one face without marks, its orientation ambiguous"
        facts = Facts((
            ("marks", f"rings {self.rings}, {'dots' if geometry.has_marks else 'points'} {self.dots}"),
            ("size", f"farthest corner {self.farthest_corner_mm:.3f} mm from the origin"),
            ("ids", f"layout id {self.layout_id}, geometry id {self.target_id}"),
        ))  # fmt: skip
        told = f"{self.kind_of_target or 'made elsewhere'}, {self.source} geometry, {marks}"
        path = Path(self.file)
        line = f"calib measure {quoted(path)} observations.csv -o measured/{quoted(Path(path.name))}"
        steps = (Command(line, "observations.csv: image,u,v,id or image,u,v,X,Y,Z"),) if self.is_made else ()
        said = Findings(tuple(Finding("note", "", printable(line)) for line in self.remarks))
        parts = (Section("", (said,)),) if self.remarks else ()
        return Page("", "", Headline("note", printable(self.file), told), parts, lead=(facts,), next_steps=steps)


@capability
def target(
    file: Annotated["TargetGeometry | Place | None", argument("a target file (NAME.target.json)")] = None,
    *,
    points: Annotated[
        "Place | None", option("make a target file of points X,Y,Z[,plane,id] that others made (CSV)", flag="--from")
    ] = None,
    planes: Annotated["Place | None", option("the points' planes, plane,nx,ny,nz,d (CSV); without: fitted")] = None,
    diameter_mm: Annotated[
        float | None,
        option("of the dots at the points, of which tables hold the images' centres (default: no marks)", 0, 1000),
    ] = None,
    inside: Annotated[bool, option("fitted planes are seen from inside, as the walls of a room")] = False,
    out: Annotated["Output | Place | None", written_to("the target file to make: NAME.target.json")] = None,
) -> TargetContents:
    """Read a target file and say what it holds, or make one of a table of points: `target("board.target.json")`.

    Raises:
        InputError: a file or a table that breaks a rule, or a place that holds something else.
    """
    from calib.app.inputs import target_of
    from designer.page.output import asked_output
    from designer.target import bounding_radius_mm

    output = asked_output(out)
    if points is None:
        if file is None:
            raise InputError("no target: give a target file, or a table of points with --from")
        lost = {"-o": output, "--planes": planes, "--diameter": diameter_mm, "--inside": inside or None}
        if given := [name for name, value in lost.items() if value is not None]:
            raise InputError(f"{given[0]}: belongs to --from POINTS.csv, which is missing")
        geometry, unused = target_of(file), tuple[str, ...]()
        name = fspath(file) if isinstance(file, str | PathLike) else "the target"
    else:
        if file is not None or output is None:
            raise InputError("--from: makes a file: give -o NAME.target.json, and no other target")
        geometry, unused = _of_points(points, planes, diameter_mm or 0.0, output, is_inside=inside)
        name = str(output.place)
    said = f"{points}: columns that a target of points has no use for: {', '.join(unused)}"
    dots = int(geometry.is_dot.sum())
    return TargetContents(
        geometry=geometry, file=name, is_made=points is not None, target_id=geometry.geometry_id,
        layout_id=geometry.layout_id, kind_of_target=None if geometry.spec is None else geometry.spec.kind,
        source=geometry.source, faces=geometry.face_count, rings=geometry.ring_count - dots, dots=dots,
        farthest_corner_mm=bounding_radius_mm(geometry), remarks=(said,) if unused else (),
    )  # fmt: skip


def _of_points(
    points: "Place", planes: "Place | None", diameter_mm: float, output: "Output", *, is_inside: bool
) -> "tuple[TargetGeometry, tuple[str, ...]]":
    """Make a target file of a table of points; it, and which columns were of no use."""
    from calib.observe.point_target import read_planes, read_points, target_from_points
    from designer.base.own_files import require_ours
    from designer.target import FORMAT, load_target, target_to_json

    place = output.place
    if not place.name.endswith(SUFFIX) or place.name == SUFFIX:
        name = f"{place.stem.split('.')[0] or 'my'}{SUFFIX}"
        raise InputError(f"-o {place}: target files end in {SUFFIX}; call it {name}")
    if is_inside and planes is not None:
        raise InputError(
            f"--inside: of fitted planes, but {planes} gives them with their normals; leave one of both out"
        )
    require_ours(place, kind=FORMAT)
    if place.exists() and place.stat().st_size:
        there = load_target(place)
        if there.spec or there.source != "nominal":
            raise InputError(f"-o {place}: exists and holds a target that was not made of points; choose another name")
    given = None if planes is None else read_planes(Path(planes))
    table = read_points(Path(points))
    geometry = target_from_points(table, given, diameter_mm=diameter_mm, inside=is_inside)
    output.write({place: target_to_json(geometry).encode()})
    return geometry, table.unused
