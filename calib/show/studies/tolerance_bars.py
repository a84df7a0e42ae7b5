"""The bars of a tolerance study: what each error costs, and how large it may be for a limit."""

from typing import TYPE_CHECKING

import numpy as np

from calib.draw.style import BLUE, EMPTY, GREEN, INK, VERMILION, note, nothing
from calib.show.studies.tolerance_words import BELOW, amount, amount_of
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.quantities import MAIN, quantity_named
from calib.studies.tolerance.record import NEVER, BudgetRow, ToleranceStudy
from designer.base.number_text import figure
from designer.base.words import capital, printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
RANKING_HEAD_PX, RANKING_PANEL_PX, RANKING_ROW_PX, ROOM = 120, 125, 28, 1.28
BUDGET_HEAD_PX, BUDGET_PANEL_PX, BUDGET_ROW_PX, EDGE, BUDGET_ROOM = 110, 130, 34, 1.5, 0.35
MANY_DECADES, MOST_TICKS = 3.0, 9
TITLES = {
    "reprojection": "Reprojection",
    "intersection": "Intersection, drawing",
    "reconstruction": "Reconstruction, drawing",
    "intersection_true": "Intersection, true shape",
    "reconstruction_true": "Reconstruction, true shape",
    "pose": "Camera's centre",
    "focal_length": "Focal length",
    "distortion_map": "Camera where seen",
}


def heading(page: "Figure", text: str) -> None:
    """The title of a figure."""
    page.suptitle(printable(text), fontsize=15, fontweight="bold", x=0.01, ha="left")


