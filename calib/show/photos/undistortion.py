"""What undistortion does to the pixels of a photo, in numbers and as a figure."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.number_text import figure as digits
from designer.page.blocks import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

STEPS = 61
"""Of the grid on the photo, along each side, by which it is judged."""
LINES, POINTS = 13, 101
"""Drawn along each side, and points of each."""
MOST_BEYOND = 0.5
"""Of the frame's width or height: what a figure shows beyond it."""


@dataclass(frozen=True)
class Change:
    """What happens to the pixels of a photo."""

    share_kept: float  # of the photo, inside the new frame; the rest is cut off
    shift_px: float  # the farthest that a pixel moves, of those kept; nan: none is

    @property
    def shift_words(self) -> str:
        """How far pixels move."""
        return f"{digits(self.shift_px, 3)} px" if np.isfinite(self.shift_px) else "an unknown distance"


def change_of(taken: Camera, pinhole: Camera) -> Change:
    """What happens to a grid of the photo's pixels."""
    last = np.array(taken.image_size) - 1.0
    grid = np.stack(np.meshgrid(*(np.linspace(0, end, STEPS) for end in last)), axis=-1).reshape(-1, 2)
    place = project(pinhole, rays(taken, grid))
    inside = ((place >= -0.5) & (place <= last + 0.5)).all(axis=1)
    shift = np.linalg.norm(place - grid, axis=1)[inside]
    return Change(float(inside.mean()), float(shift.max()) if len(shift) else np.nan)


def undistortion_figure(taken: Camera, pinhole: Camera) -> Figure:
    """Lines that were straight and level in the photo, in the undistorted frame."""
    from calib.show.run.figures import image_panel

    width, height = taken.image_size
    u, v = np.linspace(0, width - 1, POINTS), np.linspace(0, height - 1, POINTS)
    across = [np.column_stack([u, np.full(POINTS, y)]) for y in np.linspace(0, height - 1, LINES)]
    down = [np.column_stack([np.full(POINTS, x), v]) for x in np.linspace(0, width - 1, LINES)]
    lines = [project(pinhole, rays(taken, line)) for line in (*across, *down)]

    def draw(axes: "Axes") -> None:
        from calib.figures.style import image_axes

        image_axes(axes, taken.image_size, "")
        for line in lines:
            axes.plot(*line.T, color="#0072b2", linewidth=0.8)
        axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="#1a1a1a", linewidth=2)
        (left, right), (top, bottom) = (_span(lines, axis, side) for axis, side in enumerate(taken.image_size))
        axes.set(xlim=(left, right), ylim=(bottom, top))

    shift = change_of(taken, pinhole).shift_words
    words = f"Rows and columns of the photo when they are undistorted: pixels move by up to {shift}"
    caption = (
        f"{words}. The thick frame is the new image: lines outside are cut off, and where none reaches it is black."
    )
    return image_panel("What undistortion moves", taken.image_size, draw, words, caption, has_bar=False)


def _span(lines: list[Array], axis: int, side: int) -> tuple[float, float]:
    """What a figure shows along an axis: the frame, and lines that go beyond it, but not too far."""
    values = np.concatenate([line[:, axis] for line in lines])
    values = values[np.isfinite(values)]
    margin, most = 0.03 * side, MOST_BEYOND * side
    low, high = min(0.0, *values), max(float(side), *values)
    return max(low, -most) - margin, min(high, side + most) + margin
