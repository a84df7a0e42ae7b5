"""A target file of points that others made: what `calib target --from` does."""

from pathlib import Path

from calib.app.inputs import Place
from calib.observe.point_target import read_planes, read_points, target_from_points
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.own_files import require_ours
from designer.target import FORMAT, TargetGeometry, load_target, target_to_json

SUFFIX = ".target.json"
LARGEST_MM = 1000.0


def target_of_points(
    points: Place, out: Place, *, planes: Place | None = None, diameter_mm: float = 0.0, inside: bool = False
) -> TargetGeometry:
    """Make a target file of a table of points: `target_of_points("room.csv", "room.target.json")`.

    Args:
        points: a CSV with X, Y, Z and possibly plane and id.
        out: the file to write.
        planes: a CSV with plane, nx, ny, nz, d; None: fitted.
        diameter_mm: of the dots at the points; 0: no marks.
        inside: fitted planes are seen from inside, as the walls of a room.

    Raises:
        InputError: a table that breaks a rule, or a place that holds something else.
    """
    place = Path(out)
    if not place.name.endswith(SUFFIX) or place.name == SUFFIX:
        name = f"{place.stem.split('.')[0] or 'my'}{SUFFIX}"
        raise InputError(f"-o {place}: target files end in {SUFFIX}; call it {name}")
    if inside and planes is not None:
        raise InputError(
            f"--inside: of fitted planes, but {planes} gives them with their normals; leave one of both out"
        )
    if not 0 <= diameter_mm <= LARGEST_MM:
        raise InputError(f"--diameter {diameter_mm:g}mm: must be from 0mm to {LARGEST_MM:g}mm")
    require_ours(place, kind=FORMAT)
    if place.exists() and place.stat().st_size:
        there = load_target(place)
        if there.spec or there.source != "nominal":
            raise InputError(f"-o {place}: exists and holds a target that was not made of points; choose another name")
    given = None if planes is None else read_planes(Path(planes))
    geometry = target_from_points(read_points(Path(points)), given, diameter_mm=diameter_mm, inside=inside)
    write_files({place: target_to_json(geometry).encode()})
    return geometry
