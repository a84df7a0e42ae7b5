"""The tables of a tolerance study, for its page, the terminal and Markdown."""

import math

from calib.draw import tolerance_words as words
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.quantities import MAIN, other_reference, quantity_named
from calib.studies.tolerance.record import NEVER, AllowedRow, BudgetRow, CostRow, Crossovers, Together, ToleranceStudy
from calib.studies.tolerance.what_if import RankedWay
from designer.base.words import capital, figure
from designer.page.blocks import Cell, Column, Table
from designer.tolerance.sources import SOURCES

NOT_KNOWN = Cell("-")
HEADS = {
    "reprojection": "reprojection [px]",
    "intersection": "intersection, drawing [mm]",
    "reconstruction": "reconstruction, drawing [mm]",
    "intersection_true": "intersection, true shape [mm]",
    "reconstruction_true": "reconstruction, true shape [mm]",
    "pose": "camera's centre [mm]",
    "focal_length": "focal length [px]",
    "distortion_map": "camera where seen [px]",
}
COST_NOTE = (
    "Cost: sqrt(m² - m0²) of the root mean square errors m with an error and noise, m0 with noise alone; < where it is "
    "below a tenth of the noise or not told from it."
)
WAYS = "Ways of making"
SHOWN = ("distortion_map", "focal_length", "intersection_true")
WAYS_NOTE = (
    "Root mean squares with all errors and noise, the drawing taken for true; calib measure takes most back. ~: may be "
    "more than 10 % off. Price and hours are rough, 10 to 20 %, with their sources in templates/errors; a design's "
    "own page tells its printer's. Hours are of machine and hands, without delivery."
)


def _words(*titles: str) -> tuple[Column, ...]:
    return tuple(Column(title, is_number=False) for title in titles)


def _quantity_columns() -> tuple[Column, ...]:
    return tuple(Column(HEADS[name]) for name in MAIN)


def _assumed_cells(one: CostRow) -> tuple[Cell, Cell]:
    return Cell(one.error), Cell(words.assumed(one), one.rms)


def ranking_table(study: ToleranceStudy) -> Table:
    """What each error adds to the quantity that is ranked by, against the drawing and against the true shape."""
    one, other = quantity_named(study.ranked_by), other_reference(study.ranked_by)
    quantities = (one,) if other is None else (one, other)
    columns: list[Column] = [*_words("error", "assumed")]
    for quantity in quantities:
        where = ", true shape" if quantity.name.endswith("_true") else "" if other is None else ", drawing"
        columns += [Column(f"share{where}", note="of the squared costs")]
        columns += [Column(f"cost{where} [{quantity.unit}]")]
    columns.append(Column(f"without it [{one.unit}]", note="the whole if this error alone were none"))
    rows = []
    for row in study.ranking:
        cells = [*_assumed_cells(row)]
        for quantity in quantities:
            share = study.cost(row.error, quantity.name).share
            cells += [Cell(words.share_text(share), share), _cost(study, row.error, quantity.name)]
        without = study.without(row)
        rows.append((*cells, Cell(figure(without, 3), without)))
    return Table(f"What each error adds to the {one.title}", tuple(columns), tuple(rows), COST_NOTE, visible_rows=20)


def cost_table(study: ToleranceStudy) -> Table:
    """What each error costs each quantity."""
    rows = tuple((*_assumed_cells(one), *_costs(study, one.error)) for one in study.ranking)
    columns = (*_words("error", "assumed"), *_quantity_columns())
    return Table("What each error costs", columns, rows, visible_rows=20)


def together_table(study: ToleranceStudy) -> Table:
    """What all errors add together, and what is left without any: apart, so that no sorting mixes them with errors."""
    noise = [Cell(figure(study.noise(name), 3), study.noise(name)) for name in MAIN]
    rows = ((Cell("all errors together"), *_costs(study, TOGETHER)), (Cell("no error: noise alone"), *noise))
    return Table("All errors together, and none", (*_words("of"), *_quantity_columns()), rows)


def _costs(study: ToleranceStudy, error: str) -> list[Cell]:
    return [_cost(study, error, name) for name in MAIN]


def _cost(study: ToleranceStudy, error: str, quantity: str) -> Cell:
    one = study.cost(error, quantity)
    value = one.cost if math.isfinite(one.cost) else None
    return Cell(words.cost_text(one, study.noise(quantity)), value)


