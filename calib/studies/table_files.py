"""The table of a study as CSV and JSON, for other programs: in mm and px, with every statistic."""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar, cast

from calib.observe.csv_table import ANY_NAME
from calib.studies.findings import HeldClaim, findings
from calib.studies.paper_table import paper_value
from calib.studies.statistics import CaseSummary, Distribution, Over
from calib.studies.study_table_file import (
    STUDY_TABLE,
    StudyCase,
    StudyExponent,
    StudyFinding,
    StudyMetric,
    StudyRatio,
    StudyTable,
)  # fmt: skip
from calib.studies.table import markdown, notes
from designer.base.codec import encode
from designer.base.small_file import JsonValue

Row = TypeVar("Row")

MARKDOWN_FILE, CSV_FILE, JSON_FILE = "table.md", "table.csv", "table.json"
OVER: tuple[Over, ...] = ("all", "converged")


def table_files(summaries: Sequence[CaseSummary], folder: Path, reasons: Sequence[str] = ()) -> dict[Path, bytes]:
    """The files of a table and their contents.

    Args:
        summaries: of all cases.
        folder: where they are to lie.
        reasons: why findings do not hold, in lines.
    """
    told = study_table(summaries, reasons)
    return {
        folder / MARKDOWN_FILE: markdown(summaries, reasons).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: table_to_csv(told.cases),
        folder / JSON_FILE: STUDY_TABLE.text(told),
    }


def table_to_csv(cases: Sequence[StudyCase]) -> bytes:
    """A line for each case, metric, and set of samples that the statistics are over."""
    heads = [
        {key: value for key, value in cast("dict[str, JsonValue]", encode(StudyCase, case)).items() if key != "metrics"}
        for case in cases
        for _ in case.metrics
    ]
    return rows_to_csv(StudyMetric, [metric for case in cases for metric in case.metrics], heads)


def study_table(summaries: Sequence[CaseSummary], reasons: Sequence[str] = ()) -> StudyTable:
    """The cases with their statistics, the notes, the findings, and why some do not hold."""
    return StudyTable(
        tuple(map(_case, summaries)), notes(summaries), tuple(map(_finding, findings(summaries))), tuple(reasons)
    )


def _case(one: CaseSummary) -> StudyCase:
    case, counts = one.case, dict(one.statuses)
    metrics = tuple(
        _distribution(one, found, over) for over in OVER for found in (one.all if over == "all" else one.converged)
    )
    return StudyCase(
        case.target, case.sampling, case.sightings, case.size, case.pool, one.samples, counts["converged"],
        counts["stopped"], counts["degenerate"], counts["failed"], metrics,
    )  # fmt: skip


def _distribution(one: CaseSummary, found: Distribution, over: Over) -> StudyMetric:
    """The statistics of a metric, and the paper's in the same units."""
    metric = found.metric
    paper = paper_value(one.case.target, metric.name, one.case.size)
    unit = 10.0**metric.power
    theirs = (math.nan,) * 4 if paper is None else (paper.mu, paper.sigma, paper.low, paper.high)
    numbers = (
        found.mu, found.mu_error, found.sigma, found.sigma_error, *found.fit, *found.percentiles, found.skewness,
        found.excess_kurtosis, found.p_value, *(n * unit for n in theirs),
        found.mu / (theirs[0] * unit), found.sigma / (theirs[1] * unit),
    )  # fmt: skip
    return StudyMetric(over, metric.name, metric.unit, found.count, found.without, found.shape, *map(_or_none, numbers))


def _or_none(number: float) -> float | None:
    """To nine digits; None for nan."""
    return float(f"{number:.9g}") if math.isfinite(number) else None


def _finding(one: HeldClaim) -> StudyFinding:
    return StudyFinding(
        one.claim, one.sampling, one.sightings, one.verdict, one.of_converged, one.elsewhere, one.evidence,
        tuple(
            StudyRatio(ratio.size, *map(_or_none, (ratio.value, ratio.deviation, ratio.paper))) for ratio in one.ratios
        ),
        tuple(
            StudyExponent(fall.metric, *map(_or_none, (fall.exponent, fall.error, fall.paper))) for fall in one.falls
        ),
    )  # fmt: skip


def rows_to_csv(kind: type[Row], rows: Sequence[Row], heads: Sequence[Mapping[str, JsonValue]] = ()) -> bytes:
    """A line a row, its fields as columns; a head, if there are any, stands before each."""
    values = [encode(kind, row) for row in rows]
    lines = [
        {**head, **cast("dict[str, JsonValue]", row)}
        for head, row in zip(heads or [{}] * len(rows), values, strict=True)
    ]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]) if lines else ["none"], lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)
