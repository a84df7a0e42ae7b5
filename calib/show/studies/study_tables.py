"""The tables of the pages of bootstrap studies, in the paper's layout and units."""

import math
from collections.abc import Sequence

from calib.core.number_text import figure, with_digits
from calib.show.studies.parameter_spread import Spread
from calib.show.studies.study_words import fall_in_words
from calib.studies.findings import ABOUT, ROOT, SIGNIFICANT
from calib.studies.statistics import Metric
from calib.studies.study_table_file import MOST_SETTINGS, StudyCase, StudyFinding, StudyMetric, StudyTable
from calib.studies.table import LARGEST, setting_in_words
from designer.page.blocks import Cell, Column, Level, Table

PAPER = "paper"
NOT_KNOWN = Cell("-")
LEVEL_OF_VERDICT: dict[str, Level] = {"holds": "good", "holds in part": "usable", "does not hold": "bad"}
MOST_ROWS = 600
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_words(metric: Metric) -> str:
    """The paper's unit: `10⁻² mm`."""
    return f"10{str(metric.power).translate(RAISED)} {metric.unit}"


def errors_table(table: StudyTable, target: str) -> Table:
    """Errors of a target: a row a number of views and way of sampling, the paper's own rows above.

    In the paper's units if it has any of the cases.
    """
    metrics, in_paper = table.metrics, any(map(_has_paper, table.cases))
    has_ways = in_paper or any(map(any, table.settings))
    way = Column("of", is_number=False, note="the paper, or the way of sampling and counting")
    columns = [Column("views"), *((way,) if has_ways else ())]
    for metric in metrics:
        unit = unit_words(metric) if in_paper else metric.unit
        columns.append(Column(f"{metric.name} [{unit}]", note="mean ± sigma over all samples"))
        columns.append(Column("95 %", note="between these lie 95 % of the samples"))
    columns += [Column("samples"), Column("not converged")]
    rows = []
    for size in table.sizes:
        cases = [one for setting in table.settings if (one := table.case(target, size, setting)) is not None]
        rows += [_paper_row(cases[0], metrics)] if cases and _has_paper(cases[0]) else []
        rows += [_case_row(one, metrics, in_paper=in_paper, has_ways=has_ways) for one in cases]
    note = (
        "Mean ± standard deviation over all samples that have the error; the interval is that of the samples, not of a "
        "fitted Gaussian."
    )
    return Table(f"Errors of samples: {target}", tuple(columns), tuple(rows[:MOST_ROWS]), note, visible_rows=15)


def _has_paper(case: StudyCase) -> bool:
    return any(one.paper_mu is not None for one in case.metrics)


def _paper_row(case: StudyCase, metrics: Sequence[Metric]) -> tuple[Cell, ...]:
    cells = [Cell(str(case.size), case.size), Cell(PAPER)]
    for metric in metrics:
        found = case.of(metric)
        cells += [NOT_KNOWN] * 2 if found is None else _paper_cells(metric, found)
    return (*cells, Cell(""), Cell(""))


def _paper_cells(metric: Metric, found: StudyMetric) -> list[Cell]:
    """As the paper prints them."""
    values = found.paper_mu, found.paper_sigma, found.paper_low, found.paper_high
    if any(value is None for value in values):
        return [NOT_KNOWN, NOT_KNOWN]
    mu, sigma, low, high = (metric.in_paper_units(value or 0.0) for value in values)
    return [Cell(f"{mu:.2f} ± {sigma:.2f}", mu), Cell(f"{low:.2f} to {high:.2f}", low)]


def _case_row(case: StudyCase, metrics: Sequence[Metric], *, in_paper: bool, has_ways: bool) -> tuple[Cell, ...]:
    cells = [Cell(str(case.size), case.size), *((Cell(setting_in_words(*case.setting)),) if has_ways else ())]
    for metric in metrics:
        found = case.of(metric)
        cells += [NOT_KNOWN] * 2 if found is None else _cells(found, 10.0**-metric.power if in_paper else 1.0)
    lost = case.samples - case.converged
    samples = Cell(str(case.samples), case.samples)
    return (*cells, samples, Cell(str(lost), lost, level="usable" if lost else None))


def _cells(found: StudyMetric, factor: float) -> list[Cell]:
    """Mean with sigma, and the interval, times a factor."""
    if found.mu is None:
        return [NOT_KNOWN, NOT_KNOWN]
    mean = factor * found.mu
    spread = math.nan if found.sigma is None else factor * found.sigma
    text = f"{_number(mean, spread)} ± {figure(spread, 2)}" if spread > 0 else figure(mean, 4)
    if found.percentile_low is None or found.percentile_high is None:
        return [Cell(text, mean), NOT_KNOWN]
    ends = (factor * found.percentile_low, factor * found.percentile_high)
    return [Cell(text, mean), Cell(" to ".join(_number(end, spread) for end in ends), ends[0])]


def _number(value: float, sigma: float) -> str:
    """To the second digit of sigma; the errors of a lost sample may have any size."""
    if not abs(value) < LARGEST or not sigma < LARGEST or sigma < 1e-9:
        return figure(value, 3)
    return with_digits(value, sigma)


