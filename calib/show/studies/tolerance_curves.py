"""The curves of a tolerance study: costs over the size of each error, and where a target becomes worse than another."""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.style import BLUE, EMPTY, GREEN, GREY, INK, ORANGE, VERMILION, note
from calib.show.studies.tolerance_bars import COLUMNS, TITLES, heading, open_sides, plain_log_axis
from calib.show.studies.tolerance_words import BELOW, HUMAN, amount_of, swept_sources
from calib.studies.tolerance.quantities import MAIN, quantity_named
from calib.studies.tolerance.record import NEVER, BudgetRow, CostRow, CrossoverRow, Crossovers, SweepRow, ToleranceStudy
from calib.studies.tolerance.sizes import FACTORS
from designer.base.words import capital
from designer.tolerance.sources import SOURCES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEAD_PX, PANEL_PX, EDGE = 150, 300, 1.4
CROSSOVER_HEIGHT_PX, POINTS, WIDEST = 920, 200, 20.0
KIND = {"normal": "standard deviation", "uniform": "half width", "fixed": "value"}


def _amount_label(one: CostRow) -> str:
    """What an axis of an error's amounts is."""
    return f"{KIND.get(one.distribution, one.distribution)} in {HUMAN[one.unit][0]}"


def _human_size(one: CostRow) -> float:
    """The size of an error in the unit that a person calls it by, without its sign."""
    return abs(one.size) * HUMAN[one.unit][1]


