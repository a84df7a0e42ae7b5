"""How well a rig places a point in the middle of what its cameras saw: by noise, and by the rig itself.

Of one camera on a robot, or before a turntable, it is a point that the camera knows the place of: by its pose there.

One place stands for the volume; `calib budget` maps all of it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import skew, transform
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
    rig = found.rig
    middle = np.median(transform(found.rig_from_target, found.observations.points.middle_mm), axis=0)
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


@dataclass(frozen=True)
class CarriedError:
    """Of a point that one camera knows the place of, in the frame of what carries it."""

    away_mm: float  # from the camera
    sigma_mm: float  # root mean square length of its error, by the camera's pose there; nan: not determined


def carried_error(found: RigCalibration) -> CarriedError | None:
    """Of a point where the target's middle usually was; None without a carrier, or of several cameras."""
    rig = found.rig
    if found.carrier is None or len(rig.names) != 1:
        return None
    pose, frames = rig.cam_from_rig[0], found.observations.frame[0]
    seen = np.median(transform(pose @ found.rig_from_target[frames], found.observations.points.middle_mm), axis=0)
    away_mm = float(np.linalg.norm(seen))
    if rig.covariance is None:
        return CarriedError(away_mm, math.nan)
    # Of the point at q in the camera: its place moves by -s - (t - q) x w, as the centre's by -s - t x w.
    moved = np.concatenate([-skew(pose[:3, 3] - seen), -np.eye(3)], axis=1)
    rows = rig.pose_rows(0)
    return CarriedError(away_mm, float(np.sqrt(np.trace(moved @ rig.covariance[rows, rows] @ moved.T))))
