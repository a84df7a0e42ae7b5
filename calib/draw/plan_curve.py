"""What is known of a camera after each photo of a plan."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.style import BLUE, GREY, VERMILION, AxesDrawing, open_axes
from designer.base.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plan_curve(after_px: Sequence[float], tried_px: Sequence[float], goal_px: float) -> AxesDrawing:
    """The deviations after each photo, what tries of all photos came to, and what is wanted."""
    words = "Each photo makes the camera better known; dots are the tries after the last one"
    return AxesDrawing(
        "What is known after each photo", words,
        lambda axes: _draw(axes, np.array(after_px), np.array(tried_px), goal_px),
    )  # fmt: skip


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
