"""Histograms of a study's errors with the Gaussians fitted to them, as in the paper."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure as digits
from calib.figures.style import BLUE, GREEN, GREY, INK, ORANGE, VERMILION, note, nothing
from calib.show.studies.study_tables import setting_in_words, unit_words
from calib.studies.statistics import METRICS, Array, CaseSummary, Distribution, Metric, SampleArrays
from designer.base.words import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL_PX, HEAD_PX = 330, 130
SKY, PURPLE = "#56B4E9", "#CC79A7"
COLOURS = (VERMILION, ORANGE, BLUE, GREEN, PURPLE, SKY, GREY)
"""Of sizes, from the smallest up; all by Okabe and Ito, as the style's."""
EDGE_PERCENT = 0.2
"""Of the samples of a case that may lie beyond either end of the axis."""
QUARTILES_PER_SIGMA = 1.349
"""Distance of a Gaussian's quartiles: a spread that lost samples do not set."""
BINS_PER_SIGMA, FEWEST_BINS, MOST_BINS = 3.0, 24, 140
LARGEST = 1e300
ROOM = 0.12
"""Of the panel's height for the interval of one size."""


def histograms_height_px(columns: int) -> int:
    """As high as a row a metric needs; a single column has room for lower panels."""
    return HEAD_PX + len(METRICS) * (PANEL_PX if columns > 1 else PANEL_PX - 20)


def draw_histograms(page: "Figure", cases: Sequence[tuple[CaseSummary, SampleArrays]]) -> None:
    """A row a metric, a column a target, all sizes in one panel.

    Args:
        page: an empty figure.
        cases: of one way of sampling and counting.
    """
    targets = list(dict.fromkeys(one.case.target for one, _ in cases))
    sizes = sorted({one.case.size for one, _ in cases})
    axes = page.subplots(len(METRICS), len(targets), squeeze=False)
    for column, target in enumerate(targets):
        chosen = sorted((pair for pair in cases if pair[0].case.target == target), key=lambda pair: pair[0].case.size)
        for row, metric in enumerate(METRICS):
            drawn = [(samples.metrics[:, metric.column], one, sizes.index(one.case.size)) for one, samples in chosen]
            _draw_panel(axes[row, column], metric, target, drawn)
    first = cases[0][0].case.setting
    setting = f" ({setting_in_words(first)})" if any(first) else ""
    page.suptitle(
        f"Bootstrap errors{setting}: samples and fitted Gaussians. Bars: 95 % of a Gaussian; ticks: of the samples",
        fontsize=15, fontweight="bold", x=0.01, ha="left",
    )  # fmt: skip


def _draw_panel(axes: "Axes", metric: Metric, target: str, drawn: list[tuple[Array, CaseSummary, int]]) -> None:
    """One metric of one target: samples (S,), their statistics, and the place of the colour."""
    axes.set_title(f"{printable(target)}: {metric.name} error")
    axes.set_xlabel(f"{metric.name} error in {unit_words(metric)}")
    axes.set_ylabel("share of samples, %")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    # Beyond that they have no difference, or none in the paper's unit.
    scaled = [metric.in_paper_units(1.0) * values[np.abs(values) < LARGEST] for values, _, _ in drawn]
    if not any(len(values) for values in scaled):
        nothing(axes, "no sample has this error")
        return
    found = [one.of(metric.name) for _, one, _ in drawn]
    edges = _edges(scaled)
    top = 0.0
    for values, one, (_, summary, place) in zip(scaled, found, drawn, strict=True):
        if len(values):
            top = max(
                top, _draw_case(axes, edges, values, metric, one, summary.case.size, COLOURS[place % len(COLOURS)])
            )
    scale = 1 + ROOM * (len(drawn) + 0.5)
    for row, (one, (_, _, place)) in enumerate(zip(found, drawn, strict=True)):
        height = top * (1 + ROOM * (len(drawn) - row))
        _draw_interval(axes, height, metric, one, COLOURS[place % len(COLOURS)])
    axes.set_xlim(edges[0], edges[-1])
    axes.locator_params(axis="x", nbins=6)  # numbers of many digits must not run into each other
    axes.set_ylim(0, top * scale)
    note(axes, _remark(scaled, edges, [summary for _, summary, _ in drawn], found))
    axes.legend(
        loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, handlelength=1.2, borderaxespad=0.2, fontsize=10
    )


