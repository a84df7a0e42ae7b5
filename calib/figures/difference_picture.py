"""The picture of a difference of two cameras: a map with contours and arrows."""

import io
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.cameras.refit import CameraDifference, image_centre
from designer.base.words import NAME

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_INCHES = 9.0
MAP_WIDTH_INCHES = 7.2
DPI = 150
LEVELS = 12
ARROWS = 15
"""Arrows side by side."""

LEAST_TOP_PX = 1e-6
"""Smaller differences are rounding, and are not drawn."""
SHARE_SHOWN, MOST_BEYOND = 95, 2.5
"""Colours end at this percentile if the largest difference is so many times more: a lens runs away in its corners."""
TITLE = f"{NAME} camera difference"
LONGEST = 0.9
"""Length of the longest arrow, in distances between arrows."""


def difference_picture(difference: CameraDifference, title: str, note: str) -> bytes:
    """A PNG: lengths as colours and contours in px, directions as arrows; grey where a camera knows no light."""
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    width, height = difference.image_size
    map_height = MAP_WIDTH_INCHES * height / width
    figure = Figure(figsize=(WIDTH_INCHES, min(max(map_height, 2.5), 14) + 1.3), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    u, v = difference.pixel[0, :, 0], difference.pixel[:, 0, 1]
    length = np.ma.masked_invalid(difference.length_px)
    top, is_cut = scale_end(difference)
    levels = MaxNLocator(LEVELS).tick_values(0.0, top)
    light = ListedColormap(colormaps["YlOrRd"](np.linspace(0.0, 0.7, 256)))  # arrows stay visible on it
    image = axes.contourf(u, v, length, levels=levels, cmap=light, extend="max" if is_cut else "neither")
    inner = levels[1 : None if is_cut else -1]
    lines = axes.contour(u, v, length, levels=inner, colors="0.3", linewidths=0.6)
    axes.clabel(lines, list(inner)[::2], fontsize=8, fmt=lambda level: f"{level:g}")
    _arrows(axes, difference)
    _fitted_region(axes, difference)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", facecolor="0.8")
    axes.set(xlabel="u (px)", ylabel="v (px)")
    legend = "" if np.isfinite(difference.length_px).all() else "; grey: not known by both"
    cut = f"; arrows cut at {top:.2g} px" if is_cut else ""
    axes.set_title(f"{title}\n{note}{cut}{legend}", fontsize=10)
    figure.colorbar(image, ax=axes, label="difference (px)", shrink=0.9)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Title": TITLE, "Software": None})
    return buffer.getvalue()


def scale_end(difference: CameraDifference) -> tuple[float, bool]:
    """The end of the scale of colours, and whether there are lengths beyond it."""
    known = difference.length_px[np.isfinite(difference.length_px)]
    usual, largest = float(np.percentile(known, SHARE_SHOWN)), float(known.max())
    if largest > MOST_BEYOND * usual and usual > LEAST_TOP_PX:
        return usual, True
    return max(largest, LEAST_TOP_PX), False


def _arrows(axes: "Axes", difference: CameraDifference) -> None:
    """Where the second camera sees what the first sees at an arrow, drawn far too long; the key tells its scale."""
    step = max(1, difference.pixel.shape[1] // ARROWS)
    rows, columns = (_spread(count, step) for count in difference.pixel.shape[:2])
    foot = difference.pixel[np.ix_(rows, columns)].reshape(-1, 2)
    arrow = difference.difference_px[np.ix_(rows, columns)].reshape(-1, 2)
    longest = float(np.nanmax(np.linalg.norm(arrow, axis=1), initial=0.0))
    if longest <= LEAST_TOP_PX:
        return
    top, is_cut = scale_end(difference)
    if is_cut and longest > top:
        # Longer arrows are cut to the end of the colours, else the others would be dots.
        longest = top
        arrow = arrow * np.minimum(1.0, top / np.maximum(np.linalg.norm(arrow, axis=1), LEAST_TOP_PX))[:, None]
    spacing = step * float(difference.pixel[0, 1, 0] - difference.pixel[0, 0, 0])
    known = np.isfinite(arrow).all(axis=1)
    quiver = axes.quiver(
        *foot[known].T,
        *arrow[known].T,
        angles="xy",
        scale_units="xy",
        scale=longest / (LONGEST * spacing),
        color="black",
        pivot="mid",
        width=0.0025,
        minlength=0.3,
    )
    key = float(f"{longest:.1g}")
    axes.quiverkey(quiver, 0.92, -0.09, key, f"{key:g} px", labelpos="E", coordinates="axes")


def _spread(count: int, step: int) -> NDArray[np.int64]:
    """About every `step`-th of `count` places, none of them at an end."""
    parts = max(1, count // step)
    return np.round(np.linspace(0, count - 1, 2 * parts + 1)[1::2]).astype(np.int64)


def _fitted_region(axes: "Axes", difference: CameraDifference) -> None:
    """The circle that the rotation was fitted in, if it is not the whole image."""
    from matplotlib.patches import Circle

    if 0 < difference.radius_px < np.hypot(*difference.image_size) / 2:
        centre = image_centre(difference.image_size)
        circle = Circle(
            (float(centre[0]), float(centre[1])), difference.radius_px, fill=False, edgecolor="tab:blue", linestyle="--"
        )
        axes.add_patch(circle)
