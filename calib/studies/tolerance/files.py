"""The files of a tolerance study: its tables as Markdown, CSV and JSON, and its figures."""

import csv
import io
import json
import math
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.observe.csv_table import ANY_NAME
from calib.studies import figures
from calib.studies.markdown import markdown_table, plain
from calib.studies.outputs import FIGURES_FOLDER
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE
from calib.studies.tolerance.budget import Allowed
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.figure_budget import budget_height_px, draw_budget
from calib.studies.tolerance.figure_crossover import HEIGHT_PX, draw_crossover
from calib.studies.tolerance.figure_ranking import draw_ranking, ranking_height_px
from calib.studies.tolerance.figure_sweeps import draw_sweeps, sweeps_height_px, swept_sources
from calib.studies.tolerance.notes import budget_notes, crossover_notes, notes
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.report import CheckedBudget, ToleranceReport, of_name
from calib.studies.tolerance.result import Cost
from calib.studies.tolerance.tables import (
    TextTable,
    budget_table,
    cost_table,
    crossover_table,
    reach_table,
    sensitivity_table,
)
from designer.tolerance.registry import SOURCES

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure

FORMAT, VERSION = "ringsolid.tolerance_table", 1

Value = str | int | float | None


def report_files(report: ToleranceReport, folder: Path, formats: Collection[str] = ()) -> dict[Path, bytes]:
    """All files and their contents.

    Args:
        report: what was found.
        folder: where they are to lie.
        formats: of the figures besides PNG: "pdf", "svg".
    """
    return {
        folder / MARKDOWN_FILE: markdown(report).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: to_csv(report),
        folder / JSON_FILE: to_json(report),
        **figure_files(report, folder / FIGURES_FOLDER, formats),
    }


def figure_files(report: ToleranceReport, folder: Path, formats: Collection[str]) -> dict[Path, bytes]:
    """The figures as PNG, as what is asked for, and as what an earlier study left there: a page would show its old."""
    files: dict[Path, bytes] = {}
    for name, height, draw in _pages(report):
        left = {suffix for suffix in figures.METADATA if (folder / f"{name}.{suffix}").exists()}
        files |= figures.files_of(folder / name, height, draw, left | set(formats))
    return files


def _pages(report: ToleranceReport) -> "Iterator[tuple[str, int, Callable[[Figure], None]]]":
    """Name, height and content of each figure."""
    if report.ranking:
        yield "ranking", ranking_height_px(report), partial(draw_ranking, report=report)
    if report.budgets:
        yield "budget", budget_height_px(report), partial(draw_budget, report=report)
    if report.against is not None and report.against.vary:
        yield "crossover", HEIGHT_PX, partial(draw_crossover, report=report, against=report.against)
    chosen = dict.fromkeys((report.by, *(one.budget.quantity for one in report.budgets)))
    for name in chosen if report.sweeps else ():
        if swept_sources(report, name):
            yield f"sweep_{name}", sweeps_height_px(report, name), partial(draw_sweeps, report=report, quantity=name)


def markdown(report: ToleranceReport) -> str:
    """All tables with their notes."""
    parts = [f"# {plain(f'What errors of {report.name} cost a calibration')}", "", *_bullets(report.lines), ""]
    parts += [_as_markdown(cost_table(report)), "", *_bullets(notes(report))]
    for checked in report.budgets:
        parts += ["", "## How good must it be?", "", *_bullets(budget_notes(report, checked))]
        if checked.budget.is_met_without:
            parts += ["", _as_markdown(budget_table(report, checked))]
    if report.against is not None:
        against = report.against
        parts += ["", f"## {plain(f'Against {against.name}')}", "", *_bullets(against.lines), ""]
        parts += [_as_markdown(crossover_table(report, against)), "", *_bullets(crossover_notes(report, against))]
    parts += ["", "## Cost by a unit of each error", "", _as_markdown(sensitivity_table(report))]
    if report.reaches:
        parts += ["", "## How far the prediction from Jacobians holds", "", _as_markdown(reach_table(report))]
    parts += ["", "## Where the assumed amounts come from", "", _as_markdown(_origins(report))]
    return "\n".join([*parts, ""])


def _origins(report: ToleranceReport) -> TextTable:
    notes_of = report.table.errors.notes
    return TextTable("", ("number", "from"), tuple((name, where) for name, where in notes_of), left=2)


def _bullets(lines: tuple[str, ...]) -> list[str]:
    return [f"- {plain(line)}" for line in lines]


def to_csv(report: ToleranceReport) -> bytes:
    """A line for each source and quantity, and for no error and all together."""
    lines = list(_lines(report))
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]), lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)


