"""The ways in which a target is made, side by side: error of the camera, price and hours."""

import math

from calib.show.studies.tolerance_tables import HEADS
from calib.show.studies.tolerance_words import source_title
from calib.studies.tolerance.quantities import quantity_named
from calib.studies.tolerance.record import ToleranceStudy
from calib.studies.tolerance.what_if import RankedWay
from designer.base.number_text import figure
from designer.base.words import capital
from designer.page.blocks import Cell, Column, Headline, Section, Table

TITLE = "Ways of making"
SHOWN = ("distortion_map", "focal_length", "intersection_true")
NOTE = (
    "Root mean square errors with all errors of the template and noise, as the drawing is taken for true; calib "
    "measure takes "
    "most of them back. ~: the prediction may be more than 10 % off. Price and hours are rough, from the templates "
    "(templates/errors), which say where each number comes from; hours are of machine and hands, delivery takes days."
)


def ways_section(study: ToleranceStudy, by: str) -> Section | None:
    """The table and what it says; None of a study from before there were ways to choose from."""
    if study.what_ifs is None or not (ranked := study.ways(by)):
        return None
    return Section(TITLE, (ways_table(study, by),), lead=_choice(ranked))


def ways_headline(study: ToleranceStudy, by: str) -> Headline:
    """Which way is best, and which are worth their price."""
    ranked = study.ways(by)
    return Headline("note", "answered", f"{_best(ranked)} {_choice(ranked)}")


def ways_table(study: ToleranceStudy, by: str) -> Table:
    """A row a way, the best first."""
    names = (by, *(name for name in SHOWN if name != by))
    head = (Column("way", is_number=False), Column("made as", is_number=False))
    tail = (Column("most of it from", is_number=False), Column("price [EUR]"), Column("hours"))
    numbers = tuple(Column(_head(name), note=quantity_named(name).title) for name in names)
    rows = tuple(
        (
            Cell(one.way.name), Cell(one.way.title), *(_total(one, name) for name in names),
            Cell(source_title(one.worst)), _rough(one.way.price_eur), _rough(one.way.hours),
        )
        for one in study.ways(by)
    )  # fmt: skip
    noise = ", ".join(f"{figure(study.noise(name), 2)} {quantity_named(name).unit}" for name in names)
    note = f"{NOTE} Noise alone gives {noise}."
    title = f"{TITLE} by the {quantity_named(by).title}"
    return Table(title, (*head, *numbers, *tail), rows, note, visible_rows=20)


def _head(name: str) -> str:
    quantity = quantity_named(name)
    return HEADS.get(name, f"{quantity.title} [{quantity.unit}]")


def _total(one: RankedWay, quantity: str) -> Cell:
    value = one.total(quantity)
    return Cell(f"{'~' if one.is_beyond(quantity) else ''}{figure(value, 3 if value >= 1 else 2)}", value)


def _rough(value: float) -> Cell:
    """Two digits: an estimate has no more."""
    if not math.isfinite(value):
        return Cell("-")
    return Cell(f"{float(f'{value:.2g}'):g}", value)


def _best(ranked: tuple[RankedWay, ...]) -> str:
    first, last = ranked[0], ranked[-1]
    quantity = quantity_named(first.ranked_by)
    return (
        f"{capital(first.way.title)} ({first.way.name}) gives the least {quantity.title}, {_value(first)}; "
        f"{last.way.name} the largest, {_value(last)}."
    )


def _choice(ranked: tuple[RankedWay, ...]) -> str:
    """The ways that no other beats in both error and price."""
    known = [one for one in ranked if math.isfinite(one.way.price_eur)]
    worth = [one for one in known if not any(one.is_beaten_by(other) for other in known)]
    named = ", ".join(f"{one.way.name} ({_value(one)}, {_rough(one.way.price_eur).text} EUR)" for one in worth)
    return (
        f"Better ones cost more: {named}. Each other one is beaten by one of these, in error and in price."
        if named
        else ""
    )


def _value(one: RankedWay) -> str:
    value = one.total()
    return f"{figure(value, 3 if value >= 1 else 2)} {quantity_named(one.ranked_by).unit}"
