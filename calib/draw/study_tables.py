"""The tables of bootstrap studies, for page, terminal and Markdown, in the paper's layout and units."""

import math
from collections.abc import Sequence

from calib.studies.findings import ABOUT, ROOT, SIGNIFICANT, HeldClaim
from calib.studies.samples import Setting
from calib.studies.statistics import CaseSummary, Distribution, Metric
from calib.studies.study_table import StudyTable
from designer.base.words import figure, printable, with_digits
from designer.page.blocks import Cell, Column, Level, Table

PAPER = "paper"
NOT_KNOWN = Cell("-")
LEVEL_OF_VERDICT: dict[str, Level] = {"holds": "good", "holds in part": "usable", "does not hold": "bad"}
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LARGEST = 1e5
"""Numbers above are written with an exponent: the errors of a lost sample may have any size."""


def setting_in_words(setting: Setting) -> str:
    """A way of sampling and counting."""
    return printable(", ".join(part for part in setting if part)) or "ours"


def unit_words(metric: Metric) -> str:
    """The paper's unit: `10⁻² mm`."""
    return f"10{str(metric.power).translate(RAISED)} {metric.unit}"


def text_cell(value: float, text: str) -> Cell:
    """A number with its text; "-" where it is not known."""
    return Cell(text, value) if math.isfinite(value) else NOT_KNOWN


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
    return Table(f"Errors of samples: {printable(target)}", tuple(columns), tuple(rows), note, visible_rows=15)


def _has_paper(case: CaseSummary) -> bool:
    return any(one.has_paper for one in case.metrics)


def _paper_row(case: CaseSummary, metrics: Sequence[Metric]) -> tuple[Cell, ...]:
    """As the paper prints them."""
    cells = [Cell(str(case.case.size), case.case.size), Cell(PAPER)]
    for metric in metrics:
        found = case.of(metric.name)
        values = (found.paper_mu, found.paper_sigma, found.paper_low, found.paper_high)
        mu, sigma, low, high = map(metric.in_paper_units, values)
        cells += [text_cell(mu, f"{mu:.2f} ± {sigma:.2f}"), text_cell(low, f"{low:.2f} to {high:.2f}")]
    return (*cells, Cell(""), Cell(""))


def _case_row(one: CaseSummary, metrics: Sequence[Metric], *, in_paper: bool, has_ways: bool) -> tuple[Cell, ...]:
    cells = [Cell(str(one.case.size), one.case.size)]
    cells += [Cell(setting_in_words(one.case.setting))] if has_ways else []
    for metric in metrics:
        cells += _cells(one.of(metric.name), 10.0**-metric.power if in_paper else 1.0)
    lost = one.samples - one.converged
    samples = Cell(str(one.samples), one.samples)
    return (*cells, samples, Cell(str(lost), lost, level="usable" if lost else None))


def _cells(found: Distribution, factor: float) -> list[Cell]:
    """Mean with sigma, and the interval, times a factor."""
    mean, spread = factor * found.mu, factor * found.sigma
    low, high = factor * found.percentile_low, factor * found.percentile_high
    text = f"{_number(mean, spread)} ± {figure(spread, 2)}" if spread > 0 else figure(mean, 4)
    return [text_cell(mean, text), text_cell(low, f"{_number(low, spread)} to {_number(high, spread)}")]


def _number(value: float, sigma: float) -> str:
    """To the second digit of sigma."""
    if not abs(value) < LARGEST or not sigma < LARGEST or sigma < 1e-9:
        return figure(value, 3)
    return with_digits(value, sigma)


def factors_table(table: StudyTable) -> Table | None:
    """Ours over the paper's; None if the paper has none of the cases."""
    rows = []
    for target in table.targets:
        for size in table.sizes:
            cases = [table.case(target, size, setting) for setting in table.settings]
            for metric in table.metrics:
                rows += _factor_rows(metric, [one for one in cases if one is not None], table.settings)
    if not rows:
        return None
    columns = (
        Column("target", is_number=False), Column("views"), Column("error", is_number=False),
        Column("of it", is_number=False), Column("paper", note="in the unit of the error"),
        *(Column(setting_in_words(setting), note="ours over the paper's") for setting in table.settings),
    )  # fmt: skip
    note = "1: as in the paper; below 1: our error is smaller."
    return Table("Ours over the paper's Table 2", columns, tuple(rows), note)


