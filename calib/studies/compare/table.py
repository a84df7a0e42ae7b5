"""The table of a comparison, as Markdown, CSV and JSON."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path

from calib.core.number_text import figure
from calib.observe.csv_table import ANY_NAME
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN
from calib.studies.compare.objects import OBJECTS, PaperObject
from calib.studies.compare.results import METRICS, CaseResult, Explanation, Middle, Results, short
from calib.studies.compare.words import sentences
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE
from designer.words import printable

FORMAT, VERSION = "ringsolid.comparison", 1
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
Value = str | int | float | None


def files_of_table(results: Results, folder: Path) -> dict[Path, bytes]:
    """The files and their contents."""
    return {
        folder / MARKDOWN_FILE: markdown(results).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: _csv(results),
        folder / JSON_FILE: _json(results),
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


def _case_values(one: CaseResult) -> list[dict[str, Value]]:
    paper = {entry.name: entry for entry in OBJECTS}[one.name]
    rows: list[dict[str, Value]] = []
    for metric, unit in METRICS.items():
        middle = one.middle(metric)
        theirs = paper.median(metric) if one.part == FIGURE else math.nan
        rows.append({
            "object": one.name, "part": one.part, "model": one.model, "metric": metric, "unit": unit,
            "median": _number(middle.median), "low": _number(middle.low), "high": _number(middle.high),
            "prints": middle.prints, "samples": len(one.flat(metric)), "without_camera": one.without,
            "not_converged": one.unsure, "paper": _number(theirs),
        })  # fmt: skip
    return rows


def _csv(results: Results) -> bytes:
    rows = [row for one in results.cases for row in _case_values(one)]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]) if rows else ["object"], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: "" if value is None else value for name, value in row.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)


def _json(results: Results) -> bytes:
    plan = results.comparison.plan
    document = {
        "format": FORMAT, "version": VERSION,
        "plan": {
            "camera": printable(plan.camera), "prints": plan.prints, "sets": plan.sets,
            "virtual_sets": plan.slow_sets, "seed": plan.seed,
        },
        "distance_mm": {name: scene.distance_mm for name, scene in results.comparison.scenes.items()},
        "cases": [row for one in results.cases for row in _case_values(one)],
        "alone": [_alone_values(one) for one in results.explanations],
        "notes": list(notes(results)),
        "sentences": list(sentences(results)),
    }  # fmt: skip
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _alone_values(one: Explanation) -> dict[str, Value]:
    return {
        "object": one.name, "source": one.source, "multiple": _number(one.multiple),
        "multiple_low": _number(one.multiple_low), "multiple_high": _number(one.multiple_high), "amount": one.amount,
        "reconstruction_mm": _number(one.reconstruction_mm), "paper_reconstruction_mm": one.paper_reconstruction_mm,
        "reprojection_px": _number(one.reprojection_px), "prints": one.prints, "without": one.without, "why": one.why,
    }  # fmt: skip


def _number(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
