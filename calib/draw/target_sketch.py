"""What a photo of a plan will show: the target as the camera sees it.

What is known of a camera after each photo of a plan.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.draw.style import BLUE, GREY, VERMILION, AxesDrawing, open_axes
from designer.base.arrays import Array
from designer.page.blocks import Raster
from designer.page.pictures import thumbnail
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LONGEST_PX = 480
FINER = 2
"""Drawn so many times larger than shown."""
BEHIND, BODY, INK = 205, 250, 35
STEPS_OF_EDGE, STEPS_OF_RING = 8, 20
SHIFT = 4
"""Bits of a fraction of a pixel."""
FAR_OUT = 4.0
"""Widths of an image: what is projected farther off is not drawn."""


def sketch(camera: Camera, target: TargetGeometry, cam_from_target: Array) -> Raster:
    """The photo as a small picture in greys."""
    width, height = camera.image_size
    scale = LONGEST_PX * FINER / max(width, height)
    canvas = np.full((max(round(height * scale), 1), max(round(width * scale), 1)), BEHIND, dtype=np.uint8)
    eye = -cam_from_target[:3, :3].T @ cam_from_target[:3, 3]
    frame = target.target_from_face
    looks = ((eye - frame[:, :3, 3]) * frame[:, :3, 2]).sum(axis=1) > 0
    for face in np.flatnonzero(looks).tolist():
        for outline, grey in ((target.outline_mm[face], INK), (target.window_mm[face], BODY)):
            _fill(canvas, _pixels(camera, cam_from_target @ frame[face], _edges(outline), scale), grey)
        marks = None if target.marks is None else target.marks[face]
        for polygon in () if marks is None else marks.polygons_mm:
            _fill(canvas, _pixels(camera, cam_from_target @ frame[face], _edges(polygon), scale), INK)
    shown = np.flatnonzero(looks[target.ring_face])
    for radius_mm, grey in ((target.radius_outer_mm, INK), (target.radius_inner_mm, BODY)):
        for row in shown[radius_mm[shown] > 0].tolist():
            placed = cam_from_target @ frame[target.ring_face[row]]
            circle = target.center_in_face_mm[row, :2] + radius_mm[row] * _CIRCLE
            _fill(canvas, _pixels(camera, placed, circle, scale), grey)
    return thumbnail(canvas, -(-canvas.shape[1] // FINER))


_ANGLES = np.linspace(0, 2 * math.pi, STEPS_OF_RING, endpoint=False)
_CIRCLE = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)


def _edges(outline: Array) -> Array:
    """A polygon (K, 2) with points along its sides, which a lens bends."""
    step = np.linspace(0, 1, STEPS_OF_EDGE, endpoint=False)[:, None]
    line: Array = (outline[:, None] + step * (np.roll(outline, -1, axis=0) - outline)[:, None]).reshape(-1, 2)
    return line


def _pixels(camera: Camera, cam_from_face: Array, line: Array, scale: float) -> Array:
    """Those points of a face (N, 2) that are seen, in the picture."""
    place = transform(cam_from_face, np.column_stack([line, np.zeros(len(line))]))
    pixel: Array = (project(camera, place) + 0.5) * scale - 0.5
    with np.errstate(invalid="ignore"):
        near: Array = pixel[np.abs(pixel).max(axis=1) < FAR_OUT * LONGEST_PX * FINER]
    return near


def _fill(canvas: NDArray[np.uint8], pixel: Array, grey: int) -> None:
    if len(pixel) > 2:
        corner = np.round(pixel * 2**SHIFT).astype(np.int32)
        cv2.fillPoly(canvas, [corner], [grey], lineType=cv2.LINE_AA, shift=SHIFT)


def plan_curve(after_px: Sequence[float], tried_px: Sequence[float], goal_px: float) -> AxesDrawing:
    """The deviations after each photo, what tries of all photos came to, and what is wanted."""
    words = "Each photo makes the camera better known; dots are the tries after the last one"
    return AxesDrawing(
        "What is known after each photo",
        words,
        lambda axes: _draw(axes, np.array(after_px), np.array(tried_px), goal_px),
    )


def _draw(axes: "Axes", after: Array, tried: Array, goal_px: float) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator

    count, known = np.arange(1, len(after) + 1), np.isfinite(after) & (after > 0)
    axes.plot(count[known], after[known], "-o", color=BLUE, label="as planned, by the noise", linewidth=2)
    done = tried[np.isfinite(tried) & (tried > 0)]
    axes.plot(
        np.full(len(done), len(after)), done, "D", color=VERMILION, label="tried, with the target's making", zorder=3
    )
    axes.axhline(goal_px, color=GREY, linestyle="--", label="wanted")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="upper right")
    open_axes(axes, "photos", "95 % within, px (1 sigma)")
