"""The table of a study in the layout of the paper's, our rows under the paper's own; for the screen and as Markdown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calib.core.number_text import figure
from calib.studies.findings import HeldClaim, PaperFactor, against_paper, findings, settings
from calib.studies.markdown import markdown_table, plain
from calib.studies.paper_table import CORRECTED, CORRECTION, INTERVALS, PaperValue, paper_value
from calib.studies.statistics import LEAST_P, METRICS, Case, CaseSummary, Distribution, Metric
from designer.base.words import printable

if TYPE_CHECKING:
    from rich.table import Table

PAPER = "paper"
NO_NUMBER = "-"
LEAST_DIGITS, MOST_DIGITS = 2, 4
"""After the point: two as the paper has, more if a sigma of the column needs them."""


@dataclass(frozen=True)
class CaseMetric:
    """One metric of one case, in the paper's units."""

    mu: str
    sigma: str
    interval: str


NOTHING = CaseMetric(NO_NUMBER, NO_NUMBER, NO_NUMBER)


@dataclass(frozen=True)
class Row:
    """A case of each target side by side, or what the paper has of them."""

    size: int
    source: str  # PAPER, or the way of sampling and counting
    samples: tuple[str, ...]  # of each target: how many, and how many did not converge
    cells: tuple[tuple[CaseMetric, ...], ...]  # of each target: one for each of METRICS


def targets_of(summaries: Sequence[CaseSummary]) -> tuple[str, ...]:
    """The targets in the order of the cases."""
    return tuple(dict.fromkeys(one.case.target for one in summaries))


def rows_of(summaries: Sequence[CaseSummary]) -> tuple[Row, ...]:
    """The rows of the table: for each size the paper's, if it has one, and ours for each way of sampling."""
    targets = targets_of(summaries)
    of_case = {(one.case.target, one.case.size, (one.case.sampling, one.case.sightings)): one for one in summaries}
    digits = {target: digits_of([one for one in summaries if one.case.target == target]) for target in targets}
    rows = []
    for size in sorted({one.case.size for one in summaries}):
        paper = [[paper_value(target, metric.name, size) for metric in METRICS] for target in targets]
        if any(value is not None for values in paper for value in values):
            cells = tuple(tuple(map(_cell_of_paper, values)) for values in paper)
            rows.append(Row(size, PAPER, ("",) * len(targets), cells))
        for setting in settings(summaries):
            found = [of_case.get((target, size, setting)) for target in targets]
            if any(one is not None for one in found):
                cells = tuple(_cells_of_case(one, digits[target]) for target, one in zip(targets, found, strict=True))
                samples = tuple("" if one is None else _count(one) for one in found)
                rows.append(Row(size, setting_in_words(*setting), samples, cells))
    return tuple(rows)


def setting_in_words(sampling: str, sightings: str) -> str:
    """A way of sampling and counting."""
    return printable(", ".join(part for part in (sampling, sightings) if part)) or "ours"


def case_in_words(case: Case) -> str:
    """A case in a line of text."""
    setting = "".join(f", {printable(part)}" for part in (case.sampling, case.sightings) if part)
    return f"{printable(case.target)}, N = {case.size}{setting}"


def _cell_of_paper(value: PaperValue | None) -> CaseMetric:
    if value is None:
        return NOTHING
    mark = CORRECTED if value.mark == CORRECTED else ""
    return CaseMetric(f"{value.mu:.2f}", f"{value.sigma:.2f}", f"[{value.low:.2f}, {value.high:.2f}]{mark}")


def _cells_of_case(one: CaseSummary | None, digits: Sequence[int]) -> tuple[CaseMetric, ...]:
    return (NOTHING,) * len(METRICS) if one is None else tuple(map(cell_of, one.all, digits))


def digits_of(summaries: Sequence[CaseSummary]) -> tuple[int, ...]:
    """How many digits after the point each metric's smallest sigma needs, in the paper's units."""
    return tuple(_digits([metric.in_paper_units(one.of(metric.name).sigma) for one in summaries]) for metric in METRICS)


def _digits(sigmas: Sequence[float]) -> int:
    known = [sigma for sigma in sigmas if math.isfinite(sigma) and sigma > 0]
    return min(max(1 - math.floor(math.log10(min(known))), LEAST_DIGITS), MOST_DIGITS) if known else LEAST_DIGITS


