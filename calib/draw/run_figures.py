"""Figures of a run, each with what it shows in words and numbers.

Histograms: how large the errors of a metric are, and residuals against the Gaussian.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calib.core.types import Observations
from calib.draw.fields import coverage_drawing, draw_map, residuals_drawing, uncertainty_drawing
from calib.draw.sigma_map import SigmaMap, place_on_map
from calib.draw.style import (
    BLUE,
    GREEN,
    ORANGE,
    PALE,
    VERMILION,
    AxesDrawing,
    figure_of,
    image_axes,
    nothing,
    open_axes,
)
from calib.judge.coverage import Coverage
from calib.judge.difference import Apart, Known, sigma_over
from calib.judge.halves import HalvesApart, NoHalves
from calib.judge.lens_checks import made_words
from calib.judge.next_views import NextView
from calib.judge.verdict import LEAST_PX, px
from calib.solver.accuracy import share_px
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import Evaluation
from calib.solver.metrics.residual_cells import Residuals
from calib.solver.outliers import whitened
from calib.solver.problem import whiteners
from designer.base.arrays import Array
from designer.base.words import capital
from designer.base.words import figure as digits
from designer.page.blocks import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FEWEST_BINS, MOST_BINS = 10, 40
FEWEST_OF_RESIDUALS, MOST_OF_RESIDUALS = 15, 61
SHOWN_PERCENT = 99.5
"""The largest errors are counted in the last bin, so that one of thousands does not set the scale."""
ROOM = 1.45
"""Height over the highest bar, for the legend, which no line may cross."""


def _draw_sizes(axes: "Axes", sizes: Array, unit: str) -> None:
    """A histogram of the lengths (N,) of error vectors, with their root mean square and 95 % marked."""
    open_axes(axes, f"length of an error in {unit}", "how many")
    if not len(sizes):
        nothing(axes)
        return
    most = float(np.percentile(sizes, SHOWN_PERCENT)) or float(sizes.max()) or 1.0
    bins = min(max(round(2 * len(sizes) ** (1 / 3)), FEWEST_BINS), MOST_BINS)
    edges = np.linspace(0, most, bins + 1)
    count = np.histogram(np.minimum(sizes, most), edges)[0]
    axes.stairs(count, edges, fill=True, color=BLUE, alpha=0.6)
    rmse, percentile_95 = float(np.sqrt(np.mean(sizes**2))), float(np.percentile(sizes, 95))
    axes.axvline(rmse, ymax=1 / ROOM, color=VERMILION, linewidth=2.2, label="root mean square")
    axes.axvline(percentile_95, ymax=1 / ROOM, color=ORANGE, linewidth=2.2, linestyle="--", label="95 % are below")
    axes.set_xlim(0, most)
    axes.set_ylim(0, ROOM * count.max())
    axes.locator_params(axis="x", nbins=5)
    axes.legend(loc="upper right", frameon=False)


def _draw_histogram(axes: "Axes", values: Array, unit: str, sigma: float) -> None:
    """Coordinates of residuals against the Gaussian that the solution states."""
    open_axes(axes, f"predicted - measured, u and v together, in {unit}", "share in a bin, in %")
    if not len(values):
        nothing(axes)
        return
    spread = sigma if sigma > 0 else max(float(values.std()), 1e-12)
    limit = max(4.0 * spread, min(float(np.abs(values).max()), 6.0 * spread))
    bins = min(max(round(2 * len(values) ** (1 / 3)), FEWEST_OF_RESIDUALS), MOST_OF_RESIDUALS)
    edges = np.linspace(-limit, limit, bins + 1)
    share = 100 * np.histogram(values, edges)[0] / len(values)
    axes.stairs(share, edges, fill=True, color=BLUE, alpha=0.55, label=f"{len(values)} coordinates")
    at = np.linspace(-limit, limit, 400)
    gauss = np.exp(-0.5 * (at / spread) ** 2) / (spread * np.sqrt(2 * np.pi)) * 100 * (edges[1] - edges[0])
    if sigma > 0:
        label = f"Gaussian of the solution: sigma {digits(sigma, 3)} {unit}"
        axes.plot(at, gauss, color=VERMILION, linewidth=2.5, label=label)
    axes.set_xlim(-limit, limit)
    axes.set_ylim(0, 1.3 * max(share.max(), gauss.max()))
    axes.legend(loc="upper right", frameon=False)


def sizes_drawing(metric: str, sizes: Array, unit: str) -> AxesDrawing:
    """How large the errors of a metric are."""
    known = sizes[np.isfinite(sizes)]
    words = f"{len(known)} {metric} errors"
    if len(known):
        rmse, most = digits(float(np.sqrt(np.mean(known**2))), 3), digits(float(np.percentile(known, 95)), 3)
        words += f": root mean square {rmse} {unit}, 95 % are below {most} {unit}"
    return AxesDrawing(f"{metric.capitalize()} error", words, lambda axes: _draw_sizes(axes, known, unit))


def distribution_drawing(evaluation: Evaluation) -> AxesDrawing:
    """How many residuals are larger than a Gaussian has them."""
    scale = evaluation.calibration.scale
    counted, unit = _standardised(evaluation)
    words = f"{len(counted)} coordinates of residuals{'' if scale > 0 else '; no sigma is stated'}"
    if len(counted) and scale > 0:
        beyond = 100 * float(np.mean(np.abs(counted) > 3 * scale))
        words = f"{beyond:.2f} % of {len(counted)} coordinates lie beyond 3 sigma; of a Gaussian 0.27 % do"
    return AxesDrawing(
        "Distribution against the Gaussian", words, lambda axes: _draw_histogram(axes, counted, unit, scale)
    )


def _standardised(evaluation: Evaluation) -> tuple[Array, str]:
    """All coordinates of residuals that count, in px, or of a weighted solution over their stated deviations."""
    calibration, errors = evaluation.calibration, evaluation.of("reprojection")
    if errors is None or errors.sighting is None:
        return np.zeros(0), "px"
    vector, covariance = errors.vector[errors.is_counted], calibration.observations.cov_px2
    if not calibration.weighted or covariance is None:
        return vector.ravel(), "px"
    whitener = whiteners(covariance[errors.sighting[errors.is_counted]])
    return whitened(whitener, vector.T).T.ravel(), "stated sigmas"


MOST_ARROWS = 1500
CONTRADICTED = 2.0
"""Cameras of halves that differ by so many of their standard deviations contradict these."""
NOTICEABLE = 1.5
"""The covered area is told apart if the whole image is so many times as uncertain."""
HISTOGRAM_IN = 3.2
"""How high the panel of a histogram is."""
run_figure = partial(figure_of, height_in=HISTOGRAM_IN)
"""A drawing as the page of a run shows it."""


def uncertainty_figure(
    calibration: Calibration, coverage: Coverage, found: SigmaMap, halves: HalvesApart | NoHalves
) -> Figure:
    """How uncertain the camera is at each pixel, and how much of that cameras of halves of the photos confirm."""
    drawing, inside = uncertainty_drawing(found), covered_words(calibration, coverage, found)
    caption = (
        "How far a direction may be shown from its true pixel, the rotation that fits the whole image best removed: "
        "what the noise of the photos leaves open"
    )
    if calibration.target_error is not None and calibration.target_error.param_covariance.any():
        caption += f", and what a target {made_words(calibration.target_error)} may be off"
    if calibration.image_field is not None:
        caption += ", and what it took of a field fixed in the image that the lens model does not follow"
    if calibration.capture_error is not None:
        caption += ", and what is alike in all photos (motion, focus, tilt)"
    if calibration.circle_doubt is not None:
        caption += ", and what it may be off if its points, of which nobody said what they are, are centres of circles"
    if found.is_map_exact:
        caption += "; the learned map is taken as exact, so the truth is larger"
    caption += f". {inside}" if inside else ""
    if found.end:
        caption += f". Grey: beyond {found.end}, where nothing is asked of it"
    elif found.known_share < 1:
        share = f", in {100 * (1 - found.known_share):.0f} % of the image" if math.isfinite(found.most_px) else ""
        caption += f". Grey: the model has no directions there{share}"
    return run_figure(drawing, f"{caption}. {halves_words(halves)}", f"{drawing.title}: {drawing.words}")


def covered_words(calibration: Calibration, coverage: Coverage, found: SigmaMap) -> str:
    """What the verdict says of the covered area, where the map says something else of it; "" if not."""
    if not found.is_known or not np.isfinite(calibration.stated_covariance).all():
        return ""
    within = share_px(sigma_over(Known(calibration.camera, calibration.stated_covariance), coverage))
    if not found.most_px > NOTICEABLE * within:
        return ""
    return (
        "What is open where nothing was seen moves that rotation, and so all of the map; where the target was seen, "
        f"its own rotation removed, 95 % is within {digits(within, 2)} px"
    )


def halves_words(halves: HalvesApart | NoHalves) -> str:
    """A sentence if cameras of halves of the photos contradict the stated standard deviations; "" if not."""
    if isinstance(halves, NoHalves) or halves.ratio < CONTRADICTED:
        return ""
    times = digits(halves.ratio, 2)
    return f"Cameras of halves differ {times} times as much as stated: the noise's part is {times} times that."


def coverage_figure(coverage: Coverage, checked: str = "") -> Figure:
    """Where observations are, and what the verdict's check says of it; "" where nobody judged."""
    hatched = "Where it is hatched, no photo shows the target: the lens is only extrapolated there."
    said = "" if coverage.share == 1 else hatched
    if not coverage.is_lit.all():
        said = f"{said} Black: not asked for. {coverage.remark}".lstrip()
    return run_figure(coverage_drawing(coverage, checked), said)


