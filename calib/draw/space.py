"""Errors in space: on planes through a volume, and by distance."""

from typing import TYPE_CHECKING

import numpy as np

from calib.draw.fields import draw_map
from calib.draw.style import BLUE, GREY, INK, VERMILION, AxesDrawing, nothing, open_axes
from calib.space.budget_views import DepthCurve, ErrorSlice
from designer.base.words import figure as digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def slice_drawing(told: ErrorSlice) -> AxesDrawing:
    """The error of a point over a plane; grey where too few cameras see."""
    known = told.total_mm[np.isfinite(told.total_mm)]
    if not len(known):
        return AxesDrawing(told.title, "Nothing of it is seen", nothing)
    words = f"From {digits(float(known.min()), 2)} to {digits(float(known.max()), 2)} mm"
    width, height = np.ptp(told.x_mm), np.ptp(told.y_mm)
    shape = (
        max(round(1000 * float(width / max(width, height))), 1),
        max(round(1000 * float(height / max(width, height))), 1),
    )
    return AxesDrawing(told.title, words, lambda axes: _draw_slice(axes, told), shape, has_bar=True)


def _draw_slice(axes: "Axes", told: ErrorSlice) -> None:
    x, y = np.meshgrid(told.x_mm, told.y_mm)
    draw_map(axes, np.stack([x, y], axis=-1), told.total_mm, "mm", may_be_wide=True)
    axes.set_xlabel(told.x_name)
    axes.set_ylabel(told.y_name)
    axes.set_aspect("equal")
    if "down" in told.y_name:
        axes.invert_yaxis()


def depth_drawing(told: DepthCurve) -> AxesDrawing:
    """How surely depth is measured, by distance, and by what."""
    known = np.flatnonzero(np.isfinite(told.depth_mm))
    words = "No point of the line of sight is seen by enough cameras"
    if len(known):
        ends = [
            f"{digits(float(told.depth_mm[row]), 2)} mm at {told.distance_mm[row]:.0f} mm" for row in known[[0, -1]]
        ]
        words = f"Depth has a standard deviation of {ends[0]}, and of {ends[1]}"
    return AxesDrawing("Depth error over distance", words, lambda axes: _draw_depth(axes, told))


def _draw_depth(axes: "Axes", told: DepthCurve) -> None:
    lines = (
        (told.depth_mm, "depth, all that is known", INK, "-"), (told.depth_noise_mm, "by pixel noise", BLUE, "--"),
        (told.depth_calibration_mm, "by the rig's errors", VERMILION, "-."), (told.across_mm, "across", GREY, ":"),
    )  # fmt: skip
    for values, name, colour, style in lines:
        if np.isfinite(values).any():
            axes.plot(told.distance_mm, values, style, color=colour, label=name, linewidth=2)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper left")
    open_axes(axes, "distance from the rig's middle in mm", "standard deviation in mm")
