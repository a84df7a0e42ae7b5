"""The figures of a tolerance study: what errors cost, how large they may be, and against another target."""

import math
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calib.draw import style
from calib.draw import tolerance_words as words
from calib.draw.tolerance_tables import HEADS
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.quantities import MAIN, quantity_named
from calib.studies.tolerance.record import NEVER, BudgetRow, CostRow, CrossoverRow, Crossovers, SweepRow, ToleranceStudy
from calib.studies.tolerance.sizes import FACTORS
from designer.base.words import capital, figure
from designer.tolerance.sources import SOURCES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
RANKING_HEAD_PX, RANKING_PANEL_PX, RANKING_ROW_PX, ROOM = 120, 125, 28, 1.28
BUDGET_HEAD_PX, BUDGET_PANEL_PX, BUDGET_ROW_PX, EDGE, BUDGET_ROOM = 110, 130, 34, 1.5, 0.35
MANY_DECADES, MOST_TICKS = 3.0, 9
TITLES = {name: capital(head.partition(" [")[0]) for name, head in HEADS.items()}
SWEEP_HEAD_PX, SWEEP_PANEL_PX, SWEEP_EDGE = 150, 300, 1.4
CROSSOVER_HEIGHT_PX, POINTS, WIDEST = 920, 200, 20.0
KIND = {"normal": "standard deviation", "uniform": "half width", "fixed": "value"}


