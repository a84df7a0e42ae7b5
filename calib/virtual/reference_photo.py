"""The photo of a planar grid that spans the virtual sensor: which one, and where its points lie on the sensor.

A camera's rays meet a plane in a homography of its pinhole image, so the plane is the image of a pinhole that stands
where the camera stands and looks along the plane's normal: a sensor without distortion (De Boi et al. 2023).
"""

import numpy as np
from numpy.typing import NDArray

from calib.core.types import KnownPoints, Observations
from calib.detector.homography import apply, direct
from calib.virtual.learn_map import MIN_SAMPLES, MapSamples
from designer.base.errors import InputError

Array = NDArray[np.float64]

FLAT = 1e-6
"""Points that lie so near a plane, as a part of their extent, are on it."""
ENOUGH_COVERAGE = 0.9
"""Of the largest coverage of the image; among the views that have it, the most frontal is taken."""
LEAST_FRONTAL = 0.4
"""Shortening of a plane, at most that of a tilt of 66 degrees."""


def on_plane_mm(points: KnownPoints, rows: NDArray[np.int64]) -> Array | None:
    """Coordinates (K, 2) of points in the plane of those that are used, or None if these are not on one.

    Args:
        points: K of them.
        rows: of the points that are used.
    """
    used = points.position_mm[np.unique(rows)]
    middle = used.mean(axis=0)
    _, extent, axes = np.linalg.svd(used - middle, full_matrices=False)
    if len(used) < MIN_SAMPLES or not extent[2] <= FLAT * extent[1]:
        return None
    # The axes follow the target's own, so that the sensor does not depend on which points were seen.
    normal = np.cross(axes[0], axes[1])
    along = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = along - (along @ normal) * normal
    first /= np.linalg.norm(first)
    plane: Array = (points.position_mm - middle) @ np.column_stack([first, np.cross(normal, first)])
    return plane


def choose_view(observations: Observations, plane_mm: Array) -> int:
    """The view that covers most of the image, from the front if there are several.

    Raises:
        InputError: no view shows the plane well enough.
    """
    coverage = np.zeros(observations.view_count)
    frontal = np.zeros(observations.view_count)
    for view in range(observations.view_count):
        rows = np.flatnonzero(observations.view == view)
        if len(rows) < MIN_SAMPLES:
            continue
        pixel = observations.center_px[rows]
        stretch = np.linalg.svd(_stretch(pixel, plane_mm[observations.point[rows]]), compute_uv=False)
        coverage[view], frontal[view] = _hull_area(pixel), stretch[1] / stretch[0]
    able = (coverage > 0) & (frontal >= LEAST_FRONTAL)
    if not able.any():
        raise InputError(
            "no photo shows the board from the front with enough of its rings, to learn the map of the lens from; "
            "take one that fills the image"
        )
    wide = able & (coverage >= ENOUGH_COVERAGE * coverage[able].max())
    return int(np.argmax(np.where(wide, frontal, -1.0)))


def _hull_area(pixel: Array) -> float:
    """Area of the convex hull of pixels (N, 2)."""
    import cv2

    return float(cv2.contourArea(cv2.convexHull(pixel.astype(np.float32))))


def _stretch(pixel: Array, plane: Array) -> Array:
    """Derivative of the homography from pixels to a plane, in the middle of the pixels.  # (2, 2)"""
    middle = pixel.mean(axis=0)
    homography = direct(pixel - middle, plane)
    point = apply(homography, np.zeros(2))
    jacobian: Array = (homography[:2, :2] - np.outer(point, homography[2, :2])) / homography[2, 2]
    return jacobian


def sensor_points(pixel: Array, plane_mm: Array) -> Array:
    """Points of a plane on a sensor of the same scale and orientation as the image, in about pixels.

    The plane is turned, mirrored if its axes are seen from behind, scaled and moved as a whole, so that in the middle
    of the pixels the sensor's axes are those of the image; it stays the image of a pinhole with square pixels.

    Args:
        pixel: where the points are seen (N, 2).
        plane_mm: the points (N, 2).
    """
    stretch = _stretch(pixel, plane_mm)
    if np.linalg.det(stretch) < 0:
        plane_mm, stretch = plane_mm * [1, -1], np.diag([1.0, -1.0]) @ stretch
    left, extent, right = np.linalg.svd(stretch)
    turn = (left @ right).T / np.sqrt(extent.prod())
    middle = pixel.mean(axis=0)
    homography = direct(pixel - middle, plane_mm)
    point: Array = (plane_mm - apply(homography, np.zeros(2))) @ turn.T + middle
    return point


def samples_of_plane(pixel: Array, plane_mm: Array, cov_px2: Array | None) -> MapSamples:
    """What a map is learned from: points of a plane (N, 2), where they were seen, with covariances if known."""
    variance = np.ones(len(pixel)) if cov_px2 is None else 0.5 * np.trace(cov_px2, axis1=1, axis2=2)
    return MapSamples(pixel, sensor_points(pixel, plane_mm), variance, np.ones(len(pixel), dtype=np.int64))
