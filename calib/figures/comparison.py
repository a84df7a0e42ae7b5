"""Several calibrations of the same photos side by side."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.cells import cells_of, columns_rows
from calib.figures.fields import draw_means, residuals_of
from calib.figures.style import BLUE, GREEN, GREY, ORANGE, VERMILION, WIDTH_PX, bar_beside
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation
from calib.results.evaluation_table import figure as digits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, GREEN, VERMILION, GREY)
MOST = len(COLOURS)
BARS_PX = 430


def comparison_height_px(evaluations: Sequence[Evaluation]) -> int:
    """As high as bars and images need."""
    width, height = evaluations[0].calibration.camera.image_size
    across = min(len(evaluations), MOST)
    return round(BARS_PX + min(max((WIDTH_PX / across - 150) * height / width, 200.0), 900.0) + 190)


def draw_comparison(page: "Figure", evaluations: Sequence[Evaluation]) -> None:
    """Bars of each metric above; below what each model leaves over in the image, in one scale of colours."""
    shown = list(evaluations[:MOST])
    metrics = list(dict.fromkeys(errors.metric for one in shown for errors in one.errors))
    below = comparison_height_px(evaluations) - BARS_PX
    grid = page.add_gridspec(2, 1, height_ratios=[BARS_PX, below])
    bars, images = grid[0].subgridspec(1, len(metrics)), grid[1].subgridspec(1, len(shown))
    for place, metric in enumerate(metrics):
        _draw_bars(page.add_subplot(bars[place]), metric, shown)
    fields = [residuals_of(one) for one in shown]
    shape = columns_rows(fields[0].image_size, min(len(field.pixel) for field in fields))
    cells = [cells_of(field.image_size, field.pixel, field.residual_px, shape) for field in fields]
    longest = max(one.long_px for one in cells)
    every = [page.add_subplot(images[place]) for place in range(len(shown))]
    for axes, one, field, means in zip(every, shown, fields, cells, strict=True):
        title = f"{one.calibration.camera.model}: mean residual of each cell"
        colours = draw_means(axes, means, field.image_size, title, longest)
    bar_beside(every[-1], colours, "length of the mean in px", longer=True)
    page.suptitle(_headline(shown), fontsize=16, fontweight="bold", x=0.01, ha="left")


def _headline(evaluations: Sequence[Evaluation]) -> str:
    seen = evaluations[0].calibration.observations
    of = "of the photos they were solved from" if not evaluations[0].folds else "of photos held out"
    return f"Camera models compared, {seen.view_count} photos; errors {of}; shorter bars are better"


def _draw_bars(axes: "Axes", metric: str, evaluations: Sequence[Evaluation]) -> None:
    """RMSE of each model by one metric, with a tick at the median."""
    unit = next(errors.unit for one in evaluations if (errors := one.of(metric)))
    axes.set_title(f"{metric.capitalize()} error")
    axes.set_ylabel(f"RMSE in {unit}")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    heights = []
    for place, (one, colour) in enumerate(zip(evaluations, COLOURS, strict=False)):
        errors = one.of(metric)
        height = 0.0 if errors is None else float(np.nan_to_num(summarise(errors).rmse))
        heights.append(height)
        axes.bar(place, height, width=0.7, color=colour)
        axes.text(place, height, digits(height, 3), ha="center", va="bottom", fontsize=10)
    axes.set_xticks(range(len(evaluations)), [one.calibration.camera.model for one in evaluations])
    axes.set_ylim(0, 1.15 * max(*heights, 1e-12))