def sheets(study: ToleranceStudy) -> Iterator[style.FigureSheet]:
    """Those that the study has something for."""
    other, rows = study.crossovers, len(study.ranking) + 1
    if study.ranking:
        yield style.FigureSheet(
            "ranking", f"What each error adds: {study.target}", words.ranking_alt(study),
            RANKING_HEAD_PX + 2 * (RANKING_PANEL_PX + RANKING_ROW_PX * rows), partial(_draw_ranking, study=study),
            "Bars: one error alone, and all together; dashed: noise alone.",
        )  # fmt: skip
    if study.budgets:
        yield style.FigureSheet(
            "budget", "How large may errors be?", " ".join(words.budget_sentence(study, one) for one in study.budgets),
            BUDGET_HEAD_PX + len(study.budgets) * (BUDGET_PANEL_PX + BUDGET_ROW_PX * rows),
            partial(_draw_budget, study=study), "Green: there is room; red: this must come down, even alone.",
        )  # fmt: skip
    if other is not None and other.vary:
        alt = f"Errors of both targets over the size of {other.vary}. {words.against_sentence(study, other)}"
        draw = partial(_draw_crossover, study=study, other=other)
        yield style.FigureSheet("crossover", f"{study.target} against {other.target}", alt, CROSSOVER_HEIGHT_PX, draw)
    for name in words.quantities_wanted(study) if study.sweeps else ():
        if swept := words.swept_sources(study, name):
            yield style.FigureSheet(
                f"sweep_{name}", f"{capital(quantity_named(name).title)} by the size of each error",
                words.sweep_alt(study, name), SWEEP_HEAD_PX + SWEEP_PANEL_PX * max(1, -(-len(swept) // COLUMNS)),
                partial(_draw_sweeps, study=study, quantity=name),
                "Dots: draws; line: prediction; grey: where that is off by more than 10 %.",
            )  # fmt: skip


def _plain_log_axis(axes: "Axes", which: str, low: float, high: float) -> None:
    """A logarithmic axis with plain numbers: 1, 2, 5 where few decades are shown, else powers of ten."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    steps = (1, 2, 5) if np.log10(high / low) < MANY_DECADES else (1,)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [step * 10.0**power for power in powers for step in steps]
    inside = [tick for tick in ticks if low <= tick <= high]
    style.log_axis(axis, inside[:: max(1, len(inside) // MOST_TICKS)])


def _draw_ranking(page: "Figure", study: ToleranceStudy) -> None:
    """Bars of costs with 95 % intervals, all together, and what noise alone gives: a panel for each main quantity."""
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS, sharey=True)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_costs(place, study, name)
    names = [*(f"{one.error} {words.amount(one.unit, one.size)}" for one in study.ranking), "all together"]
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].invert_yaxis()
    kind = "predicted" if study.kind == "linear" else f"{study.draws} draws, whiskers 95 %"
    style.heading(page, f"What each error adds to the errors of a calibration: {study.target}, {kind}")
    style.legend_below(page, axes[0, :1], 3)


def _draw_costs(axes: "Axes", study: ToleranceStudy, name: str) -> None:
    unit, noise = quantity_named(name).unit, study.noise(name)
    rows = [study.cost(error, name) for error in (*(one.error for one in study.ranking), TOGETHER)]
    low, value, high = np.nan_to_num([(one.cost_low, one.cost, one.cost_high) for one in rows]).T
    at = np.arange(len(value))
    axes.barh(at[:-1], value[:-1], color=style.BLUE, height=0.66, label="one error alone")
    axes.barh(at[-1:], value[-1:], color=style.INK, height=0.66, label="all together")
    axes.axvline(noise, color=style.VERMILION, linewidth=1.8, linestyle="--", label="noise alone")
    if study.kind == "draws":
        spread = np.stack([value - np.minimum(low, value), np.maximum(high, value) - value])
        axes.errorbar(value, at, xerr=spread, linestyle="", color="#7f7f7f", capsize=3, linewidth=1.4)
    for y, (bar, end) in enumerate(zip(value.tolist(), high.tolist(), strict=True)):
        least = words.BELOW * noise
        text = f"< {figure(max(end, least), 2)}" if bar < least else figure(bar, 2)
        axes.annotate(
            "0" if end == 0 else text, (max(bar, end, noise), y), (5, 0), textcoords="offset points", fontsize=10,
            va="center",
        )  # fmt: skip
    axes.set_xlim(0, ROOM * max(float(high.max()), noise))
    axes.locator_params(axis="x", nbins=4)
    axes.tick_params(axis="y", length=0)
    axes.set_title(TITLES[name])
    style.open_axes(axes, unit, "")
    style.note(axes, f"noise alone {figure(noise, 2)} {unit}")


def _draw_budget(page: "Figure", study: ToleranceStudy) -> None:
    """A panel a limit: bars from the assumed amount to the largest one that is allowed."""
    axes = page.subplots(len(study.budgets), 1, squeeze=False)[:, 0]
    for place, budget in zip(axes, study.budgets, strict=True):
        _draw_limit(place, study, budget)
    style.heading(page, f"How good must it be? Largest errors of {study.target}, each as if it were the only one")


def _draw_limit(axes: "Axes", study: ToleranceStudy, budget: BudgetRow) -> None:
    one = quantity_named(budget.quantity)
    noise, total = study.noise(one.name), study.total(one.name)
    axes.set_title(f"{capital(one.title)} up to {budget.limit:g} {one.unit}")
    if not budget.met_by_noise_alone:
        style.nothing(axes, f"noise alone gives {figure(noise, 2)} {one.unit}: no print is good enough")
        return
    allowed = {row.error: (row.largest_rms, row.largest_rms_low, row.largest_rms_high) for row in budget.alone}
    bars = [tuple(end / row.rms for end in allowed[row.error]) for row in study.ranking]
    together = budget.together.factor, budget.together.factor_low, budget.together.factor_high
    ends = [bound for bar in (*bars, together) for bound in bar if 1 / NEVER**2 < bound <= NEVER]
    low, high = min([*ends, 1.0]) / EDGE, max([*ends, 1.0])
    high *= max((high / low) ** BUDGET_ROOM, EDGE)  # room for words to the right
    for y, (row, bar) in enumerate(zip(study.ranking, bars, strict=True)):
        largest, is_limited = words.amount_of(row, bar[0] * row.rms), bar[0] <= NEVER
        told = f"up to {largest}; assumed {words.amount(row.unit, row.size)}" if is_limited else "any, for this"
        _draw_bar(axes, y, bar, told, high, has_interval=study.kind == "draws")
    factor = together[0]
    told = f"up to {figure(factor, 3)} times all that is assumed" if factor <= NEVER else "any, for this"
    _draw_bar(axes, len(bars), together, told, high, has_interval=study.kind == "draws")
    axes.axvline(1.0, color=style.INK, linewidth=1.6, linestyle=":")
    axes.set_yticks(range(len(bars) + 1), [*(row.error for row in study.ranking), "all together"])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    _plain_log_axis(axes, "x", low, high)
    style.open_axes(axes, "largest allowed over assumed; whiskers: 95 %" if study.draws else "largest over assumed", "")
    assumed = f"with all errors as assumed {figure(total, 3)} {one.unit}"
    style.note(axes, f"{assumed}, with noise alone {figure(noise, 2)} {one.unit}")


def _draw_bar(axes: "Axes", y: int, bar: tuple[float, ...], told: str, end: float, *, has_interval: bool) -> None:
    """Green from the assumed amount up to what is allowed, red down to it."""
    factor, low, high = bar
    if not 0 < factor <= NEVER:
        axes.barh(y, end - 1.0, left=1.0, color=style.EMPTY, height=0.62)
        axes.annotate(told, (1.0, y), (8, 0), textcoords="offset points", va="center", fontsize=11)
        return
    left, right = sorted((1.0, factor))
    axes.barh(y, right - left, left=left, color=style.GREEN if factor >= 1 else style.VERMILION, height=0.62)
    if has_interval:
        upper = min(high, end)
        spread = np.array([[factor - min(low, factor)], [max(upper - factor, 0.0)]])
        axes.errorbar([factor], [y], xerr=spread, color=style.INK, capsize=4, linewidth=1.4, linestyle="")
        right = max(right, upper)
    axes.annotate(told, (right, y), (8, 0), textcoords="offset points", va="center", fontsize=11)


def _amount_label(one: CostRow) -> str:
    """What an axis of an error's amounts is."""
    return f"{KIND.get(one.distribution, one.distribution)} in {words.HUMAN[one.unit][0]}"


def _human_size(one: CostRow) -> float:
    """The size of an error in the unit that a person calls it by, without its sign."""
    return abs(one.size) * words.HUMAN[one.unit][1]


def _draw_sweeps(page: "Figure", study: ToleranceStudy, quantity: str) -> None:
    """What one quantity costs over each error's amount, double logarithmic, all panels with the same scale of costs."""
    rows = [study.cost(name, quantity) for name in words.swept_sources(study, quantity)]
    swept = {one.error: one for one in study.sweeps}
    axes = page.subplots(-(-len(rows) // COLUMNS), COLUMNS, sharey=True, squeeze=False).ravel()
    budget = next((one for one in study.budgets if one.quantity == quantity), None)
    low, high = _cost_limits(study, rows, [swept[one.error] for one in rows], budget)
    for place, row in zip(axes, rows, strict=False):
        _draw_size(place, study, row, swept[row.error], budget)
        _plain_log_axis(place, "y", low, high)
    for place in axes[len(rows) :]:
        place.set_visible(False)
    one = quantity_named(quantity)
    for place in axes[::COLUMNS]:
        place.set_ylabel(f"cost in {one.unit}")
    title = f"{capital(one.title)} by the size of each error"
    style.heading(page, f"{title}: {study.target} (dots: draws with 95 %; line: prediction)")
    style.legend_below(page, axes, 7)


def _draw_size(axes: "Axes", study: ToleranceStudy, row: CostRow, swept: SweepRow, budget: BudgetRow | None) -> None:
    size, noise = _human_size(row), study.noise(row.quantity)
    ends = np.array([FACTORS[0] / SWEEP_EDGE, FACTORS[-1] * SWEEP_EDGE])
    if row.reach < ends[1]:
        off = max(row.reach, ends[0]) * size
        axes.axvspan(off, ends[1] * size, color=style.EMPTY, alpha=0.6, label="prediction off by > 10 %")
    axes.axhline(noise, color=style.VERMILION, linestyle="--", linewidth=1.6, label="noise alone")
    if budget is not None and budget.met_by_noise_alone:
        label = f"limit {budget.limit:g}{budget.unit}, less the noise"
        axes.axhline(math.sqrt(budget.limit**2 - noise**2), color=style.GREEN, linewidth=2, label=label)
    axes.plot(ends * size, ends * row.predicted, color=style.GREY, linewidth=1.8, label="prediction")
    axes.axvline(size, color=style.INK, linestyle=":", linewidth=1.4, label="assumed")
    _draw_draws(axes, row, swept, size)
    axes.set_title(row.error)
    style.open_axes(axes, f"{capital(SOURCES[row.error].title)}:\n{_amount_label(row)}", "")
    _plain_log_axis(axes, "x", *(ends * size))
    axes.grid(visible=True, which="major", color=style.EMPTY, linewidth=0.8)
    axes.set_axisbelow(True)


def _draw_draws(axes: "Axes", row: CostRow, swept: SweepRow, size: float) -> None:
    costs = swept.of(row.quantity)
    value, low, high = map(np.array, (costs.cost, costs.cost_low, costs.cost_high))
    x = np.array(swept.rms) / row.rms * size
    sure = (value > 0) & (low > 0)
    spread = np.stack([value - low, high - value])[:, sure]
    axes.errorbar(
        x[sure], value[sure], spread, linestyle="", marker="o", markersize=6, color=style.BLUE, capsize=3, label="draws"
    )
    bounded = ~sure & (high > 0)
    if bounded.any():
        axes.plot(
            x[bounded], high[bounded], linestyle="", marker="v", markersize=8, markerfacecolor="none", color=style.BLUE,
            label="draws: less than",
        )  # fmt: skip


def _cost_limits(
    study: ToleranceStudy, rows: list[CostRow], swept: list[SweepRow], budget: BudgetRow | None
) -> tuple[float, float]:
    """The scale of all panels: from below the noise, or the smallest cost, to the largest."""
    quantity = rows[0].quantity
    noise, costs = study.noise(quantity), [one.predicted for one in rows]
    low = max(min(noise, FACTORS[0] * min(costs)), words.BELOW * noise) / SWEEP_EDGE
    drawn = [float(np.nanmax(one.of(quantity).cost_high)) for one in swept]
    high = SWEEP_EDGE * max(FACTORS[-1] * max(costs), *drawn, 0.0)
    if budget is not None:
        high, low = max(high, 1.2 * budget.limit), min(low, budget.limit / 2)
    return low, max(high, 2 * noise)


def _draw_crossover(page: "Figure", study: ToleranceStudy, other: Crossovers) -> None:
    """Both targets over the amount of the varied error; all other errors are as assumed: a panel a main quantity."""
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_crossing(place, study, other, study.cost(other.vary, name))
    style.heading(page, f"How large may {other.vary} be before {study.target} is worse than {other.target}?")
    style.legend_below(page, axes[0, :1], 4)


def _draw_crossing(axes: "Axes", study: ToleranceStudy, other: Crossovers, row: CostRow) -> None:
    found, size = other.by_key[row.error, row.quantity], _human_size(row)
    own = found.own_without
    factor = found.rms / row.rms
    crosses = found.verdict == "crosses" and factor <= NEVER
    widest = min(max(2.0, 1.5 * factor), WIDEST) if crosses else 2.0
    at = np.linspace(0, widest, POINTS)
    low, high = np.hypot(own, at * row.cost_low), np.hypot(own, at * row.cost_high)
    axes.fill_between(at * size, low, high, color=style.BLUE, alpha=0.25)
    axes.plot(at * size, np.hypot(own, at * row.cost), color=style.BLUE, linewidth=2.4, label=study.target)
    axes.axhspan(found.other_low, found.other_high, color=style.ORANGE, alpha=0.3, linewidth=0)
    axes.axhline(found.other, color=style.ORANGE, linewidth=2.4, label=other.target)
    axes.axvline(size, color=style.INK, linestyle=":", linewidth=1.4, label="assumed")
    if crosses and factor <= widest:
        axes.plot([factor * size], [found.other], marker="o", markersize=10, color=style.VERMILION, linestyle="")
    axes.set_xlim(0, widest * size)
    axes.set_ylim(0, 1.15 * max(math.hypot(own, widest * row.cost), found.other))
    axes.locator_params(axis="x", nbins=5)
    axes.set_title(TITLES[row.quantity])
    style.open_axes(axes, f"{row.error}: {_amount_label(row)}", row.quantity_unit)
    style.note(axes, _verdict(row, found))


def _verdict(row: CostRow, found: CrossoverRow) -> str:
    """The panel in a few words."""
    if found.verdict == "loses at zero":
        return f"worse even without {row.error}"
    if found.rms > NEVER * row.rms:
        return "never worse by this"
    return f"worse from {words.amount_of(row, found.rms)} on"
