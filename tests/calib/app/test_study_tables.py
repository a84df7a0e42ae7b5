"""The table of a study: in the paper's layout, and for other programs."""

import csv
import io
import json
import re

import numpy as np
import pytest

from calib.app.study_bootstrap import Bootstrap
from calib.draw.study_tables import errors_table, findings_table
from calib.draw.study_words import finding_of, study_notes
from calib.studies.identity import StudyIdentity
from calib.studies.runner import DrawCount
from calib.studies.samples import Case
from calib.studies.statistics import BOARD, CORRECTION, ICOSAHEDRON
from calib.studies.study_table import StudyCases, StudyTable
from tests.support.study_cases import SETTINGS, made, paper_cases, table_of_cases, with_failures
from tests.support.study_commands import nothing_drawn


def paper_table(settings: tuple[tuple[str, str], ...] = SETTINGS) -> StudyTable:
    """The paper's study, one case with failures."""
    cases = paper_cases(1000, settings=settings)
    first = Case(BOARD, 20, 200, *settings[0])
    cases[first] = with_failures(cases[first], np.random.default_rng(1), degenerate=3, failed=2)
    return table_of_cases(cases)


@pytest.fixture(autouse=True)
def _nothing_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    monkeypatch.setattr("calib.app.bootstrap_page.study_sheets", lambda cases, table: ())


def result(table: StudyTable) -> Bootstrap:
    """A study that says this."""
    return Bootstrap(table, StudyCases("luhmann", {}, {}), StudyIdentity(1, (), ()), DrawCount(), (), b"", "out")


def markdown(table: StudyTable) -> str:
    return result(table).tables()["table.md"].decode()


def csv_lines(table: StudyTable) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(result(table).csv().decode())))


def test_rows_are_in_the_papers_order_beside_the_papers_own() -> None:
    """For each size the paper's row, then one for each sampling and count of observations; a table a target."""
    table = paper_table()
    board, ico = (errors_table(table, target) for target in (BOARD, ICOSAHEDRON))
    ours = ["binary, all", "binary, <= 75 deg", "area, all", "area, <= 75 deg"]
    for one in (board, ico):
        assert [row[0].text for row in one.rows] == ["20"] * 5 + ["50"] * 5 + ["120"] * 5
        assert [row[1].text for row in one.rows] == 3 * ["paper", *ours]
    heads = [column.title for column in board.columns]
    inter, pose = heads.index("intersection [10⁻² mm]"), heads.index("pose [10⁻¹ mm]")
    assert [cell.text for cell in board.rows[0][inter : inter + 2]] == ["4.27 ± 0.48", "3.40 to 5.20"]
    assert [cell.text for cell in ico.rows[10][pose : pose + 2]] == ["0.78 ± 0.15", "0.58 to 1.09"]


def test_numbers_are_in_the_papers_units() -> None:
    """0.0427 mm is 4.27 in units of 1e-2 mm; 0.124 px is 1.24; 0.144 mm of pose is 1.44."""
    values = np.array([0.124, 0.0427, 0.0083, 0.144]) * np.linspace(0.9, 1.1, 101)[:, None]
    row = errors_table(table_of_cases({Case(BOARD, 20, 200): made(values)}), BOARD).rows[1]
    assert [cell.value for cell in row[2:10:2]] == pytest.approx([0.83, 4.27, 1.24, 1.44])
    assert row[5].text.split(" to ")[1] == "4.68"


def test_another_target_has_no_rows_of_the_paper() -> None:
    """The table serves any target and size; nothing is said of the paper, and no claim of two targets is made."""
    samples = made(np.random.default_rng(1).normal(1, 0.1, (100, 4)))
    table = table_of_cases({Case("cube", size, 50): samples for size in (20, 33)})
    assert [row[0].text for row in errors_table(table, "cube").rows] == ["20", "33"]
    assert "paper" not in markdown(table)
    assert all(one.exponents for one in table.findings)


def test_failed_samples_are_shown() -> None:
    """In the row of their case, in the notes with the errors of the converged, and in the files."""
    table = paper_table()
    assert [cell.text for cell in errors_table(table, BOARD).rows[1][-2:]] == ["1000", "5"]
    (note,) = [one for one in study_notes(table) if one.level == "usable"]
    assert note.title == "board, 20 views, binary, all"
    assert "995 converged, 3 degenerate, 2 failed" in note.text
    assert "995 converged, 3 degenerate, 2 failed" in markdown(table)
    first = csv_lines(table)[0]
    assert (first["converged"], first["degenerate"], first["failed"], first["count"]) == ("995", "3", "2", "998")


