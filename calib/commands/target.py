"""The command `calib target`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from designer.base.answer import Summary, Value
from designer.base.errors import InputError
from designer.page.terminal import quoted, shown

if TYPE_CHECKING:
    from designer.target import TargetGeometry


def target(
    file: Annotated[Path | None, typer.Argument(help="a target file (NAME.target.json)")] = None,
    *,
    from_: Annotated[
        Path | None, typer.Option("--from", help="make a target file of points X,Y,Z[,plane,id] that others made (CSV)")
    ] = None,
    planes: Annotated[
        Path | None, typer.Option(help="the points' planes, plane,nx,ny,nz,d (CSV); without: fitted")
    ] = None,
    diameter: Annotated[
        str | None,
        typer.Option(help="of the dots at the points, of which tables hold the images' centres (default: no marks)"),
    ] = None,
    inside: Annotated[
        bool, typer.Option("--inside", help="fitted planes are seen from inside, as the walls of a room")
    ] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="the target file to make: NAME.target.json")] = None,
) -> Summary:
    """Read a target file and say what it holds, or make one of a table of points."""
    from calib.api.pointing import target_of_points
    from calib.renderer.quantities import length
    from designer.target import load_target

    if from_ is None:
        if file is None:
            raise InputError("no target: give a target file, or a table of points with --from")
        lost = {"-o": out, "--planes": planes, "--diameter": diameter, "--inside": inside or None}
        if given := [option for option, value in lost.items() if value is not None]:
            raise InputError(f"{given[0]}: belongs to --from POINTS.csv, which is missing")
        return Summary(_say(file, load_target(file)))
    if file is not None or out is None:
        raise InputError("--from: makes a file: give -o NAME.target.json, and no other target")
    diameter_mm = length("--diameter", diameter or "0mm", 0, 1000)
    geometry = target_of_points(from_, out, planes=planes, diameter_mm=diameter_mm, inside=inside)
    answer = _say(out, geometry)
    print(f"wrote  {shown(out)}")
    step = f"calib measure {quoted(out)} observations.csv -o measured/{quoted(Path(out.name))}"
    print(f"next   {step}   # observations.csv: image,u,v,id or image,u,v,X,Y,Z")
    return Summary(answer, (out,), (step,))


def _say(file: Path, geometry: "TargetGeometry") -> dict[str, Value]:
    """What a target holds."""
    from designer.target import bounding_radius_mm

    dots = int(geometry.is_dot.sum())
    kind = "made elsewhere" if geometry.spec is None else geometry.spec.kind
    if not geometry.has_marks:
        marks = f"points without marks on {geometry.face_count} plane{'s' if not geometry.is_planar else ''}"
    elif not geometry.is_planar:
        marks = f"{geometry.face_count} faces {'with' if (geometry.face_code >= 0).all() else 'without'} codes"
    else:
        marks = "one face with an origin mark" if dots else "one face without marks, its orientation ambiguous"
    print(f"{file}: {kind}, {geometry.source} geometry, {marks}")
    print(f"  rings {geometry.ring_count - dots}, {'dots' if geometry.has_marks else 'points'} {dots}")
    print(f"  farthest corner {bounding_radius_mm(geometry):.3f} mm from the origin")
    print(f"  layout id {geometry.layout_id}, geometry id {geometry.geometry_id}")
    return {
        "target_id": geometry.geometry_id, "layout_id": geometry.layout_id,
        "kind": None if geometry.spec is None else geometry.spec.kind, "source": geometry.source,
        "faces": geometry.face_count, "rings": geometry.ring_count - dots, "dots": dots,
        "farthest_corner_mm": bounding_radius_mm(geometry),
    }  # fmt: skip
