"""Points in space from what the cameras of a rig saw of them: what `calib triangulate` does."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.api.check_object import as_points, seen_of_object
from calib.api.page_shown import ShownAsPage
from calib.app.inputs import Place, folder_of, rig_of
from calib.cameras.rig import Rig
from calib.core.types import RigObservations
from calib.observe.rig_sightings import read_point_table
from calib.records.triangulation_file import (
    POINTS_FILE,
    RESIDUALS_FILE,
    TRIANGULATION,
    TRIANGULATION_FILE,
    TriangulationRecord,
    points_csv,
    record_of,
    residuals_csv,
)
from calib.renderer.quantities import real
from calib.space.known_lengths import LengthCheck
from calib.space.sightings import PointSightings
from calib.space.triangulate import Triangulation, noise_of, triangulate_points
from designer.base.errors import InputError
from designer.base.files import check_folder, write_files
from designer.base.number_text import figure
from designer.base.own_files import require_ours
from designer.base.small_file import place_of
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

NOISE_PX = (1e-6, 1e3)
POINTS = "ringsolid.points"
TABLE_SUFFIX = ".csv"
NOTICEABLE = 1.05
"""Times as much scatter as stated, that is taken into account."""
OWN_TARGET = (
    "the rig was solved from this very target: an error of its size is in both, so known distances and scale agree "
    "whatever it is; show a second target"
)


@dataclass(frozen=True, eq=False)
class TriangulationResult(ShownAsPage):
    """Points in the rig's frame: `found.points.position_mm`, `found.points.covariance_mm2`, `found.save("points")`.

    In a notebook the result shows its page.
    """

    points: Triangulation
    record: TriangulationRecord  # all that is told of them
    kind = "triangulation"

    @property
    def lengths(self) -> LengthCheck | None:
        """Of a check object: its distances against the known ones."""
        return self.record.lengths

    def save(self, place: Place) -> tuple[Path, ...]:
        """Write a folder with tables and `triangulation.json`, or `found.save("points.csv")` alone; return the files.

        Raises:
            InputError: the place takes no such files, or holds somebody else's.
        """
        path = folder_of(place)
        if path.suffix.lower() == TABLE_SUFFIX:
            files = {path: points_csv(self.points)}
        else:
            files = {
                path / POINTS_FILE: points_csv(self.points),
                path / RESIDUALS_FILE: residuals_csv(self.points),
                path / TRIANGULATION_FILE: TRIANGULATION.text(self.record),
            }
        write_files(files)
        return tuple(files)


def check_points_place(place: Path) -> None:
    """Refuse a table or folder that takes no points, before any work is done.

    Raises:
        InputError: the message names it.
    """
    if place.suffix.lower() == TABLE_SUFFIX:
        require_ours(place, kind=POINTS)
        check_folder(place.parent)
        return
    check_folder(place)
    require_ours(place / POINTS_FILE, kind=POINTS)
    require_ours(place / RESIDUALS_FILE, kind="ringsolid.residuals")
    require_ours(place / TRIANGULATION_FILE, kind=TRIANGULATION.format)


def triangulate(
    rig: Rig | Place,
    sightings: PointSightings | RigObservations | Place | None = None,
    *,
    target: TargetGeometry | Place | None = None,
    photos: Place | Iterable[Place] = (),
    noise_px: float | Sequence[float] | None = None,
    rejects: bool = True,
    jobs: int | None = None,
    progress: Progress = unheard,
) -> TriangulationResult:
    """Find where points are that several cameras see, and how surely: `triangulate("rig.json", "sightings.csv")`.

    >>> found = calib.triangulate("rig.json", "sightings.csv")
    >>> found.points.position_mm, found.points.covariance_mm2
    >>> calib.triangulate("rig.json", target="board.target.json", photos=["left", "right"]).lengths.rms_mm

    Args:
        rig: the cameras, or the file of them.
        sightings: a table with camera,frame,point,u,v and perhaps sigma_px. Of a target, as of points with X,Y,Z, the
            known distances are compared with the measured ones.
        target: a check object, which photos of the rig's cameras show; not the one that the rig was solved from.
        photos: of it: a folder a camera, named as that is in the rig, or one that holds such folders.
        noise_px: of a coordinate of a sighting that does not state its own, for all cameras or each; None: the rig's.
        rejects: leave out sightings that contradict the others; else all have their say.
        jobs: photos at a time; None: one per core.
        progress: is told what is being done.

    Raises:
        InputError: a file that cannot be read, a camera that is not in the rig, or noise that is nowhere stated.
    """
    from calib.space.known_lengths import check_lengths

    known = rig_of(rig)
    noise = noise_of_person(known, noise_px)
    settings = {} if isinstance(rig, Rig) else {"rig file": fspath(rig)}
    seen_target = seen_of_object(known, sightings, target, photos, jobs, progress)
    if seen_target is not None:
        settings |= _named(sightings, target)
        seen = as_points(known, seen_target)
        if known.geometry_id and seen_target.points.geometry_id == known.geometry_id:
            seen = replace(seen, remarks=(*seen.remarks, OWN_TARGET))
        found = _of_target(known, seen, noise, rejects=rejects)
        lengths = check_lengths(found, seen_target.points.position_mm, "the check object")
    else:
        if isinstance(sightings, PointSightings):
            seen = sightings
        elif isinstance(sightings, str | PathLike):
            seen = read_point_table(place_of(sightings, "a table of sightings"), known)
            settings["sightings"] = fspath(sightings)
        else:
            raise InputError(f"{type(sightings).__name__}: give sightings, their table, or those of a target")
        found, lengths = triangulate_points(known, seen, noise, rejects=rejects), None
    return TriangulationResult(found, record_of(found, settings, lengths))


def noise_of_person(rig: Rig, noise_px: float | Sequence[float] | None) -> NDArray[np.float64] | None:
    """The noise that a person gives, for each camera (C,); None: none is given.

    Raises:
        InputError: no number, or not one for each camera.
    """
    if noise_px is None:
        return None
    each = [noise_px] if isinstance(noise_px, int | float) else list(noise_px)
    if len(each) not in (1, len(rig.names)):
        raise InputError(f"--noise: {len(each)} numbers for {len(rig.names)} cameras; give one, or one a camera")
    return noise_of(rig, np.array([real("--noise", one, *NOISE_PX, " px") for one in each]))


def _of_target(rig: Rig, seen: PointSightings, noise_px: NDArray[np.float64] | None, *, rejects: bool) -> Triangulation:
    """The points of a target: with the noise that was given, or as their centres state it, or as much more as shows."""
    if noise_px is not None:
        return triangulate_points(rig, replace(seen, cov_px2=None), noise_px, rejects=rejects)
    found = triangulate_points(rig, seen, rejects=rejects)
    if seen.cov_px2 is None or not found.scale > NOTICEABLE:
        return found
    remark = f"centres scatter {figure(found.scale, 3)} times as much as they state; the sigmas are of what they do"
    more = replace(seen, cov_px2=seen.cov_px2 * found.scale**2, remarks=(*seen.remarks, remark))
    return triangulate_points(rig, more, rejects=rejects)


def _named(sightings: object, target: object) -> dict[str, str]:
    """The files that what was seen comes from."""
    named = {"sightings": sightings, "check object": target}
    return {what: fspath(one) for what, one in named.items() if isinstance(one, str | PathLike)}
