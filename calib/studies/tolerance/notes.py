"""What to know of a tolerance study's tables, in words."""

import math

from calib.core.number_text import figure
from calib.studies.tolerance.crossover import Crossover
from calib.studies.tolerance.draw import TOGETHER, case_names
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import (
    FEWEST_TO_CHECK,
    MAIN,
    NEVER,
    OFF,
    Against,
    CheckedBudget,
    ToleranceReport,
    deviations,
    of_name,
)
from calib.studies.tolerance.tables import short, size_in_words
from designer.tolerance.registry import SOURCES

MOST_DEVIATIONS = 8
DIAMETERS = ("ink_bleed",)


def notes(report: ToleranceReport) -> tuple[str, ...]:
    """Lines under the table of costs."""
    table = report.table
    how = (
        "predicted from the solver's Jacobians, where errors are small; without --linear draws check it"
        if table.kind == "linear"
        else f"{table.draws} draws, ± standard error; < where it is below a tenth of the noise, or not told from it"
    )
    lines = [f"cost: sqrt(m² - m0²) of the root mean square errors m with and m0 without the error; {how}"]
    lines += _ranking_lines(report)
    lines += [f"{name}: {_why_idle(report, name)}" for name in report.idle]
    lines += _failures(report)
    lines += _deviation_lines(report)
    lines += _reach_lines(report)
    lines += _excess_lines(report)
    return tuple(lines)


def _ranking_lines(report: ToleranceReport) -> list[str]:
    table, row = report.table, quantity_row(report.by)
    share = {name: float(table.share[table.sources.index(name), row]) for name in report.ranking}
    large = [name for name in report.ranking if share[name] >= 0.1]
    if not large:
        return [f"{of_name(report.by).title}: no error of these matters to it"]
    total, unit = float(table.total[row]), of_name(report.by).unit
    noise = float(table.baseline.value[row])
    parts = ", ".join(f"{name} {100 * share[name]:.0f} %" for name in large[:4])
    return [
        f"{of_name(report.by).title}: {figure(noise, 2)}{unit} from noise alone, {figure(total, 3)}{unit} with all "
        f"errors; most of that is from {parts}"
    ]


def _why_idle(report: ToleranceReport, name: str) -> str:
    """Why a source does nothing."""
    if report.table.errors.amount(name).sigma == 0:
        return "is 0"
    many, why = report.face_count > 1, ""
    if name in DIAMETERS:
        why = "it changes the rings' diameters, not their centres"
    elif name == "warp" and many:
        why = "it is for boards; faces of a solid bend by face_bow"
    elif name == "stair_steps" and not many:
        why = "the board lies flat on the printer's bed"
    elif SOURCES[name].scope == "face" and not many:
        why = "a board is one face, and where it stands does not matter"
    return f"does nothing to this target{f': {why}' if why else ''}"


def _failures(report: ToleranceReport) -> list[str]:
    cases = zip(case_names(report.table.errors), report.table.failed, strict=False)
    return [
        f"{'all errors together' if name == TOGETHER else name}: {count} of {report.table.draws} draws have no "
        "solution and do not count"
        for name, count in cases
        if count
    ]


def _deviation_lines(report: ToleranceReport) -> list[str]:
    """Where the prediction is off."""
    if report.table.kind == "linear":
        return []
    if report.table.draws < FEWEST_TO_CHECK:
        return [f"{report.table.draws} draws are too few to check the prediction with; {FEWEST_TO_CHECK} do"]
    found = deviations(report)
    if not found:
        return ["the prediction from Jacobians (--linear) is within 10 % of the draws for every source"]
    lines = []
    for one in found[:MOST_DEVIATIONS]:
        unit = of_name(one.quantity).unit
        name = "all together" if one.source == TOGETHER else one.source
        lines.append(
            f"prediction off: {name}, {of_name(one.quantity).title}: {figure(one.linear, 3)}{unit} predicted, "
            f"{figure(one.drawn, 3)}{unit} by draws"
        )
    if len(found) > MOST_DEVIATIONS:
        lines.append(f"and {len(found) - MOST_DEVIATIONS} more: table.csv has all")
    return lines


