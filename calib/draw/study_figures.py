"""The pictures of a bootstrap study: histograms of its errors, correlations of parameters, and sigma over views."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.draw import style
from calib.draw.study_tables import setting_in_words, unit_words
from calib.studies.samples import Case
from calib.studies.statistics import (
    METRICS,
    CaseSummary,
    Correlations,
    Distribution,
    Metric,
    SampleArrays,
    paper_value,
    predicted_correlations,
)
from calib.studies.study_table import StudyCases
from designer.base.arrays import Array
from designer.base.words import figure, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

NOT_IN_NAMES = re.compile(r"[^a-z0-9]+")
CONVERGENCE_PX, HEAD_PX = 1050, 160
COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.ORANGE, style.GREY)
"""Of targets."""
MARKERS, STYLES = ("o", "s", "^", "D"), ("-", "--", "-.", ":")
"""Of ways of sampling."""
DARK = 0.6
"""Correlations beyond this have white numbers."""
PANEL_PX, HISTOGRAM_HEAD_PX = 330, 130
SKY, PURPLE = "#56B4E9", "#CC79A7"
SIZE_COLOURS = (style.VERMILION, style.ORANGE, style.BLUE, style.GREEN, PURPLE, SKY, style.GREY)
"""Of sizes, from the smallest up; all by Okabe and Ito, as the style's."""
EDGE_PERCENT = 0.2
"""Of the samples of a case that may lie beyond either end of the axis."""
QUARTILES_PER_SIGMA = 1.349
"""Distance of a Gaussian's quartiles: a spread that lost samples do not set."""
BINS_PER_SIGMA, FEWEST_BINS, MOST_BINS = 3.0, 24, 140
LARGEST = 1e300
ROOM = 0.12
"""Of the panel's height for the interval of one size."""


def slug(label: str) -> str:
    """A label as a part of a file's name."""
    slug = NOT_IN_NAMES.sub("_", label.lower()).strip("_")
    return f"_{slug}" if slug else ""


@dataclass(frozen=True, eq=False)
class Pair:
    """The correlations of the samples of a case, and those that the solution of all its views predicts."""

    case: Case
    found: Correlations
    predicted: Correlations | None = None


def pairs_of(cases: StudyCases, chosen: Sequence[Case]) -> list[Pair]:
    """Of each target's case with the most views, which is the closest to linear, if its parameters vary."""
    pairs = []
    for target in dict.fromkeys(case.target for case in chosen):
        case = max((case for case in chosen if case.target == target), key=lambda case: case.size)
        covariance = cases.covariance.get(case.pool_key)
        stated = None if covariance is None else predicted_correlations(covariance, cases.names)
        if (found := cases.together(case)).strongest is not None:
            pairs.append(Pair(case, found, stated))
    return pairs


def correlations_height_px(count: int) -> int:
    """Of square matrices side by side."""
    return round(HEAD_PX + (style.WIDTH_PX - 180) / max(count, 2))


def draw_correlations(page: "Figure", pairs: Sequence[Pair]) -> None:
    """A matrix a target; one or more."""
    axes = page.subplots(1, len(pairs), squeeze=False)[0]
    for place, pair in zip(axes, pairs, strict=True):
        shown = _draw_matrix(place, pair)
    style.bar_beside(axes[-1], shown, "correlation")
    style.heading(page, "Correlations of the camera's parameters")


def _draw_matrix(axes: "Axes", pair: Pair) -> "ScalarMappable":
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("signed", [style.BLUE, "white", style.VERMILION]).with_extremes(
        bad=style.EMPTY
    )
    matrix, names = merged(pair), [name.removesuffix("_px") for name in pair.found.names]
    shown = axes.imshow(matrix, cmap=colours, vmin=-1, vmax=1)
    axes.set_xticks(range(len(names)), names)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    case = pair.case
    setting = f", {setting_in_words(case.setting)}" if any(case.setting) else ""
    axes.set_title(f"{printable(case.target)}, N = {case.size}{setting}")
    for (row, column), value in np.ndenumerate(matrix):
        if np.isfinite(value):
            colour = style.PALE if abs(value) > DARK else style.DEEP
            text = f"{round(value, 2) + 0.0:.2f}"
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=11)
    samples = f"{pair.found.count} converged samples"
    axes.set_xlabel(f"of {samples}" if pair.predicted is None else f"below the diagonal: {samples}; above: predicted")
    ties = "no two parameters vary"
    if pair.found.strongest is not None:
        first, second, strength = pair.found.strongest
        ties = f"strongest {first.removesuffix('_px')} with {second.removesuffix('_px')}: {strength:.3f}"
    style.note(axes, f"root mean square {pair.found.root_mean_square:.2f}; {ties}")
    return shown


