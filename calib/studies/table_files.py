"""The table of a study as CSV and JSON, for other programs: in mm and px, with every statistic."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path

from calib.observe.csv_table import ANY_NAME
from calib.studies.findings import HeldClaim, findings
from calib.studies.paper_table import paper_value
from calib.studies.statistics import CaseSummary, Distribution, Over
from calib.studies.table import markdown, notes

FORMAT, VERSION = "ringsolid.study_table", 1
MARKDOWN_FILE, CSV_FILE, JSON_FILE = "table.md", "table.csv", "table.json"
OVER: tuple[Over, ...] = ("all", "converged")

Value = str | int | float | None


def table_files(summaries: Sequence[CaseSummary], folder: Path, reasons: Sequence[str] = ()) -> dict[Path, bytes]:
    """The files of a table and their contents.

    Args:
        summaries: of all cases.
        folder: where they are to lie.
        reasons: why findings do not hold, in lines.
    """
    return {
        folder / MARKDOWN_FILE: markdown(summaries, reasons).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: table_to_csv(summaries),
        folder / JSON_FILE: table_to_json(summaries, reasons),
    }


def table_to_csv(summaries: Sequence[CaseSummary]) -> bytes:
    """A line for each case, metric, and set of samples that the statistics are over."""
    lines = [
        {**_case(one), **_distribution(one, found, over)}
        for one in summaries
        for over in OVER
        for found in (one.all if over == "all" else one.converged)
    ]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]) if lines else [], lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)


def table_to_json(summaries: Sequence[CaseSummary], reasons: Sequence[str] = ()) -> bytes:
    """The cases with their statistics, the notes, the findings, and why some do not hold."""
    cases = []
    for one in summaries:
        metrics = [
            _distribution(one, found, over) for over in OVER for found in (one.all if over == "all" else one.converged)
        ]
        cases.append({**_case(one), "metrics": metrics})
    document = {
        "format": FORMAT,
        "version": VERSION,
        "cases": cases,
        "notes": list(notes(summaries)),
        "findings": [_finding(one) for one in findings(summaries)],
        "reasons": list(reasons),
    }
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _case(one: CaseSummary) -> dict[str, Value]:
    case = one.case
    return {
        "target": case.target, "sampling": case.sampling, "sightings": case.sightings, "size": case.size,
        "pool": case.pool, "samples": one.samples, **dict(one.statuses),
    }  # fmt: skip


def _distribution(one: CaseSummary, found: Distribution, over: Over) -> dict[str, Value]:
    """The statistics of a metric, and the paper's in the same units."""
    metric = found.metric
    paper = paper_value(one.case.target, metric.name, one.case.size)
    unit = 10.0**metric.power
    theirs = (math.nan,) * 4 if paper is None else (paper.mu, paper.sigma, paper.low, paper.high)
    numbers = {
        "mu": found.mu, "mu_error": found.mu_error, "sigma": found.sigma, "sigma_error": found.sigma_error,
        "fit_low": found.fit[0], "fit_high": found.fit[1],
        "percentile_low": found.percentiles[0], "percentile_high": found.percentiles[1],
        "skewness": found.skewness, "excess_kurtosis": found.excess_kurtosis, "p_value": found.p_value,
        **dict(zip(("paper_mu", "paper_sigma", "paper_low", "paper_high"), (n * unit for n in theirs), strict=True)),
        "mu_by_paper": found.mu / (theirs[0] * unit), "sigma_by_paper": found.sigma / (theirs[1] * unit),
    }  # fmt: skip
    return {
        "over": over, "metric": metric.name, "unit": metric.unit, "count": found.count, "without": found.without,
        "shape": found.shape, **{name: _or_none(number) for name, number in numbers.items()},
    }  # fmt: skip


def _or_none(number: float) -> float | None:
    """To nine digits; None for nan."""
    return float(f"{number:.9g}") if math.isfinite(number) else None


def _finding(one: HeldClaim) -> dict[str, object]:
    return {
        "claim": one.claim, "sampling": one.sampling, "sightings": one.sightings, "verdict": one.verdict,
        "verdict_of_converged": one.of_converged, "elsewhere": one.elsewhere,
        "evidence": one.evidence,
        "ratios": [
            {"size": ratio.size, "ratio": _or_none(ratio.value), "standard_errors": _or_none(ratio.deviation),
             "paper": _or_none(ratio.paper)}
            for ratio in one.ratios
        ],
        "exponents": [
            {"metric": fall.metric, "exponent": _or_none(fall.exponent), "error": _or_none(fall.error),
             "paper": _or_none(fall.paper)}
            for fall in one.falls
        ],
    }  # fmt: skip