def _lines(report: ToleranceReport) -> Iterator[dict[str, Value]]:
    table, linear = report.table, report.linear
    for row in range(len(QUANTITIES)):
        yield _line(report, BARE, row, _at(table.baseline, (row,)), float(linear.baseline.value[row]))
        for place, name in enumerate(table.sources):
            yield _line(report, name, row, _at(table.cost, (place, row)), float(linear.cost.value[place, row]))
        yield _line(report, TOGETHER, row, _at(table.together, (row,)), float(linear.together.value[row]))


def _line(
    report: ToleranceReport, name: str, row: int, cost: tuple[float, float, float], linear: float
) -> dict[str, Value]:
    """One cost, in the quantity's unit, and by the source's unit."""
    table, one = report.table, QUANTITIES[row]
    is_source = name in table.sources
    share = reach = sigma = math.nan
    if is_source:
        place = table.sources.index(name)
        share, sigma = float(table.share[place, row]), float(table.sigma[place])
        reach = sigma * report.reach(name, one.name)
    amount = table.errors.amount(name) if is_source else None
    return {
        "error": name, "distribution": "" if amount is None else amount.kind,
        "size": None if amount is None else number(amount.size), "rms": number(sigma),
        "unit": SOURCES[name].unit if is_source else "", "quantity": one.name, "quantity_unit": one.unit,
        "cost": number(cost[0]), "cost_low": number(cost[1]), "cost_high": number(cost[2]),
        "predicted": number(linear), "share": number(share),
        "by_unit": number(cost[0] / sigma) if sigma > 0 else None,
        "by_unit_low": number(cost[1] / sigma) if sigma > 0 else None,
        "by_unit_high": number(cost[2] / sigma) if sigma > 0 else None,
        "prediction_holds_to_rms": number(reach),
    }  # fmt: skip


def _at(cost: Cost, place: tuple[int, ...]) -> tuple[float, float, float]:
    return float(cost.value[place]), float(cost.low[place]), float(cost.high[place])


def number(value: float) -> float | None:
    """To nine digits; None for nan and infinity."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


def to_json(report: ToleranceReport) -> bytes:
    """Costs, budgets, sweeps, crossovers and notes."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "target": report.name,
        "setting": list(report.lines),
        "kind": report.table.kind,
        "draws": report.table.draws,
        "failed": list(report.table.failed),
        "ranked_by": report.by,
        "costs": list(_lines(report)),
        "budgets": [_budget(report, one) for one in report.budgets],
        "sweeps": [
            {"error": one.source, "rms": one.amount.tolist(), "quantities": [
                {"quantity": name.name, **_rows(one.cost, row), "predicted": [number(v) for v in one.linear[:, row]]}
                for row, name in enumerate(QUANTITIES)
            ]}
            for one in report.sweeps
        ],
        "crossovers": _crossovers(report),
        "sources_of_amounts": dict(report.table.errors.notes),
        "notes": list(notes(report)),
    }  # fmt: skip
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def _rows(cost: Cost, row: int) -> dict[str, list[float | None]]:
    names = {"cost": cost.value, "cost_low": cost.low, "cost_high": cost.high}
    return {name: [number(float(value)) for value in np.asarray(values)[:, row]] for name, values in names.items()}


def _budget(report: ToleranceReport, checked: CheckedBudget) -> dict[str, object]:
    budget = checked.budget
    sigma = dict(zip(report.table.sources, report.table.sigma.tolist(), strict=True))
    return {
        "quantity": budget.quantity, "limit": budget.limit, "unit": of_name(budget.quantity).unit,
        "met_by_noise_alone": budget.is_met_without,
        "met_as_assumed": report.is_kept(budget),
        "alone": [
            {"error": name, "unit": SOURCES[name].unit, **_allowed("largest_rms", allowed, sigma[name]),
             "by_draws": name in checked.by_draws}
            for name, allowed in budget.alone
        ],
        "together": {**_allowed("factor", budget.together, 1.0), "by_draws": TOGETHER in checked.by_draws},
    }  # fmt: skip


def _allowed(name: str, allowed: Allowed, unit: float) -> dict[str, float | None]:
    """None where there is no limit."""
    bounds = {name: allowed.factor, f"{name}_low": allowed.low, f"{name}_high": allowed.high}
    return {key: number(unit * value) for key, value in bounds.items()}


def _crossovers(report: ToleranceReport) -> dict[str, object] | None:
    against = report.against
    if against is None:
        return None
    return {
        "target": against.name, "setting": list(against.lines), "errors": against.table.errors.name,
        "found": [
            {"error": name, "unit": SOURCES[name].unit, "quantity": one.quantity, "verdict": one.verdict,
             "rms": number(one.amount), "rms_low": number(one.low), "rms_high": number(one.high),
             "own_without": number(one.own), "other": number(one.other), "noise_share": number(one.noise_share)}
            for name, found in against.crossovers
            for one in found
        ],
    }  # fmt: skip


def _as_markdown(cells: TextTable) -> str:
    return markdown_table(cells.head, cells.body)
