"""What one source costs over its amount, a panel for each source, double logarithmic."""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.style import BLUE, EMPTY, GREEN, GREY, INK, VERMILION
from calib.studies.tolerance.budget import Budget
from calib.studies.tolerance.figure_parts import amount_label, heading, human_size, open_sides, plain_log_axis
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import ToleranceReport, of_name
from calib.studies.tolerance.sweep import FACTORS, Sweep
from designer.base.words import capital
from designer.tolerance.registry import SOURCES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
HEAD_PX, PANEL_PX = 150, 300
EDGE = 1.4
BELOW = 0.1


def swept_sources(report: ToleranceReport, quantity: str) -> tuple[str, ...]:
    """The sources that cost a quantity more than a tenth of the noise at some amount that is shown, largest first."""
    row = quantity_row(quantity)
    least = BELOW * float(report.linear.baseline.value[row]) / FACTORS[-1]
    cost = report.linear.cost.value[:, row]
    return tuple(
        name for name in report.linear.ranking(quantity) if cost[report.linear.sources.index(name)] > max(least, 0.0)
    )


def sweeps_height_px(report: ToleranceReport, quantity: str) -> int:
    """As high as rows of four panels need."""
    return HEAD_PX + PANEL_PX * max(1, -(-len(swept_sources(report, quantity)) // COLUMNS))


def draw_sweeps(page: "Figure", report: ToleranceReport, quantity: str) -> None:
    """The panels of one quantity, all with the same scale of costs.

    Args:
        page: an empty figure.
        report: with a source that costs this quantity something.
        quantity: by its name.
    """
    names = swept_sources(report, quantity)
    rows = -(-len(names) // COLUMNS)
    axes = page.subplots(rows, COLUMNS, sharey=True, squeeze=False).ravel()
    budget = next((one.budget for one in report.budgets if one.budget.quantity == quantity), None)
    low, high = _cost_limits(report, quantity, names, budget)
    for place, name in zip(axes, names, strict=False):
        _draw_panel(place, report, quantity, name, budget)
        plain_log_axis(place, "y", low, high)
    for place in axes[len(names) :]:
        place.set_visible(False)
    one = of_name(quantity)
    for place in axes[::COLUMNS]:
        place.set_ylabel(f"cost in {one.unit}")
    how = "predicted" if not report.sweeps else "dots: draws with 95 %; line: prediction"
    heading(page, f"{capital(one.title)} by the size of each error: {report.name} ({how})")
    known = {label: handle for place in axes for handle, label in zip(*place.get_legend_handles_labels(), strict=True)}
    page.legend(known.values(), known.keys(), loc="outside lower center", ncols=7, frameon=False)


def _draw_panel(axes: "Axes", report: ToleranceReport, quantity: str, name: str, budget: Budget | None) -> None:
    errors, row = report.table.errors, quantity_row(quantity)
    size, noise = human_size(errors, name), float(report.table.baseline.value[row])
    line = float(report.linear.cost.value[report.linear.sources.index(name), row])
    ends = np.array([FACTORS[0] / EDGE, FACTORS[-1] * EDGE])
    reach = report.reach(name, quantity)
    if reach < ends[1]:
        axes.axvspan(
            max(reach, ends[0]) * size, ends[1] * size, color=EMPTY, alpha=0.6, label="prediction off by > 10 %"
        )
    axes.axhline(noise, color=VERMILION, linestyle="--", linewidth=1.6, label="noise alone")
    if budget is not None and budget.is_met_without:
        room = math.sqrt(budget.limit**2 - noise**2)
        axes.axhline(
            room, color=GREEN, linewidth=2, label=f"limit {budget.limit:g}{of_name(quantity).unit}, less the noise"
        )
    axes.plot(ends * size, ends * line, color=GREY, linewidth=1.8, label="prediction")
    axes.axvline(size, color=INK, linestyle=":", linewidth=1.4, label="assumed")
    for sweep in report.sweeps:
        if sweep.source == name:
            _draw_draws(axes, sweep, row, size)
    axes.set_title(name)
    axes.set_xlabel(f"{capital(SOURCES[name].title)}:\n{amount_label(errors, name)}")
    plain_log_axis(axes, "x", *(ends * size))
    axes.grid(visible=True, which="major", color=EMPTY, linewidth=0.8)
    axes.set_axisbelow(True)
    open_sides(axes)


def _draw_draws(axes: "Axes", sweep: Sweep, row: int, size: float) -> None:
    value, low, high = (getattr(sweep.cost, end)[:, row] for end in ("value", "low", "high"))
    x = sweep.factor * size
    sure = (value > 0) & (low > 0)
    spread = np.stack([value - low, high - value])[:, sure]
    axes.errorbar(
        x[sure], value[sure], spread, linestyle="", marker="o", markersize=6, color=BLUE, capsize=3, label="draws"
    )
    bounded = ~sure & (high > 0)
    if bounded.any():
        axes.plot(
            x[bounded], high[bounded], linestyle="", marker="v", markersize=8, markerfacecolor="none", color=BLUE,
            label="draws: less than",
        )  # fmt: skip


def _cost_limits(
    report: ToleranceReport, quantity: str, names: tuple[str, ...], budget: Budget | None
) -> tuple[float, float]:
    """The scale of all panels: from below the noise, or the smallest cost, to the largest."""
    row = quantity_row(quantity)
    noise = float(report.table.baseline.value[row])
    cost = np.array([float(report.linear.cost.value[report.linear.sources.index(name), row]) for name in names])
    low = max(min(noise, FACTORS[0] * float(cost.min())), BELOW * noise) / EDGE
    drawn = [one.cost.high[:, row] for one in report.sweeps if one.source in names]
    high = EDGE * max(FACTORS[-1] * float(cost.max()), *(float(np.nanmax(one)) for one in drawn), 0.0)
    if budget is not None:
        high, low = max(high, 1.2 * budget.limit), min(low, budget.limit / 2)
    return low, max(high, 2 * noise)
