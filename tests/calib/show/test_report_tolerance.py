"""The page of a tolerance study: costs, limits and crossovers are those that were found."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from calib.studies.table_files import JSON_FILE
from calib.studies.tolerance.files import tolerance_file
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import MAIN
from calib.studies.tolerance.table_file import TOLERANCE_TABLE, ToleranceFile
from calib.studies.tolerance.tables import budget_table, crossover_table
from designer.page.blocks import Page
from tests.support.report_folders import findings_of, page_of, table_of, tolerance_files, tolerance_report, written


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A study's folder."""
    return written(tolerance_files(), tmp_path)


@pytest.fixture
def page(folder: Path) -> Page:
    """Its page."""
    return page_of("tolerance", folder)


def test_the_order_is_that_of_the_study(folder: Path) -> None:
    """Errors are ranked as the study ranks them; what does nothing is left out."""
    table = TOLERANCE_TABLE.read_if_there(folder / JSON_FILE)
    assert isinstance(table, ToleranceFile)
    assert [one.error for one in table.ranking] == list(tolerance_report().ranking)


def test_costs_are_those_of_the_study(page: Page) -> None:
    """Each cost, all together and noise alone are the table's; what is left without an error is the rest of squares."""
    report, table = tolerance_report(), table_of(page, "What each error costs")
    rows = {row[0].text: row for row in table.rows}
    row = quantity_row("intersection")
    total = math.hypot(float(report.table.baseline.value[row]), float(report.table.together.value[row]))
    for name in report.ranking:
        cost = report.table.cost.value[report.table.sources.index(name)]
        for place, quantity in enumerate(MAIN):
            assert rows[name][4 + place].value == pytest.approx(cost[quantity_row(quantity)], rel=1e-8)
        assert rows[name][3].value == pytest.approx(math.sqrt(total**2 - cost[row] ** 2))
    assert rows.keys() == set(report.ranking)  # sorting must not mix sums with errors
    rows = {row[0].text: row for row in table_of(page, "All errors together, and none").rows}
    for place, quantity in enumerate(MAIN):
        at = quantity_row(quantity)
        assert rows["all errors together"][1 + place].value == pytest.approx(float(report.table.together.value[at]))
        assert rows["no error: noise alone"][1 + place].value == pytest.approx(float(report.table.baseline.value[at]))


def test_the_largest_errors_are_those_of_the_study(page: Page) -> None:
    """What keeps a limit stands as in the study's own table, and is marked where it is below what is assumed."""
    report = tolerance_report()
    own = budget_table(report, report.budgets[0])
    shown = table_of(page, "For intersection up to 0.01")
    words = {row[0].split("(")[-1].rstrip(")"): row[2] for row in own.body[:-1]}
    for row in shown.rows[:-1]:
        name = row[0].text.split("(")[-1].rstrip(")")
        assert row[2].text == words[name]
        factor = row[4].value
        assert factor is None or row[4].level == ("good" if factor >= 1 else "bad")


def test_a_missed_limit_comes_first(page: Page, tmp_path: Path) -> None:
    """With one limit missed of two the answer is bad; with none missed it is good, and without limits a number."""
    assert page.headline is not None
    assert page.headline.level == "bad"
    assert "missed" in page.headline.sentence
    levels = {one.title: one.level for one in findings_of(page) if one.rule}
    assert levels == {"Intersection error against the drawing": "bad", "Reprojection error": "good"}
    for budgets, level in ((tolerance_report().budgets[1:], "good"), ((), "note")):
        other = tmp_path / level
        written(
            {"table.json": TOLERANCE_TABLE.text(tolerance_file(replace(tolerance_report(), budgets=budgets)))}, other
        )
        headline = page_of("tolerance", other).headline
        assert headline is not None
        assert headline.level == level


def test_crossovers_are_those_of_the_study(page: Page) -> None:
    """From which size of an error on the target is worse stands as in the study's own table."""
    report = tolerance_report()
    assert report.against is not None
    own = {row[0].split("\n")[0]: row[1:] for row in crossover_table(report, report.against).body}
    for row in table_of(page, "Worse than board from").rows:
        assert tuple(cell.text for cell in row[2:]) == own[row[0].text]
    totals = table_of(page, "Both as they are assumed")
    own_total, their_total = (own[f"{name}, as assumed"] for name in ("ico", "board"))
    for place, row in enumerate(totals.rows):
        assert (row[1].text.split()[0], row[2].text.split()[0]) == (own_total[place], their_total[place])
        assert row[3].level == ("good" if float(row[1].value or 0) < float(row[2].value or 0) else "bad")


def test_warnings_of_the_setting_are_seen(page: Page) -> None:
    """What the study warned of is not hidden among the facts."""
    assert any((one.level, one.text) == ("usable", "it is near") for one in findings_of(page))


def test_a_prediction_needs_no_draws(tmp_path: Path) -> None:
    """A study without draws says that nothing checked it, and has no intervals."""
    report = tolerance_report()
    linear = replace(report, table=report.linear, sweeps=(), reaches=(), against=None)
    page = page_of("tolerance", written({"table.json": TOLERANCE_TABLE.text(tolerance_file(linear))}, tmp_path))
    prediction = next(one for one in page.sections if one.title == "Prediction")
    assert "without --linear" in prediction.lead
    assert "without a single draw" in page.sections[0].lead
    assert {row[3].text for row in table_of(page, "For intersection").rows} == {""}


@pytest.mark.parametrize("value", [1e99, -1e99, 0, 1e-300])
def test_absurd_numbers_have_a_page(value: float, tmp_path: Path) -> None:
    """Whatever finite numbers a table holds, there is a page."""
    document = json.loads(tolerance_files()["table.json"])
    for row in document["costs"]:
        row.update(dict.fromkeys(("cost", "cost_low", "cost_high", "predicted", "share", "rms"), value))
    for row in document["crossovers"]["found"]:
        row["other"] = row["rms"] = value
    page = page_of("tolerance", written({"table.json": json.dumps(document).encode()}, tmp_path))
    assert page.headline is not None
