"""How far each pose of a camera on a robot is off what all of them say."""

from typing import TYPE_CHECKING

import numpy as np

from calib.draw.style import BLUE, GREY, VERMILION, AxesDrawing, log_axis, open_axes
from calib.rigs.pose_pairs import FAR, PairsSolution
from designer.base.words import figure as digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = 0.1
"""What is less is drawn there."""


def pose_errors_drawing(found: PairsSolution) -> AxesDrawing:
    """Weighed lengths of the poses' errors, in their order; those left out are marked."""
    counts = np.isfinite(found.off) & ~found.is_off
    out = int(found.is_off.sum())
    words = (
        f"Of {int(counts.sum())} poses the worst is {digits(float(found.off[counts].max()), 2)} standard deviations off"
    )
    more = f"; {out} {'is' if out == 1 else 'are'} left out" if out else ""
    return AxesDrawing("How well the poses fit", words + more, lambda axes: _draw(axes, found))


def _draw(axes: "Axes", found: PairsSolution) -> None:
    from matplotlib.ticker import MaxNLocator

    number = np.arange(1, len(found.off) + 1)
    for rows, colour, name in ((~found.is_off, BLUE, "count"), (found.is_off, VERMILION, "left out")):
        if rows.any():
            axes.plot(number[rows], found.off[rows].clip(LEAST), "o", color=colour, label=name, markersize=6)
    axes.axhline(np.sqrt(FAR), color=GREY, linestyle="--", linewidth=1.5)
    axes.set_yscale("log")
    log_axis(axes.yaxis)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="upper left")
    open_axes(axes, "pose, in the order of the file", "error, standard deviations")
