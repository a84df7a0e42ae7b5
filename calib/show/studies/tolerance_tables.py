"""The tables of the page of a tolerance study."""

import math
from collections.abc import Sequence

import numpy as np

from calib.core.number_text import figure
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.report import MAIN, NEVER, of_name
from calib.studies.tolerance.result import Cost
from calib.studies.tolerance.table_file import (
    AllowedRow,
    BudgetRow,
    CostRow,
    CrossoverRow,
    Crossovers,
    ErrorUnit,
    Together,
    ToleranceFile,
)
from calib.studies.tolerance.tables import HEADS, cost_cell, short, size_words
from designer.base.words import capital
from designer.page.blocks import Cell, Column, Level, Table
from designer.tolerance.registry import SOURCES

SMALL_SHARE = 1e-3
NOT_KNOWN = Cell("-")


def source_title(error: str) -> str:
    """An error in words."""
    return SOURCES[error].title.partition(",")[0] if error in SOURCES else error


def amount(unit: ErrorUnit, size: float | None) -> str:
    """A size in the unit that a person calls it by."""
    if size is None:
        return "-"
    return f"{size:g}" if unit == "" else size_words(size, unit)


def assumed(one: CostRow) -> str:
    """The amount of an error that was assumed, and how it is distributed if that is not normally."""
    kind = "" if one.distribution in ("", "normal") else f"{one.distribution} "
    return f"{kind}{amount(one.unit, one.size)}"


def amount_of(one: CostRow, rms: float | None) -> str:
    """A size whose root mean square is this, distributed as what was assumed."""
    if rms is None or one.size is None or not one.rms:
        return "-"
    return amount(one.unit, one.size * rms / one.rms)


def head(quantity: str) -> str:
    """A quantity with its unit over a column."""
    return HEADS[quantity].replace("\n", " ")


def cost_table(table: ToleranceFile) -> Table:
    """What each error costs each quantity."""
    by = of_name(table.ranked_by)
    columns = (
        Column("error", is_number=False), Column("assumed", is_number=False, note="one standard deviation"),
        Column(f"share of {short(by.name)}"),
        Column(f"without it [{by.unit}]", note=f"the {by.title} that would be left if this error alone were none"),
        *(Column(head(name), note=of_name(name).title) for name in MAIN),
    )  # fmt: skip
    rows = [_cost_row(table, one) for one in table.ranking]
    note = (
        "A cost is what an error adds, in squares, to what noise alone gives; < where it is below a tenth of the noise "
        "or not told from it."
    )
    return Table("What each error costs", columns, tuple(rows), note, visible_rows=20)


def together_table(table: ToleranceFile) -> Table:
    """What all errors add together, and what is left without any: apart, so that no sorting mixes them with errors."""
    columns = (Column("of", is_number=False), *(Column(head(name), note=of_name(name).title) for name in MAIN))
    noise = [Cell(figure(table.noise(name), 3), table.noise(name)) for name in MAIN]
    rows = (
        (Cell("all errors together"), *_costs(table, TOGETHER)),
        (Cell("no error: noise alone"), *noise),
    )
    return Table("All errors together, and none", columns, rows)


def _cost_row(table: ToleranceFile, one: CostRow) -> tuple[Cell, ...]:
    share = one.share or 0.0
    text = "< 0.1 %" if share < SMALL_SHARE else f"{100 * share:.1f} %"
    left = math.sqrt(max(table.total(one.quantity) ** 2 - (one.cost or 0.0) ** 2, 0.0))
    return (
        Cell(one.error), Cell(assumed(one), one.rms), Cell(text, share),
        Cell(figure(left, 3), left), *_costs(table, one.error),
    )  # fmt: skip


def _costs(table: ToleranceFile, error: str) -> list[Cell]:
    return [_cost(table, error, name) for name in MAIN]


def _cost(table: ToleranceFile, error: str, quantity: str) -> Cell:
    found = table.cost(error, quantity)
    if found is None or found.cost is None:
        return Cell("no solution")
    low, high = (found.cost if end is None else end for end in (found.cost_low, found.cost_high))
    cost = Cost(np.array(found.cost), np.array(low), np.array(high))
    return Cell(cost_cell(cost, (), table.noise(quantity)).replace("\n", " "), found.cost)