def merged(pair: Pair) -> Array:
    """The correlations found below the diagonal, above it those predicted, or else found too.  # (P, P)"""
    above = pair.found.matrix if pair.predicted is None else pair.predicted.matrix
    matrix = np.where(np.tri(len(above), dtype=np.bool_), pair.found.matrix, above)
    # A parameter is always tied to itself: full colour there would outshine what matters.
    np.fill_diagonal(matrix, np.nan)
    return matrix


def draw_convergence(page: "Figure", summaries: Sequence[CaseSummary]) -> None:
    """A panel a metric, double logarithmic: ours, the paper's, and what 1/sqrt(N) would be."""
    axes = page.subplots(2, 2).ravel()
    for place, metric in zip(axes, METRICS, strict=True):
        _draw_panel(place, metric, summaries)
    sightings = summaries[0].case.sightings
    of = f" ({printable(sightings)})" if sightings else ""
    style.heading(page, f"Standard deviation of the errors over the number of views{of}; bars: standard error")
    style.legend_below(page, axes, 4, handle_length=3.2)


def _draw_panel(axes: "Axes", metric: Metric, summaries: Sequence[CaseSummary]) -> None:
    from matplotlib.ticker import NullFormatter

    axes.set_title(f"{metric.name.capitalize()} error")
    style.open_axes(axes, "N, views of a sample", f"σ in {unit_words(metric)}")
    sizes = sorted({one.case.size for one in summaries})
    samplings = list(dict.fromkeys(one.case.sampling for one in summaries))
    is_drawn = []
    for number, target in enumerate(dict.fromkeys(one.case.target for one in summaries)):
        colour = COLOURS[number % len(COLOURS)]
        for place, sampling in enumerate(samplings):
            chosen = [one for one in summaries if (one.case.target, one.case.sampling) == (target, sampling)]
            is_drawn.append(_draw_series(axes, metric, sorted(chosen, key=lambda one: one.case.size), colour, place))
        _draw_paper(axes, metric, target, sizes, colour)
    if not any(is_drawn):
        style.nothing(axes, "no case has a standard deviation")
        return
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.xaxis.set_minor_formatter(NullFormatter())
    style.log_axis(axes.yaxis)
    axes.grid(visible=True, which="major", color="#e4e4e4", linewidth=0.8)
    axes.set_axisbelow(True)


def _draw_series(axes: "Axes", metric: Metric, cases: Sequence[CaseSummary], colour: str, place: int) -> bool:
    """One target in one way of sampling; whether there was anything to draw."""
    found = [(one.case.size, one.of(metric.name)) for one in cases]
    known = [(size, one) for size, one in found if 0 < one.sigma < math.inf]
    if not known:
        return False
    sizes = np.array([size for size, _ in known], dtype=np.float64)
    sigma = np.array([metric.in_paper_units(one.sigma) for _, one in known])
    error = np.array([metric.in_paper_units(one.sigma_error) for _, one in known])
    case = cases[0].case
    guide = sigma[-1] * np.sqrt(sizes[-1] / sizes)
    axes.plot(sizes, guide, color=style.GREY, linewidth=1.2, linestyle=(0, (1, 2)), label="1/√N through the largest N")
    axes.errorbar(
        sizes, sigma, np.minimum(error, 0.99 * sigma), color=colour, linewidth=2.2, capsize=4, markersize=8,
        marker=MARKERS[place % len(MARKERS)], linestyle=STYLES[place % len(STYLES)],
        label=printable(case.target) + (f", {printable(case.sampling)}" if case.sampling else ""),
    )  # fmt: skip
    return True


