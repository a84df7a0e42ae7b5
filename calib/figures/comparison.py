"""Several calibrations of the same photos side by side."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure as digits
from calib.figures.fields import draw_means
from calib.figures.style import (
    ABOVE_PX,
    BELOW_PX,
    BLUE,
    DPI,
    GREEN,
    GREY,
    LEFT_PX,
    ORANGE,
    VERMILION,
    WIDTH_PX,
    axes_at,
    bar_beside,
    headline,
)
from calib.metrics.errors import summarise
from calib.metrics.evaluation import Evaluation
from calib.metrics.residual_cells import cells_of, columns_rows, residuals_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, ORANGE, GREEN, VERMILION, GREY)
MOST = len(COLOURS)
ACROSS = 3
"""More images side by side leave no room for their titles."""
BARS_PX, BARS_TOP_PX = 430, 90
RIGHT_PX, BAR_PX = 15, 110
"""Beside each axes on the right, and for the scale of colours beside the last image."""
NUMBER_POINTS, DIGIT_EMS = 10.0, 0.64
"""Size of the numbers on bars where there is room, and how wide a digit of the font is."""
BESIDE_BARS_PX, BETWEEN_PX = 120, 6
"""At most beside the bars of a metric, for the scale and its label; and between two numbers at least."""
SHORT, LEAST_PART = 0.01, 1e-9
"""Below the first a number has too many zeros for a bar; no smaller part of a unit than the second is written."""


def comparison_height_px(evaluations: Sequence[Evaluation]) -> int:
    """As high as bars and images need."""
    width, height = evaluations[0].calibration.camera.image_size
    rows, across = _rows_columns(min(len(evaluations), MOST))
    return round(BARS_PX + rows * (min(max((WIDTH_PX / across - 150) * height / width, 200.0), 900.0) + 170) + 20)


def _rows_columns(count: int) -> tuple[int, int]:
    """How the images of so many models stand."""
    across = min(count, ACROSS)
    return -(-count // across), across


def draw_comparison(page: "Figure", evaluations: Sequence[Evaluation]) -> None:
    """Bars of each metric above; below what each model leaves over in the image, in one scale of colours."""
    shown = list(evaluations[:MOST])
    metrics = list(dict.fromkeys(errors.metric for one in shown for errors in one.errors))
    for place, metric in enumerate(metrics):
        across = WIDTH_PX / len(metrics)
        bars = axes_at(
            page, place * across + LEFT_PX, BARS_TOP_PX, across - LEFT_PX - RIGHT_PX, BARS_PX - BARS_TOP_PX - 45
        )
        _draw_bars(bars, metric, shown, across)
    fields = [residuals_of(one) for one in shown]
    shape = columns_rows(fields[0].image_size, min(len(field.pixel) for field in fields))
    cells = [cells_of(field.image_size, field.pixel, field.residual_px, shape) for field in fields]
    longest = max(one.long_px for one in cells)
    every = [_image_axes(page, place, shown) for place in range(len(shown))]
    for axes, one, field, means in zip(every, shown, fields, cells, strict=True):
        title = f"{one.calibration.camera.model}: mean residual of each cell"
        colours = draw_means(axes, means, field.image_size, title, longest)
    bar_beside(every[min(len(every), ACROSS) - 1], colours, "length of the mean in px", longer=True)
    headline(page, _headline(shown))


def _image_axes(page: "Figure", place: int, evaluations: Sequence[Evaluation]) -> "Axes":
    """Room for the image of one of the models, in its row."""
    rows, across = _rows_columns(len(evaluations))
    width, high = (WIDTH_PX - BAR_PX) / across, (comparison_height_px(evaluations) - BARS_PX) / rows
    left, top = place % across * width + LEFT_PX, BARS_PX + place // across * high + ABOVE_PX
    return axes_at(page, left, top, width - LEFT_PX - RIGHT_PX, high - ABOVE_PX - BELOW_PX)


def _headline(evaluations: Sequence[Evaluation]) -> str:
    seen = evaluations[0].calibration.observations
    of = "of the photos they were solved from" if not evaluations[0].folds else "of photos held out"
    return f"Camera models compared, {seen.view_count} photos; errors {of}; shorter bars are better"


def part_of_unit(largest: float) -> float:
    """The thousandth, or a smaller part of a unit, in which numbers are short enough to stand on narrow bars."""
    part = 1.0
    while 0 < largest / part < SHORT and part > LEAST_PART:
        part /= 1000
    return round(part, 12)


def number_points(texts: Sequence[str], across_px: float) -> float:
    """The size of type in which as many numbers stand side by side, whatever the machine's fonts are hinted to."""
    room_px = across_px / len(texts) - BETWEEN_PX
    return min(NUMBER_POINTS, room_px / (DIGIT_EMS * max(map(len, texts))) * 72 / DPI)


def _draw_bars(axes: "Axes", metric: str, evaluations: Sequence[Evaluation], width_px: float) -> None:
    """RMSE of each model by one metric, in axes so wide with all that belongs to them."""
    unit = next(errors.unit for one in evaluations if (errors := one.of(metric)))
    found = [one.of(metric) for one in evaluations]
    rmse = [0.0 if errors is None else float(np.nan_to_num(summarise(errors).rmse)) for errors in found]
    part = part_of_unit(max(rmse))
    heights = [height / part for height in rmse]
    axes.set_title(f"{metric.capitalize()} error")
    axes.set_ylabel(f"RMSE in {unit}" if part == 1 else f"RMSE in {np.format_float_positional(part)} {unit}")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    numbers = [digits(height, 3) for height in heights]
    points = number_points(numbers, width_px - BESIDE_BARS_PX)
    for place, (height, number, colour) in enumerate(zip(heights, numbers, COLOURS, strict=False)):
        axes.bar(place, height, width=0.7, color=colour)
        axes.text(place, height, number, ha="center", va="bottom", fontsize=points)
    names = [one.calibration.camera.model for one in evaluations]
    axes.set_xticks(range(len(names)), names, rotation=0 if len(names) <= ACROSS else 30)
    axes.set_ylim(0, 1.15 * max(*heights, 1e-12))