def test_a_case_where_everything_failed() -> None:
    """It has a row, and no numbers."""
    samples = with_failures(made(np.ones((30, 4))), np.random.default_rng(1), degenerate=0, failed=30)
    table = table_of_cases({Case("cube", 20, 200): samples, Case("cube", 30, 200): made(np.ones((30, 4)))})
    row = errors_table(table, "cube").rows[0]
    assert [cell.text for cell in row] == ["20", *["-"] * 8, "30", "30"]
    json.loads(json.dumps(result(table).document()), parse_constant=pytest.fail)


def test_wild_numbers_keep_the_table_readable() -> None:
    """The error of a lost sample has an exponent, not two hundred digits."""
    values = np.ones((50, 4))
    values[0] = 1e200
    row = errors_table(table_of_cases({Case("cube", 20, 50): made(values)}), "cube").rows[0]
    assert max(len(cell.text) for cell in row) < 25


def test_markdown_is_a_table_whatever_the_names() -> None:
    """All lines of a table have the same number of cells; a name neither ends a cell nor makes a link or a tag."""
    samples = made(np.random.default_rng(1).normal(1, 0.1, (100, 4)))
    name = "a|b\n[x](http://y) <img> `c` \x1b[31m"
    text = markdown(table_of_cases({Case(name, size, 50, "", "*all*"): samples for size in (20, 50)}))
    tables: list[list[str]] = [[]]
    for line in text.splitlines():
        if line.startswith("|"):
            tables[-1].append(line)
        elif tables[-1]:
            tables.append([])
    for lines in filter(None, tables):
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1
    assert "\x1b" not in text
    assert "](" not in text
    assert not re.search(r"(?<!\\)<(?!br>)", text)


def test_markdown_has_table_factors_and_findings() -> None:
    """Those that hold with their ratios, those that do not in full."""
    text = markdown(paper_table())
    assert re.search(
        r"\| intersection error is lower for the icosahedron \| holds: 0.(59|60), 0.60, 0.(59|60) \|", text
    )
    assert "| board | 20 | intersection | mean | 4.27 · 10⁻² mm | " in text
    assert f"- {CORRECTION}" in text
    assert "- reprojection error is lower for the board: " in text  # the lost samples leave it open


def test_csv_is_in_mm_and_px() -> None:
    """A line for each case, metric and set of samples; the paper's numbers in the same units; no cell says nan."""
    lines = csv_lines(paper_table())
    assert len(lines) == 24 * 4 * 2
    assert "nan" not in {value for line in lines for value in line.values()}
    wanted = {"target": ICOSAHEDRON, "size": "120", "metric": "intersection", "over": "all", "sampling": "area"}
    found = [line for line in lines if wanted.items() <= line.items()]
    assert len(found) == 2
    for line in found:
        assert float(line["paper_mu"]) == pytest.approx(0.0257)
        assert float(line["mu"]) == pytest.approx(0.0257 / 3, rel=0.01)
        assert float(line["mu_by_paper"]) == pytest.approx(1 / 3, rel=0.01)
        assert float(line["percentile_low"]) < float(line["mu"]) < float(line["percentile_high"])


def test_json_holds_the_same_as_csv_and_the_findings() -> None:
    """Numbers of both files are equal; NaN, which JSON has not, is null."""
    table = paper_table((("binary", "all"),))
    document = json.loads(json.dumps(result(table).document()), parse_constant=pytest.fail)
    flat = [(case["target"], case["size"], one) for case in document["cases"] for one in case["metrics"]]
    for (target, size, one), line in zip(flat, csv_lines(table), strict=True):
        names = ("target", "size", "metric", "over")
        assert [target, str(size), one["metric"], one["over"]] == [line[name] for name in names]
        assert one["sigma"] == float(line["sigma"])
    assert [one["claim"] for one in document["findings"]] == [one.claim for one in table.findings]
    assert document["findings"][0]["ratios"][0]["paper"] == pytest.approx(2.56 / 4.27)
    assert document["cameras"][0]["parameters"][0]["stated"] == pytest.approx(1.0)


def test_findings_have_a_line_a_claim_and_a_column_a_way_of_sampling() -> None:
    """So a reader sees what a claim depends on."""
    found = findings_table(paper_table().findings)
    assert found is not None
    assert (len(found.rows), len(found.columns)) == (12, 5)


def test_lost_samples_that_change_a_verdict_are_named() -> None:
    """One degenerate sample may decide over sigma; what the converged say is said beside it."""
    cases = paper_cases(2000, settings=(("binary", "all"),))
    for case, samples in cases.items():
        if case.target == ICOSAHEDRON:
            cases[case] = with_failures(samples, np.random.default_rng(1), degenerate=60, failed=0)
    found = table_of_cases(cases).findings
    (one,) = (one for one in found if one.claim == "intersection error is more stable for the icosahedron")
    assert one.verdict != "holds"
    assert "over converged samples alone: holds" in finding_of(one, found).text
