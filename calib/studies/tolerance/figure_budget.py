"""How large each error may be for a limit, beside what it is assumed to be."""

from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure
from calib.figures.style import EMPTY, GREEN, INK, VERMILION, note, nothing
from calib.studies.tolerance.budget import Allowed
from calib.studies.tolerance.figure_parts import heading, open_sides, plain_log_axis
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import NEVER, CheckedBudget, ToleranceReport, of_name
from calib.studies.tolerance.tables import size_in_words
from designer.base.words import capital

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEAD_PX, PANEL_PX, ROW_PX = 110, 130, 34
EDGE, ROOM = 1.5, 0.35


def budget_height_px(report: ToleranceReport) -> int:
    """As high as a row a source of each limit needs."""
    return HEAD_PX + len(report.budgets) * (PANEL_PX + ROW_PX * (len(report.ranking) + 1))


def draw_budget(page: "Figure", report: ToleranceReport) -> None:
    """A panel a limit: bars from the assumed amount to the largest one that is allowed.

    Args:
        page: an empty figure.
        report: with budgets.
    """
    axes = page.subplots(len(report.budgets), 1, squeeze=False)[:, 0]
    for place, checked in zip(axes, report.budgets, strict=True):
        _draw_panel(place, report, checked)
    heading(page, f"How good must it be? Largest errors of {report.name}, each as if it were the only one")


def _draw_panel(axes: "Axes", report: ToleranceReport, checked: CheckedBudget) -> None:
    budget, table, errors = checked.budget, report.table, report.table.errors
    one = of_name(budget.quantity)
    noise = float(table.baseline.value[quantity_row(one.name)])
    total = float(table.total[quantity_row(one.name)])
    axes.set_title(f"{capital(one.title)} up to {budget.limit:g} {one.unit}")
    if not budget.is_met_without:
        nothing(axes, f"noise alone gives {figure(noise, 2)} {one.unit}: no print is good enough")
        return
    alone = dict(budget.alone)
    rows = [(name, alone[name], size_in_words(errors, name)) for name in report.ranking]
    low, high = _limits([*(allowed for _, allowed, _ in rows), budget.together])
    for y, (name, allowed, assumed) in enumerate(rows):
        words = "does not matter"
        if allowed.factor <= NEVER:
            words = f"up to {size_in_words(errors, name, allowed.factor)}; assumed {assumed}"
        _draw_bar(axes, y, allowed, words, high, has_interval=table.kind == "draws")
    factor = budget.together.factor
    together = f"up to {figure(factor, 3)} times all that is assumed" if factor <= NEVER else "does not matter"
    _draw_bar(axes, len(rows), budget.together, together, high, has_interval=table.kind == "draws")
    axes.axvline(1.0, color=INK, linewidth=1.6, linestyle=":")
    axes.set_yticks(range(len(rows) + 1), [*(name for name, _, _ in rows), "all together"])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    plain_log_axis(axes, "x", low, high)
    axes.set_xlabel("largest allowed over assumed; whiskers: 95 %" if table.draws else "largest over assumed")
    note(
        axes,
        f"with all errors as assumed {figure(total, 3)} {one.unit}, with noise alone {figure(noise, 2)} {one.unit}",
    )
    open_sides(axes)


def _limits(allowed: list[Allowed]) -> tuple[float, float]:
    """The ends of the scale, with room for words to the right."""
    shown = [bound for one in allowed for bound in (one.factor, one.low, one.high) if 1 / NEVER**2 < bound <= NEVER]
    low, high = min([*shown, 1.0]) / EDGE, max([*shown, 1.0])
    return low, high * max((high / low) ** ROOM, EDGE)


def _draw_bar(axes: "Axes", y: int, allowed: Allowed, words: str, high: float, *, has_interval: bool) -> None:
    """Green from the assumed amount up to what is allowed, red down to it."""
    if not 0 < allowed.factor <= NEVER:
        axes.barh(y, high - 1.0, left=1.0, color=EMPTY, height=0.62)
        axes.annotate(words, (1.0, y), (8, 0), textcoords="offset points", va="center", fontsize=11)
        return
    left, right = sorted((1.0, allowed.factor))
    fits = allowed.factor >= 1
    axes.barh(y, right - left, left=left, color=GREEN if fits else VERMILION, height=0.62)
    end = right
    if has_interval:
        upper = min(allowed.high, high)
        spread = np.array([[allowed.factor - min(allowed.low, allowed.factor)], [max(upper - allowed.factor, 0.0)]])
        axes.errorbar([allowed.factor], [y], xerr=spread, color=INK, capsize=4, linewidth=1.4, linestyle="")
        end = max(right, upper)
    axes.annotate(words, (end, y), (8, 0), textcoords="offset points", va="center", fontsize=11)