def residuals_figure(residuals: Residuals, rmse_px: float) -> Figure:
    """The residual of each observation."""
    drawing = residuals_drawing(residuals, rmse_px, MOST_ARROWS)
    return run_figure(drawing, "The arrow at the lower right gives the scale.")


def systematic_figure(drawing: AxesDrawing, checked: str = "") -> Figure:
    """The mean residuals, cell by cell, and what the verdict's check says of them; "" where nobody judged."""
    words = f"{drawing.words}{f': {checked}' if checked else ''}"
    return run_figure(replace(drawing, words=words), "Arrows are the mean residual of a cell, enlarged.")


SUBJECTS = {
    "reprojection": "how far an observation is from where the camera predicts it",
    "weighted": "how far an observation is from where the camera predicts it, in standard deviations that it states",
    "intersection": "how far the ray of an observation meets the target's plane from the point's place",
    "reconstruction": "how far a point is from where the rays of all photos that show it meet",
    "pose": "how far a photo's camera is from where it truly was",
    "rotation": "by how much a photo's camera is turned against how it truly was",
}
"""What an error of each metric is."""


def sizes_figure(metric: str, sizes: Array, unit: str) -> Figure:
    """A histogram of one metric's errors."""
    what = SUBJECTS.get(metric)
    return run_figure(sizes_drawing(metric, sizes, unit), f"An error is {what}." if what else "")


