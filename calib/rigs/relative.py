"""How cameras of a rig stand to each other, and how surely: what does not depend on whose frame the rig's is.

How well a rig places a point in the middle of what its cameras saw: by noise, and by the rig itself.

Of one camera on a robot, or before a turntable, it is the target as a photo shows it: by the camera's pose there, and
by its lens. Both are off together, as by a principal point that a turned camera makes up for.

One place stands for the volume; `calib budget` maps all of it.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras.rig import POSE, Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import compose, invert, log_rotation, skew, transform
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_frames, tells_size
from calib.solver.free_shape import PosedSightings, free_directions
from calib.space.budget import expected_errors
from calib.space.volume import seen_by_cameras
from designer.base.arrays import Array

SURELY = 3.0
"""Standard deviations from zero beyond which a length or an angle has a direction, along which its own is told."""


@dataclass(frozen=True, eq=False)
class Relative:
    """Camera B as camera A sees it."""

    b_from_a: Array  # (4, 4)
    covariance: Array  # (6, 6) of it: rotation vector (rad), shift (mm), in B's axes
    center_covariance_mm2: Array  # (3, 3) of B's centre in A's frame, in B's axes

    @property
    def baseline_mm(self) -> float:
        """The distance of the two centres."""
        return float(np.linalg.norm(self.b_from_a[:3, 3]))

    @property
    def baseline_sigma_mm(self) -> float:
        """Its standard deviation; of two centres that may coincide, that along the least known direction."""
        return _sigma_of_length(self.b_from_a[:3, 3], self.covariance[3:, 3:])

    @property
    def angle_rad(self) -> float:
        """By which one is turned against the other, 0 to pi."""
        return float(np.linalg.norm(log_rotation(self.b_from_a[:3, :3])))

    @property
    def angle_sigma_rad(self) -> float:
        """Its standard deviation; of two that may not be turned, that about the least known axis."""
        return _sigma_of_length(log_rotation(self.b_from_a[:3, :3]), self.covariance[:3, :3])

    @property
    def turn_sigma_rad(self) -> float:
        """Of the rotation, about the least known axis."""
        return worst(self.covariance[:3, :3])[0]

    @property
    def place_sigma_mm(self) -> float:
        """Of B's centre in A's frame, along the least known direction."""
        return worst(self.center_covariance_mm2)[0]


def relative(rig: Rig, a: int, b: int) -> Relative:
    """Camera b against camera a, by the rig's joint covariance; nan where that is not known."""
    b_from_a = compose(rig.cam_from_rig[b], invert(rig.cam_from_rig[a]))
    covariance = np.full((6, 6), np.nan)
    if rig.covariance is not None:
        rows = np.r_[rig.pose_rows(a), rig.pose_rows(b)]
        # w = w_b - R w_a and s = s_b - R s_a + (R t_a) x w, with R of b_from_a
        turn, carried = b_from_a[:3, :3], b_from_a[:3, :3] @ rig.cam_from_rig[a, :3, 3]
        jacobian = np.zeros((6, 12))
        jacobian[:3, :3], jacobian[:3, 6:9] = -turn, np.eye(3)
        jacobian[3:, 3:6], jacobian[3:, 9:] = -turn, np.eye(3)
        jacobian[3:] += skew(carried) @ jacobian[:3]
        covariance = jacobian @ rig.covariance[np.ix_(rows, rows)] @ jacobian.T
    return Relative(b_from_a, covariance, center_covariance(b_from_a, covariance))


def center_covariance(cam_from_other: Array, covariance: Array) -> Array:
    """Of where a camera is in another frame, in the camera's axes: its centre moves by `-s - t x w`.  # (3, 3)"""
    jacobian = np.concatenate([-skew(cam_from_other[:3, 3]), -np.eye(3)], axis=1)
    moved: Array = jacobian @ covariance @ jacobian.T
    return moved


def center_sigma_mm(rig: Rig) -> Array:
    """Of where the cameras are, along the axes of the rig's frame; 0 of the camera whose frame it is.  # (C, 3)"""
    sigma = np.full((len(rig.names), 3), np.nan)
    if rig.covariance is not None:
        for row, pose in enumerate(rig.cam_from_rig):
            rows = rig.pose_rows(row)
            in_camera = center_covariance(pose, rig.covariance[rows, rows])
            sigma[row] = np.sqrt(np.diagonal(pose[:3, :3].T @ in_camera @ pose[:3, :3]).clip(min=0.0))
    return sigma


def worst(covariance: Array) -> tuple[float, Array]:
    """The largest standard deviation of a covariance (N, N), and along which unit vector (N,); nan if not known."""
    if not np.isfinite(covariance).all():
        return float("nan"), np.full(len(covariance), np.nan)
    value, axis = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return float(np.sqrt(max(value[-1], 0.0))), axis[:, -1]


def _sigma_of_length(vector: Array, covariance: Array) -> float:
    """Of a vector's length; beyond doubt it has a direction, else any may be meant."""
    length: float = float(np.linalg.norm(vector))
    most = worst(covariance)[0]
    if not length > SURELY * most:
        return most
    unit = vector / length
    return float(np.sqrt(np.maximum(unit @ covariance @ unit, 0.0)))


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
