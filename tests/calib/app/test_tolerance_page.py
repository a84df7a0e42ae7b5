"""What is shown of a tolerance study: page, tables, files and figures say what was found."""

import csv
import io
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from calib.draw.tolerance_tables import budget_table, ranking_table
from calib.draw.tolerance_words import amount_of, cost_text, tolerance_headline
from calib.studies.tolerance.budget import budget_row, largest_allowed
from calib.studies.tolerance.predict import linear_table
from calib.studies.tolerance.quantities import MAIN, NAMES, Requirement, quantity_row
from calib.studies.tolerance.record import BudgetRow
from designer.page.blocks import Page, Paragraph, Table
from designer.tolerance.error_file import parse_amount
from designer.tolerance.sources import SOURCES
from tests.support.pages import findings_of, table_of
from tests.support.study_commands import nothing_drawn
from tests.support.tolerance_settings import few_errors, ico_setting, told, tolerance_study, tolerance_table


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    """The study's page, without pictures."""
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    return told(tolerance_study()).page()


def texts_of(table: Table) -> dict[str, tuple[str, ...]]:
    """The texts of each row by the first."""
    return {row[0].text: tuple(cell.text for cell in row[1:]) for row in table.rows}


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.0, 0.0, 0.0, "0"),
        (0.004, 0.0039, 0.0041, "< 0.010"),  # a tenth of the noise bounds what is far below it
        (0.0, 0.0, 0.03, "< 0.030"),  # draws that do not tell it from the noise bound it by their interval
        (0.5, 0.4804, 0.5196, "0.500 ± 0.010"),
        (0.5, 0.5, 0.5, "0.500"),
        (math.nan, math.nan, math.nan, "no solution"),
    ],
)
def test_costs_are_told_as_far_as_they_are_known(value: float, low: float, high: float, text: str) -> None:
    """A cost has its standard error; far below the noise, or not told from it, there is a bound and no tiny number."""
    one = replace(tolerance_study().cost("scale", "pose"), cost=value, cost_low=low, cost_high=high)
    assert cost_text(one, noise=0.1) == text


@pytest.mark.parametrize("name", ["face_tilt", "ring_jitter", "scale", "warp"])
def test_sizes_are_read_back_as_they_were_shown(name: str) -> None:
    """A size in a table, typed in as it stands there, is that size to three digits."""
    one = tolerance_study().cost(name, "pose")
    text = amount_of(one, 0.12345 * one.rms)
    assert parse_amount(text, SOURCES[name]).size == pytest.approx(0.12345 * one.size, rel=6e-3)
    assert len(re.sub("[^0-9]", "", text).lstrip("0")) <= 3


def test_the_answer_names_what_it_is_against() -> None:
    """An error that shows against the true shape alone is in the headline, in the ranking, and beside a limit."""
    study = tolerance_study()
    sentence = tolerance_headline(replace(study, budgets=())).sentence
    drawing, true = sentence.split("The intersection error against the true shape is ")
    assert "intersection error against the drawing" in drawing
    assert "scale of the print" not in drawing
    assert "most of that is from scale of the print" in true
    table = ranking_table(study)
    shares = {column.title: place - 1 for place, column in enumerate(table.columns) if "share" in column.title}
    scale = texts_of(table)["scale"]
    assert scale[shares["share, drawing"]] == "< 0.1 %"
    assert float(scale[shares["share, true shape"]].split()[0]) > 50
    budget = texts_of(budget_table(study, study.budgets[0]))["scale"]
    assert budget[1] == "any"
    assert "of the intersection error against the true shape" in budget[-1]


def test_costs_are_those_of_the_study(page: Page) -> None:
    """Each cost, all together and noise alone are the table's; what is left without an error is the rest of squares."""
    study, table = tolerance_study(), tolerance_table()
    ranked = {row[0].text: row for row in table_of(page, "What each error adds").rows}
    rows = {row[0].text: row for row in table_of(page, "What each error costs").rows}
    row = quantity_row("intersection")
    for one in study.ranking:
        cost = table.cost.value[table.sources.index(one.error)]
        for place, quantity in enumerate(MAIN):
            assert rows[one.error][2 + place].value == pytest.approx(cost[quantity_row(quantity)], rel=1e-8)
        assert ranked[one.error][-1].value == pytest.approx(math.sqrt(table.total[row] ** 2 - cost[row] ** 2))
    assert rows.keys() == ranked.keys() == {one.error for one in study.ranking}  # sorting must not mix sums with errors
    rows = {row[0].text: row for row in table_of(page, "All errors together, and none").rows}
    for place, quantity in enumerate(MAIN):
        at = quantity_row(quantity)
        assert rows["all errors together"][1 + place].value == pytest.approx(float(table.together.value[at]))
        assert rows["no error: noise alone"][1 + place].value == pytest.approx(float(table.baseline.value[at]))


def test_what_does_nothing_is_told(page: Page) -> None:
    """Errors that do nothing to this target are no rows of its tables, and are named."""
    told = {one.title: one.text for one in findings_of(page)}
    assert "do nothing to this target" in told["ink_bleed, warp"]


