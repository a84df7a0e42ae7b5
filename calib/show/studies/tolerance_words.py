"""What the page of a tolerance study says in words: its answer, and what its figures show."""

import math

from calib.core.number_text import figure
from calib.show.studies.tolerance_tables import amount_of, assumed, other_totals, source_title
from calib.studies.tolerance.report import MAIN, NEVER, of_name
from calib.studies.tolerance.table_file import BudgetRow, CostRow, Crossovers, ToleranceFile
from calib.studies.tolerance.tables import short
from designer.base.words import capital
from designer.page.blocks import Finding, Headline

LARGE_SHARE = 0.1
MOST_NAMED = 3


def tolerance_headline(table: ToleranceFile) -> Headline:
    """Whether the limits are kept; without any, what the errors cost."""
    missed = [one for one in table.budgets if not one.met_as_assumed]
    if missed:
        return Headline("bad", "limit missed", " ".join(budget_sentence(table, one) for one in missed))
    if table.budgets:
        return Headline("good", "limit kept", " ".join(budget_sentence(table, one) for one in table.budgets))
    against = f" {against_sentence(table, table.crossovers)}" if table.crossovers is not None else ""
    return Headline("note", "answered", cost_sentence(table, table.ranked_by) + against)


def cost_sentence(table: ToleranceFile, quantity: str) -> str:
    """What all errors make of a quantity, and which of them most."""
    one = of_name(quantity)
    total, noise = table.total(quantity), table.noise(quantity)
    large = [
        found for found in table.ranking if quantity == table.ranked_by and (found.share or 0.0) >= LARGE_SHARE
    ][:MOST_NAMED]  # fmt: skip
    names = ", ".join(f"{source_title(found.error)} ({100 * (found.share or 0.0):.0f} %)" for found in large)
    most = f"; most of that is from {names}" if names else ""
    text = (
        f"With errors as assumed the {one.title} of {table.target} is {figure(total, 3)} {one.unit}, "
        f"{figure(noise, 2)} {one.unit} from noise alone{most}."
    )
    return text + (f" {_without(table, large[0])}" if large else "")


def _without(table: ToleranceFile, one: CostRow) -> str:
    """What would be left without the largest error."""
    left = math.sqrt(max(table.total(one.quantity) ** 2 - (one.cost or 0.0) ** 2, 0.0))
    return f"Without {source_title(one.error)} it would be {figure(left, 3)} {of_name(one.quantity).unit}."


def budget_sentence(table: ToleranceFile, budget: BudgetRow) -> str:
    """Whether a limit is kept, and how much larger or smaller errors may be."""
    one = of_name(budget.quantity)
    total, limit = f"{figure(table.total(one.name), 3)} {one.unit}", f"{budget.limit:g} {one.unit}"
    verdict = "kept" if budget.met_as_assumed else "missed"
    return (
        f"{capital(one.title)} of {table.target} is {total} where {limit} are allowed: {verdict}. "
        f"{budget_advice(table, budget)}"
    )


def budget_advice(table: ToleranceFile, budget: BudgetRow) -> str:
    """How much room errors have, or what must come down."""
    one = of_name(budget.quantity)
    if not budget.met_by_noise_alone:
        return (
            f"Noise alone gives {figure(table.noise(one.name), 2)} {one.unit}, so no print is good enough: take more "
            "views, come nearer, or allow more."
        )
    factor = budget.together.factor
    if factor is None or factor > NEVER:
        return "It is kept whatever these errors are."
    return f"All errors together may be {figure(factor, 2)} times what is assumed.{_alone(table, budget)}"


def _alone(table: ToleranceFile, budget: BudgetRow) -> str:
    """The errors that break a limit even alone, and to what each must come down."""
    allowed = {one.error: one for one in budget.alone}
    broken = [
        (one, allowed[one.error])
        for one in table.ranking
        if one.error in allowed
        and one.rms
        and (largest := allowed[one.error].largest_rms) is not None
        and largest < one.rms
    ]
    parts = [
        f"{source_title(one.error)} from {assumed(one)} to {amount_of(one, limit.largest_rms)}"
        for one, limit in broken[:MOST_NAMED]
    ]
    if not parts:
        return ""
    more = f" (and {len(broken) - MOST_NAMED} more)" if len(broken) > MOST_NAMED else ""
    return f" Even alone these must come down: {', '.join(parts)}{more}."


def budget_finding(table: ToleranceFile, budget: BudgetRow) -> Finding:
    """A limit as something that was checked."""
    one = of_name(budget.quantity)
    return Finding(
        "good" if budget.met_as_assumed else "bad", f"{capital(one.title)}",
        budget_advice(table, budget), f"{figure(table.total(one.name), 3)} {one.unit}",
        f"at most {budget.limit:g} {one.unit}",
    )  # fmt: skip


def against_sentence(table: ToleranceFile, other: Crossovers) -> str:
    """Which target is better, by how many of the errors."""
    theirs = other_totals(other)
    known = [name for name in MAIN if theirs.get(name)]
    if not known:
        return ""
    better = [name for name in known if table.total(name) < theirs[name]]
    by = table.ranked_by if table.ranked_by in known else known[0]
    ratio = max(table.total(by) / theirs[by], 1e-12)
    word = "smaller" if ratio < 1 else "larger"
    return (
        f"Against {other.target}, {table.target} is better by {len(better)} of {len(known)} errors; its "
        f"{of_name(by).title} is {figure(max(ratio, 1 / ratio), 2)} times {word}."
    )


def ranking_alt(table: ToleranceFile) -> str:
    """What the bars show."""
    parts = []
    for name in MAIN:
        costs = [(table.value(one.error, name), one.error) for one in table.ranking]
        if costs and max(costs)[0] > 0:
            value, error = max(costs)
            parts.append(f"{short(name)} {source_title(error)}, {figure(value, 2)} {of_name(name).unit}")
    return f"The largest single cost of each error of the calibration: {'; '.join(parts) or 'none'}."


def budget_alt(table: ToleranceFile) -> str:
    """What the bars of the budgets show."""
    return " ".join(budget_sentence(table, one) for one in table.budgets)


def crossover_alt(table: ToleranceFile, other: Crossovers) -> str:
    """What the curves of both targets show."""
    return f"Errors of both targets over the size of one error. {against_sentence(table, other)}"


def sweep_alt(table: ToleranceFile, quantity: str) -> str:
    """What the curves of a quantity show."""
    one = of_name(quantity)
    parts = []
    for row in table.sweeps:
        found = row.of(quantity)
        costs = [] if found is None else [cost for cost in found.cost if cost is not None]
        if costs and max(costs) > 0.1 * table.noise(quantity):
            parts.append(f"{source_title(row.error)} up to {figure(max(costs), 2)} {one.unit}")
    off = [
        row.error
        for row in table.ranking
        if (cost := table.cost(row.error, quantity)) is not None
        and cost.prediction_holds_to_rms is not None
        and row.rms is not None
        and cost.prediction_holds_to_rms < row.rms
    ]
    fails = f" The prediction is off by more than 10 % at what is assumed for {', '.join(off)}." if off else ""
    return f"{capital(one.title)} by the size of each error: {'; '.join(parts) or 'none matters'}.{fails}"
