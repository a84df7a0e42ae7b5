"""Ways to share out views among two halves, so that both cover the image and see the target from all sides."""

import numpy as np
from numpy.typing import NDArray

from calib.solver.calibration import Calibration

Array = NDArray[np.float64]

MOST_SPLITS = 4
PER_RIGHT_ANGLE = 0.35
"""A turn of the target by a right angle counts as much as a shift by about half of the image."""


def splits(calibration: Calibration) -> tuple[NDArray[np.bool_], ...]:
    """Up to four ways: which views (V,) belong to the first half.

    Each orders the views along another direction in which they differ (where in the image, how large, from which side,
    how rolled; the principal axes of these) and takes them in turns: first, second, second, first. So the halves are
    alike in that direction, and in the others not on purpose: halves with the same poses would make the same errors.
    The order in which the views are given does not matter but for ties.
    """
    feature = _features(calibration)
    feature -= feature.mean(axis=0)
    axes = np.linalg.svd(feature, full_matrices=False)[2]
    # An axis may point either way; which one must not depend on the order of the views.
    axes *= np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None], axis=1))
    found: dict[bytes, NDArray[np.bool_]] = {}
    for axis in axes[:MOST_SPLITS]:
        rank = np.argsort(np.argsort(feature @ axis, kind="stable"))
        is_first = np.isin(rank % 4, (0, 3))
        # A half and its complement are the same split.
        found.setdefault((is_first == is_first[0]).tobytes(), is_first)
    return tuple(found.values())


def _features(calibration: Calibration) -> Array:
    """Where each view sees the target in the image and how large, from which side, and how rolled.  # (V, 8)"""
    seen = calibration.observations
    count = np.maximum(np.bincount(seen.view, minlength=seen.view_count), 1)[:, None]
    place = seen.center_px / max(seen.image_size) - 0.5
    middle = np.stack([np.bincount(seen.view, place[:, k], seen.view_count) for k in range(2)], axis=1) / count
    square = np.stack([np.bincount(seen.view, place[:, k] ** 2, seen.view_count) for k in range(2)], axis=1) / count
    size = np.sqrt(np.maximum(square - middle**2, 0.0)).mean(axis=1, keepdims=True)
    rotation = calibration.cam_from_target[:, :3, :3]
    # The viewing direction in the target's frame, and the direction of its x axis in the image.
    turn = np.concatenate([rotation[:, 2], rotation[:, :2, 0]], axis=1)
    return np.concatenate([middle, size, PER_RIGHT_ANGLE * turn], axis=1)
