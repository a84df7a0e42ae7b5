"""The pictures of a bootstrap study: histograms of its errors, correlations of parameters, and sigma over views."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.style import BLUE, DEEP, EMPTY, GREEN, GREY, ORANGE, PALE, VERMILION, WIDTH_PX, bar_beside, nothing
from calib.figures.style import note as remark
from calib.show.studies import study_folder
from calib.show.studies.histograms_figure import draw_histograms, histograms_height_px
from calib.show.studies.study_tables import setting_in_words, unit_words
from calib.studies.paper_table import paper_value
from calib.studies.statistics import (
    METRICS,
    Array,
    Case,
    CaseSummary,
    Correlations,
    Metric,
    predicted_correlations,
)
from calib.studies.study_table import StudyCases, StudyTable
from designer.base.words import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

NOT_IN_NAMES = re.compile(r"[^a-z0-9]+")
CONVERGENCE_PX, HEAD_PX = 1050, 160
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, GREY)
"""Of targets."""
MARKERS, STYLES = ("o", "s", "^", "D"), ("-", "--", "-.", ":")
"""Of ways of sampling."""
DARK = 0.6
"""Correlations beyond this have white numbers."""


def study_figures(cases: StudyCases, table: StudyTable, folder: Path) -> dict[Path, bytes]:
    """All pictures of a study.

    Args:
        cases: its samples.
        table: what they say.
        folder: where the pictures are to lie.
    """
    files: dict[Path, bytes] = {}
    for setting in table.settings:
        label = slug("_".join(setting))
        chosen = [one for one in table.cases if one.case.setting == setting]
        draw = partial(draw_histograms, cases=[(one, cases.samples[one.case]) for one in chosen])
        columns = len({one.case.target for one in chosen})
        files |= study_folder.files_of(folder / f"histograms{label}", histograms_height_px(columns), draw)
        pairs = _pairs(cases, [one.case for one in chosen])
        if pairs:
            height_px = round(HEAD_PX + (WIDTH_PX - 180) / max(len(pairs), 2))
            place = folder / f"correlations{label}"
            files |= study_folder.files_of(place, height_px, partial(draw_correlations, pairs=pairs))
    for sightings in dict.fromkeys(one.case.sightings for one in table.cases):
        files |= convergence_files([one for one in table.cases if one.case.sightings == sightings], folder)
    return files


def slug(label: str) -> str:
    """A label as a part of a file's name."""
    slug = NOT_IN_NAMES.sub("_", label.lower()).strip("_")
    return f"_{slug}" if slug else ""


def convergence_files(summaries: Sequence[CaseSummary], folder: Path) -> dict[Path, bytes]:
    """Sigma over the number of views, of cases that count the same observations; nothing of one number only."""
    if len({one.case.size for one in summaries}) < 2:
        return {}
    place = folder / f"sigma{slug(summaries[0].case.sightings)}"
    return study_folder.files_of(place, CONVERGENCE_PX, partial(draw_convergence, summaries=summaries))


@dataclass(frozen=True, eq=False)
class Pair:
    """The correlations of the samples of a case, and those that the solution of all its views predicts."""

    case: Case
    found: Correlations
    predicted: Correlations | None = None


def _pairs(cases: StudyCases, chosen: Sequence[Case]) -> list[Pair]:
    """Of each target's case with the most views, which is the closest to linear, if its parameters vary."""
    pairs = []
    for target in dict.fromkeys(case.target for case in chosen):
        case = max((case for case in chosen if case.target == target), key=lambda case: case.size)
        covariance = cases.covariance.get(case.pool_key)
        stated = None if covariance is None else predicted_correlations(covariance, cases.names)
        if (found := cases.together(case)).strongest is not None:
            pairs.append(Pair(case, found, stated))
    return pairs


def draw_correlations(page: "Figure", pairs: Sequence[Pair]) -> None:
    """A matrix a target; one or more."""
    axes = page.subplots(1, len(pairs), squeeze=False)[0]
    for place, pair in zip(axes, pairs, strict=True):
        shown = _draw_matrix(place, pair)
    bar_beside(axes[-1], shown, "correlation")
    page.suptitle("Correlations of the camera's parameters", fontsize=15, fontweight="bold", x=0.01, ha="left")


def _draw_matrix(axes: "Axes", pair: Pair) -> "ScalarMappable":
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("signed", [BLUE, "white", VERMILION]).with_extremes(bad=EMPTY)
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
            colour = PALE if abs(value) > DARK else DEEP
            text = f"{round(value, 2) + 0.0:.2f}"
            axes.text(column, row, text, ha="center", va="center", color=colour, fontsize=11)
    samples = f"{pair.found.count} converged samples"
    axes.set_xlabel(f"of {samples}" if pair.predicted is None else f"below the diagonal: {samples}; above: predicted")
    ties = "no two parameters vary"
    if pair.found.strongest is not None:
        first, second, strength = pair.found.strongest
        ties = f"strongest {first.removesuffix('_px')} with {second.removesuffix('_px')}: {strength:.3f}"
    remark(axes, f"root mean square {pair.found.root_mean_square:.2f}; {ties}")
    return shown


def merged(pair: Pair) -> Array:
    """The correlations found below the diagonal, above it those predicted, or else found too.  # (P, P)"""
    above = pair.found.matrix if pair.predicted is None else pair.predicted.matrix
    matrix = np.where(np.tri(len(above), dtype=np.bool_), pair.found.matrix, above)
    # A parameter is always tied to itself: full colour there would outshine what matters.
    np.fill_diagonal(matrix, np.nan)
    return matrix


def draw_convergence(page: "Figure", summaries: Sequence[CaseSummary]) -> None:
    """A panel a metric, double logarithmic: ours, the paper's, and what 1/sqrt(N) would be.

    Args:
        page: an empty figure.
        summaries: that count the same observations, of two or more sizes.
    """
    axes = page.subplots(2, 2).ravel()
    for place, metric in zip(axes, METRICS, strict=True):
        _draw_panel(place, metric, summaries)
    sightings = summaries[0].case.sightings
    of = f" ({printable(sightings)})" if sightings else ""
    title = f"Standard deviation of the errors over the number of views{of}; bars: standard error"
    page.suptitle(title, fontsize=15, fontweight="bold", x=0.01, ha="left")
    known = {label: handle for one in axes for handle, label in zip(*one.get_legend_handles_labels(), strict=True)}
    page.legend(known.values(), known.keys(), loc="outside lower center", ncols=4, frameon=False, handlelength=3.2)


def _draw_panel(axes: "Axes", metric: Metric, summaries: Sequence[CaseSummary]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_title(f"{metric.name.capitalize()} error")
    axes.set_xlabel("N, views of a sample")
    axes.set_ylabel(f"σ in {unit_words(metric)}")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
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
        nothing(axes, "no case has a standard deviation")
        return
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
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
    axes.plot(sizes, guide, color=GREY, linewidth=1.2, linestyle=(0, (1, 2)), label="1/√N through the largest N")
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
