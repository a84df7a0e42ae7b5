"""The pages of bootstrap studies: the numbers on them are those of the study."""

import json
import re
from dataclasses import replace

import pytest

from calib.studies.statistics import METRICS
from tests.support.pages import table_of
from tests.support.report_folders import SIZES, bootstrap_result, paper_result
from tests.support.study_commands import nothing_drawn


@pytest.fixture(autouse=True)
def _nothing_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)


def test_errors_are_those_of_the_table() -> None:
    """Each mean and interval on the page of a person's study is the table's, in mm and px."""
    page = bootstrap_result().page()
    table = table_of(page, "Errors of samples")
    heads = [column.title for column in table.columns]
    cases = json.loads(json.dumps(bootstrap_result().document()))["cases"]
    assert [row[0].value for row in table.rows] == list(SIZES)
    for row, case in zip(table.rows, cases, strict=True):
        of = {one["metric"]: one for one in case["metrics"] if one["over"] == "all"}
        for name, unit in (("intersection", "mm"), ("reconstruction", "mm"), ("reprojection", "px")):
            cell = row[heads.index(f"{name} [{unit}]")]
            assert cell.value == pytest.approx(of[name]["mu"])
            mean, sigma = (float(word) for word in cell.text.split(" ± "))
            assert mean == pytest.approx(of[name]["mu"], abs=0.06 * of[name]["sigma"])
            assert sigma == pytest.approx(of[name]["sigma"], rel=0.05)
            assert row[heads.index(f"{name} [{unit}]") + 1].value == pytest.approx(of[name]["percentile_low"])
    assert not any("pose" in head for head in heads), "no sample has a pose error"


def test_the_answer_is_the_spread_of_the_camera() -> None:
    """The headline tells sigma of the focal length with the most views, as the samples have it."""
    found = bootstrap_result()
    sigma = list(found.cases.samples.values())[-1].params[:, 0].std(ddof=1)
    page = found.page()
    assert page.headline is not None
    sure = re.search(r"sure to ([\d.]+) px", page.headline.sentence)
    assert sure is not None
    assert float(sure[1]) == pytest.approx(sigma, rel=0.05)
    assert f"With {SIZES[-1]} views" in page.headline.sentence
    row = table_of(page, "How sure the camera's parameters are").rows[0]
    assert [cell.text for cell in row[:2]] == ["fx_px", "px"]
    assert row[3].value == pytest.approx(sigma)
    assert row[4].value == pytest.approx(1e-3), "of the solution of all views"


@pytest.mark.parametrize(("lost", "level"), [(0, "note"), (2, "usable"), (30, "bad")])
def test_lost_samples_make_the_answer_worse(lost: int, level: str) -> None:
    """A study of which many samples have no good camera says so first."""
    found = bootstrap_result()
    *first, case = found.table.cases
    case = replace(case, converged=case.samples - lost, degenerate=lost)
    page = replace(found, table=replace(found.table, cases=(*first, case))).page()
    assert page.headline is not None
    assert page.headline.level == level


def test_factors_over_the_papers_numbers_are_those_of_the_study() -> None:
    """Each factor on the page is that of the document."""
    factors = table_of(paper_result().page(), "Ours over the paper's")
    of = {
        (case["target"], case["size"], one["metric"], case["sampling"], case["sightings"]): one
        for case in json.loads(json.dumps(paper_result().document()))["cases"]
        for one in case["metrics"]
        if one["over"] == "all"
    }
    assert len(factors.rows) == 2 * 3 * len(METRICS) * 2
    for row in factors.rows:
        key = (row[0].text, int(row[1].text), row[2].text)
        name = {"mean": "mu_by_paper", "sigma": "sigma_by_paper"}[row[3].text]
        assert row[5].value == of[(*key, "binary", "all")][name]
        assert row[-1].value == of[(*key, "area", "<= 75 deg")][name]


def test_findings_that_hold_are_counted() -> None:
    """The headline counts the claims that hold in all, in some and in no ways of sampling, as the table has them."""
    page = paper_result().page()
    verdicts: dict[str, set[str]] = {}
    for one in json.loads(json.dumps(paper_result().document()))["findings"]:
        verdicts.setdefault(one["claim"], set()).add(one["verdict"])
    everywhere = sum(found == {"holds"} for found in verdicts.values())
    nowhere = sum(not found & {"holds", "holds in part"} for found in verdicts.values())
    assert page.headline is not None
    assert page.headline.word == f"{everywhere} of {len(verdicts)} hold"
    counts = [int(number) for number in re.findall(r"(\d+) in (?:some|none)", page.headline.sentence)]
    assert sum(counts) == len(verdicts) - everywhere
    assert nowhere == 0 or f"{nowhere} in none" in page.headline.sentence
    cells = [cell for row in table_of(page, "The paper's findings").rows for cell in row[1:]]
    assert all((cell.level == "good") == cell.text.startswith("holds:") for cell in cells)
    assert any(cell.level == "good" for cell in cells)