def test_a_limit_is_kept_by_what_is_stated(page: Page) -> None:
    """The stated size of one error, put into the prediction, just meets the limit; what is below the assumed is bad."""
    shown = table_of(page, "For intersection error against the drawing up to 0.01")
    errors = few_errors().only("face_tilt")
    text = texts_of(shown)["face_tilt"][1]
    predicted = linear_table(ico_setting(), errors.with_amount("face_tilt", parse_amount(text, SOURCES["face_tilt"])))
    assert predicted.total[quantity_row("intersection")] == pytest.approx(0.01, rel=0.15)
    for row in shown.rows:
        factor = row[4].value
        assert factor is None or row[4].level == ("good" if factor >= 1 else "bad")


def test_a_limit_below_the_noise_is_told() -> None:
    """Where noise alone is more than the limit, no print is said to be good enough."""
    row = budget_row(largest_allowed(tolerance_table(), Requirement("reprojection", 1e-4)), tolerance_table())
    assert not row.met_by_noise_alone
    sentence = tolerance_headline(replace(tolerance_study(), budgets=(row,))).sentence
    assert "Noise alone gives" in sentence
    assert "no print is good enough" in sentence


def test_a_missed_limit_comes_first(page: Page) -> None:
    """With one limit missed of two the answer is bad; with none missed it is good, and without limits a number."""
    assert page.headline is not None
    assert page.headline.level == "bad"
    assert "missed" in page.headline.sentence
    levels = {one.title: one.level for one in findings_of(page) if one.rule}
    assert levels == {"Intersection error against the drawing": "bad", "Reprojection error": "good"}
    study = tolerance_study()
    kept: tuple[tuple[tuple[BudgetRow, ...], str], ...] = ((study.budgets[1:], "good"), ((), "note"))
    for budgets, level in kept:
        assert tolerance_headline(replace(study, budgets=budgets)).level == level


def test_crossovers_are_those_of_the_study(page: Page) -> None:
    """The target loses now exactly where its error is the larger one, in both tables."""
    other, row = tolerance_study().crossovers, table_of(page, "Worse than board from").rows[1]
    assert other is not None
    assert row[0].text == other.vary == "face_tilt"
    for name, cell, total in zip(MAIN, row[2:], table_of(page, "Both as they are assumed").rows, strict=True):
        at = quantity_row(name)
        alone = math.hypot(*tolerance_table().cost.value[:, at], tolerance_table().baseline.value[at])
        assert cell.level == ("bad" if alone > other.totals[name] else "good"), name
        assert total[1].value == pytest.approx(tolerance_table().total[at])
        assert total[2].value == other.totals[name]
        assert total[3].level == ("good" if float(total[1].value or 0) < float(total[2].value or 0) else "bad")


def test_warnings_of_the_setting_are_seen(page: Page) -> None:
    """What the study warned of is not hidden among the facts."""
    assert any((one.level, one.text) == ("usable", "ico: it is near") for one in findings_of(page))


def test_a_prediction_needs_no_draws() -> None:
    """A study without draws says that nothing checked it, and has no intervals."""
    page = told(tolerance_study(linear=True)).page()
    assert any("without --linear" in one.text for one in findings_of(page))
    assert "without a single draw" in next(one.text for one in page.lead if isinstance(one, Paragraph))
    assert {row[3].text for row in table_of(page, "For intersection").rows} == {""}


def test_few_draws_say_nothing_of_a_prediction(page: Page) -> None:
    """Draws whose spread is not known do not call a prediction wrong, nor right."""
    few = told(replace(tolerance_study(), draws=3)).page()
    said = "3 draws are too few to check the prediction with; 10 do."
    assert said in {one.text for one in findings_of(few)} - {one.text for one in findings_of(page)}


def test_files_say_the_same() -> None:
    """CSV has every cost of every quantity; Markdown has the page's tables and findings."""
    files = told(replace(tolerance_study(linear=True), crossovers=None)).tables()
    lines = list(csv.DictReader(io.StringIO(files["table.csv"].decode())))
    assert len(lines) == len(NAMES) * (len(few_errors().sources) + 2)
    text = files["table.md"].decode()
    for words in (
        "**What each error adds to",
        "**Cost by a unit of each error**",
        "| face\\_tilt | 0.1deg |",
        "missed",
    ):
        assert words in text


def test_figures_are_readable_pictures() -> None:
    """All figures of a study are drawn as PNG, 1600 pixels wide and not empty; in other formats, those asked for."""
    predicted = replace(tolerance_study(linear=True), crossovers=None, budgets=())
    files = told(predicted, formats=("pdf", "svg")).tables()
    assert {name for name in files if "/" in name} == {f"figures/ranking.{one}" for one in ("png", "pdf", "svg")}
    drawn = told(replace(tolerance_study(), budgets=tolerance_study().budgets[:1])).tables()
    pictures = {name: content for name, content in drawn.items() if "/" in name}
    names = {"ranking", "budget", "crossover", "sweep_intersection"}
    assert pictures.keys() == {f"figures/{name}.png" for name in names}
    for content in pictures.values():
        with Image.open(io.BytesIO(content)) as picture:
            assert picture.size[0] == 1600
            assert np.asarray(picture.convert("L")).std() > 10
