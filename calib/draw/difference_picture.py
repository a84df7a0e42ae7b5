"""The picture of a difference of two cameras: a map with contours and arrows."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras.refit import CameraDifference, image_centre
from calib.draw.fields import draw_map
from calib.draw.sigma_map import scale_end
from calib.draw.style import DEEP, PALE, image_axes, note, picture, round_length
from designer.base.words import NAME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAP_WIDTH_PX = 1300
ARROWS = 15
"""Arrows side by side."""
LEAST_PX = 1e-6
"""Smaller differences are rounding, and have no arrows."""
TITLE = f"{NAME} camera difference"
LONGEST = 0.9
"""Length of the longest arrow, in distances between arrows."""


def difference_picture(difference: CameraDifference, title: str, text: str) -> bytes:
    """A PNG: lengths as colours and contours in px, directions as arrows; grey where a camera knows no light.

    Args:
        difference: of two cameras, known at one pixel at least.
        title: of the picture.
        text: below the title.
    """
    width, height = difference.image_size
    length = difference.length_px

    def draw(page: "Figure") -> None:
        axes = page.add_subplot()
        image_axes(axes, difference.image_size)
        axes.set_title(title)
        draw_map(axes, difference.pixel, length, "px")
        longest, is_cut = _arrows(axes, difference)
        _fitted_region(axes, difference)
        cut = f"; arrows cut at {longest:.2g} px" if is_cut else ""
        note(axes, f"{text}{cut}" + ("" if np.isfinite(length).all() else "; grey: not known by both"))

    return picture(round(min(max(MAP_WIDTH_PX * height / width, 500), 2600)) + 180, draw, title=TITLE)


def _arrows(axes: "Axes", difference: CameraDifference) -> tuple[float, bool]:
    """Where the second camera sees what the first sees at an arrow, drawn far too long; a key tells the scale.

    Returns:
        The longest that is drawn, and whether others were cut to it: else those of most places would be dots.
    """
    step = max(1, difference.pixel.shape[1] // ARROWS)
    rows, columns = (_spread(count, step) for count in difference.pixel.shape[:2])
    foot = difference.pixel[np.ix_(rows, columns)].reshape(-1, 2)
    arrow = difference.difference_px[np.ix_(rows, columns)].reshape(-1, 2)
    known = np.isfinite(arrow).all(axis=1)
    foot, arrow = foot[known], arrow[known]
    length = np.hypot(*arrow.T)
    end, is_cut = scale_end(difference.length_px[np.isfinite(difference.length_px)])
    longest = min(float(length.max(initial=0.0)), end)
    if longest <= LEAST_PX:
        return longest, False
    arrow = arrow * np.minimum(1.0, longest / np.maximum(length, LEAST_PX))[:, None]
    spacing = step * float(difference.pixel[0, 1, 0] - difference.pixel[0, 0, 0])
    quiver = axes.quiver(
        *foot.T, *arrow.T, angles="xy", scale_units="xy", scale=longest / (LONGEST * spacing), color=PALE,
        edgecolor=DEEP, linewidth=0.6, pivot="mid", width=0.022, units="inches", minlength=0.3,
    )  # fmt: skip
    key = round_length(longest)
    axes.quiverkey(quiver, 0.94, 1.025, key, f"{key:g} px", labelpos="E", coordinates="axes")
    return longest, is_cut


def _spread(count: int, step: int) -> NDArray[np.int64]:
    """About every `step`-th of `count` places, none of them at an end."""
    parts = max(1, count // step)
    return np.round(np.linspace(0, count - 1, 2 * parts + 1)[1::2]).astype(np.int64)


def _fitted_region(axes: "Axes", difference: CameraDifference) -> None:
    """The circle that the rotation was fitted in, if it is not the whole image."""
    from matplotlib.patches import Circle

    if 0 < difference.radius_px < np.hypot(*difference.image_size) / 2:
        u, v = image_centre(difference.image_size).tolist()
        axes.add_patch(Circle((u, v), difference.radius_px, fill=False, edgecolor=PALE, linestyle="--", linewidth=2))
