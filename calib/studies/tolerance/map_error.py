"""How far a camera is off over the image, its best rotation removed, fast: as `calib.cameras.refit`.

The pixels and rays of the true camera are the same each time, so the rays are computed once. Only the part of the image
counts in which rings were seen, their convex hull: beyond it a lens polynomial is extrapolated, and means nothing.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise, rays
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation
from designer.base.arrays import Array

COLUMNS = 24
STEPS = 5
SMALL_RAD = 1e-10


@dataclass(frozen=True, eq=False)
class ImageGrid:
    """Pixels of the true camera, evenly spread over the part of the image that was seen."""

    pixel: Array  # (2, N)
    ray: Array  # (3, N)


def grid_of(camera: Camera, seen_px: Array) -> ImageGrid:
    """The grid of a true camera within the convex hull of pixels (M, 2)."""
    import cv2

    hull = cv2.convexHull(seen_px.astype(np.float32))
    low, high = seen_px.min(axis=0), seen_px.max(axis=0)
    across, down = (high - low).tolist()
    rows = max(2, round(down / max(across, 1.0) * COLUMNS))
    u, v = np.meshgrid(np.linspace(low[0], high[0], COLUMNS), np.linspace(low[1], high[1], min(rows, 4 * COLUMNS)))
    pixel = np.column_stack([u.ravel(), v.ravel()])
    inside = np.array([cv2.pointPolygonTest(hull, (x, y), measureDist=False) >= 0 for x, y in pixel.tolist()])
    ray = rays(camera, pixel)
    known = inside & np.isfinite(ray).all(axis=1)
    return ImageGrid(np.ascontiguousarray(pixel[known].T), np.ascontiguousarray(ray[known].T))


def map_error_px(grid: ImageGrid, camera: Camera) -> float:
    """Root mean square distance; nan if the camera does not show all of the rays."""
    rotation = np.eye(3)
    residual = np.full_like(grid.pixel, np.nan)
    for _ in range(STEPS):
        point = np.ascontiguousarray(rotation @ grid.ray)
        linear = linearise(camera, point)
        residual = (linear.pixel - grid.pixel).reshape(-1)
        if not np.isfinite(residual).all():
            return float("nan")
        jacobian = turn_jacobian(point, linear.by_point)
        step = np.asarray(np.linalg.solve(jacobian.T @ jacobian, -(jacobian.T @ residual)))
        if np.abs(step).max() < SMALL_RAD:
            break
        rotation = exp_rotation(step) @ rotation
    return float(np.sqrt((residual @ residual) / (len(residual) // 2)))


def turn_jacobian(point: Array, by_point: Array) -> Array:
    """Derivatives (2 N,) of pixels by a turn of points (3, N): a gradient g by y is y x g by w.  # (2 N, 3)"""
    columns = [np.cross(point, gradient, axis=0) for gradient in by_point]
    return np.concatenate(columns, axis=1).T
