"""The page of a comparison: medians are the table's, and the answer follows from them."""

import re

import pytest

from calib.studies.compare.cases import FIGURE, LENS_DRAWN
from designer.page.blocks import Page
from tests.support.pages import table_of
from tests.support.report_folders import compare_result
from tests.support.study_commands import nothing_drawn


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    """The page of a made-up comparison."""
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    return compare_result().page()


def medians() -> dict[tuple[str, str, str, str], float]:
    """Of the table, by object, part, model and metric."""
    cases = compare_result().results.table.cases
    return {(one.object, one.part, one.model, one.metric): one.median for one in cases}


def test_medians_are_those_of_the_table(page: Page) -> None:
    """Each error of each object and model is the table's, and the paper's stands beside."""
    table = table_of(page, "The paper's objects")
    assert len(table.rows) == 2
    for row in table.rows:
        key = (row[0].text, FIGURE, row[2].text)
        assert row[3].value == medians()[(*key, "intersection")]
        assert row[5].value == medians()[(*key, "reconstruction")]
        assert row[7].value == medians()[(*key, "reprojection")]
    assert {row[0].text: row[4].text for row in table.rows} == {"AluBoard": "0.4", "ShinyIco": "1.74-1.83"}
    lens = table_of(page, "A lens that no Brown model fits")
    for row in lens.rows:
        assert row[4].value == medians()[(row[1].text, LENS_DRAWN, row[2].text, "held_intersection")]


def test_the_answer_names_the_best_and_the_factors(page: Page) -> None:
    """The best object, by how many times, and how much the virtual camera wins behind the lens."""
    found = medians()
    best, worst = (found[(name, FIGURE, "opencv", "intersection")] for name in ("AluBoard", "ShinyIco"))
    brown, learned = (found[("AluBoard", LENS_DRAWN, model, "held_intersection")] for model in ("opencv", "virtual"))
    assert page.headline is not None
    assert page.headline.word == "AluBoard is best"
    below = re.search(r"([\d.]+) times below ShinyIco", page.headline.sentence)
    smaller = re.search(r"AluBoard as drawn, ([\d.]+) times smaller", page.headline.sentence)
    assert below is not None
    assert smaller is not None
    assert float(below[1]) == pytest.approx(worst / best, rel=0.05)
    assert float(smaller[1]) == pytest.approx(brown / learned, rel=0.05)


def test_explanations_need_both_numbers(page: Page) -> None:
    """An error explains the paper if its reconstruction error is right too and it is within reach."""
    rows = {row[1].text: row for row in table_of(page, "Single errors").rows}
    assert (rows["warp"][-1].text, rows["warp"][-1].level) == ("yes", "good")
    assert (rows["noise"][-1].text, rows["noise"][-1].level) == ("no", "bad")
    assert rows["skew"][-1].text == "skew has no effect"
