"""The page of a budget."""

import pytest

import calib
from designer.page.blocks import Facts, Figure, Table
from tests.support.space_scenes import row_of_cameras


@pytest.fixture(scope="module")
def budget_of_pair() -> calib.Budget:
    """The budget of a pair, made once."""
    return calib.budget(row_of_cameras(2), distance_mm=(700, 1500))


def test_a_budgets_page_shows_depth_planes_and_what_would_help(budget_of_pair: calib.Budget) -> None:
    """Three figures of a pair; each change with what it assumes; the headline's number is the table's."""
    page = budget_of_pair.page()
    figures = [block for section in page.sections for block in section.blocks if isinstance(block, Figure)]
    assert [one.title.split(",")[0] for one in figures] == [
        "Depth error over distance", "Error of a point", "Error of a point"
    ]  # fmt: skip
    first, *_, last = [block for section in page.sections for block in section.blocks if isinstance(block, Table)]
    assert page.headline is not None
    assert page.headline.word == f"{first.rows[0][1].text} mm"
    assumed = next(block for section in page.sections for block in section.blocks if isinstance(block, Facts))
    assert [name for name, _ in assumed.rows] == [row[0].text for row in last.rows[1:]]
