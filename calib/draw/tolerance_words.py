"""What a tolerance study says in words: its answer, what limits it keeps, and what else there is to know."""

import math
from collections.abc import Iterator, Sequence

from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.quantities import MAIN, other_reference, quantity_named
from calib.studies.tolerance.record import (
    FEWEST_TO_CHECK,
    NEVER,
    OFF,
    BudgetRow,
    CostRow,
    Crossovers,
    ErrorUnit,
    ToleranceStudy,
)
from calib.studies.tolerance.sizes import FACTORS
from calib.studies.tolerance.what_if import RankedWay
from designer.base.words import capital, figure, with_digits
from designer.page.blocks import Finding, Headline
from designer.tolerance.sources import SOURCES

BELOW = 0.1
"""Of the noise: a cost below adds half a percent to an error, and is no more than told to be small."""
EXACT = 2e-3
"""A standard error below this share of its value is not shown."""
SMALL_SHARE, LARGE_SHARE = 1e-3, 0.1
MOST_NAMED, MOST_DEVIATIONS = 3, 8
HUMAN: dict[ErrorUnit, tuple[str, float]] = {
    "mm": ("mm", 1.0), "rad": ("deg", math.degrees(1.0)), "1": ("%", 100.0), "K": ("K", 1.0), "": ("", 1.0),
}  # fmt: skip
"""What a person calls a unit of errors, and how many there are in one."""


def source_title(error: str) -> str:
    """An error in words."""
    return SOURCES[error].title if error in SOURCES else error


def short(quantity: str) -> str:
    """A quantity's name as words."""
    return quantity.replace("_", " ")


def amount(unit: ErrorUnit, size: float) -> str:
    """A size to three digits, in the unit that a person calls it by."""
    name, per = HUMAN[unit]
    return f"{float(f'{size * per:.3g}'):g}{name}" if math.isfinite(size) else "-"


def assumed(one: CostRow) -> str:
    """The amount of an error that was assumed, and how it is distributed if that is not normally."""
    kind = "" if one.distribution in ("", "normal") else f"{one.distribution} "
    return f"{kind}{amount(one.unit, one.size)}"


def amount_of(one: CostRow, rms: float) -> str:
    """A size whose root mean square is this, distributed as what was assumed."""
    return amount(one.unit, one.size * rms / one.rms) if one.rms else "-"


def share_text(share: float) -> str:
    """A share of the squared costs."""
    return "< 0.1 %" if share < SMALL_SHARE else f"{100 * share:.1f} %"


def cost_text(one: CostRow, noise: float) -> str:
    """A cost with its standard error; what is far below the noise, or not told from it, is only bounded."""
    low, high = (one.cost if math.isnan(end) else end for end in (one.cost_low, one.cost_high))
    if not math.isfinite(one.cost):
        return "no solution"
    if one.cost == 0 and high == 0:
        return "0"
    least = BELOW * noise
    if one.cost < least or not low > 0:
        return f"< {figure(max(high, least), 2)}"
    error = (high - low) / (2 * HALF_WIDTH)
    if not error > EXACT * one.cost:
        return figure(one.cost, 3)
    decimals = min(max(0, 1 - math.floor(math.log10(error))), 15)
    return f"{with_digits(one.cost, error)} ± {error:.{decimals}f}"


def tolerance_headline(study: ToleranceStudy) -> Headline:
    """Whether the limits are kept; without any, what the errors cost."""
    missed = [one for one in study.budgets if not one.met_as_assumed]
    if missed:
        return Headline("bad", "limit missed", " ".join(budget_sentence(study, one) for one in missed))
    if study.budgets:
        return Headline("good", "limit kept", " ".join(budget_sentence(study, one) for one in study.budgets))
    sentence = cost_sentence(study)
    if study.crossovers is not None:
        sentence += f" {against_sentence(study, study.crossovers)}"
    return Headline("note", "answered", sentence)


def cost_sentence(study: ToleranceStudy) -> str:
    """What all errors make of the quantity that is ranked by, which of them most, and the same against the other shape.

    An error may show against the drawing or against the true shape alone, so one without the other would mislead.
    """
    one, other = quantity_named(study.ranked_by), other_reference(study.ranked_by)
    noise, first = study.noise(one.name), _large(study, one.name)[:1]
    text = (
        f"With errors as assumed the {one.title} of {study.target} is {_value(study.total(one.name), one.unit)}, "
        f"{figure(noise, 2)} {one.unit} from noise alone{_most_of(study, one.name)}."
    )
    for row in first:
        text += f" Without {source_title(row.error)} it would be {_value(study.without(row), one.unit)}."
    if other is None:
        return text
    total = _value(study.total(other.name), other.unit)
    return f"{text} The {other.title} is {total}{_most_of(study, other.name)}."