def budget_table(table: ToleranceFile, budget: BudgetRow) -> Table:
    """The largest amount of each error that keeps a limit, as if it were the only one."""
    allowed = {one.error: one for one in budget.alone}
    columns = (
        Column("error", is_number=False), Column("assumed", is_number=False), Column("largest alone"),
        Column("95 %", is_number=False), Column("largest / assumed"), Column("", is_number=False),
    )  # fmt: skip
    rows = [_budget_row(one, allowed[one.error], table) for one in table.ranking if one.error in allowed]
    if budget.together.factor is not None:
        rows.append(_together_row(budget.together, budget.together.factor, table))
    note = "Largest: as if all other errors were none. Below 1 in the last number: this error alone breaks the limit."
    title = f"For {short(budget.quantity)} up to {budget.limit:g} {budget.unit}"
    return Table(title, columns, tuple(rows), note, visible_rows=20)


def _together_row(together: Together, factor: float, table: ToleranceFile) -> tuple[Cell, ...]:
    """All errors scaled alike; a prediction has no interval."""
    low, high = together.factor_low, together.factor_high
    has_interval = table.kind == "draws" and low is not None and high is not None
    interval = f"{figure(low or 0.0, 3)} x to {figure(high or 0.0, 3)} x" if has_interval else ""
    times = Cell(f"{figure(factor, 3)} x", factor)
    return Cell("all together, alike"), Cell("1 x"), times, Cell(interval), _over_assumed(factor), Cell("")


def _over_assumed(factor: float) -> Cell:
    return Cell(figure(factor, 3), factor, level=_fits(factor))


def _fits(factor: float) -> Level:
    return "good" if factor >= 1 else "bad"


def _budget_row(one: CostRow, allowed: AllowedRow, table: ToleranceFile) -> tuple[Cell, ...]:
    title = Cell(f"{source_title(one.error)} ({one.error})")
    factor = allowed.largest_rms / one.rms if allowed.largest_rms is not None and one.rms else None
    if factor is None or factor > NEVER:
        return title, Cell(assumed(one), one.rms), Cell("does not matter", math.inf), Cell(""), Cell(""), Cell("")
    low, high = (amount_of(one, end) for end in (allowed.largest_rms_low, allowed.largest_rms_high))
    interval = "" if table.kind == "linear" or "-" in (low, high) else f"{low} to {high}"
    return (
        title, Cell(assumed(one), one.rms), Cell(amount_of(one, allowed.largest_rms), allowed.largest_rms),
        Cell(interval), _over_assumed(factor),
        Cell("found with draws" if allowed.by_draws else ""),
    )  # fmt: skip


def crossover_table(table: ToleranceFile, other: Crossovers) -> Table:
    """From which amount of each error on the target loses to the other."""
    found: dict[tuple[str, str], CrossoverRow] = {(one.error, one.quantity): one for one in other.found}
    columns = (
        Column("error", is_number=False), Column("assumed", is_number=False),
        *(Column(head(name), note=of_name(name).title) for name in MAIN),
    )  # fmt: skip
    rows = [
        (Cell(one.error), Cell(assumed(one), one.rms),
         *(_crossing(one, found.get((one.error, name))) for name in MAIN))
        for one in table.ranking
    ]  # fmt: skip
    note = (
        "The size of one error from which on the target is the worse one, all others as assumed. 0: worse already "
        "without it; never: it does not make it worse. Green: still better at what is assumed."
    )
    return Table(f"Worse than {other.target} from", columns, tuple(rows), note, visible_rows=20)


def _crossing(one: CostRow, found: CrossoverRow | None) -> Cell:
    if found is None:
        return NOT_KNOWN
    if found.verdict == "loses at zero":
        return Cell("0", 0.0, level="bad")
    factor = math.inf if found.rms is None or not one.rms else found.rms / one.rms
    if factor > NEVER:
        return Cell("never", math.inf, level="good")
    return Cell(amount_of(one, found.rms), found.rms, level=_fits(factor))


def totals_table(table: ToleranceFile, other: Crossovers) -> Table:
    """Both targets as they are assumed to be made."""
    theirs = other_totals(other)
    columns = (
        Column("error of the calibration", is_number=False), Column(table.target), Column(other.target),
        Column("ratio", note="below 1: the first is better"),
    )  # fmt: skip
    rows = []
    for name in MAIN:
        own, there, unit = table.total(name), theirs.get(name), of_name(name).unit
        if there is None:
            continue
        ratio = own / there if there > 0 else math.inf
        numbers = [Cell(f"{figure(value, 3)} {unit}", value) for value in (own, there)]
        level: Level = "good" if ratio < 1 else "bad"
        rows.append((Cell(of_name(name).title), *numbers, Cell(figure(ratio, 3), ratio, level=level)))
    return Table("Both as they are assumed to be made", columns, tuple(rows))


def other_totals(other: Crossovers) -> dict[str, float]:
    """The other target's errors, by quantity."""
    return {one.quantity: one.other for one in other.found if one.other is not None}