def _draw_paper(axes: "Axes", metric: Metric, target: str, sizes: Sequence[int], colour: str) -> None:
    """The paper's standard deviations, if it has this target."""
    known = [(size, value.sigma) for size in sizes if (value := paper_value(target, metric.name, size)) is not None]
    if known:
        axes.plot(
            [size for size, _ in known], [sigma for _, sigma in known], linestyle="", marker="P", markersize=15,
            zorder=4, markerfacecolor="none", markeredgecolor=colour, markeredgewidth=1.8, label=f"{target}, paper",
        )  # fmt: skip


def histograms_height_px(columns: int) -> int:
    """As high as a row a metric needs; a single column has room for lower panels."""
    return HISTOGRAM_HEAD_PX + len(METRICS) * (PANEL_PX if columns > 1 else PANEL_PX - 20)


def draw_histograms(page: "Figure", cases: Sequence[tuple[CaseSummary, SampleArrays]]) -> None:
    """A row a metric, a column a target, all sizes in one panel."""
    targets = list(dict.fromkeys(one.case.target for one, _ in cases))
    sizes = sorted({one.case.size for one, _ in cases})
    axes = page.subplots(len(METRICS), len(targets), squeeze=False)
    for column, target in enumerate(targets):
        chosen = sorted((pair for pair in cases if pair[0].case.target == target), key=lambda pair: pair[0].case.size)
        for row, metric in enumerate(METRICS):
            drawn = [(samples.metrics[:, metric.column], one, sizes.index(one.case.size)) for one, samples in chosen]
            _draw_errors(axes[row, column], metric, target, drawn)
    first = cases[0][0].case.setting
    setting = f" ({setting_in_words(first)})" if any(first) else ""
    of = f"Bootstrap errors{setting}: samples and fitted Gaussians"
    style.heading(page, f"{of}. Bars: 95 % of a Gaussian; ticks: of the samples")


def _draw_errors(axes: "Axes", metric: Metric, target: str, drawn: list[tuple[Array, CaseSummary, int]]) -> None:
    """One metric of one target: samples (S,), their statistics, and the place of the colour."""
    axes.set_title(f"{printable(target)}: {metric.name} error")
    style.open_axes(axes, f"{metric.name} error in {unit_words(metric)}", "share of samples, %")
    # Beyond that they have no difference, or none in the paper's unit.
    scaled = [metric.in_paper_units(1.0) * values[np.abs(values) < LARGEST] for values, _, _ in drawn]
    if not any(len(values) for values in scaled):
        style.nothing(axes, "no sample has this error")
        return
    found = [one.of(metric.name) for _, one, _ in drawn]
    edges = _edges(scaled)
    top = 0.0
    for values, one, (_, summary, place) in zip(scaled, found, drawn, strict=True):
        if len(values):
            top = max(
                top,
                _draw_case(
                    axes, edges, values, metric, one, summary.case.size, SIZE_COLOURS[place % len(SIZE_COLOURS)]
                ),
            )
    scale = 1 + ROOM * (len(drawn) + 0.5)
    for row, (one, (_, _, place)) in enumerate(zip(found, drawn, strict=True)):
        height = top * (1 + ROOM * (len(drawn) - row))
        _draw_interval(axes, height, metric, one, SIZE_COLOURS[place % len(SIZE_COLOURS)])
    axes.set_xlim(edges[0], edges[-1])
    axes.locator_params(axis="x", nbins=6)  # numbers of many digits must not run into each other
    axes.set_ylim(0, top * scale)
    style.note(axes, _remark(scaled, edges, [summary for _, summary, _ in drawn], found))
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
    label = f"N = {size}: {found.shape}\nµ {figure(mu, 3)}  σ {figure(sigma, 2)}"
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
    axes.plot(
        [left, right], [height, height], linestyle="", marker="|", markersize=13, markeredgewidth=1.8, color=style.INK
    )


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