def _large(study: ToleranceStudy, quantity: str) -> list[CostRow]:
    return [one for one in study.ranked(quantity) if one.share >= LARGE_SHARE][:MOST_NAMED]


def _most_of(study: ToleranceStudy, quantity: str) -> str:
    names = ", ".join(f"{source_title(one.error)} ({100 * one.share:.0f} %)" for one in _large(study, quantity))
    return f"; most of that is from {names}" if names else ""


def _value(value: float, unit: str) -> str:
    return f"{figure(value, 3)} {unit}"


def budget_sentence(study: ToleranceStudy, budget: BudgetRow) -> str:
    """Whether a limit is kept, and how much larger or smaller errors may be."""
    one = quantity_named(budget.quantity)
    verdict = "kept" if budget.met_as_assumed else "missed"
    return (
        f"{capital(one.title)} of {study.target} is {_value(study.total(one.name), one.unit)} where {budget.limit:g} "
        f"{one.unit} are allowed: {verdict}. {budget_advice(study, budget)}"
    )


def budget_advice(study: ToleranceStudy, budget: BudgetRow) -> str:
    """How much room errors have, or what must come down."""
    one = quantity_named(budget.quantity)
    if not budget.met_by_noise_alone:
        return (
            f"Noise alone gives {figure(study.noise(one.name), 2)} {one.unit}, so no print is good enough: take more "
            "views, come nearer, or allow more."
        )
    if budget.together.factor > NEVER:
        return "It is kept whatever these errors are."
    text = f"All errors together may be {figure(budget.together.factor, 2)} times what is assumed."
    largest = {one.error: one.largest_rms for one in budget.alone}
    broken = [row for row in study.ranking if largest[row.error] < row.rms]
    parts = [
        f"{source_title(row.error)} from {assumed(row)} to {amount_of(row, largest[row.error])}"
        for row in broken[:MOST_NAMED]
    ]
    more = f" (and {len(broken) - MOST_NAMED} more)" if len(broken) > MOST_NAMED else ""
    return f"{text} Even alone these must come down: {', '.join(parts)}{more}." if parts else text


def budget_finding(study: ToleranceStudy, budget: BudgetRow) -> Finding:
    """A limit as something that was checked."""
    one = quantity_named(budget.quantity)
    return Finding(
        "good" if budget.met_as_assumed else "bad", capital(one.title), budget_advice(study, budget),
        _value(study.total(one.name), one.unit), f"at most {budget.limit:g} {one.unit}",
    )  # fmt: skip


def elsewhere(study: ToleranceStudy, error: str, quantity: str) -> str:
    """What an error that does nothing to a quantity costs against the other shape; "" if nothing."""
    other = other_reference(quantity)
    if other is None:
        return ""
    one, noise = study.cost(error, other.name), study.noise(other.name)
    return f"costs {_value(one.cost, other.unit)} of the {other.title}" if one.cost > BELOW * noise else ""


def against_sentence(study: ToleranceStudy, other: Crossovers) -> str:
    """Which target is better, by how many of the errors."""
    known = [name for name in MAIN if other.totals[name] > 0]
    if not known:
        return ""
    better = [name for name in known if study.total(name) < other.totals[name]]
    by = study.ranked_by if study.ranked_by in known else known[0]
    ratio = max(study.total(by) / other.totals[by], 1e-12)
    word = "smaller" if ratio < 1 else "larger"
    return (
        f"Against {other.target}, {study.target} is better by {len(better)} of {len(known)} errors; its "
        f"{quantity_named(by).title} is {figure(max(ratio, 1 / ratio), 2)} times {word}."
    )


def cost_notes(study: ToleranceStudy) -> Iterator[Finding]:
    """What to know of the table of costs."""
    if study.idle:
        text = "No measured point moves against the others: these errors do nothing to this target, or are 0."
        yield Finding("note", ", ".join(study.idle), text)
    for error, count in zip((BARE, *study.errors, TOGETHER), study.failed, strict=False):
        if count:
            text = f"{count} of {study.draws} draws have no solution and do not count."
            yield Finding("usable", "all errors together" if error == TOGETHER else error, text)


