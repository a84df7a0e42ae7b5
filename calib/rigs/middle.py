"""How well a rig places a point in the middle of what its cameras saw: by noise, and by the rig itself.

One place stands for the volume; `calib budget` maps all of it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import transform
from calib.rigs.result import RigCalibration
from calib.space.budget import expected_errors
from calib.space.volume import seen_by_cameras

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MiddleError:
    """Of one point, in the rig's frame."""

    point_mm: Array  # (3,)
    away_mm: float  # from the nearest camera that sees it
    cameras: tuple[int, ...]  # that see it
    noise_mm: float  # root mean square length of its error, by the noise of one sighting a camera
    rig_mm: float  # likewise by what the rig is off

    @property
    def sigma_mm(self) -> float:
        """Both together."""
        return math.hypot(self.noise_mm, self.rig_mm)


def middle_error(found: RigCalibration) -> MiddleError | None:
    """The expected error of a triangulated point in the middle of all held targets; None if not two cameras see it."""
    rig, points = found.rig, found.observations.points.position_mm
    middle = np.median(transform(found.rig_from_target, 0.5 * (points.min(axis=0) + points.max(axis=0))), axis=0)
    if len(rig.names) < 2 or not (found.noise_px > 0).all():
        return None
    expected = expected_errors(rig, middle[None], found.noise_px)
    by_rig = expected.calibration_mm2
    if by_rig is None or not np.isfinite(expected.covariance_mm2).all():
        return None
    seeing = np.flatnonzero(seen_by_cameras(rig, middle[None])[0])
    away_mm = float(np.linalg.norm(rig.center_mm[seeing] - middle, axis=1).min())
    noise_mm, rig_mm = (math.sqrt(float(np.trace(part[0]))) for part in (expected.noise_mm2, by_rig))
    return MiddleError(middle, away_mm, tuple(seeing.tolist()), noise_mm, rig_mm)
