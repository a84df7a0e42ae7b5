"""The sliders on the page of a tolerance study: what errors of other sizes would do, and the command line of it."""

import math
import shlex
from collections.abc import Iterator, Sequence
from itertools import chain

from calib.draw.tolerance_words import HUMAN, source_title
from calib.studies.tolerance.quantities import MAIN, NAMES, quantity_named, quantity_row
from calib.studies.tolerance.record import ToleranceStudy, nine_digits
from calib.studies.tolerance.what_if import SetError, Way, WhatIf, WhatIfTable
from designer.base.words import figure
from designer.page import blocks
from designer.page.blocks import Cell, Column, Level, Section, Table
from designer.page.what_if import Choice, Measure, SetSize, Slider, WhatIfModel, WhatIfSide
from designer.tolerance.source import Unit
from designer.tolerance.sources import SOURCES

OUT, WHAT_IF = "what-if", "What if"
SET_ANEW = ("--errors", "--set", "--against-errors", "--against-set", "--require", "--by", "--out", "-o")
SWITCHES = ("--linear", "--resume", "--json")
"""Options of the command that made the study, and those without a value, that the sliders' command has no use for."""
WANTED = 0.5
"""Of what a measure is, where no limit was asked for: a place to start from."""
WIDEST, NARROWEST = 10.0, 0.1
"""Of the sizes that any way of making has: where sliders end, and the decade around that."""
ROUNDING = 1e-6
"""Of a logarithm: ten times 0.1 degrees is 1 degree."""
SMALLEST: dict[Unit, tuple[float, float]] = {"mm": (0.01, 1), "rad": (0.01, 1), "1": (0.01, 1), "K": (1, 10)}
"""Where they end for errors that no way has, as a person counts them (assumptions)."""
LEAD = "Set sizes of errors, or a way of making: the prediction follows."
NOTE = (
    "Predicted for small errors, as sums of squares{draws}. Hatched: what is missed of this error puts what is looked "
    "at 10 % off; a number with a warning is that far off by all of them. What two errors do to each other only draws "
    "tell: the command below."
)
BY_DRAWS = ", where all other sections tell what was drawn"


def what_if_section(study: ToleranceStudy, command: str) -> Section | None:
    """The sliders; None where no error does anything."""
    if not study.what_ifs.start.errors:
        return None
    sides = tuple(_sides(study))
    shown = tuple(quantity_row(name) for name in (*MAIN, study.ranked_by) if math.isfinite(study.noise(name)))
    measures = tuple(_measure(study, name) for name in NAMES)
    model = WhatIfModel(
        measures, tuple(dict.fromkeys(shown)), quantity_row(study.ranked_by), sides, _command(study, command)
    )
    note = NOTE.format(draws=BY_DRAWS if study.kind == "draws" else "")
    return Section(WHAT_IF, (blocks.Sliders("How large each error is", model, _table(study), note),), lead=LEAD)


def _tables(study: ToleranceStudy) -> Iterator[tuple[str, WhatIfTable]]:
    """What is compared, by name."""
    yield study.target, study.what_ifs
    if study.crossovers is not None:
        yield study.crossovers.target, study.crossovers.what_ifs


def _sides(study: ToleranceStudy) -> Iterator[WhatIfSide]:
    for number, (name, table) in enumerate(_tables(study)):
        sliders = tuple(_slider(error, table) for error in range(len(table.start.errors)))
        before = "--against-" if number else "--"
        yield WhatIfSide(
            name, table.law, sliders, tuple(map(_choice, table.ways)), _choice(table.start), f"{before}errors",
            f"{before}set",
        )  # fmt: skip


def _per(error: str) -> tuple[str, float]:
    """What a person calls the unit of an error, and how many are in one."""
    return HUMAN[SOURCES[error].unit]


def _slider(place: int, table: WhatIfTable) -> Slider:
    error = table.start.errors[place].error
    unit, per = _per(error)
    sizes = [per * abs(way.errors[place].size) for way in (*table.ways, table.start) if way.errors[place].size]
    low, high = SMALLEST[SOURCES[error].unit]
    if sizes:
        low, high = NARROWEST * min(sizes), WIDEST * max(sizes)
    decades = (10.0 ** math.floor(math.log10(size) + ROUNDING) for size in (low, high))
    return Slider(error, source_title(error), unit, *map(nine_digits, decades))


def _choice(way: Way) -> Choice:
    return Choice(way.name, way.title, tuple(map(_setting, way.errors)))


def _setting(one: SetError) -> SetSize:
    per = _per(one.error)[1]
    return SetSize(one.distribution, nine_digits(one.size * per), one.gain / per)


def _measure(study: ToleranceStudy, name: str) -> Measure:
    one = quantity_named(name)
    asked = {budget.quantity: budget.limit for budget in study.budgets}
    total = study.what_if().total(name)
    guess = float(f"{WANTED * total:.1g}") if total > 0 else 1.0
    return Measure(name, one.title, one.unit, asked.get(name, guess), name in asked)


def _command(study: ToleranceStudy, made_by: str) -> tuple[str, ...]:
    """The words of a command line without what the sliders set."""
    try:
        words = shlex.split(made_by)
    except ValueError:  # it was too long for its place
        words = []
    if words[1:2] != ["tolerance"]:
        other = () if study.crossovers is None else ("--against", f"{study.crossovers.target}.target.json")
        return ("design", "tolerance", f"{study.target}.target.json", *other, "-o", OUT)
    return (*_without(words, SET_ANEW), "-o", OUT)


def _without(words: Sequence[str], options: Sequence[str]) -> Iterator[str]:
    """Words without some options and their values."""
    rest = iter(words)
    for word in rest:
        if word in options:
            next(rest, "")
        elif word.partition("=")[0] not in (*options, *SWITCHES):
            yield word


def _table(study: ToleranceStudy) -> Table:
    """What is predicted where nothing can be set."""
    asked = [(name, table.ask(None, {})) for name, table in _tables(study)]
    columns = (
        Column("of the calibration", is_number=False),
        *chain.from_iterable((Column(name), Column("noise alone")) for name, _ in asked),
    )
    names = (name for name in MAIN if math.isfinite(study.noise(name)))
    rows = tuple(
        (Cell(quantity_named(name).title), *chain.from_iterable(_cells(one, name) for _, one in asked))
        for name in names
    )
    return Table("Predicted with errors as assumed", columns, rows)


def _cells(asked: WhatIf, name: str) -> tuple[Cell, Cell]:
    """The total, with care where it is beyond reach, and what noise alone gives."""
    unit, row = quantity_named(name).unit, quantity_row(name)
    total, noise = asked.total(name), math.sqrt(asked.table.law.noise[row])
    level: Level | None = "usable" if name in asked.beyond else None
    return Cell(f"{figure(total, 3)} {unit}", total, level=level), Cell(f"{figure(noise, 3)} {unit}", noise)
