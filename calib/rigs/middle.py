"""How well a rig places a point in the middle of what its cameras saw: by noise, and by the rig itself.

Of one camera on a robot, or before a turntable, it is the target as a photo shows it: by the camera's pose there, and
by its lens. Both are off together, as by a principal point that a turned camera makes up for.

One place stands for the volume; `calib budget` maps all of it.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import POSE
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import skew, transform
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_frames, tells_size
from calib.solver.free_shape import PosedSightings, free_directions
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
    """Of what one camera sees, in the frame of what carries it."""

    away_mm: float  # from the camera
    sigma_mm: float  # root mean square length of its error, by the camera's lens and pose there; nan: not determined


def carried_error(found: RigCalibration) -> CarriedError | None:
    """Of the target's middle, over all photos; None without a carrier, or of several cameras.

    A photo's pose of the target follows the lens, by least squares; its own noise is left out.
    """
    if found.carrier is None or len(found.cameras) != 1:
        return None
    frames, middle_mm = found.observations.frame[0], found.carrier.size * found.observations.points.middle_mm
    seen = transform(found.cam_from_rig[0] @ found.rig_from_target[frames], middle_mm)
    away_mm = float(np.linalg.norm(np.median(seen, axis=0)))
    if not np.isfinite(found.stated_covariance).all():
        return CarriedError(away_mm, math.nan)
    basis = free_directions(found.stated_covariance)
    wide = np.concatenate([basis, np.zeros((len(basis), POSE + tells_size(found)))], axis=1)
    lever_mm = found.rig_from_target[:, :3, :3] @ middle_mm
    square = sum(
        float((_placed(photo, lever_mm[frame])[:, : basis.shape[1]] ** 2).sum())
        for frame, photo in zip(frames.tolist(), posed_frames(found, wide, frames), strict=True)
    )
    return CarriedError(away_mm, math.sqrt(square / len(frames)))


def _placed(photo: PosedSightings, lever_mm: Array) -> Array:
    """How a point moves in the rig's frame with each unknown of the camera, the target's pose following.  # (3, Q)"""
    by_pose, by_camera = photo.by_pose.reshape(-1, POSE), photo.by_camera.reshape(2 * len(photo.point), -1)
    follows = -symmetric_inverse(by_pose.T @ by_pose).inverse @ (by_pose.T @ by_camera)
    moved: Array = follows[3:] - skew(lever_mm) @ follows[:3]
    return moved