def cell_of(found: Distribution, digits: int) -> CaseMetric:
    """A distribution in the paper's units; the interval is that of the samples."""
    metric = found.metric
    low, high = (_number(metric, value, digits) for value in found.percentiles)
    interval = NO_NUMBER if NO_NUMBER in (low, high) else f"[{low}, {high}]"
    return CaseMetric(_number(metric, found.mu, digits), _number(metric, found.sigma, digits), interval)


LARGEST = 1e5
"""Numbers above are written with an exponent: the errors of a lost sample may have any size."""


def _number(metric: Metric, value: float, digits: int) -> str:
    scaled = metric.in_paper_units(value)
    if not math.isfinite(scaled):
        return NO_NUMBER
    return f"{scaled:.{digits}f}" if abs(scaled) < LARGEST else f"{scaled:.2e}"


def _count(one: CaseSummary) -> str:
    """How many samples, and how many of them did not converge."""
    bad = ", ".join(f"{count} {status}" for status, count in one.statuses if count and status != "converged")
    return f"{one.samples}" + (f" ({bad})" if bad else "")


def screen_tables(summaries: Sequence[CaseSummary]) -> tuple["Table", ...]:
    """The table for a terminal, one target below the other."""
    from rich.table import Table
    from rich.text import Text

    rows, tables = rows_of(summaries), []
    for place, target in enumerate(targets_of(summaries)):
        table = Table(box=None, padding=(0, 2, 0, 0), title=Text(printable(target), "bold"), title_justify="left")
        table.add_column("N", justify="right")
        table.add_column("of")
        for metric in METRICS:
            table.add_column(Text(f"{metric.short}\n[{metric.paper_unit}]\nmu  sigma"), justify="right")
        table.add_column("samples", overflow="fold")
        for row in rows:
            cells = [f"{cell.mu}  {cell.sigma}\n{cell.interval}" for cell in row.cells[place]]
            if all(cell == NOTHING for cell in row.cells[place]) and not row.samples[place]:
                continue
            style = "dim" if row.source == PAPER else ""
            table.add_row(str(row.size), Text(row.source), *map(Text, cells), Text(row.samples[place]), style=style)
        tables.append(table)
    return tuple(tables)


def notes(summaries: Sequence[CaseSummary]) -> tuple[str, ...]:
    """What to know of the table, one line each."""
    lines = [
        "mu and sigma of the Gaussian fitted to all samples that have the error, degenerate and stopped ones too; "
        "[2.5 %, 97.5 %] of the same samples",
    ]
    lines += [line for one in summaries if (line := _not_converged(one))]
    lines += _shapes(summaries)
    errors = [
        error / value
        for one in summaries
        for found in one.all
        for error, value in ((found.mu_error, found.mu), (found.sigma_error, found.sigma))
        if value > 0 and math.isfinite(error)
    ]
    if errors:
        lines.append(
            f"standard errors by the number of samples: at most {figure(100 * max(errors), 2)} % of a mean or sigma"
        )
    known = [paper_value(one.case.target, metric.name, one.case.size) for one in summaries for metric in METRICS]
    if any(value is not None for value in known):
        lines.append(INTERVALS)
    if any(value is not None and value.mark == CORRECTED for value in known):
        lines.append(CORRECTION)
    return tuple(lines)


def _not_converged(one: CaseSummary) -> str:
    """The statuses of a case that has others than converged, and its numbers without those."""
    if one.counted("converged") == one.samples:
        return ""
    counts = ", ".join(f"{count} {status}" for status, count in one.statuses if count)
    cells = [
        (found.metric.short, cell_of(found, digits))
        for found, digits in zip(one.converged, digits_of([one]), strict=True)
        if found.count
    ]
    only = "; ".join(f"{short} {cell.mu} {cell.sigma}" for short, cell in cells)
    return f"{case_in_words(one.case)}: {counts}; mu and sigma of the converged: {only or 'none'}"


