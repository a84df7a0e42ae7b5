"""The page of a study of costs: ratios are the table's, and the answer follows from them."""

import pytest

from designer.page.blocks import Page
from tests.support.pages import table_of
from tests.support.report_folders import cost_result
from tests.support.study_commands import nothing_drawn


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    """The page of a made-up study."""
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    return cost_result().page()


def test_the_answer_counts_what_is_sure(page: Page) -> None:
    """Under which conditions another cost is better more often than worse; where, and by how much."""
    assert page.headline is not None
    assert page.headline.word == "it depends"
    assert page.headline.sentence == (
        "Distances in the image are not beaten on balance: as drawn. They are: as made: ray (1 better, 0 worse of 1)."
    )
    (row,) = table_of(page, "Costs against").rows
    assert [cell.text for cell in row[2:5]] == ["1", "2", "3"]
    assert (row[2].level, row[3].level) == ("good", "bad")
    lead = next(section.lead for section in page.sections if section.title == "Every comparison")
    assert lead.endswith("ray (board, as made: camera against truth, px, 0.900 times).")


def test_ratios_stand_with_their_intervals(page: Page) -> None:
    """Of each scene, condition and measure; marked if sure, and with how many sets have none."""
    rows = {(row[1].text, row[2].text): row for row in table_of(page, "Errors over").rows}
    worse = rows["as drawn", "camera against truth, px"]
    assert (worse[3].text, worse[4].text, worse[4].level) == ("0.0100", "2.000 [1.900, 2.100]; 1 without", "bad")
    assert rows["as made", "camera against truth, px"][4].level == "good"


def test_starts_are_told_with_their_shares(page: Page) -> None:
    """By cost over all scenes, the one that stands most first; shares have Wilson's interval."""
    lead = next(section.lead for section in page.sections if section.title == "Bad starts")
    assert "ray 90 %, image 75 %" in lead
    rows = {row[1].text: row for row in table_of(page, "Bad starts").rows}
    assert rows["image"][3].text == "75 % [59, 86]"  # (45 + z² / 2) / (60 + z²) ± 2.3195 × 0.0599
    assert [cell.text for cell in rows["ray"][4:]] == ["10", "1", "8"]
