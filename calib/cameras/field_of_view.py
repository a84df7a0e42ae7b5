"""How much a camera sees: angles along its image, right for any lens, also beyond 180 degrees.

The angle between the light at two sides of an image says nothing beyond half a turn: it is taken by way of the axis.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import angles_between
from designer.base.arrays import Array

STEPS = 1024
"""Pixels looked at along a line."""
HALVINGS = 50
AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class FieldOfView:
    """Angles between what the camera sees at opposite sides of its image; nan where it sees nothing along the way."""

    across_rad: float  # along the middle row
    down_rad: float  # along the middle column
    diagonal_rad: float  # the larger one
    off_axis_rad: float  # the farthest from the axis along any of these
    ends_inside: bool  # the model has no rays at a side: its field ends inside the image


def field_of_view(camera: Camera) -> FieldOfView:
    """The field of view of a camera: `field_of_view(camera).across_rad`."""
    width, height = camera.image_size
    right, low, u, v = width - 1.0, height - 1.0, width / 2, height / 2
    lines = np.array([[(0, v), (right, v)], [(u, 0), (u, low)], [(0, 0), (right, low)], [(right, 0), (0, low)]])
    sights = [_along(camera, *line) for line in lines]
    across, down, *diagonals = (float(angles_between(sight[:2], sight[2]).sum()) for sight in sights)
    off_axis = float(angles_between(np.concatenate(sights), AXIS).max())
    ends = bool(np.isnan(rays(camera, lines[:2])).any())
    return FieldOfView(across, down, max(diagonals), off_axis, ends)


def _along(camera: Camera, start: Array, end: Array) -> Array:
    """The first and the last direction that a line of the image shows, and the one nearest the axis.  # (3, 3)"""
    pixel = start + np.linspace(0, 1, STEPS)[:, None] * (end - start)
    ray = rays(camera, pixel)
    known = np.flatnonzero(np.isfinite(ray[:, 2]))
    if not len(known):
        return np.full((3, 3), np.nan)
    first, last = known[0], known[-1]
    ends = [
        _last_ray(camera, pixel[k], pixel[min(max(k + step, 0), STEPS - 1)]) for k, step in ((first, -1), (last, 1))
    ]
    return np.array([*ends, ray[np.nanargmax(ray[:, 2])]])


def _last_ray(camera: Camera, known: Array, unknown: Array) -> Array:
    """The direction where a model ends between two pixels; a pixel is too coarse where it folds."""
    for _ in range(HALVINGS):
        middle = (known + unknown) / 2
        known, unknown = (middle, unknown) if np.isfinite(rays(camera, middle)).all() else (known, middle)
    return rays(camera, known)


def spokes(camera: Camera, count: int, steps: int) -> Array:
    """What a camera sees from near its axis to the border of its image, or to where the model ends.

    Returns:
        Unit directions (steps, count, 3): rows from the middle outwards, each clockwise from the image's top left; nan
        along a line on which nothing is seen.
    """
    width, height = camera.image_size
    quarter = np.arange(count) * 4 / count
    u = np.interp(quarter, [0, 1, 2, 3, 4], [0, width - 1, width - 1, 0, 0])
    v = np.interp(quarter, [0, 1, 2, 3, 4], [0, 0, height - 1, height - 1, 0])
    size = np.array(camera.image_size)
    middle = project(camera, AXIS)
    if not ((middle >= 0) & (middle < size)).all():
        middle = (size - 1) / 2
    share = np.linspace(0, 1, STEPS)[:, None, None]
    ray = rays(camera, middle + share * (np.column_stack([u, v]) - middle))
    last = np.array([np.flatnonzero(known).max(initial=0) for known in np.isfinite(ray[..., 2]).T])
    row = np.round(np.linspace(1 / steps, 1, steps)[:, None] * last).astype(np.int64)
    picked: Array = ray[row, np.arange(count)]
    return picked