def _shapes(summaries: Sequence[CaseSummary]) -> list[str]:
    """How many distributions of each metric are no Gaussians, and what else."""
    found = [one for summary in summaries for one in summary.all if one.count]
    tested = [one.shape for one in found if one.shape != "too few"]
    normal = tested.count("normal")
    lines = [f"{normal} of {len(tested)} distributions are normal (D'Agostino and Pearson, p >= {LEAST_P:g})"] * bool(
        tested
    )
    for metric in METRICS:
        of_metric = [one for one in found if one.metric == metric]
        parts = []
        for shape in dict.fromkeys(one.shape for one in of_metric):
            skewness = [one.skewness for one in of_metric if one.shape == shape]
            known = math.isfinite(skewness[0])
            extremes = " to ".join(dict.fromkeys(f"{end(skewness):.2f}" for end in (min, max)))
            parts.append(f"{shape} in {len(skewness)}" + (f" (skewness {extremes})" if known else ""))
        if parts:
            lines.append(f"{metric.name} error: of {len(of_metric)} cases {', '.join(parts)}")
    return lines


def markdown(summaries: Sequence[CaseSummary], reasons: Sequence[str] = ()) -> str:
    """Table, notes, what is against the paper, findings, and why some do not hold, as Markdown."""
    parts = [markdown_table(*_cells_of_markdown(summaries)), "", *(f"- {plain(line)}" for line in notes(summaries))]
    factors = against_paper(summaries)
    if factors:
        parts += ["", "Ours over the paper's:", "", markdown_table(*_cells_of_factors(factors, settings(summaries)))]
    found = findings(summaries)
    if found:
        parts += [
            "",
            "The paper's findings with our numbers (ratios from the smallest N up; exponents of N for "
            f"{', '.join(metric.name for metric in METRICS)}):",
            "",
            markdown_table(*_cells_of_findings(found, numbers=True)),
        ]
        parts += ["", *(f"- {plain(finding_in_words(one))}" for one in found if one.verdict != "holds")]
        parts += [f"- {plain(line)}" for line in reasons]
    return "\n".join([*parts, ""])


def _cells_of_markdown(summaries: Sequence[CaseSummary]) -> tuple[list[str], list[list[str]]]:
    targets = targets_of(summaries)
    head = ["N", "of"]
    for target in targets:
        head += [f"{printable(target)}: {metric.short} [{metric.paper_unit}]" for metric in METRICS]
        head += [f"{printable(target)}: samples"]
    body = []
    for row in rows_of(summaries):
        cells = [str(row.size), row.source]
        for samples, of_target in zip(row.samples, row.cells, strict=True):
            cells += [f"{cell.mu} ({cell.sigma})\n{cell.interval}" for cell in of_target] + [samples]
        body.append(cells)
    return head, body


def _cells_of_factors(
    factors: Sequence[PaperFactor], order: Sequence[tuple[str, str]]
) -> tuple[list[str], list[list[str]]]:
    """A line for each number of the paper, a column for each way of sampling."""
    head = ["target", "N", "metric", "", PAPER, *(setting_in_words(*setting) for setting in order)]
    keys = dict.fromkeys((one.case.target, one.case.size, one.metric, one.statistic, one.paper) for one in factors)
    values = {
        (one.case.target, one.case.size, one.metric, one.statistic, (one.case.sampling, one.case.sightings)): one.value
        for one in factors
    }
    body = []
    for target, size, metric, statistic, paper in keys:
        ours = [values.get((target, size, metric, statistic, setting), math.nan) for setting in order]
        body.append(
            [printable(target), str(size), metric, statistic, f"{paper:.2f}", *(figure(value, 3) for value in ours)]
        )
    return head, body


def _cells_of_findings(found: Sequence[HeldClaim], *, numbers: bool) -> tuple[list[str], list[list[str]]]:
    """A line for each claim, a column for each way of sampling."""
    order = tuple(dict.fromkeys((one.sampling, one.sightings) for one in found))
    cells = {
        (one.claim, (one.sampling, one.sightings)): one.verdict + (f": {one.numbers}" if numbers else "")
        for one in found
    }
    head = ["the paper finds", *(setting_in_words(*setting) for setting in order)]
    claims = dict.fromkeys(one.claim for one in found)
    return head, [[claim, *(cells.get((claim, setting), NO_NUMBER) for setting in order)] for claim in claims]


def findings_table(found: Sequence[HeldClaim]) -> "Table":
    """Which findings hold in which way of sampling, for a terminal."""
    from rich.table import Table
    from rich.text import Text

    head, body = _cells_of_findings(found, numbers=False)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in head:
        table.add_column(Text(name))
    for cells in body:
        table.add_row(*map(Text, cells))
    return table


def finding_in_words(one: HeldClaim) -> str:
    """A finding with its numbers in one line."""
    return f"{setting_in_words(one.sampling, one.sightings)}: {one.sentence}"
