"""A solved rig that a print is to be measured from: `calib measure --rig`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.app.inputs import Place
from calib.observe.observations import known_points
from calib.records.rig_folder import read_rig_run
from calib.rigs.result import RigCalibration
from designer.base.errors import InputError
from designer.target import TargetGeometry, bounding_radius_mm

LEAST_FRAMES = 3
"""From fewer, a target that may have any shape does not tell the cameras."""
FAR_OFF = 0.05
"""Part of a target's size that no print of it is off."""


def rig_to_measure_from(rig: RigCalibration | Place, nominal: TargetGeometry, *, is_alone: bool) -> RigCalibration:
    """The rig with the target's rings as designed.

    Args:
        rig: solved, or its folder.
        nominal: as designed.
        is_alone: whether nothing else is given that says what was seen, or how cameras are solved.

    Raises:
        InputError: a folder that cannot be read, a rig of another target, too few frames, or what is given beside it.
    """
    if not is_alone:
        raise InputError(
            "--rig: the rig has its photos, and says how its cameras were solved; leave detections, --photos, "
            "--model, --fix, --share, --one-camera and --image-size out"
        )
    name = "the rig" if isinstance(rig, RigCalibration) else str(rig)
    found = rig if isinstance(rig, RigCalibration) else read_rig_run(Path(rig)).found
    points = found.observations.points.position_mm
    if points.shape != nominal.center_mm.shape or _apart_mm(points, nominal) > FAR_OFF * bounding_radius_mm(nominal):
        raise InputError(f"{name}: saw another target; give the target file that it was solved with, as designed")
    if found.status == "degenerate":
        raise InputError(f"{name}: its frames do not determine the cameras ({found.remarks[0]}); take more first")
    if found.observations.frame_count < LEAST_FRAMES:
        raise InputError(
            f"{name}: {found.observations.frame_count} frames; at least {LEAST_FRAMES} are needed, and 20 or more with "
            "the target turned to all sides measure it well"
        )
    drawn = known_points(nominal)
    seen = tuple(replace(one, points=drawn) for one in found.observations.sightings)
    return replace(found, observations=replace(found.observations, sightings=seen))


def told_of(rig: RigCalibration) -> tuple[str, ...]:
    """What to know of the rig, a line each."""
    cameras, frames = len(rig.cameras), rig.observations.frame_count
    said = f"measured from {frames} frames by {cameras} cameras held together; where they stand was solved, too"
    return (said, *rig.remarks, *rig.observations.remarks)


def _apart_mm(points: NDArray[np.float64], nominal: TargetGeometry) -> float:
    return float(np.linalg.norm(points - nominal.center_mm, axis=1).max())
