"""Whether a target fits the photos of a setting and its rings are large enough, and the distance that would do."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.poses import PoseGrid, grid_poses
from calib.studies.tolerance.setting import CAP_RAD
from designer.target import TargetGeometry, bounding_radius_mm

Array = NDArray[np.float64]

CHECKED_VIEWS = 60
FARTHEST = 64.0
CLOSE = 1.01


@dataclass(frozen=True)
class ViewFit:
    """How a target sits in the photos from one distance."""

    distance_mm: float
    fitting: float  # share of the views that show all of it
    fits_from_mm: float  # distance from which all do; inf: none as far as was tried
    radius_px: float  # of the largest ring, facing the camera
    large_to_mm: float  # distance up to which the rings are large enough

    @property
    def remark(self) -> str:
        """What is wrong and the distance that would do; "" if nothing is."""
        too_near, too_small = self.fitting < 1, self.radius_px < LEAST_RADIUS_PX
        if not (too_near or too_small):
            return ""
        parts = [f"the target reaches beyond the image in {1 - self.fitting:.0%} of the views"] * too_near
        parts += [
            f"rings that face the camera have a radius of {self.radius_px:.1f}px, less than {LEAST_RADIUS_PX:g}px"
        ] * too_small
        return f"at {self.distance_mm:g}mm {' and '.join(parts)}; {self._remedy(too_near=too_near)}"

    def _remedy(self, *, too_near: bool) -> str:
        if too_near and self.fits_from_mm <= self.large_to_mm:
            return f"it fits from --distance {math.ceil(self.fits_from_mm)}mm on"
        if not too_near and self.fits_from_mm <= self.large_to_mm:
            return f"they are large enough up to --distance {math.floor(self.large_to_mm)}mm"
        if not math.isfinite(self.fits_from_mm):
            return "with this camera no distance shows all of it; use another camera"
        return (
            f"all of it shows from {math.ceil(self.fits_from_mm)}mm on, its rings are large enough up to "
            f"{math.floor(self.large_to_mm)}mm: this camera sees one or the other"
        )


def view_fit(target: TargetGeometry, camera: Camera, distance_mm: float) -> ViewFit:
    """How a target sits in photos from all sides, or of a board from a cap, that look at its origin.

    Args:
        target: nominal.
        camera: that takes them.
        distance_mm: of the cameras from the target's origin, outside of it.
    """
    half_angle = CAP_RAD if target.is_planar else math.pi
    grid = PoseGrid(CHECKED_VIEWS, half_angle, (distance_mm, distance_mm), random_roll=True, aim_offset_mm=0.0)
    poses = grid_poses(grid, np.random.default_rng(0))
    nearest = float(np.linalg.norm(target.center_mm, axis=1).min())
    focal_px = float(camera.params[0])
    largest = float(target.radius_outer_mm.max())
    return ViewFit(
        distance_mm,
        _fitting(target, camera, poses, 1.0),
        distance_mm * _least_factor(target, camera, poses),
        focal_px * largest / (distance_mm - nearest),
        nearest + focal_px * largest / LEAST_RADIUS_PX,
    )


def _fitting(target: TargetGeometry, camera: Camera, poses: Array, factor: float) -> float:
    """Share of the views that show all corners of the target, so many times as far away."""
    frame = target.target_from_face
    corner = np.einsum("fij,fkj->fki", frame[:, :3, :2], target.outline_mm) + frame[:, None, :3, 3]
    corner = corner.reshape(-1, 3)
    in_camera = np.einsum("vij,kj->vki", poses[:, :3, :3], corner) + factor * poses[:, None, :3, 3]
    with np.errstate(invalid="ignore"):
        pixel = project(camera, in_camera)
        inside = (pixel >= -0.5) & (pixel <= np.array(camera.image_size) - 0.5)
    return float(inside.all(axis=(1, 2)).mean())


def _least_factor(target: TargetGeometry, camera: Camera, poses: Array) -> float:
    """The least multiple of the distance at which all views show all of the target; inf if that is too far."""
    inside = bounding_radius_mm(target) / float(np.linalg.norm(poses[:, :3, 3], axis=1).min())
    low, high = inside, max(2 * inside, 1.0)
    while _fitting(target, camera, poses, high) < 1:
        low, high = high, 2 * high
        if high > FARTHEST:
            return math.inf
    while high / low > CLOSE:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _fitting(target, camera, poses, middle) == 1 else (middle, high)
    return high