def open_sides(axes: "Axes") -> None:
    """No frame where there is no scale."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def plain_log_axis(axes: "Axes", which: str, low: float, high: float) -> None:
    """A logarithmic axis with plain numbers: 1, 2, 5 where few decades are shown, else powers of ten."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    steps = (1, 2, 5) if np.log10(high / low) < MANY_DECADES else (1,)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [step * 10.0**power for power in powers for step in steps]
    inside = [tick for tick in ticks if low <= tick <= high]
    axis.set_major_locator(FixedLocator(inside[:: max(1, len(inside) // MOST_TICKS)]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())


def ranking_height_px(study: ToleranceStudy) -> int:
    """As high as a row a source needs."""
    return RANKING_HEAD_PX + 2 * (RANKING_PANEL_PX + RANKING_ROW_PX * (len(study.ranking) + 1))


def draw_ranking(page: "Figure", study: ToleranceStudy) -> None:
    """Bars of the costs with 95 % intervals, all together, and what noise alone gives: a panel for each main quantity.

    Args:
        page: an empty figure.
        study: with one error that has an effect, or more.
    """
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS, sharey=True)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_costs(place, study, name)
    names = [*(f"{one.error} {amount(one.unit, one.size)}" for one in study.ranking), "all together"]
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].invert_yaxis()
    kind = "predicted" if study.kind == "linear" else f"{study.draws} draws, whiskers 95 %"
    heading(page, f"What each error adds to the errors of a calibration: {study.target}, {kind}")
    page.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)


def _draw_costs(axes: "Axes", study: ToleranceStudy, name: str) -> None:
    unit, noise = quantity_named(name).unit, study.noise(name)
    rows = [study.cost(error, name) for error in (*(one.error for one in study.ranking), TOGETHER)]
    low, value, high = np.nan_to_num([(one.cost_low, one.cost, one.cost_high) for one in rows]).T
    at = np.arange(len(value))
    axes.barh(at[:-1], value[:-1], color=BLUE, height=0.66, label="one error alone")
    axes.barh(at[-1:], value[-1:], color=INK, height=0.66, label="all together")
    axes.axvline(noise, color=VERMILION, linewidth=1.8, linestyle="--", label="noise alone")
    if study.kind == "draws":
        spread = np.stack([value - np.minimum(low, value), np.maximum(high, value) - value])
        axes.errorbar(value, at, xerr=spread, linestyle="", color="#7f7f7f", capsize=3, linewidth=1.4)
    for y, (bar, end) in enumerate(zip(value.tolist(), high.tolist(), strict=True)):
        least = BELOW * noise
        text = f"< {figure(max(end, least), 2)}" if bar < least else figure(bar, 2)
        axes.annotate(
            "0" if end == 0 else text, (max(bar, end, noise), y), (5, 0), textcoords="offset points", fontsize=10,
            va="center",
        )  # fmt: skip
    axes.set_xlim(0, ROOM * max(float(high.max()), noise))
    axes.locator_params(axis="x", nbins=4)
    axes.tick_params(axis="y", length=0)
    axes.set_title(TITLES[name])
    axes.set_xlabel(unit)
    note(axes, f"noise alone {figure(noise, 2)} {unit}")
    open_sides(axes)


def budget_height_px(study: ToleranceStudy) -> int:
    """As high as a row a source of each limit needs."""
    return BUDGET_HEAD_PX + len(study.budgets) * (BUDGET_PANEL_PX + BUDGET_ROW_PX * (len(study.ranking) + 1))


def draw_budget(page: "Figure", study: ToleranceStudy) -> None:
    """A panel a limit: bars from the assumed amount to the largest one that is allowed.

    Args:
        page: an empty figure.
        study: with budgets.
    """
    axes = page.subplots(len(study.budgets), 1, squeeze=False)[:, 0]
    for place, budget in zip(axes, study.budgets, strict=True):
        _draw_budget(place, study, budget)
    heading(page, f"How good must it be? Largest errors of {study.target}, each as if it were the only one")


def _draw_budget(axes: "Axes", study: ToleranceStudy, budget: BudgetRow) -> None:
    one = quantity_named(budget.quantity)
    noise, total = study.noise(one.name), study.total(one.name)
    axes.set_title(f"{capital(one.title)} up to {budget.limit:g} {one.unit}")
    if not budget.met_by_noise_alone:
        nothing(axes, f"noise alone gives {figure(noise, 2)} {one.unit}: no print is good enough")
        return
    allowed = {row.error: (row.largest_rms, row.largest_rms_low, row.largest_rms_high) for row in budget.alone}
    bars = [tuple(end / row.rms for end in allowed[row.error]) for row in study.ranking]
    together = budget.together.factor, budget.together.factor_low, budget.together.factor_high
    ends = [bound for bar in (*bars, together) for bound in bar if 1 / NEVER**2 < bound <= NEVER]
    low, high = min([*ends, 1.0]) / EDGE, max([*ends, 1.0])
    high *= max((high / low) ** BUDGET_ROOM, EDGE)  # room for words to the right
    for y, (row, bar) in enumerate(zip(study.ranking, bars, strict=True)):
        largest, is_limited = amount_of(row, bar[0] * row.rms), bar[0] <= NEVER
        words = f"up to {largest}; assumed {amount(row.unit, row.size)}" if is_limited else "any, for this"
        _draw_bar(axes, y, bar, words, high, has_interval=study.kind == "draws")
    factor = together[0]
    words = f"up to {figure(factor, 3)} times all that is assumed" if factor <= NEVER else "any, for this"
    _draw_bar(axes, len(bars), together, words, high, has_interval=study.kind == "draws")
    axes.axvline(1.0, color=INK, linewidth=1.6, linestyle=":")
    axes.set_yticks(range(len(bars) + 1), [*(row.error for row in study.ranking), "all together"])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    plain_log_axis(axes, "x", low, high)
    axes.set_xlabel("largest allowed over assumed; whiskers: 95 %" if study.draws else "largest over assumed")
    assumed = f"with all errors as assumed {figure(total, 3)} {one.unit}"
    note(axes, f"{assumed}, with noise alone {figure(noise, 2)} {one.unit}")
    open_sides(axes)


def _draw_bar(axes: "Axes", y: int, bar: tuple[float, ...], words: str, end: float, *, has_interval: bool) -> None:
    """Green from the assumed amount up to what is allowed, red down to it."""
    factor, low, high = bar
    if not 0 < factor <= NEVER:
        axes.barh(y, end - 1.0, left=1.0, color=EMPTY, height=0.62)
        axes.annotate(words, (1.0, y), (8, 0), textcoords="offset points", va="center", fontsize=11)
        return
    left, right = sorted((1.0, factor))
    axes.barh(y, right - left, left=left, color=GREEN if factor >= 1 else VERMILION, height=0.62)
    if has_interval:
        upper = min(high, end)
        spread = np.array([[factor - min(low, factor)], [max(upper - factor, 0.0)]])
        axes.errorbar([factor], [y], xerr=spread, color=INK, capsize=4, linewidth=1.4, linestyle="")
        right = max(right, upper)
    axes.annotate(words, (right, y), (8, 0), textcoords="offset points", va="center", fontsize=11)
