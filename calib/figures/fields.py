"""Residuals over the image: one by one, and their means in cells, which show distortion that no parameter took up."""

from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure as digits
from calib.figures.style import (
    BLUE,
    DEEP,
    EMPTY,
    INK,
    LABEL_POINTS,
    PALE,
    SEQUENTIAL,
    VERMILION,
    image_axes,
    note,
    round_length,
)
from calib.metrics.residual_cells import LEAST_PER_CELL, ResidualCells, Residuals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh

MOST_ARROWS = 4000
ARROW_SHARE = 0.04
"""Length of a large residual (95 %) on paper, of the image's width."""


def draw_residuals(axes: "Axes", residuals: Residuals, most: int = MOST_ARROWS) -> None:
    """An arrow a residual, enlarged, or of very many some."""
    image_axes(axes, residuals.image_size, "What is left over: predicted - measured")
    count = len(residuals.pixel)
    rows = np.arange(count) if count <= most else np.linspace(0, count - 1, most).astype(np.int64)
    pixel, arrow = residuals.pixel[rows], residuals.residual_px[rows]
    if not count:
        note(axes, "no residual counts")
    else:
        enlarged = _enlarged(residuals.image_size, float(np.percentile(np.hypot(*residuals.residual_px.T), 95)))
        axes.quiver(
            *pixel.T, *arrow.T, angles="xy", scale_units="xy", scale=1 / enlarged, width=0.012, units="inches",
            color=BLUE, headwidth=4, headlength=4, headaxislength=3.5, rasterized=True,
        )  # fmt: skip
        _scale_arrow(axes, residuals.image_size[0], enlarged)
        shown = "" if len(rows) == count else f"; {len(rows)} of {count} drawn"
        note(axes, f"arrows {enlarged:g} x enlarged{shown}")
    if len(residuals.outlier_px):
        axes.plot(
            *residuals.outlier_px.T, "x", color=VERMILION, markersize=8, markeredgewidth=2,
            label=f"{len(residuals.outlier_px)} outliers, left out",
        )  # fmt: skip
        axes.legend(loc="upper right")


def _enlarged(image_size: tuple[int, int], length_px: float) -> float:
    """How much arrows are enlarged: a round number."""
    return round_length(ARROW_SHARE * image_size[0] / length_px) if length_px > 0 else 1.0


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


def draw_means(
    axes: "Axes", cells: ResidualCells, image_size: tuple[int, int], title: str, long_px: float
) -> "QuadMesh":
    """The mean residual of each cell; return what a scale of colours belongs to.

    Args:
        axes: to draw in.
        cells: with their means.
        image_size: width, height in px.
        title: of the axes.
        long_px: the end of the scales; longer arrows are cut, brighter colours are not there.
    """
    image_axes(axes, image_size, title)
    axes.set_facecolor(EMPTY)
    long_px = max(long_px, 1e-12)
    shown = axes.pcolormesh(
        cells.edge_u, cells.edge_v, cells.length_px, cmap=SEQUENTIAL, vmin=0, vmax=long_px, rasterized=True
    )
    known = np.isfinite(cells.length_px)
    if not known.any():
        note(axes, f"no cell has {LEAST_PER_CELL} residuals")
        return shown
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
    note(axes, f"RMS {digits(cells.rms_of_means_px, 2)} px, {digits(cells.rms_by_noise_px, 2)} by noise alone")
    return shown
