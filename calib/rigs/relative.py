"""How cameras of a rig stand to each other, and how surely: what does not depend on whose frame the rig's is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import Rig
from calib.core.se3 import compose, invert, log_rotation, skew

Array = NDArray[np.float64]

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
