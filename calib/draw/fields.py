"""Fields over the image: residuals and their means, values as bands of colour, what is covered.

The picture of a difference of two cameras: a map with contours and arrows.

What undistortion moves.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.refit import CameraDifference, image_centre
from calib.cameras.undistortion import UndistortionChange, moved
from calib.draw.sigma_map import SigmaMap, scale_end
from calib.draw.style import (
    BLUE,
    DEEP,
    EMPTY,
    INK,
    LABEL_POINTS,
    PALE,
    SEQUENTIAL,
    VERMILION,
    AxesDrawing,
    bar_beside,
    image_axes,
    note,
    picture,
    round_length,
)
from calib.judge.coverage import Coverage
from calib.solver.metrics.residual_cells import ResidualCells, Residuals
from designer.base.arrays import Array, Rows
from designer.base.words import NAME, capital
from designer.base.words import figure as digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ARROWS = 4000
ARROW_SHARE = 0.04
"""Length of a large residual (95 %) on paper, of the image's width."""


def _draw_residuals(axes: "Axes", residuals: Residuals, most: int) -> None:
    """An arrow a residual, enlarged, or of very many some."""
    image_axes(axes, residuals.image_size)
    count = len(residuals.pixel)
    rows = np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)
    pixel, arrow = residuals.pixel[rows], residuals.residual_px[rows]
    if count:
        long_px = float(np.percentile(np.hypot(*residuals.residual_px.T), 95))
        enlarged = round_length(ARROW_SHARE * residuals.image_size[0] / long_px) if long_px > 0 else 1.0
        axes.quiver(
            *pixel.T, *arrow.T, angles="xy", scale_units="xy", scale=1 / enlarged, width=0.012, units="inches",
            color=BLUE, headwidth=4, headlength=4, headaxislength=3.5, rasterized=True,
        )  # fmt: skip
        _scale_arrow(axes, residuals.image_size[0], enlarged)
    if len(residuals.outlier_px):
        axes.plot(
            *residuals.outlier_px.T, "x", color=VERMILION, markersize=8, markeredgewidth=2,
            label=f"{len(residuals.outlier_px)} outliers, left out",
        )  # fmt: skip
        axes.legend(loc="upper right")


def residuals_drawing(residuals: Residuals, rmse_px: float, most: int = MOST_ARROWS) -> AxesDrawing:
    """How large residuals are, as arrows."""
    count, outliers = len(residuals.pixel), len(residuals.outlier_px)
    words = f"{count} residuals, {digits(rmse_px, 3)} px root mean square"
    words += f"; {outliers} outliers, marked by crosses, were left out" if outliers else ""
    words += f"; {most} are drawn" if count > most else ""
    return AxesDrawing(
        "Residuals: predicted - measured", words, lambda axes: _draw_residuals(axes, residuals, most),
        residuals.image_size,
    )  # fmt: skip


def _scale_arrow(axes: "Axes", width: int, enlarged: float) -> None:
    """An arrow of a round length below the right end of the image, with that length: above it is the note."""
    from matplotlib.transforms import offset_copy

    length = round_length(0.08 * width / enlarged)
    place = offset_copy(axes.get_xaxis_transform(), fig=axes.get_figure(root=True), y=-LABEL_POINTS, units="points")
    axes.annotate(
        f"{length:g} px ", (width - 0.5, 0), (width - 0.5 - length * enlarged, 0), xycoords=place, textcoords=place,
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.5, "shrinkA": 0, "shrinkB": 0}, va="center",
        ha="right", annotation_clip=False,
    )  # fmt: skip


