"""At which size of one error a target becomes worse than another, a panel for each main quantity."""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.style import BLUE, INK, ORANGE, VERMILION, note
from calib.studies.tolerance.crossover import Crossover
from calib.studies.tolerance.figure_parts import amount_label, heading, human_size, open_sides
from calib.studies.tolerance.figure_ranking import TITLES
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import MAIN, NEVER, Against, ToleranceReport, of_name
from calib.studies.tolerance.tables import size_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT_PX, COLUMNS = 920, 4
POINTS = 200
WIDEST = 20.0


def draw_crossover(page: "Figure", report: ToleranceReport, against: Against) -> None:
    """Both targets over the amount of the varied source; all other errors are as assumed.

    Args:
        page: an empty figure.
        report: of the target that is varied.
        against: the other, with a source to vary.
    """
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_panel(place, report, against, name)
    heading(page, f"How large may {against.vary} be before {report.name} is worse than {against.name}?")
    page.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)


def _draw_panel(axes: "Axes", report: ToleranceReport, against: Against, name: str) -> None:
    errors, source, row = report.table.errors, against.vary, quantity_row(name)
    found, unit = against.of(source, name), of_name(name).unit
    sigma = errors.amount(source).sigma
    size = human_size(errors, source)
    cost, low, high = (
        float(getattr(report.table.cost, end)[report.table.sources.index(source), row])
        for end in ("value", "low", "high")
    )
    factor = found.amount / sigma
    crosses = found.verdict == "crosses" and factor <= NEVER
    widest = min(max(2.0, 1.5 * factor), WIDEST) if crosses else 2.0
    at = np.linspace(0, widest, POINTS)
    axes.fill_between(at * size, np.hypot(found.own, at * low), np.hypot(found.own, at * high), color=BLUE, alpha=0.25)
    axes.plot(at * size, np.hypot(found.own, at * cost), color=BLUE, linewidth=2.4, label=report.name)
    base, together = against.table.baseline, against.table.together
    axes.axhspan(
        math.hypot(float(base.low[row]), float(together.low[row])),
        math.hypot(float(base.high[row]), float(together.high[row])),
        color=ORANGE, alpha=0.3, linewidth=0,
    )  # fmt: skip
    axes.axhline(found.other, color=ORANGE, linewidth=2.4, label=against.name)
    axes.axvline(size, color=INK, linestyle=":", linewidth=1.4, label="assumed")
    if crosses and factor <= widest:
        axes.plot([factor * size], [found.other], marker="o", markersize=10, color=VERMILION, linestyle="")
    axes.set_xlim(0, widest * size)
    axes.set_ylim(0, 1.15 * max(float(np.hypot(found.own, widest * cost)), found.other))
    axes.locator_params(axis="x", nbins=5)
    axes.set_title(TITLES[name])
    axes.set_xlabel(f"{source}: {amount_label(errors, source)}")
    axes.set_ylabel(unit)
    note(axes, _verdict(report, found, source))
    open_sides(axes)


def _verdict(report: ToleranceReport, found: Crossover, source: str) -> str:
    """The panel in a few words."""
    errors = report.table.errors
    if found.verdict == "loses at zero":
        return f"worse even without {source}"
    factor = found.amount / errors.amount(source).sigma
    if factor > NEVER:
        return "never worse by this"
    return f"worse from {size_in_words(errors, source, factor)} on"
