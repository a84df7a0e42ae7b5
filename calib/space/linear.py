"""What the pixels of a rig depend on: the points in space, and each camera's parameters and pose.

How large an error in space is: one number of a covariance, and three of many.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from calib.cameras import linearise
from calib.cameras.rig import Rig
from calib.core.se3 import skew, transform
from designer.base.arrays import Array, Flags
from designer.base.marks import Gap

ROUNDING = 1e-14
"""Part of a covariance's largest eigenvalue, its diagonal scaled to one, that is rounding."""


@dataclass(frozen=True, eq=False)
class LinearSight:
    """N points of the rig's frame as one camera sees them, with the derivatives; nan where it does not see."""

    pixel: Array  # (N, 2)
    by_point: Array  # (N, 2, 3) by the point in the rig's frame
    by_params: Array  # (N, 2, P)
    turned: Array  # (N, 3) the point in the camera's axes, before the shift
    by_cam_point: Array  # (N, 2, 3) by the point in the camera's frame

    @cached_property
    def by_unknowns(self) -> Array:
        """By the camera's P parameters and the six of its pose, as `Rig` has them.  # (N, 2, P + 6)"""
        by_turn = -self.by_cam_point @ skew(self.turned)
        return np.concatenate([self.by_params, by_turn, self.by_cam_point], axis=2)


def linear_sight(rig: Rig, camera: int, point_mm: Array) -> LinearSight:
    """Linearise a camera of a rig at points (N, 3) of the rig's frame."""
    rotation, shift = rig.cam_from_rig[camera, :3, :3], rig.cam_from_rig[camera, :3, 3]
    turned = point_mm @ rotation.T
    seen = linearise(rig.cameras[camera], (turned + shift).T)
    by_cam_point = np.ascontiguousarray(seen.by_point.transpose(2, 0, 1))
    return LinearSight(seen.pixel.T, by_cam_point @ rotation, seen.by_params.transpose(2, 0, 1), turned, by_cam_point)


def covariance_factor(covariance: Array) -> Array:
    """Independent errors of size one that make a covariance (K, K): `S = F F'`.  # (K, R)"""
    sigma = np.sqrt(np.diagonal(covariance).clip(min=0.0))
    unit = np.where(sigma > 0, sigma, 1.0)
    value, vector = np.linalg.eigh(covariance / unit[:, None] / unit)
    keeps = value > ROUNDING * value[-1:].clip(min=0.0)
    factor: Array = sigma[:, None] * vector[:, keeps] * np.sqrt(value[keeps])
    return factor


@lru_cache(maxsize=4)
def calibration_factor(rig: Rig) -> Array | None:
    """The rig's own errors likewise (K, R); None where its covariance is not known, or not determined.

    Kept for the next call: of cameras with hundreds of parameters it takes seconds.
    """
    if rig.covariance is None or not np.isfinite(rig.covariance).all():
        return None
    factor = covariance_factor(rig.covariance)
    factor.setflags(write=False)
    return factor


def is_in_image(rig: Rig, camera: int, point_mm: Array) -> Flags:
    """Which points (N, 3) of the rig's frame a camera shows within its image.  # (N,)"""
    pixel = rig.cameras[camera].project(transform(rig.cam_from_rig[camera], point_mm))
    width, height = rig.cameras[camera].image_size
    off = np.abs(pixel - np.array([width - 1, height - 1]) / 2)
    return np.asarray((off <= [width / 2, height / 2]).all(axis=-1))


def rays_in_rig(rig: Rig, camera: int, pixel: Array) -> Array:
    """Unit directions (N, 3), in the rig's axes, of what pixels (N, 2) of a camera see."""
    rays: Array = rig.cameras[camera].rays(pixel) @ rig.cam_from_rig[camera, :3, :3]
    return rays


MOST = 95
"""Per cent of the points that are better than what is told of most."""


@dataclass(frozen=True)
class PointErrors:
    """Root mean square lengths of errors in space, of many points; nan where they are not known."""

    median_mm: Gap
    most_mm: Gap  # 95 % of the points are better
    worst_mm: Gap


NOT_KNOWN = PointErrors(float("nan"), float("nan"), float("nan"))


def rms_error_mm(covariance_mm2: Array) -> Array:
    """The root mean square of the length of an error (N,) with a covariance (N, 3, 3)."""
    sigma: Array = np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2))
    return sigma


def errors_of(length_mm: Array) -> PointErrors:
    """Three numbers of many (N,); nan of those that are not known, and of none."""
    known = length_mm[np.isfinite(length_mm)]
    if not len(known):
        return NOT_KNOWN
    return PointErrors(*(float(value) for value in (*np.percentile(known, [50, MOST]), known.max())))


def rms_errors(covariance_mm2: Array | None) -> PointErrors:
    """Three numbers of the errors of many points with covariances (N, 3, 3); nan if these are not known."""
    return NOT_KNOWN if covariance_mm2 is None else errors_of(rms_error_mm(covariance_mm2))