def _draw_means(axes: "Axes", cells: ResidualCells, image_size: tuple[int, int], long_px: float) -> None:
    """The mean residual of each cell, with a scale of colours that ends at `long_px`; longer arrows are cut."""
    image_axes(axes, image_size)
    axes.set_facecolor(EMPTY)
    long_px = max(long_px, 1e-12)
    shown = axes.pcolormesh(
        cells.edge_u, cells.edge_v, cells.length_px, cmap=SEQUENTIAL, vmin=0, vmax=long_px, rasterized=True
    )
    bar_beside(axes, shown, "length of the mean in px", longer=True)
    known = np.isfinite(cells.length_px)
    if not known.any():
        return
    step = float(cells.edge_u[1] - cells.edge_u[0])
    enlarged = round_length(step / long_px)
    arrow = cells.mean_px[known]
    arrow = arrow * np.minimum(1.0, 1.4 * step / np.maximum(enlarged * np.hypot(*arrow.T), 1e-12))[:, None]
    axes.quiver(
        *(cells.center_px[known] - arrow * enlarged / 2).T, *arrow.T, angles="xy", scale_units="xy",
        scale=1 / enlarged, width=0.022, units="inches", color=PALE, edgecolor=DEEP, linewidth=0.6, headwidth=4,
        headlength=4, headaxislength=3.5,
    )  # fmt: skip
    _scale_arrow(axes, image_size[0], enlarged)


def systematic_drawing(
    cells: ResidualCells, image_size: tuple[int, int], title: str = "Systematic residuals", long_px: float | None = None
) -> AxesDrawing:
    """The mean residuals, cell by cell, in colours that end at a length; None: as the cells have it."""
    mean, noise = cells.rms_of_means_px, cells.rms_by_noise_px
    words = "Too few observations to tell what is systematic"
    if math.isfinite(mean):
        expected = f", noise alone would leave {digits(noise, 2)} px" if math.isfinite(noise) else ""
        words = f"Means of cells are {digits(mean, 2)} px long{expected}"
    end = cells.long_px if long_px is None else long_px
    return AxesDrawing(title, words, lambda axes: _draw_means(axes, cells, image_size, end), image_size, has_bar=True)


ROUND = tuple(round(step * 10.0**power, 9) for power in range(-6, 5) for step in (1, 2, 5))
BANDS = 25
"""Flat bands of colour make small files."""
FLAT, WIDE = 1.2, 20.0
"""Values that differ by less than the first factor need no contours, by more than the second a scale of powers."""
MOST_CONTOURS = 6
LEAST_SHARE = 0.15
"""Of the largest value: smaller contours crowd around the point of no difference."""


def draw_map(axes: "Axes", pixel: Array, values: Array, unit: str, *, may_be_wide: bool = False) -> None:
    """Draw values that are known at one place at least; where they are not, it stays grey.

    Args:
        axes: that are the image.
        pixel: (R, C, 2) an even grid.
        values: (R, C) not negative, nan where they are not known.
        unit: of the values, "" for none.
        may_be_wide: colours may go by powers of ten, for values that are small in one place and large in another.
    """
    from matplotlib.colors import LogNorm

    axes.set_facecolor(EMPTY)
    known = values[np.isfinite(values)]
    least, most = float(known.min()), float(known.max())
    by_powers = may_be_wide and most > WIDE * least > 0
    end, is_cut = (most, False) if by_powers else scale_end(known)
    bands = np.geomspace(least, most, BANDS + 1) if by_powers else np.linspace(0, end or 1.0, BANDS + 1)
    u, v = pixel[..., 0], pixel[..., 1]
    shown = axes.contourf(
        u, v, np.ma.masked_invalid(np.clip(values, bands[0], None if is_cut else bands[-1])), levels=bands.tolist(),
        cmap=SEQUENTIAL, norm=LogNorm(least, most) if by_powers else None, extend="max" if is_cut else "neither",
    )  # fmt: skip
    shown.set_rasterized(True)  # as shapes, bands that touch would show seams
    levels = _thinned([level for level in ROUND if max(least, 0 if by_powers else LEAST_SHARE * most) < level < most])
    bar_beside(axes, shown, unit, ticks=levels if by_powers else 5)
    if most > FLAT * least:
        lines = axes.contour(u, v, values, levels=levels or [float(np.median(known))], colors=PALE, linewidths=1.3)
        for text in axes.clabel(lines, fontsize=11, fmt=f"%.3g {unit}".rstrip()):
            text.set_bbox({"facecolor": DEEP, "edgecolor": "none", "pad": 1.5, "alpha": 0.75})


