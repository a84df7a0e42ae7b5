"""The tables of a tolerance study as cells of text, for the screen and for Markdown."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.core.number_text import figure, with_digits
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.budget import Allowed
from calib.studies.tolerance.crossover import Crossover
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import MAIN, NEVER, Against, CheckedBudget, ToleranceReport, of_name
from calib.studies.tolerance.result import Cost, ToleranceTable
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import SOURCES
from designer.tolerance.source import Unit

if TYPE_CHECKING:
    from rich.table import Table

Array = NDArray[np.float64]

BELOW = 0.1
"""Of the noise: a cost below adds half a percent to an error, and is no more than told to be small."""
EXACT = 2e-3
"""A standard error below this share of its value is not shown."""
HEADS = {
    "reprojection": "reprojection\n[px]",
    "intersection": "intersection\ndrawing [mm]",
    "reconstruction": "reconstruction\ndrawing [mm]",
    "intersection_true": "intersection\ntrue shape [mm]",
    "reconstruction_true": "reconstruction\ntrue shape [mm]",
    "pose": "camera's\ncentre [mm]",
    "focal_length": "focal\nlength [px]",
    "distortion_map": "camera\nwhere seen [px]",
}
HUMAN: dict[Unit, tuple[str, float]] = {
    "mm": ("mm", 1.0),
    "rad": ("deg", math.degrees(1.0)),
    "1": ("%", 100.0),
    "K": ("K", 1.0),
}
"""What a person calls a source's unit, and how many there are in one."""


@dataclass(frozen=True)
class TextTable:
    """A table of text; cells may have two lines."""

    title: str
    head: tuple[str, ...]
    body: tuple[tuple[str, ...], ...]
    left: int = 1  # so many columns are words


def amount_in_words(errors: ErrorModel, source: str, factor: float = 1.0) -> str:
    """A multiple of a source's amount: `0.1deg`, and how it is distributed if that is not normally."""
    kind = errors.amount(source).kind
    return ("" if kind == "normal" else f"{kind} ") + size_in_words(errors, source, factor)


def size_in_words(errors: ErrorModel, source: str, factor: float = 1.0) -> str:
    """A multiple of a source's size to three digits, in the unit that a person calls it by."""
    return size_words(factor * errors.amount(source).size, SOURCES[source].unit)


def size_words(size: float, source_unit: Unit) -> str:
    """A size to three digits, in the unit that a person calls it by."""
    unit, per = HUMAN[source_unit]
    return f"{float(f'{size * per:.3g}'):g}{unit}"


def cost_cell(cost: Cost, place: tuple[int, ...], noise: float) -> str:
    """A cost with its standard error; what is far below the noise, or not told from it, is only bounded."""
    value, low, high = (float(bound[place]) for bound in (cost.value, cost.low, cost.high))
    if not math.isfinite(value):
        return "no solution"
    if value == 0 and high == 0:
        return "0"
    least = BELOW * noise
    if value < least or not low > 0:
        return f"< {figure(max(high, least), 2)}"
    return _with_error(value, (high - low) / (2 * HALF_WIDTH))


def _with_error(value: float, error: float) -> str:
    if not error > EXACT * value:
        return figure(value, 3)
    decimals = min(max(0, 1 - math.floor(math.log10(error))), 15)
    return f"{with_digits(value, error)}\n± {error:.{decimals}f}"


def cost_table(report: ToleranceReport) -> TextTable:
    """What each source costs, all together, and what noise alone gives."""
    table = report.table
    share = table.share[:, quantity_row(report.by)]
    rows = []
    for name in report.ranking:
        place = table.sources.index(name)
        title = f"{SOURCES[name].title}\n{name} {amount_in_words(table.errors, name)}"
        rows.append((title, _share(float(share[place])), *_costs(table.cost, (place,), table)))
    rows.append(("all errors together", "", *_costs(table.together, (), table)))
    noise = [figure(float(table.baseline.value[quantity_row(name)]), 3) for name in MAIN]
    rows.append(("no error: noise alone", "", *noise))
    head = ("what an error costs", f"share of\n{short(report.by)}", *(HEADS[name] for name in MAIN))
    return TextTable("", head, tuple(rows))


def _costs(cost: Cost, place: tuple[int, ...], table: ToleranceTable) -> list[str]:
    rows = [quantity_row(name) for name in MAIN]
    return [cost_cell(cost, (*place, row), float(table.baseline.value[row])) for row in rows]


def short(quantity: str) -> str:
    """A quantity's name as words."""
    return quantity.replace("_", " ")


def _share(share: float) -> str:
    return "< 0.1 %" if share < 1e-3 else f"{100 * share:.1f} %"