def _factor_rows(metric: Metric, cases: Sequence[CaseSummary], settings: Sequence[Setting]) -> list[tuple[Cell, ...]]:
    """The rows of mean and sigma of an error of one target and size, if the paper has them."""
    found = {one.case.setting: one.of(metric.name) for one in cases}
    paper = next((one for one in found.values() if one.has_paper), None)
    if paper is None:
        return []
    rows = []
    for name, value, factors in (
        ("mean", paper.paper_mu, {way: one.mu_by_paper for way, one in found.items()}),
        ("sigma", paper.paper_sigma, {way: one.sigma_by_paper for way, one in found.items()}),
    ):
        ours = [factors.get(way, math.nan) for way in settings]
        case = cases[0].case
        rows.append((
            Cell(printable(case.target)), Cell(str(case.size), case.size), Cell(metric.name), Cell(name),
            Cell(f"{metric.in_paper_units(value):.2f} · {unit_words(metric)}", value),
            *(text_cell(factor, figure(factor, 3)) for factor in ours),
        ))  # fmt: skip
    return rows


def findings_table(found: Sequence[HeldClaim]) -> Table | None:
    """Which claims hold in which way of sampling; None if there are none."""
    settings = tuple(dict.fromkeys(one.setting for one in found))
    of = {(one.claim, one.setting): one for one in found}
    claims = tuple(dict.fromkeys(one.claim for one in found))
    if not claims:
        return None
    columns = (
        Column("claim", is_number=False),
        *(Column(setting_in_words(setting), is_number=False) for setting in settings),
    )
    rows = tuple((Cell(claim), *(_verdict_cell(of.get((claim, setting))) for setting in settings)) for claim in claims)
    note = (
        "Numbers: ratios of the two targets, from the fewest views up (below 1: as the paper finds); or the exponents "
        "of the number of views for the errors one by one (-0.5: as 1/sqrt(N))."
    )
    return Table("The paper's findings with our numbers", columns, rows, note, visible_rows=20)


def _verdict_cell(one: HeldClaim | None) -> Cell:
    if one is None:
        return NOT_KNOWN
    values = [*(part.ratio for part in one.ratios), *(part.exponent for part in one.exponents)]
    numbers = ", ".join(f"{value:.2f}" for value in values)
    text = f"{one.verdict}: {numbers}" if numbers else one.verdict
    return Cell(text, level=LEVEL_OF_VERDICT.get(one.verdict, "note"))


def falls_table(table: StudyTable) -> Table | None:
    """How fast the sigma of each error falls with the number of views; None if that is not known."""
    rows = []
    for one in table.findings:
        for part in one.exponents if one.about == "fall" else ():
            is_slow = part.exponent > ROOT + ABOUT + SIGNIFICANT * part.error
            rows.append((
                Cell(printable(one.target)), Cell(part.metric),
                Cell(f"{part.exponent:.2f} ± {part.error:.2f}", part.exponent),
                Cell(fall_in_words(part.exponent, part.error), level="usable" if is_slow else None),
            ))  # fmt: skip
    if not rows:
        return None
    columns = (
        Column("target", is_number=False),
        Column("error", is_number=False),
        Column("exponent", note="a of sigma = c N^a, N the number of views; -0.5 is 1/sqrt(N)"),
        Column("that is", is_number=False),
    )
    return Table("How fast sigma falls with the number of views", columns, tuple(rows))


def fall_in_words(exponent: float, error: float) -> str:
    """How fast sigma falls, against 1/sqrt(N)."""
    if abs(exponent - ROOT) <= ABOUT and SIGNIFICANT * error < -ROOT:
        return "about as 1/sqrt(N)"
    if abs(exponent - ROOT) <= ABOUT + SIGNIFICANT * error:
        return "not told from 1/sqrt(N) by so few samples"
    if exponent < ROOT:
        return "faster than 1/sqrt(N): samples of few views are at times much worse than usual"
    return "slower than 1/sqrt(N): more views bring less than usual"


def parameters_table(table: StudyTable) -> Table | None:
    """How the camera's parameters scatter, a column a case; None if that is not known."""
    cameras = table.cameras
    if not cameras:
        return None
    columns = [Column("parameter", is_number=False), Column("unit", is_number=False)]
    columns += [
        Column(f"sigma, {one.case.size} views", note=f"over {one.converged} converged samples") for one in cameras
    ]
    columns.append(Column("sigma stated", note="by the one solution of all views, from its Jacobians"))
    rows = []
    for same in zip(*(one.parameters for one in cameras), strict=True):
        sigmas = (*(one.sigma for one in same), same[-1].stated)
        rows.append((Cell(same[0].name), Cell(same[0].unit), *(text_cell(one, figure(one, 3)) for one in sigmas)))
    note = "Standard deviations over the samples: what a parameter would be off by, had other photos been taken."
    return Table("How sure the camera's parameters are", tuple(columns), tuple(rows), note)
