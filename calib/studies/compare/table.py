"""The table of a comparison, as Markdown, CSV and JSON."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from calib.core.number_text import figure
from calib.observe.csv_table import ANY_NAME
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN
from calib.studies.compare.comparison_file import COMPARISON, AloneRow, CaseRow, ComparisonFile, ComparisonPlan
from calib.studies.compare.objects import OBJECTS, PaperObject
from calib.studies.compare.results import METRICS, CaseResult, Explanation, Middle, Results, short
from calib.studies.compare.words import sentences
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE, rows_to_csv
from designer.base.words import printable

HEAD = ("object", "made as", "model", "intersection mm", "paper", "reconstruction mm", "paper", "reprojection px")
LENS_HEAD = (
    "lens",
    "object",
    "model",
    "intersection mm",
    "held out",
    "reprojection px",
    "held out",
    "rays, % of image",
)
ALONE_HEAD = (
    "object",
    "source",
    "amount",
    "x template",
    "reconstruction mm",
    "paper",
    "reprojection px",
    "explains both",
)


def files_of_table(results: Results, folder: Path) -> dict[Path, bytes]:
    """The files and their contents."""
    told = comparison_of(results)
    return {
        folder / MARKDOWN_FILE: markdown(results).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: rows_to_csv(CaseRow, told.cases),
        folder / JSON_FILE: COMPARISON.text(told),
    }


def figure_rows(results: Results) -> list[tuple[str, ...]]:
    """The paper's figure as rows of `HEAD`."""
    return [
        _figure_row(one, found)
        for one in OBJECTS
        for found in results.cases
        if (found.name, found.part) == (one.name, FIGURE)
    ]


def _figure_row(one: PaperObject, found: CaseResult) -> tuple[str, ...]:
    paper = "-" if not math.isfinite(one.reconstruction_mm) else f"{one.reconstruction_mm:g}"
    return (
        f"{one.label} {one.name}", one.errors, found.model, shown(found.middle("intersection")), one.intersection_text,
        shown(found.middle("reconstruction")), paper, shown(found.middle("reprojection")),
    )  # fmt: skip


def lens_rows(results: Results) -> list[tuple[str, ...]]:
    """The lens that no Brown model fits, as rows of `LENS_HEAD`."""
    return [
        (
            found.part, found.name, found.model, shown(found.middle("intersection")),
            shown(found.middle("held_intersection")), shown(found.middle("reprojection")),
            shown(found.middle("held_reprojection")), f"{100 * found.middle('image_share').median:.0f}",
        )
        for part in (LENS_DRAWN, LENS_MADE, PLAIN_DRAWN)
        for found in results.cases
        if found.part == part
    ]  # fmt: skip


def alone_rows(results: Results) -> list[tuple[str, ...]]:
    """Single sources, as rows of `ALONE_HEAD`."""
    return [_alone_row(one) for one in results.explanations]


def _alone_row(one: Explanation) -> tuple[str, ...]:
    if not one.prints:
        return (one.name, one.source, "-", "-", "-", f"{one.paper_reconstruction_mm:g}", "-", one.why)
    fit = "no" if not one.fits else "yes" if one.is_within_reach else "beyond reach"
    times = f"{short(one.multiple)} [{short(one.multiple_low)}, {short(one.multiple_high)}]"
    return (
        one.name, one.source, one.amount or "-", times, figure(one.reconstruction_mm, 2),
        f"{one.paper_reconstruction_mm:g}", figure(one.reprojection_px, 2), fit,
    )  # fmt: skip


def shown(middle: Middle) -> str:
    """A median and its interval."""
    if not middle.prints:
        return "-"
    if middle.prints == 1:
        return figure(middle.median, 3)
    return f"{figure(middle.median, 3)} [{figure(middle.low, 3)}, {figure(middle.high, 3)}]"


def notes(results: Results) -> tuple[str, ...]:
    """How to read the tables, and samples that are not as the others."""
    plan = results.comparison.plan
    lines = [
        f"{plan.prints} prints of each object, {plan.sets} sets of photos of each print ({plan.slow_sets} for virtual)"
        f", camera {plan.camera}. Median over prints of the median of a print's sets; in brackets what 95 % of the "
        "prints lie between. As drawn: one print, many sets.",
    ]
    for one in results.cases:
        if one.without or one.unsure:
            lines.append(
                f"{one.name}, {one.part}, {one.model}: {one.without} sets without a camera, {one.unsure} whose "
                "solution did not converge."
            )
    return tuple(lines)


def markdown(results: Results) -> str:
    """All tables, notes and sentences."""
    parts = [
        "# The paper's objects, simulated",
        _table(HEAD, figure_rows(results)),
        "\n".join(f"- {line}" for line in notes(results)),
        "## A lens that no Brown model fits",
        _table(LENS_HEAD, lens_rows(results)),
        "## Single errors scaled until the intersection error is the paper's",
        _table(ALONE_HEAD, alone_rows(results)),
        "## In words",
        "\n".join(f"- {line}" for line in sentences(results)),
    ]
    return printable_lines("\n\n".join(parts)) + "\n"


def printable_lines(text: str) -> str:
    """Lines without characters that would steer a terminal: a camera's file may be called anything."""
    return "\n".join(printable(line) for line in text.split("\n"))


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)


def comparison_of(results: Results) -> ComparisonFile:
    """All that a comparison says, as its file has it."""
    plan = results.comparison.plan
    return ComparisonFile(
        ComparisonPlan(printable(plan.camera), plan.prints, plan.sets, plan.slow_sets, plan.seed),
        {name: scene.distance_mm for name, scene in results.comparison.scenes.items()},
        tuple(row for one in results.cases for row in _case_rows(one)),
        tuple(_alone_values(one) for one in results.explanations),
        notes(results),
        tuple(sentences(results)),
    )


def _case_rows(one: CaseResult) -> Iterator[CaseRow]:
    paper = {entry.name: entry for entry in OBJECTS}[one.name]
    for metric, unit in METRICS.items():
        middle = one.middle(metric)
        theirs = paper.median(metric) if one.part == FIGURE else math.nan
        yield CaseRow(
            one.name, one.part, one.model, metric, unit, _number(middle.median), _number(middle.low),
            _number(middle.high), middle.prints, len(one.flat(metric)), one.without, one.unsure, _number(theirs),
        )  # fmt: skip


def _alone_values(one: Explanation) -> AloneRow:
    return AloneRow(
        one.name, one.source, _number(one.multiple), _number(one.multiple_low), _number(one.multiple_high), one.amount,
        _number(one.reconstruction_mm), one.paper_reconstruction_mm, _number(one.reprojection_px), one.prints,
        one.without, one.why,
    )  # fmt: skip


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