def factors_table(table: StudyTable) -> Table | None:
    """Ours over the paper's; None if the paper has none of the cases."""
    settings = table.settings
    rows = []
    for target in table.targets:
        for size in table.sizes:
            cases = [table.case(target, size, setting) for setting in settings]
            for metric in table.metrics:
                found = [None if one is None else one.of(metric) for one in cases]
                rows += _factor_rows(target, size, metric, found)
    if not rows:
        return None
    columns = (
        Column("target", is_number=False), Column("views"), Column("error", is_number=False),
        Column("of it", is_number=False), Column("paper", note="in the unit of the error"),
        *(Column(setting_in_words(*setting), note="ours over the paper's") for setting in settings),
    )  # fmt: skip
    note = "1: as in the paper; below 1: our error is smaller. Sorted by a click on a column's head."
    return Table("Ours over the paper's Table 2", columns, tuple(rows[:MOST_ROWS]), note)


def _factor_rows(target: str, size: int, metric: Metric, found: Sequence[StudyMetric | None]) -> list[tuple[Cell, ...]]:
    """The rows of mean and sigma of an error, if the paper has them."""
    known = next((one for one in found if one is not None and one.paper_mu is not None), None)
    if known is None:
        return []
    rows = []
    for name, paper, factors in (
        ("mean", known.paper_mu, [None if one is None else one.mu_by_paper for one in found]),
        ("sigma", known.paper_sigma, [None if one is None else one.sigma_by_paper for one in found]),
    ):
        theirs = NOT_KNOWN if paper is None else Cell(
            f"{metric.in_paper_units(paper):.2f} · {unit_words(metric)}", paper
        )  # fmt: skip
        ours = [NOT_KNOWN if factor is None else Cell(figure(factor, 3), factor) for factor in factors]
        rows.append((Cell(target), Cell(str(size), size), Cell(metric.name), Cell(name), theirs, *ours))
    return rows


def findings_table(found: Sequence[StudyFinding], title: str) -> Table | None:
    """Which claims hold in which way of sampling; None if there are none."""
    settings = tuple(dict.fromkeys(one.setting for one in found))[:MOST_SETTINGS]
    of = {(one.claim, one.setting): one for one in found}
    claims = tuple(dict.fromkeys(one.claim for one in found))
    if not claims:
        return None
    columns = (
        Column("claim", is_number=False),
        *(Column(setting_in_words(*setting), is_number=False) for setting in settings),
    )
    rows = tuple((Cell(claim), *(_verdict_cell(of.get((claim, setting))) for setting in settings)) for claim in claims)
    note = (
        "Numbers: ratios of the two targets, from the fewest views up (below 1: as the paper finds); or the exponents "
        "of the number of views for the errors one by one (-0.5: as 1/sqrt(N))."
    )
    return Table(title, columns, rows[:MOST_ROWS], note, visible_rows=20)


def falls_table(found: Sequence[StudyFinding]) -> Table | None:
    """How fast the sigma of each error falls with the number of views; None if that is not known."""
    falls = {
        (one.claim.rpartition(" for the ")[2], part.metric): part
        for one in found
        for part in one.exponents
        if part.exponent is not None and part.error is not None
    }
    rows = []
    for (target, metric), part in falls.items():
        exponent, error = part.exponent or 0.0, part.error or 0.0
        is_slow = exponent > ROOT + ABOUT + SIGNIFICANT * error
        words = fall_in_words(exponent, error).partition(", ")[2]
        rows.append((
            Cell(target), Cell(metric), Cell(f"{exponent:.2f} ± {error:.2f}", exponent),
            Cell(words, level="usable" if is_slow else None),
        ))  # fmt: skip
    if not rows:
        return None
    columns = (
        Column("target", is_number=False), Column("error", is_number=False),
        Column("exponent", note="a of sigma = c N^a, N the number of views; -0.5 is 1/sqrt(N)"),
        Column("that is", is_number=False),
    )  # fmt: skip
    return Table("How fast sigma falls with the number of views", columns, tuple(rows[:MOST_ROWS]))


def _verdict_cell(one: StudyFinding | None) -> Cell:
    if one is None:
        return NOT_KNOWN
    numbers = f": {one.numbers}" if one.numbers else ""
    return Cell(f"{one.verdict}{numbers}", level=LEVEL_OF_VERDICT.get(one.verdict, "note"))


def parameters_table(found: Sequence[Spread]) -> Table | None:
    """How the camera's parameters scatter, a column a case; None if that is not known."""
    if not found or any(one.names != found[0].names for one in found):
        return None
    columns = [Column("parameter", is_number=False), Column("unit", is_number=False)]
    columns += [
        Column(f"sigma, {one.case.size} views", note=f"over {one.count} converged samples") for one in found
    ] + [Column("sigma stated", note="by the one solution of all views, from its Jacobians")]
    rows = []
    for place, (name, unit) in enumerate(zip(found[0].names, found[0].units, strict=True)):
        sigmas = [float(one.sigma[place]) for one in found]
        stated = found[-1].stated
        last = math.nan if stated is None else float(stated[place])
        rows.append((Cell(name), Cell(unit), *(Cell(figure(value, 3), value) for value in (*sigmas, last))))
    note = "Standard deviations over the samples: what a parameter would be off by, had other photos been taken."
    return Table("How sure the camera's parameters are", tuple(columns), tuple(rows), note)