def budget_table(study: ToleranceStudy, budget: BudgetRow) -> Table:
    """The largest amount of each error that keeps a limit, as if it were the only one, and of all together."""
    allowed = {one.error: one for one in budget.alone}
    columns = (
        *_words("error", "assumed"), Column("largest alone"), *_words("95 %"), Column("largest / assumed"), *_words(""),
    )  # fmt: skip
    rows = [_budget_row(study, one, allowed[one.error], budget.quantity) for one in study.ranking]
    if budget.together.factor <= NEVER:
        rows.append(_together_row(study, budget.together))
    note = "Largest: as if all other errors were none. Below 1 in the last number: this error alone breaks the limit."
    title = f"For {quantity_named(budget.quantity).title} up to {budget.limit:g} {budget.unit}"
    return Table(title, columns, tuple(rows), note, visible_rows=20)


def _budget_row(study: ToleranceStudy, one: CostRow, allowed: AllowedRow, quantity: str) -> tuple[Cell, ...]:
    factor = allowed.largest_rms / one.rms
    if factor > NEVER:
        remark = words.elsewhere(study, one.error, quantity)
        return (*_assumed_cells(one), Cell("any", math.inf), Cell(""), Cell(""), Cell(remark))
    low, high = (words.amount_of(one, end) for end in (allowed.largest_rms_low, allowed.largest_rms_high))
    interval = "" if study.kind == "linear" else f"{low} to {high}" if math.isfinite(allowed.largest_rms_high) else ""
    largest = Cell(words.amount_of(one, allowed.largest_rms), allowed.largest_rms)
    return (*_assumed_cells(one), largest, Cell(interval), _over_assumed(factor), _found_by(allowed))


def _together_row(study: ToleranceStudy, together: Together) -> tuple[Cell, ...]:
    """All errors scaled alike; a prediction has no interval."""
    interval = ""
    if study.kind == "draws" and math.isfinite(together.factor_high):
        interval = f"{figure(together.factor_low, 3)} x to {figure(together.factor_high, 3)} x"
    times = Cell(f"{figure(together.factor, 3)} x", together.factor)
    over = _over_assumed(together.factor)
    return Cell("all together, alike"), Cell("1 x"), times, Cell(interval), over, _found_by(together)


def _found_by(allowed: AllowedRow | Together) -> Cell:
    """How a largest amount was found, if not by the square law where that was checked."""
    unchecked = "beyond where the square law was checked" if allowed.unchecked else ""
    return Cell("found with draws" if allowed.by_draws else unchecked)


def _over_assumed(factor: float) -> Cell:
    return Cell(figure(factor, 3), factor, level="good" if factor >= 1 else "bad")


def crossover_table(study: ToleranceStudy, other: Crossovers) -> Table:
    """From which amount of each error on the target loses to the other."""
    rows = tuple(
        (*_assumed_cells(one), *(_crossing(one, other, name) for name in MAIN))
        for one in study.ranking
        if (one.error, one.quantity) in other.by_key
    )
    note = (
        "The size of one error from which on the target is the worse one, all others as assumed. 0: worse already "
        "without it; never: it does not make it worse; in brackets its 95 %. Green: still better at what is assumed."
    )
    columns = (*_words("error", "assumed"), *_quantity_columns())
    return Table(f"Worse than {other.target} from", columns, rows, note, visible_rows=20)


def _crossing(one: CostRow, other: Crossovers, quantity: str) -> Cell:
    found = other.by_key[one.error, quantity]
    if found.verdict == "loses at zero":
        return Cell("0", 0.0, level="bad")
    factor = found.rms / one.rms if one.rms else math.inf
    if factor > NEVER:
        return Cell("never", math.inf, level="good")
    ends = [words.amount_of(one, end) if math.isfinite(end) else "any" for end in (found.rms_low, found.rms_high)]
    interval = f" ({ends[0]} to {ends[1]})" if found.rms_low < found.rms_high else ""
    return Cell(f"{words.amount_of(one, found.rms)}{interval}", found.rms, level="good" if factor >= 1 else "bad")


def totals_table(study: ToleranceStudy, other: Crossovers) -> Table:
    """Both targets as they are assumed to be made."""
    columns = (
        *_words("error of the calibration"), Column(study.target), Column(other.target),
        Column("ratio", note="below 1: the first is better"),
    )  # fmt: skip
    rows = []
    for name in MAIN:
        one, own, theirs = quantity_named(name), study.total(name), other.totals[name]
        ratio = own / theirs if theirs > 0 else math.inf
        numbers = [Cell(f"{figure(value, 3)} {one.unit}", value) for value in (own, theirs)]
        rows.append((Cell(one.title), *numbers, Cell(figure(ratio, 3), ratio, level="good" if ratio < 1 else "bad")))
    return Table("Both as they are assumed to be made", columns, tuple(rows))


def sensitivity_table(study: ToleranceStudy) -> Table:
    """The cost by a unit of each error."""
    rows = []
    for one in study.ranking:
        unit, per = words.HUMAN[one.unit]
        cells = (_by_unit(study, one.error, name, per) for name in MAIN)
        rows.append((Cell(f"1{unit} of {one.error}"), *cells))
    columns = (*_words("by"), *_quantity_columns())
    return Table("Cost by a unit of each error", columns, tuple(rows), visible_rows=20)


