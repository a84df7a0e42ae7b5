"""The files of a tolerance study: its tables as Markdown, CSV and JSON, and its figures."""

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
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE, rows_to_csv
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
from calib.studies.tolerance.sweep import Sweep
from calib.studies.tolerance.table_file import (
    TOLERANCE_TABLE,
    AllowedRow,
    BudgetRow,
    CostRow,
    CrossoverRow,
    Crossovers,
    SweepCosts,
    SweepRow,
    Together,
    ToleranceFile,
)  # fmt: skip
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


def report_files(report: ToleranceReport, folder: Path, formats: Collection[str] = ()) -> dict[Path, bytes]:
    """All files and their contents.

    Args:
        report: what was found.
        folder: where they are to lie.
        formats: of the figures besides PNG: "pdf", "svg".
    """
    told = tolerance_file(report)
    return {
        folder / MARKDOWN_FILE: markdown(report).encode("utf-8", ANY_NAME),
        folder / CSV_FILE: rows_to_csv(CostRow, told.costs),
        folder / JSON_FILE: TOLERANCE_TABLE.text(told),
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


def _lines(report: ToleranceReport) -> Iterator[CostRow]:
    """A row for each source and quantity, and for no error and all together."""
    table, linear = report.table, report.linear
    for row in range(len(QUANTITIES)):
        yield _line(report, BARE, row, _at(table.baseline, (row,)), float(linear.baseline.value[row]))
        for place, name in enumerate(table.sources):
            yield _line(report, name, row, _at(table.cost, (place, row)), float(linear.cost.value[place, row]))
        yield _line(report, TOGETHER, row, _at(table.together, (row,)), float(linear.together.value[row]))


def _line(report: ToleranceReport, name: str, row: int, cost: tuple[float, float, float], linear: float) -> CostRow:
    """One cost, in the quantity's unit, and by the source's unit."""
    table, one = report.table, QUANTITIES[row]
    is_source = name in table.sources
    share = reach = sigma = math.nan
    if is_source:
        place = table.sources.index(name)
        share, sigma = float(table.share[place, row]), float(table.sigma[place])
        reach = sigma * report.reach(name, one.name)
    amount = table.errors.amount(name) if is_source else None
    value, low, high = map(number, cost)
    low_by, by, high_by = (number(cost[n] / sigma) if sigma > 0 else None for n in (1, 0, 2))
    return CostRow(
        name, "" if amount is None else amount.kind, None if amount is None else number(amount.size), number(sigma),
        SOURCES[name].unit if is_source else "", one.name, one.unit, value, low, high, number(linear), number(share),
        by, low_by, high_by, number(reach),
    )  # fmt: skip


def _at(cost: Cost, place: tuple[int, ...]) -> tuple[float, float, float]:
    return float(cost.value[place]), float(cost.low[place]), float(cost.high[place])


def number(value: float) -> float | None:
    """To nine digits; None for nan and infinity."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


def tolerance_file(report: ToleranceReport) -> ToleranceFile:
    """Costs, budgets, sweeps, crossovers and notes, as the file has them."""
    table = report.table
    return ToleranceFile(
        report.name, tuple(report.lines), table.kind, table.draws, table.failed, report.by, tuple(_lines(report)),
        tuple(_budget(report, one) for one in report.budgets), tuple(map(_sweep, report.sweeps)), _crossovers(report),
        dict(table.errors.notes), tuple(notes(report)),
    )  # fmt: skip


def _sweep(one: Sweep) -> SweepRow:
    """An error at several amounts."""
    costs = (one.cost.value, one.cost.low, one.cost.high, one.linear)
    quantities = (
        SweepCosts(name.name, *(tuple(number(float(v)) for v in np.asarray(cost)[:, row]) for cost in costs))
        for row, name in enumerate(QUANTITIES)
    )
    return SweepRow(one.source, tuple(one.amount.tolist()), tuple(quantities))


def _budget(report: ToleranceReport, checked: CheckedBudget) -> BudgetRow:
    budget = checked.budget
    sigma = dict(zip(report.table.sources, report.table.sigma.tolist(), strict=True))
    alone = (
        AllowedRow(name, SOURCES[name].unit, *_allowed(allowed, sigma[name]), name in checked.by_draws)
        for name, allowed in budget.alone
    )
    return BudgetRow(
        budget.quantity, budget.limit, of_name(budget.quantity).unit, budget.is_met_without, report.is_kept(budget),
        tuple(alone), Together(*_allowed(budget.together, 1.0), TOGETHER in checked.by_draws),
    )  # fmt: skip


def _allowed(allowed: Allowed, unit: float) -> tuple[float | None, float | None, float | None]:
    """The largest amount with its interval; None where there is no limit."""
    return number(unit * allowed.factor), number(unit * allowed.low), number(unit * allowed.high)


def _crossovers(report: ToleranceReport) -> Crossovers | None:
    against = report.against
    if against is None:
        return None
    found = tuple(
        CrossoverRow(
            name, SOURCES[name].unit, one.quantity, one.verdict,
            *map(number, (one.amount, one.low, one.high, one.own, one.other, one.noise_share)),
        )
        for name, found in against.crossovers
        for one in found
    )  # fmt: skip
    return Crossovers(against.name, tuple(against.lines), against.table.errors.name, found)


def _as_markdown(cells: TextTable) -> str:
    return markdown_table(cells.head, cells.body)
