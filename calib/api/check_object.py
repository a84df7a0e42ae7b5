"""What the cameras of a rig saw of a check object, whose distances are known."""

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import NoReturn

import numpy as np

from calib.api.rig_observing import photos_of_rig, rig_input, search_rig
from calib.app.inputs import Place, require_photos_for_jobs, target_of
from calib.cameras.rig import Rig
from calib.core.types import RigObservations
from calib.space.sightings import PointSightings
from designer.base.errors import InputError
from designer.base.words import shown
from designer.page.progress import Progress
from designer.target import TargetGeometry


def seen_of_object(
    rig: Rig,
    sightings: PointSightings | RigObservations | Place | None,
    target: TargetGeometry | Place | None,
    photos: Place | Iterable[Place],
    jobs: int | None,
    progress: Progress,
) -> RigObservations | None:
    """What was seen of a check object; None of points that nobody knows.

    Raises:
        InputError: too much or too little is given, or photos or a table that cannot be used.
    """
    from calib.observe.rig_sightings import has_known_points, read_rig_sightings

    given = rig_input(photos, None, None, None, None)
    if (sightings is None) != bool(given.photos):
        raise InputError("give a table of sightings; or --photos of a check object with its --target")
    if sightings is None:
        if target is None:
            raise InputError("--photos: name the target file of what they show with --target")
        taken = photos_of_rig(given)
        lenses = {name: rig.cameras[rig.row(name)] for name in taken.camera_names}
        return search_rig(target_of(target, "rings"), taken, lenses, _all_are_given, jobs, progress)[1]
    require_photos_for_jobs(jobs)
    if isinstance(sightings, RigObservations):
        return sightings
    if isinstance(sightings, str | PathLike) and has_known_points(Path(sightings)):
        return read_rig_sightings(Path(sightings), None if target is None else target_of(target))
    if target is not None:
        raise InputError("--target: is of photos, or of a table of its points by X,Y,Z or id; leave it out")
    return None


def _all_are_given(name: str) -> NoReturn:
    raise AssertionError(f"the lens of camera {name} is the rig's")


def as_points(rig: Rig, observations: RigObservations) -> PointSightings:
    """What cameras saw of a target as sightings of unknown points, all of the target's points by their rows.

    Raises:
        InputError: a camera that is not in the rig, or photos of another size than its own.
    """
    camera, frame, point, center, cov = [], [], [], [], []
    for name, seen, frames in zip(observations.camera_names, observations.sightings, observations.frame, strict=True):
        row = rig.row(name)
        if seen.image_size != rig.cameras[row].image_size:
            raise InputError(
                f"camera {shown(name)}: photos of {seen.image_size[0]} x {seen.image_size[1]} px, but the rig's camera "
                f"has {rig.cameras[row].image_size[0]} x {rig.cameras[row].image_size[1]} px"
            )
        camera.append(np.full(len(seen.view), row))
        frame.append(frames[seen.view])
        point.append(seen.point)
        center.append(seen.center_px)
        cov.append(np.full((len(seen.view), 2, 2), np.nan) if seen.cov_px2 is None else seen.cov_px2)
    count = len(observations.points.position_mm)
    kept, place = np.unique(np.concatenate(frame) * count + np.concatenate(point), return_inverse=True)
    return PointSightings(
        observations.frame_names, tuple(map(str, range(count))), kept // count, kept % count, np.concatenate(camera),
        place, np.concatenate(center), np.concatenate(cov), observations.remarks,
    )  # fmt: skip