def _by_unit(study: ToleranceStudy, error: str, quantity: str, per: float) -> Cell:
    one, text = study.cost(error, quantity), _cost(study, error, quantity).text
    if text == "0" or text[0] in "<n" or not math.isfinite(one.by_unit):
        return NOT_KNOWN
    value, low, high = (end / per for end in (one.by_unit, one.by_unit_low, one.by_unit_high))
    interval = f" ({figure(low, 3)} to {figure(high, 3)})" if high > low else ""
    return Cell(f"{figure(value, 3)}{interval}", value)


def reach_table(study: ToleranceStudy) -> Table:
    """Up to which amount the prediction from Jacobians holds."""
    rows = []
    for one in study.ranking:
        first = study.first_off(one.error)
        limit, fails = Cell("all tried", math.inf), ""
        if math.isfinite(first.reach):
            rms, fails = first.prediction_holds_to_rms, words.short(first.quantity)
            limit = Cell(words.amount_of(one, rms), rms, level=None if rms >= one.rms else "usable")
        ends = (Cell(figure(value, 3), value) for value in (one.cost, one.predicted))
        rows.append((*_assumed_cells(one), limit, Cell(fails), *ends))
    columns = (
        *_words("error", "assumed"), Column("within 10 % up to"), *_words("fails first for"), Column("by draws"),
        Column("predicted"),
    )  # fmt: skip
    note = f"By draws and predicted: the cost of {words.short(study.ranked_by)} at what is assumed."
    return Table("How far the prediction from Jacobians holds", columns, tuple(rows), note, visible_rows=20)


def sweep_table(study: ToleranceStudy, quantity: str) -> Table:
    """What each error costs a quantity at several amounts."""
    columns = [*_words("error")]
    for number in range(1, 1 + max(len(one.rms) for one in study.sweeps)):
        columns += [*_words(f"size {number}"), Column(f"cost {number}")]
    rows = []
    for one in study.sweeps:
        amounts, costs = study.cost(one.error, quantity), one.of(quantity).cost
        cells = [Cell(one.error)]
        for rms, cost in zip(one.rms, costs, strict=True):
            cells.append(Cell(words.amount_of(amounts, rms), rms))
            cells.append(Cell(figure(cost, 3), cost) if math.isfinite(cost) else NOT_KNOWN)
        rows.append((*cells, *[NOT_KNOWN] * (len(columns) - len(cells))))
    named = quantity_named(quantity)
    return Table(f"{capital(named.title)} at several sizes of each error [{named.unit}]", tuple(columns), tuple(rows))


def amounts_table(study: ToleranceStudy) -> Table:
    """Where the assumed amounts come from."""
    sizes = {error: words.assumed(study.cost(error, MAIN[0])) for error in study.errors}
    rows = tuple(
        tuple(map(Cell, (name, words.source_title(name) if name in SOURCES else "", sizes.get(name, ""), where)))
        for name, where in study.sources_of_amounts.items()
    )
    return Table("Where the assumed amounts come from", _words("error", "is", "assumed", "from"), rows, visible_rows=20)


def ways_table(study: ToleranceStudy, by: str) -> Table:
    """A row a way, the best first."""
    names = (by, *(name for name in SHOWN if name != by))
    head = (Column("way", is_number=False), Column("made as", is_number=False))
    tail = (Column("most of it from", is_number=False), Column("price [EUR]"), Column("hours"))
    numbers = tuple(Column(_head(name)) for name in names)
    rows = tuple(
        (
            Cell(one.way.name), Cell(one.way.title), *(_total(one, name) for name in names),
            Cell(words.source_title(one.worst)), _rough(one.way.price_eur),
            _rough(one.way.hours),
        )
        for one in study.ways(by)
    )  # fmt: skip
    noise = ", ".join(f"{figure(study.noise(name), 2)} {quantity_named(name).unit}" for name in names)
    note = f"{WAYS_NOTE} Noise alone gives {noise}."
    title = f"{WAYS} by the {quantity_named(by).title}"
    return Table(title, (*head, *numbers, *tail), rows, note, visible_rows=20)


def _head(name: str) -> str:
    quantity = quantity_named(name)
    return HEADS.get(name, f"{quantity.title} [{quantity.unit}]")


def _total(one: RankedWay, quantity: str) -> Cell:
    value = one.total(quantity)
    return Cell(f"{'~' if one.is_beyond(quantity) else ''}{figure(value, 3 if value >= 1 else 2)}", value)


def _rough(value: float) -> Cell:
    return Cell(words.two_digits(value), value if math.isfinite(value) else None)