def apart_figure(title: str, found: Apart | HalvesApart, image_size: tuple[int, int], words: str) -> Figure:
    """How far two cameras lie apart over what the photos cover."""

    def draw(axes: "Axes") -> None:
        image_axes(axes, image_size)
        draw_map(axes, found.pixel, found.length_px, "px")

    return run_figure(AxesDrawing(title, words, draw, image_size, has_bar=True))


def apart_words(found: Apart | HalvesApart) -> str:
    """Where two cameras differ most, as a sentence without its full stop."""
    length = found.length_px
    row, column = np.unravel_index(np.nanargmax(length), length.shape)
    width, height = found.pixel[-1, -1] + found.pixel[0, 0]
    size = round(width + 1), round(height + 1)
    place = place_on_map(found.pixel, np.isfinite(length), (int(row), int(column)), size)
    most = float(np.nanmax(length))
    if most < LEAST_PX:
        return f"{capital(px(most))} everywhere"
    return f"95 % of the covered area differs by at most {px(found.percentile_95_px)}, the most is {px(most)} {place}"


MOST_DOTS, MANY_DOTS = 3000, 1500
COLOURS = (VERMILION, BLUE, GREEN, ORANGE)
SEEN = "#b4b4b4"
LABEL_APART = 0.05
"""Between numbers, of the image's width."""


def draw_next_views(
    axes: "Axes", image_size: tuple[int, int], views: Sequence[NextView], covered_pixels: Array
) -> None:
    """The outlines of the proposed views, numbered from 1, over the sightings so far."""
    image_axes(axes, image_size)
    axes.set_facecolor("white")
    count = len(covered_pixels)
    rows = np.arange(count) if count <= MOST_DOTS else np.linspace(0, count - 1, MOST_DOTS).astype(np.int64)
    axes.plot(
        *covered_pixels[rows].T, "o", color=SEEN, markersize=4 if count < MANY_DOTS else 2.5, markeredgewidth=0,
        zorder=1, rasterized=True,
    )  # fmt: skip
    labels: list[Array] = []
    for number, view in enumerate(views, start=1):
        _draw_one(axes, number, view, labels, LABEL_APART * image_size[0])


def _draw_one(axes: "Axes", number: int, view: NextView, labels: list[Array], apart_px: float) -> None:
    """One target's faces in one colour, and its number in their middle, beside the numbers that are there already."""
    colour = COLOURS[(number - 1) % len(COLOURS)]
    for line in view.outline_px:
        axes.fill(*line.T, facecolor=colour, alpha=0.08, linewidth=0, zorder=2)
        axes.plot(*line.T, color=colour, linewidth=2.2 if len(view.outline_px) == 1 else 1.4, zorder=3)
    if not view.outline_px:
        return
    points = np.concatenate(view.outline_px)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    while any(np.hypot(*(middle - other)) < apart_px for other in labels):
        middle = middle + np.array([0.0, apart_px])
    labels.append(middle)
    axes.annotate(
        str(number), middle, ha="center", va="center", fontsize=14, fontweight="bold", color=PALE, zorder=4,
        bbox={"boxstyle": "circle,pad=0.3", "facecolor": colour, "edgecolor": PALE, "linewidth": 1.5},
    )  # fmt: skip


def next_views_figure(seen: Observations, proposed: Sequence[NextView], area: str = "image") -> Figure:
    """Where to hold the target in the next photos."""
    count = "One more photo" if len(proposed) == 1 else f"{len(proposed)} more photos"
    last = proposed[-1]
    words = f"{count} would bring 95 % of the {area} within about {digits(last.sigma_px_after, 1)} px (1 sigma)"
    if last.covered_after > proposed[0].covered_before:
        words += f" and the coverage to {100 * last.covered_after:.0f} %"
    words += ", if the lens is as estimated"
    return run_figure(
        AxesDrawing(
            "Where to hold the target next", words,
            lambda axes: draw_next_views(axes, seen.image_size, proposed, seen.center_px), seen.image_size,
        ),
        "Grey: points seen so far. Numbered: outlines of the target in the next photos.",
    )  # fmt: skip