def prediction_sentence(study: ToleranceStudy) -> str:
    """Whether the prediction from Jacobians holds."""
    if study.kind == "linear":
        return "Predicted for small errors; nothing has checked it: design tolerance without --linear draws."
    if study.draws < FEWEST_TO_CHECK:
        return f"{study.draws} draws are too few to check the prediction with; {FEWEST_TO_CHECK} do."
    if any(study.deviations()):
        return "The prediction is off for what is named below: trust the draws there."
    return "The prediction is within 10 % of the draws for every error: --linear, which takes seconds, will do."


def prediction_notes(study: ToleranceStudy) -> Iterator[Finding]:
    """Where the prediction fails, and where errors do not add in squares."""
    found = list(study.deviations())
    for one in found[:MOST_DEVIATIONS]:
        quantity = quantity_named(one.quantity)
        name = "all together" if one.error == TOGETHER else one.error
        text = f"{_value(one.predicted, quantity.unit)} predicted, {_value(one.cost, quantity.unit)} by draws."
        yield Finding("usable", f"{name}, {quantity.title}", text)
    if len(found) > MOST_DEVIATIONS:
        yield Finding("usable", "", f"And {len(found) - MOST_DEVIATIONS} more: table.csv has all.")
    off = [(name, study.excess(name)) for name in MAIN]
    parts = [f"{quantity_named(name).title} {value:.2f}" for name, value in off if abs(value - 1) > OFF]
    if parts:
        text = f"All together over the root of their summed squares: {', '.join(parts)}."
        yield Finding("note", "Errors that do not add in squares", text)


def ranking_alt(study: ToleranceStudy) -> str:
    """What the bars show."""
    parts = []
    for name in MAIN:
        costs = [(one.cost, one.error) for one in study.ranked(name) if one.cost > 0]
        if costs:
            value, error = max(costs)
            parts.append(f"{short(name)} {source_title(error)}, {figure(value, 2)} {quantity_named(name).unit}")
    return f"The largest single cost of each error of the calibration: {'; '.join(parts) or 'none'}."


def swept_sources(study: ToleranceStudy, quantity: str) -> tuple[str, ...]:
    """The errors that cost a quantity more than a tenth of the noise at some amount that is drawn, largest first."""
    least = BELOW * study.cost(BARE, quantity).predicted / FACTORS[-1]
    costs = {one.error: study.cost(one.error, quantity).predicted for one in study.sweeps}
    return tuple(
        sorted((error for error, cost in costs.items() if cost > max(least, 0.0)), key=lambda one: -costs[one])
    )


def sweep_alt(study: ToleranceStudy, quantity: str) -> str:
    """What the curves of a quantity show."""
    one = quantity_named(quantity)
    largest = {row.error: max(filter(math.isfinite, row.of(quantity).cost), default=0.0) for row in study.sweeps}
    parts = [
        f"{source_title(error)} up to {figure(largest[error], 2)} {one.unit}"
        for error in swept_sources(study, quantity)
    ]
    return f"{capital(one.title)} by the size of each error: {'; '.join(parts) or 'none matters'}."


def quantities_wanted(study: ToleranceStudy) -> Sequence[str]:
    """The quantity that errors are ranked by, and those with a limit."""
    return tuple(dict.fromkeys((study.ranked_by, *(one.quantity for one in study.budgets))))


def best_way(ranked: tuple[RankedWay, ...]) -> str:
    """The best and the last."""
    first, last = ranked[0], ranked[-1]
    quantity = quantity_named(first.ranked_by)
    return (
        f"{capital(first.way.title)} ({first.way.name}) gives the least {quantity.title}, {_way_value(first)}; "
        f"{last.way.name} the largest, {_way_value(last)}."
    )


def choice_of_ways(ranked: tuple[RankedWay, ...]) -> str:
    """The ways that no other beats in both error and price."""
    known = [one for one in ranked if math.isfinite(one.way.price_eur)]
    worth = [one for one in known if not any(one.is_beaten_by(other) for other in known)]
    named = ", ".join(f"{one.way.name} ({_way_value(one)}, {two_digits(one.way.price_eur)} EUR)" for one in worth)
    return f"Better ones cost more: {named}. Each other one is beaten in error and price." if named else ""


def _way_value(one: RankedWay) -> str:
    value = one.total()
    return f"{figure(value, 3 if value >= 1 else 2)} {quantity_named(one.ranked_by).unit}"


def two_digits(value: float) -> str:
    """An estimate has no more."""
    return f"{float(f'{value:.2g}'):g}" if math.isfinite(value) else "-"
