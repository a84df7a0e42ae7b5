"""How the standard deviations of a study's errors fall with the number of views."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.style import BLUE, GREEN, GREY, ORANGE, VERMILION, nothing
from calib.studies.figure_histograms import unit_of
from calib.studies.paper_table import paper_value
from calib.studies.statistics import METRICS, CaseSummary, Metric
from designer.base.words import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = (BLUE, VERMILION, GREEN, ORANGE, GREY)
"""Of targets."""
MARKERS, STYLES = ("o", "s", "^", "D"), ("-", "--", "-.", ":")
"""Of ways of sampling."""


def convergence_height_px() -> int:
    """As high as two rows of panels need."""
    return 1050


def draw_convergence(page: "Figure", summaries: Sequence[CaseSummary]) -> None:
    """A panel a metric, double logarithmic: ours, the paper's, and what 1/sqrt(N) would be.

    Args:
        page: an empty figure.
        summaries: that count the same sightings, of two or more sizes.
    """
    axes = page.subplots(2, 2)
    for place, metric in zip(axes.ravel(), METRICS, strict=True):
        _draw_panel(place, metric, summaries)
    sightings = summaries[0].case.sightings
    of = f" ({printable(sightings)})" if sightings else ""
    page.suptitle(
        f"Standard deviation of the errors over the number of views{of}; bars: standard error",
        fontsize=15,
        fontweight="bold",
        x=0.01,
        ha="left",
    )
    known = {
        label: handle for one in axes.ravel() for handle, label in zip(*one.get_legend_handles_labels(), strict=True)
    }
    page.legend(known.values(), known.keys(), loc="outside lower center", ncols=4, frameon=False, handlelength=3.2)


def _draw_panel(axes: "Axes", metric: Metric, summaries: Sequence[CaseSummary]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_title(f"{metric.name.capitalize()} error")
    axes.set_xlabel("N, views of a sample")
    axes.set_ylabel(f"σ in {unit_of(metric)}")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    targets = list(dict.fromkeys(one.case.target for one in summaries))
    samplings = list(dict.fromkeys(one.case.sampling for one in summaries))
    falls = []
    for number, target in enumerate(targets):
        colour = COLOURS[number % len(COLOURS)]
        for place, sampling in enumerate(samplings):
            chosen = [one for one in summaries if (one.case.target, one.case.sampling) == (target, sampling)]
            falls += [_draw_series(axes, metric, sorted(chosen, key=lambda one: one.case.size), colour, place)]
        _draw_paper(axes, metric, target, sorted({one.case.size for one in summaries}), colour)
    if not any(falls):
        nothing(axes, "no case has a standard deviation")
        return
    axes.set_xscale("log")
    axes.set_yscale("log")
    sizes = sorted({one.case.size for one in summaries})
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
    name = printable(case.target) + (f", {printable(case.sampling)}" if case.sampling else "")
    guide = sigma[-1] * np.sqrt(sizes[-1] / sizes)
    axes.plot(sizes, guide, color=GREY, linewidth=1.2, linestyle=(0, (1, 2)), label="1/√N through the largest N")
    axes.errorbar(
        sizes, sigma, np.minimum(error, 0.99 * sigma), color=colour, linewidth=2.2, capsize=4, markersize=8,
        marker=MARKERS[place % len(MARKERS)], linestyle=STYLES[place % len(STYLES)], label=name,
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