def _thinned(levels: list[float]) -> list[float]:
    """At most so many contours that their labels have room: if need be powers of ten alone, or some of these."""
    if len(levels) > MOST_CONTOURS:
        levels = [level for level in levels if f"{level:e}".startswith("1")]
    return levels[:: -(-len(levels) // MOST_CONTOURS) or 1]


def _draw_coverage(axes: "Axes", coverage: Coverage) -> None:
    """How many photos cover each cell of the image; what none covers is hatched, what is not asked for is dark."""
    from matplotlib.colors import ListedColormap

    image_axes(axes, coverage.image_size)
    (width, height), views = coverage.image_size, coverage.views
    axes.fill_between([-0.5, width - 0.5], -0.5, height - 0.5, facecolor=EMPTY, hatch="///", linewidth=0)
    rows, columns = views.shape
    edge_u, edge_v = np.linspace(-0.5, width - 0.5, columns + 1), np.linspace(-0.5, height - 0.5, rows + 1)
    if not coverage.is_lit.all():
        dark = np.where(coverage.is_lit, np.nan, 0.0)
        axes.pcolormesh(edge_u, edge_v, dark, cmap=ListedColormap([INK]), rasterized=True)
    if (views > 0).any():
        count = np.where(views > 0, views.astype(np.float64), np.nan)
        shown = axes.pcolormesh(edge_u, edge_v, count, cmap=SEQUENTIAL, vmin=0, rasterized=True)
        bar_beside(
            axes,
            shown,
            "photos that cover it",
            ticks=sorted({float(x) for x in np.linspace(0, views.max(), 6).round()}),
        )


def coverage_drawing(coverage: Coverage, checked: str = "") -> AxesDrawing:
    """How many photos cover the image, and what the verdict's check says of it; "" where nobody judged."""
    words = capital(checked) or f"The observations surround {100 * coverage.share:.0f} % of the {coverage.area}"
    return AxesDrawing(
        "Coverage of the sensor", words, lambda axes: _draw_coverage(axes, coverage), coverage.image_size, has_bar=True
    )


def uncertainty_drawing(found: SigmaMap) -> AxesDrawing:
    """How uncertain a camera is over the image."""
    less = "learned map taken as exact" if found.is_map_exact else "less a common rotation"
    title = f"Uncertainty of the camera (1 sigma, {less})"

    def draw(axes: "Axes") -> None:
        image_axes(axes, found.image_size)
        axes.set_facecolor(EMPTY)
        if found.is_known:
            draw_map(axes, found.pixel, found.sigma_px, "px", may_be_wide=True)

    return AxesDrawing(title, found.words, draw, found.image_size, has_bar=True)


MAP_WIDTH_PX = 1300
ARROWS = 15
"""Arrows side by side."""
LEAST_PX = 1e-6
"""Smaller differences are rounding, and have no arrows."""
TITLE = f"{NAME} camera difference"
LONGEST = 0.9
"""Length of the longest arrow, in distances between arrows."""


def difference_picture(difference: CameraDifference, title: str, text: str) -> bytes:
    """A PNG: lengths as colours and contours in px, directions as arrows; grey where a camera knows no light."""
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


def _spread(count: int, step: int) -> Rows:
    """About every `step`-th of `count` places, none of them at an end."""
    parts = max(1, count // step)
    return np.round(np.linspace(0, count - 1, 2 * parts + 1)[1::2]).astype(np.int64)


def _fitted_region(axes: "Axes", difference: CameraDifference) -> None:
    """The circle that the rotation was fitted in, if it is not the whole image."""
    from matplotlib.patches import Circle

    if 0 < difference.radius_px < np.hypot(*difference.image_size) / 2:
        u, v = image_centre(difference.image_size).tolist()
        axes.add_patch(Circle((u, v), difference.radius_px, fill=False, edgecolor=PALE, linestyle="--", linewidth=2))


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