def sensitivity_table(report: ToleranceReport) -> TextTable:
    """The cost by a unit of each source."""
    table = report.table
    rows = []
    for name in report.ranking:
        place = table.sources.index(name)
        unit, per = HUMAN[SOURCES[name].unit]
        cells = []
        for quantity in MAIN:
            at = (place, quantity_row(quantity))
            low, value, high = (float(getattr(table.sensitivity, end)[at]) / per for end in ("low", "value", "high"))
            known = cost_cell(table.cost, at, float(table.baseline.value[at[1]]))
            cells.append("-" if known == "0" or known[0] in "<n" else _interval(value, low, high))
        rows.append((f"{name}, by 1{unit}", *cells))
    return TextTable("", ("sensitivity", *(HEADS[name] for name in MAIN)), tuple(rows))


def _interval(value: float, low: float, high: float) -> str:
    return figure(value, 3) + (f"\n{figure(low, 3)} to {figure(high, 3)}" if high > low else "")


def reach_table(report: ToleranceReport) -> TextTable:
    """Up to which amount each source's prediction holds."""
    errors = report.table.errors
    rows = []
    for name in report.ranking:
        factor = report.reach(name)
        if math.isnan(factor):
            continue
        first = report.first_off(name)
        if first:
            cells = (size_in_words(errors, name, factor), short(first))
        else:
            cells = (f"beyond {size_in_words(errors, name, report.tried_to)}", "")
        rows.append((name, size_in_words(errors, name), *cells))
    return TextTable("", ("prediction", "assumed", "within 10 % up to", "fails first for"), tuple(rows), left=1)


def budget_table(report: ToleranceReport, checked: CheckedBudget) -> TextTable:
    """The largest amount of each source, as if it were the only one, and of all together."""
    errors, budget = report.table.errors, checked.budget
    alone = dict(budget.alone)
    rows = []
    for name in report.ranking:
        cells = _allowed_cells(alone[name], partial(size_in_words, errors, name), report)
        title = f"{SOURCES[name].title} ({name})"
        rows.append((title, amount_in_words(errors, name), *cells, _remark(checked, name)))
    together = _allowed_cells(budget.together, lambda factor: f"{figure(factor, 3)} x", report)
    rows.append(("all together, so many times as large", "1 x", *together, _remark(checked, TOGETHER)))
    unit = of_name(budget.quantity).unit
    head = (
        f"for {short(budget.quantity)} up to {budget.limit:g}{unit}", "assumed", "largest alone", "95 % interval", ""
    )  # fmt: skip
    return TextTable("", head, tuple(rows))


def _allowed_cells(allowed: Allowed, words: Callable[[float], str], report: ToleranceReport) -> tuple[str, str]:
    """The largest multiple, and its interval, which predictions do not have."""
    if allowed.factor > NEVER:
        return "does not matter", ""
    if allowed.factor == 0:
        return "nothing", ""
    if report.table.kind == "linear":
        return words(allowed.factor), ""
    if allowed.high > NEVER:
        return f"> {words(allowed.low)}", ""
    return words(allowed.factor), f"{words(allowed.low)} to {words(allowed.high)}"


def _remark(checked: CheckedBudget, name: str) -> str:
    if name in checked.by_draws:
        return "found with draws"
    return "beyond where the square law was checked" if name in checked.beyond else ""


def crossover_table(report: ToleranceReport, against: Against) -> TextTable:
    """The amount of each source at which the target loses to the other."""
    rows = []
    for name, _ in against.crossovers:
        if report.has_effect(name):
            cells = [_crossing(report.table.errors, name, against.of(name, quantity)) for quantity in MAIN]
            rows.append((f"{name}\n{amount_in_words(report.table.errors, name)}", *cells))
    own = (f"{report.name}, as assumed", *(figure(float(report.table.total[quantity_row(name)]), 3) for name in MAIN))
    other = (
        f"{against.name}, as assumed", *(figure(float(against.table.total[quantity_row(name)]), 3) for name in MAIN)
    )  # fmt: skip
    head = (f"worse than {against.name} from", *(HEADS[name] for name in MAIN))
    return TextTable("", head, (*rows, own, other))


def _crossing(errors: ErrorModel, source: str, found: Crossover) -> str:
    """Where a target loses by one source."""
    factor = found.amount / errors.amount(source).sigma
    if found.verdict == "loses at zero":
        return "0"
    return "never" if factor > NEVER else size_in_words(errors, source, factor)


def screen_table(cells: TextTable) -> "Table":
    """A table for a terminal."""
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, padding=(0, 2, 0, 0))
    for column, name in enumerate(cells.head):
        table.add_column(Text(name), justify="left" if column < cells.left else "right")
    for row in cells.body:
        table.add_row(*map(Text, row))
    return table
