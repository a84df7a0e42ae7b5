"""What a target file holds, or one of a board or of points that others made: `calib target`."""

from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.target_contents import TargetContents, asked_place, contents_of, made_target
from calib.app.target_from_photo import photo_target
from calib.app.target_of_marks import board_target, joined_target
from designer.base.errors import InputError
from designer.base.options import argument, option
from designer.page.capability import capability, instead, written_to

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from designer.page.output import Output
    from designer.target import TargetGeometry

KALIBR = (".yaml", ".yml")


@instead(marks=board_target, join=joined_target, from_photo=photo_target)
@capability
def target(
    file: Annotated["TargetGeometry | Place | None", argument("a target file (NAME.target.json)")] = None,
    *,
    points: Annotated[
        "Place | None",
        option("make one of what others made: points X,Y,Z[,plane,id] (CSV), or Kalibr's target (YAML)", flag="--from"),
    ] = None,
    planes: Annotated["Place | None", option("the points' planes, plane,nx,ny,nz,d (CSV); without: fitted")] = None,
    diameter_mm: Annotated[
        float | None,
        option(
            "of the dots at the points, of which tables hold the images' centres (default: no marks), or of circles",
            0,
            1000,
        ),
    ] = None,
    inside: Annotated[bool, option("fitted planes are seen from inside, as the walls of a room")] = False,
    out: Annotated["Output | Place | None", written_to("the target file to make: NAME.target.json")] = None,
) -> TargetContents:
    """Read a target file and say what it holds, or make one of a board or of points: `target("board.target.json")`.

    What others made gets its file by --from, --marks, --join or --from-photo.

    Raises:
        InputError: a file or a table that breaks a rule, or a place that holds something else.
    """  # fmt: skip
    from calib.app.inputs import target_of
    from designer.page.output import asked_output

    if points is None:
        if file is None:
            raise InputError("no target: give a target file, a table of points with --from, or a board with --marks")
        lost = {"-o": asked_output(out), "--planes": planes, "--diameter": diameter_mm, "--inside": inside or None}
        if given := [name for name, value in lost.items() if value is not None]:
            raise InputError(f"{given[0]}: belongs to --from POINTS.csv, which is missing")
        geometry = target_of(file)
        return contents_of(geometry, fspath(file) if isinstance(file, str | PathLike) else "the target")
    if file is not None:
        raise InputError("--from: makes a file: give -o NAME.target.json, and no other target")
    output = asked_place(out, "--from")
    if Path(points).suffix.lower() in KALIBR:
        if planes is not None or inside:
            flag = "--inside" if inside else "--planes"
            raise InputError(f"{flag}: of points; {points} is Kalibr's target; leave it out")
        from calib.observe.point_target import read_kalibr_target
        from designer.target import target_of_marks

        marks, remarks = read_kalibr_target(Path(points), diameter_mm)
        geometry = target_of_marks([marks], marks.target_from_face("center")[None])
        return made_target(output, geometry, remarks=remarks)
    return _of_points(points, planes, diameter_mm or 0.0, output, is_inside=inside)


def _of_points(
    points: "Place", planes: "Place | None", diameter_mm: float, output: "Output", *, is_inside: bool
) -> TargetContents:
    """Make a target file of a table of points."""
    from calib.observe.point_target import read_planes, read_points, target_from_points
    from designer.page.terminal import quoted

    if is_inside and planes is not None:
        raise InputError(
            f"--inside: of fitted planes, but {planes} gives them with their normals; leave one of both out"
        )
    given = None if planes is None else read_planes(Path(planes))
    table = read_points(Path(points))
    geometry = target_from_points(table, given, diameter_mm=diameter_mm, inside=is_inside)
    said = f"{points}: columns that a target of points has no use for: {', '.join(table.unused)}"
    line = f"calib measure {quoted(output.place)} observations.csv -o measured/{quoted(Path(output.place.name))}"
    step = (line, "observations.csv: image,u,v,id or image,u,v,X,Y,Z")
    return made_target(output, geometry, step, (said,) if table.unused else ())