def sensitivity_table(table: ToleranceFile) -> Table:
    """The cost by a unit of each error."""
    columns = (Column("by", is_number=False), *(Column(head(name)) for name in MAIN))
    rows = []
    for one in table.ranking:
        unit = amount(one.unit, 1.0) if one.unit in ("mm", "K", "") else {"rad": "1deg", "1": "1%"}[one.unit]
        scale = {"rad": math.pi / 180, "1": 0.01}.get(one.unit, 1.0)
        rows.append((Cell(f"{unit} of {one.error}"), *(_by_unit(table, one.error, name, scale) for name in MAIN)))
    return Table("Cost by a unit of each error", columns, tuple(rows), visible_rows=20)


def _by_unit(table: ToleranceFile, error: str, quantity: str, scale: float) -> Cell:
    found, text = table.cost(error, quantity), _cost(table, error, quantity).text
    if found is None or found.by_unit is None or text == "0" or text[0] in "<n":
        return NOT_KNOWN
    value = found.by_unit * scale
    return Cell(figure(value, 3), value)


def reach_table(table: ToleranceFile) -> Table | None:
    """Up to which amount the prediction from Jacobians holds; None if that was not tried."""
    if not table.sweeps:
        return None
    columns = (
        Column("error", is_number=False), Column("assumed", is_number=False), Column("within 10 % up to"),
        Column("fails first for", is_number=False), Column("by draws"), Column("predicted"),
    )  # fmt: skip
    rows = []
    for one in table.ranking:
        limits = [
            (found.prediction_holds_to_rms, name)
            for name in MAIN
            if (found := table.cost(one.error, name)) is not None and found.prediction_holds_to_rms is not None
        ]
        drawn, predicted = one.cost or 0.0, one.predicted or 0.0
        ends = (Cell(figure(drawn, 3), drawn), Cell(figure(predicted, 3), predicted))
        if limits:
            rms, first = min(limits)
            holds = bool(one.rms is None or rms >= one.rms)
            limit = Cell(amount_of(one, rms), rms, level=None if holds else "usable")
            rows.append((Cell(one.error), Cell(assumed(one), one.rms), limit, Cell(short(first)), *ends))
        else:
            rows.append((Cell(one.error), Cell(assumed(one), one.rms), Cell("all tried", math.inf), Cell(""), *ends))
    note = f"By draws and predicted: the cost of {short(table.ranked_by)} at what is assumed."
    return Table("How far the prediction from Jacobians holds", columns, tuple(rows), note, visible_rows=20)


def sweep_table(table: ToleranceFile, quantity: str) -> Table | None:
    """What each error costs a quantity at several amounts; None if that was not drawn."""
    rms = {one.error: one for one in table.ranking}
    swept = [(one, found) for one in table.sweeps if one.error in rms and (found := one.of(quantity)) is not None]
    if not swept:
        return None
    count = max(len(one.rms) for one, _ in swept)
    columns = [Column("error", is_number=False)]
    for place in range(count):
        columns += [Column(f"size {place + 1}", is_number=False), Column(f"cost {place + 1}")]
    rows = []
    for one, found in swept:
        cells = [Cell(one.error)]
        for place in range(count):
            known = place < min(len(one.rms), len(found.cost))
            cost = found.cost[place] if known else None
            cells.append(Cell(amount_of(rms[one.error], one.rms[place]), one.rms[place]) if known else NOT_KNOWN)
            cells.append(NOT_KNOWN if cost is None else Cell(figure(cost, 3), cost))
        rows.append(tuple(cells))
    unit = of_name(quantity).unit
    return Table(
        f"{capital(of_name(quantity).title)} at several sizes of each error [{unit}]", tuple(columns), tuple(rows)
    )


def amounts_table(table: ToleranceFile) -> Table:
    """Where the assumed amounts come from."""
    ranked = {one.error: one for one in table.costs if one.size is not None}
    rows = tuple(
        (Cell(name), Cell(source_title(name) if name in SOURCES else ""),
         Cell(assumed(ranked[name])) if name in ranked else Cell(""), Cell(where))
        for name, where in table.sources_of_amounts.items()
    )  # fmt: skip
    columns = tuple(Column(title, is_number=False) for title in ("error", "is", "assumed", "from"))
    return Table("Where the assumed amounts come from", columns, rows, visible_rows=20)


def quantities_wanted(table: ToleranceFile) -> Sequence[str]:
    """The quantity that errors are ranked by, and those with a limit."""
    return tuple(dict.fromkeys((table.ranked_by, *(one.quantity for one in table.budgets))))