def _reach_lines(report: ToleranceReport) -> list[str]:
    """Up to which amounts the prediction holds."""
    if not report.reaches:
        return []
    limited = [(name, report.first_off(name)) for name in report.ranking if report.first_off(name)]
    parts = [
        f"{name} {size_in_words(report.table.errors, name, report.reach(name))} ({short(first)})"
        for name, first in limited
    ]
    others = f"{'the others' if limited else 'every error'} at least to {report.tried_to:g} times what is assumed"
    parts += [others] if len(limited) < len(report.ranking) else []
    return [f"of a few prints, in which misses do not average out, it is within 10 % up to: {', '.join(parts)}"]


def _excess_lines(report: ToleranceReport) -> list[str]:
    """Where errors do not add in squares."""
    rows = [(name, float(report.table.excess[quantity_row(name)])) for name in MAIN]
    off = [f"{of_name(name).title} {value:.2f}" for name, value in rows if abs(value - 1) > OFF]
    return [f"errors together over the root of their summed squares: {', '.join(off)}"] if off else []


def budget_notes(report: ToleranceReport, checked: CheckedBudget) -> tuple[str, ...]:
    """What a limit means, in words."""
    budget, table = checked.budget, report.table
    one = of_name(budget.quantity)
    noise, total = (float(values[quantity_row(one.name)]) for values in (table.baseline.value, table.total))
    limit = f"{one.title} up to {budget.limit:g}{one.unit}"
    if not budget.is_met_without:
        return (
            f"{limit}: noise alone gives {figure(noise, 2)}{one.unit}, so no print is good enough; "
            "take more views, come nearer, or allow more",
        )
    if budget.together.factor > NEVER:
        return (f"{limit}: met, whatever these errors are",)
    factor = budget.together.factor
    interval = ""
    if table.kind == "draws":
        interval = f" ({figure(budget.together.low, 2)} to {figure(budget.together.high, 2)})"
    verdict = "met with the errors as assumed" if total <= budget.limit else "not met"
    lines = [
        f"{limit}: {verdict} ({figure(total, 3)}{one.unit}); all errors together may be "
        f"{figure(factor, 3)} times as large{interval}"
    ]
    too_large = [name for name, allowed in budget.alone if allowed.factor < 1]
    if too_large:
        lines.append(f"too large even alone: {', '.join(too_large)}")
    return tuple(lines)


def crossover_notes(report: ToleranceReport, against: Against) -> tuple[str, ...]:
    """At which amount of the varied source the target loses, for each main quantity."""
    if not against.vary:
        return ()
    return tuple(_crossover_line(report, against, against.of(against.vary, name)) for name in MAIN)


def _crossover_line(report: ToleranceReport, against: Against, found: Crossover) -> str:
    errors, source = report.table.errors, against.vary
    one, sigma = of_name(found.quantity), report.table.errors.amount(against.vary).sigma
    unit = one.unit
    own, other = f"{figure(found.own, 3)}{unit}", f"{figure(found.other, 3)}{unit}"
    if found.verdict == "loses at zero":
        return f"{one.title}: loses already without {source}, {own} against {other}; {_reason(report, source, found)}"
    if found.amount > NEVER * sigma:
        return f"{one.title}: {source} does not make it lose, {own} without it against {other}"
    at, low, high = (size_in_words(errors, source, bound / sigma) for bound in (found.amount, found.low, found.high))
    if math.isinf(found.high):
        high = "any"
    interval = f" ({low} to {high})" if report.table.kind == "draws" else ""
    now = "wins" if found.amount > sigma else "loses"
    return (
        f"{one.title}: loses from {source} {at} on{interval}; {now} at {size_in_words(errors, source)}; "
        f"{own} without it against {other}"
    )


def _reason(report: ToleranceReport, source: str, found: Crossover) -> str:
    """Why a target loses without the varied source."""
    if found.noise_share > 0.5:
        return f"noise is {100 * found.noise_share:.0f} % of its square"
    row = quantity_row(found.quantity)
    rest = [name for name in report.table.ranking(found.quantity) if name != source]
    if not rest:
        return "noise and its other errors"
    square = found.own**2
    first = rest[0]
    share = float(report.table.cost.value[report.table.sources.index(first), row]) ** 2 / square
    return f"most of all by {first}, {100 * share:.0f} % of its square"
