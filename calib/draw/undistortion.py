"""What undistortion moves."""

from typing import TYPE_CHECKING

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.undistortion import UndistortionChange, moved
from calib.draw.style import AxesDrawing, image_axes
from designer.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LINES, POINTS = 13, 101
"""Drawn along each side, and points of each."""
MOST_BEYOND = 0.5
"""Of the frame's width or height: what a figure shows beyond it."""


def undistortion_drawing(
    taken: Camera, new_camera: Camera, change: UndistortionChange, cam_from_new: Array | None = None
) -> AxesDrawing:
    """Lines that were straight and level in the photo, in the undistorted frame."""
    last_u, last_v = (side - 1 for side in taken.image_size)
    u, v = np.linspace(0, last_u, POINTS), np.linspace(0, last_v, POINTS)
    across = [np.column_stack([u, np.full(POINTS, y)]) for y in np.linspace(0, last_v, LINES)]
    down = [np.column_stack([np.full(POINTS, x), v]) for x in np.linspace(0, last_u, LINES)]
    lines = [_unbroken(moved(taken, new_camera, cam_from_new, line), new_camera) for line in (*across, *down)]
    width, height = new_camera.image_size

    def draw(axes: "Axes") -> None:
        image_axes(axes, new_camera.image_size)
        for line in lines:
            axes.plot(*line.T, color="#0072b2", linewidth=0.8)
        axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="#1a1a1a", linewidth=2)
        (left, right), (top, bottom) = (_span(lines, axis, side) for axis, side in enumerate(new_camera.image_size))
        axes.set(xlim=(left, right), ylim=(bottom, top))

    words = "Rows and columns of the photo when they are undistorted"
    if np.isfinite(change.shift_px):
        words += f": pixels move by up to {change.shift_words}"
    words += "; the thick frame is the new image: lines outside are cut off, and where none reaches it is black"
    return AxesDrawing("What undistortion moves", words, draw, new_camera.image_size)


def _unbroken(line: Array, new_camera: Camera) -> Array:
    """A line (N, 2) with a gap where it goes on at the other side of the picture."""
    jumps = np.abs(np.diff(line[:, 0], prepend=line[0, 0])) > new_camera.image_size[0] / 2
    return np.where(jumps[:, None], np.nan, line)


def _span(lines: list[Array], axis: int, side: int) -> tuple[float, float]:
    """What a figure shows along an axis: the frame, and lines that go beyond it, but not too far."""
    values = np.concatenate([line[:, axis] for line in lines])
    values = values[np.isfinite(values)]
    margin, most = 0.03 * side, MOST_BEYOND * side
    low, high = min(0.0, *values), max(float(side), *values)
    return max(low, -most) - margin, min(high, side + most) + margin