def sweeps_height_px(study: ToleranceStudy, quantity: str) -> int:
    """As high as rows of four panels need."""
    return HEAD_PX + PANEL_PX * max(1, -(-len(swept_sources(study, quantity)) // COLUMNS))


def draw_sweeps(page: "Figure", study: ToleranceStudy, quantity: str) -> None:
    """What one quantity costs over each error's amount, double logarithmic, all panels with the same scale of costs.

    Args:
        page: an empty figure.
        study: with an error that costs this quantity something.
        quantity: by its name.
    """
    rows = [study.cost(name, quantity) for name in swept_sources(study, quantity)]
    swept = {one.error: one for one in study.sweeps}
    axes = page.subplots(-(-len(rows) // COLUMNS), COLUMNS, sharey=True, squeeze=False).ravel()
    budget = next((one for one in study.budgets if one.quantity == quantity), None)
    low, high = _cost_limits(study, rows, [swept[one.error] for one in rows], budget)
    for place, row in zip(axes, rows, strict=False):
        _draw_sweep(place, study, row, swept[row.error], budget)
        plain_log_axis(place, "y", low, high)
    for place in axes[len(rows) :]:
        place.set_visible(False)
    one = quantity_named(quantity)
    for place in axes[::COLUMNS]:
        place.set_ylabel(f"cost in {one.unit}")
    title = f"{capital(one.title)} by the size of each error"
    heading(page, f"{title}: {study.target} (dots: draws with 95 %; line: prediction)")
    known = {label: handle for place in axes for handle, label in zip(*place.get_legend_handles_labels(), strict=True)}
    page.legend(known.values(), known.keys(), loc="outside lower center", ncols=7, frameon=False)


def _draw_sweep(axes: "Axes", study: ToleranceStudy, row: CostRow, swept: SweepRow, budget: BudgetRow | None) -> None:
    size, noise = _human_size(row), study.noise(row.quantity)
    ends = np.array([FACTORS[0] / EDGE, FACTORS[-1] * EDGE])
    if row.reach < ends[1]:
        off = max(row.reach, ends[0]) * size
        axes.axvspan(off, ends[1] * size, color=EMPTY, alpha=0.6, label="prediction off by > 10 %")
    axes.axhline(noise, color=VERMILION, linestyle="--", linewidth=1.6, label="noise alone")
    if budget is not None and budget.met_by_noise_alone:
        label = f"limit {budget.limit:g}{budget.unit}, less the noise"
        axes.axhline(math.sqrt(budget.limit**2 - noise**2), color=GREEN, linewidth=2, label=label)
    axes.plot(ends * size, ends * row.predicted, color=GREY, linewidth=1.8, label="prediction")
    axes.axvline(size, color=INK, linestyle=":", linewidth=1.4, label="assumed")
    _draw_draws(axes, row, swept, size)
    axes.set_title(row.error)
    axes.set_xlabel(f"{capital(SOURCES[row.error].title)}:\n{_amount_label(row)}")
    plain_log_axis(axes, "x", *(ends * size))
    axes.grid(visible=True, which="major", color=EMPTY, linewidth=0.8)
    axes.set_axisbelow(True)
    open_sides(axes)


def _draw_draws(axes: "Axes", row: CostRow, swept: SweepRow, size: float) -> None:
    costs = swept.of(row.quantity)
    value, low, high = map(np.array, (costs.cost, costs.cost_low, costs.cost_high))
    x = np.array(swept.rms) / row.rms * size
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
    study: ToleranceStudy, rows: list[CostRow], swept: list[SweepRow], budget: BudgetRow | None
) -> tuple[float, float]:
    """The scale of all panels: from below the noise, or the smallest cost, to the largest."""
    quantity = rows[0].quantity
    noise, costs = study.noise(quantity), [one.predicted for one in rows]
    low = max(min(noise, FACTORS[0] * min(costs)), BELOW * noise) / EDGE
    drawn = [float(np.nanmax(one.of(quantity).cost_high)) for one in swept]
    high = EDGE * max(FACTORS[-1] * max(costs), *drawn, 0.0)
    if budget is not None:
        high, low = max(high, 1.2 * budget.limit), min(low, budget.limit / 2)
    return low, max(high, 2 * noise)


def draw_crossover(page: "Figure", study: ToleranceStudy, other: Crossovers) -> None:
    """Both targets over the amount of the varied error; all other errors are as assumed: a panel a main quantity.

    Args:
        page: an empty figure.
        study: of the target that is varied.
        other: the other target, with an error to vary.
    """
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_crossover(place, study, other, study.cost(other.vary, name))
    heading(page, f"How large may {other.vary} be before {study.target} is worse than {other.target}?")
    page.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, frameon=False)


def _draw_crossover(axes: "Axes", study: ToleranceStudy, other: Crossovers, row: CostRow) -> None:
    found, size = other.by_key[row.error, row.quantity], _human_size(row)
    own = found.own_without
    factor = found.rms / row.rms
    crosses = found.verdict == "crosses" and factor <= NEVER
    widest = min(max(2.0, 1.5 * factor), WIDEST) if crosses else 2.0
    at = np.linspace(0, widest, POINTS)
    low, high = np.hypot(own, at * row.cost_low), np.hypot(own, at * row.cost_high)
    axes.fill_between(at * size, low, high, color=BLUE, alpha=0.25)
    axes.plot(at * size, np.hypot(own, at * row.cost), color=BLUE, linewidth=2.4, label=study.target)
    axes.axhspan(found.other_low, found.other_high, color=ORANGE, alpha=0.3, linewidth=0)
    axes.axhline(found.other, color=ORANGE, linewidth=2.4, label=other.target)
    axes.axvline(size, color=INK, linestyle=":", linewidth=1.4, label="assumed")
    if crosses and factor <= widest:
        axes.plot([factor * size], [found.other], marker="o", markersize=10, color=VERMILION, linestyle="")
    axes.set_xlim(0, widest * size)
    axes.set_ylim(0, 1.15 * max(math.hypot(own, widest * row.cost), found.other))
    axes.locator_params(axis="x", nbins=5)
    axes.set_title(TITLES[row.quantity])
    axes.set_xlabel(f"{row.error}: {_amount_label(row)}")
    axes.set_ylabel(row.quantity_unit)
    note(axes, _verdict(row, found))
    open_sides(axes)


def _verdict(row: CostRow, found: CrossoverRow) -> str:
    """The panel in a few words."""
    if found.verdict == "loses at zero":
        return f"worse even without {row.error}"
    if found.rms > NEVER * row.rms:
        return "never worse by this"
    return f"worse from {amount_of(row, found.rms)} on"