def _edges(scaled: list[Array]) -> Array:
    """Bins for all sizes of a panel, fine enough for the narrowest, over all but the wildest samples."""
    ends = [np.percentile(values, [EDGE_PERCENT, 100 - EDGE_PERCENT]) for values in scaled if len(values)]
    low, high = min(float(pair[0]) for pair in ends), max(float(pair[1]) for pair in ends)
    pad = 0.04 * (high - low) or max(1e-3 * abs(high), 1e-9)
    low, high = low - pad, high + pad
    spreads = [float(np.subtract(*np.percentile(values, [75, 25]))) for values in scaled if len(values)]
    narrowest = min((spread / QUARTILES_PER_SIGMA for spread in spreads if spread > 0), default=high - low)
    bins = min(max(round(BINS_PER_SIGMA * (high - low) / narrowest), FEWEST_BINS), MOST_BINS)
    return np.linspace(low, high, bins + 1)


def _draw_case(
    axes: "Axes", edges: Array, values: Array, metric: Metric, found: Distribution, size: int, colour: str
) -> float:
    """Histogram and Gaussian of one size; returns how high they are."""
    share = 100 * np.histogram(values, edges)[0] / len(values)
    mu, sigma = metric.in_paper_units(found.mu), metric.in_paper_units(found.sigma)
    label = f"N = {size}: {found.shape}\nµ {digits(mu, 3)}  σ {digits(sigma, 2)}"
    axes.stairs(share, edges, fill=True, color=colour, alpha=0.35)
    if not 0 < sigma < LARGEST:
        axes.plot([], [], color=colour, linewidth=2.4, label=label)
        return float(share.max())
    at = np.linspace(edges[0], edges[-1], 500)
    gauss = 100 * (edges[1] - edges[0]) * np.exp(-0.5 * ((at - mu) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    axes.plot(at, gauss, color=colour, linewidth=2.4, label=label)
    return float(max(share.max(), gauss.max()))


def _draw_interval(axes: "Axes", height: float, metric: Metric, found: Distribution, colour: str) -> None:
    """The intervals of one size above the histograms: a bar with a point at the mean, ticks at the percentiles."""
    ends = (found.fit_low, found.fit_high, found.percentile_low, found.percentile_high, found.mu)
    low, high, left, right, mu = map(metric.in_paper_units, ends)
    if not np.isfinite([low, high]).all():
        return
    axes.plot([low, high], [height, height], color=colour, linewidth=4, solid_capstyle="butt")
    axes.plot([mu], [height], marker="o", markersize=6, color=colour, markeredgecolor="white")
    axes.plot([left, right], [height, height], linestyle="", marker="|", markersize=13, markeredgewidth=1.8, color=INK)


def _remark(scaled: list[Array], edges: Array, summaries: list[CaseSummary], found: list[Distribution]) -> str:
    """How many samples, and which of them the panel does not show or are not to be trusted."""
    samples = sum(one.samples for one in summaries)
    beyond = sum(int(((values < edges[0]) | (values > edges[-1])).sum()) for values in scaled)
    parts = [f"{samples} samples"]
    for status in ("stopped", "degenerate", "failed"):
        count = sum(dict(one.statuses)[status] for one in summaries)
        parts += [f"{count} {status}"] if count else []
    undefined = sum(one.without for one in found) - sum(one.failed for one in summaries)
    parts += [f"{undefined} without this error"] if undefined > 0 else []
    parts += [f"{beyond} beyond the axis"] if beyond else []
    return ", ".join(parts)
