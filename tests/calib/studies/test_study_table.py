"""The table of a study: in the paper's layout, and for other programs."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from calib.studies.findings import findings
from calib.studies.paper_table import BOARD, CORRECTION, ICOSAHEDRON
from calib.studies.statistics import Case, CaseSummary, summarise
from calib.studies.table import CaseMetric, findings_table, markdown, notes, rows_of, screen_tables
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE, table_files
from tests.support.study_cases import SETTINGS, made, paper_cases, with_failures


def paper_summaries(settings: tuple[tuple[str, str], ...] = SETTINGS) -> list[CaseSummary]:
    """The paper's study, one case with failures."""
    cases = paper_cases(1000, settings=settings)
    first = Case(BOARD, 20, 200, *settings[0])
    cases[first] = with_failures(cases[first], np.random.default_rng(1), degenerate=3, failed=2)
    return [summarise(case, samples) for case, samples in cases.items()]


def shown(summaries: list[CaseSummary]) -> str:
    """Tables as a terminal of 120 columns shows them."""
    console = Console(width=120, file=io.StringIO(), highlight=False)
    for table in screen_tables(summaries):
        console.print(table)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def csv_lines(content: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(content.decode())))


def test_rows_are_in_the_papers_order_beside_the_papers_own() -> None:
    """For each size the paper's row, then one for each sampling and count of sightings, both targets side by side."""
    rows = rows_of(paper_summaries())
    assert [row.size for row in rows] == [20] * 5 + [50] * 5 + [120] * 5
    ours = ["binary, all", "binary, <= 75 deg", "area, all", "area, <= 75 deg"]
    assert [row.source for row in rows] == 3 * ["paper", *ours]
    assert all(len(row.cells) == 2 and len(row.cells[0]) == 4 for row in rows)
    assert rows[0].cells[0][1] == CaseMetric("4.27", "0.48", "[3.40, 5.20]c")
    assert rows[10].cells[1][3] == CaseMetric("0.78", "0.15", "[0.58, 1.09]")


def test_numbers_are_in_the_papers_units() -> None:
    """0.0427 mm is 4.27 in units of 1e-2 mm; 0.124 px is 1.24; 0.144 mm of pose is 1.44."""
    values = np.array([0.124, 0.0427, 0.0083, 0.144]) * np.linspace(0.9, 1.1, 101)[:, None]
    (paper, ours) = rows_of([summarise(Case(BOARD, 20, 200), made(values))])
    assert [cell.mu[:4] for cell in ours.cells[0]] == ["0.83", "4.27", "1.24", "1.44"]
    assert [cell.mu for cell in paper.cells[0]] == ["0.83", "4.27", "1.24", "1.44"]
    low, high = re.findall(r"[\d.]+", ours.cells[0][1].interval)
    assert float(low) == pytest.approx(4.27 * 0.905, rel=2e-3)
    assert float(high) == pytest.approx(4.27 * 1.095, rel=2e-3)


def test_another_target_has_no_rows_of_the_paper() -> None:
    """The table serves any target and size; nothing is said of the paper, and no claim of two targets is made."""
    samples = made(np.random.default_rng(1).normal(1, 0.1, (100, 4)))
    summaries = [summarise(Case("cube", size, 50), samples) for size in (20, 33)]
    assert [row.source for row in rows_of(summaries)] == ["ours", "ours"]
    text = markdown(summaries)
    assert "paper |" not in text
    assert CORRECTION not in notes(summaries)
    assert all(one.falls for one in findings(summaries))


def test_failed_samples_are_shown() -> None:
    """In the row of their case, in the notes with the numbers of the converged, and in the files."""
    summaries = paper_summaries()
    assert "1000 (3 degenerate, 2 failed)" in rows_of(summaries)[1].samples
    (line,) = [line for line in notes(summaries) if line.startswith("board, N = 20, binary, all")]
    assert "995 converged, 3 degenerate, 2 failed" in line
    assert "degenerate" in shown(summaries)
    assert "1000 (3 degenerate, 2 failed)" in markdown(summaries)
    first = csv_lines(table_files(summaries, Path())[Path(CSV_FILE)])[0]
    assert (first["converged"], first["degenerate"], first["failed"], first["count"]) == ("995", "3", "2", "998")


def test_a_case_where_everything_failed() -> None:
    """It has a row, and no numbers."""
    samples = with_failures(made(np.ones((30, 4))), np.random.default_rng(1), degenerate=0, failed=30)
    summaries = [summarise(Case(BOARD, 20, 200), samples)]
    row = rows_of(summaries)[1]
    assert row.cells[0][0] == CaseMetric("-", "-", "-")
    assert row.samples == ("30 (30 failed)",)
    assert "30 failed" in shown(summaries)
    json.loads(table_files(summaries, Path())[Path(JSON_FILE)])


def test_wild_numbers_keep_the_table_readable() -> None:
    """The error of a lost sample has an exponent, not two hundred digits."""
    values = np.ones((50, 4))
    values[0] = 1e200
    cells = rows_of([summarise(Case("cube", 20, 50), made(values))])[0].cells[0]
    assert max(len(cell.mu) for cell in cells) < 12


def test_a_small_sigma_has_its_digits() -> None:
    """As many digits after the point as the column's smallest sigma needs, the same in all rows of ours."""
    generator = np.random.default_rng(1)
    summaries = [
        summarise(Case("cube", size, 50), made(generator.normal(0.03, sigma, (500, 4))))
        for size, sigma in ((20, 1e-3), (50, 2e-5))
    ]
    digits = {len(row.cells[0][0].sigma.split(".")[1]) for row in rows_of(summaries)}
    assert digits == {4}


def test_the_screen_holds_a_table_a_target_in_120_columns() -> None:
    """No cell is broken: the paper's and our numbers are there in full."""
    text = shown(paper_summaries())
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 120
    assert text.count("[3.40, 5.20]c") == 1
    assert len(re.findall(r"\[\d+\.\d+, \d+\.\d+\]", text)) == 15 * 8


def test_markdown_is_a_table_whatever_the_names() -> None:
    """All lines of a table have the same number of cells; a name neither ends a cell nor makes a link or a tag."""
    samples = made(np.random.default_rng(1).normal(1, 0.1, (100, 4)))
    name = "a|b\n[x](http://y) <img> `c` \x1b[31m"
    text = markdown([summarise(Case(name, size, 50, "", "*all*"), samples) for size in (20, 50)])
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
    text = markdown(paper_summaries())
    assert re.search(
        r"\| intersection error is lower for the icosahedron \| holds: 0.(59|60), 0.60, 0.(59|60) \|", text
    )
    assert "| board | 20 | intersection | mu | 4.27 | " in text
    assert f"- {CORRECTION}" in text
    assert "binary, all: reprojection error is lower for the board" in text  # the lost samples leave it open


def test_csv_is_in_mm_and_px() -> None:
    """A line for each case, metric and set of samples; the paper's numbers in the same units; no cell says nan."""
    summaries = paper_summaries()
    content = table_files(summaries, Path())[Path(CSV_FILE)]
    lines = csv_lines(content)
    assert len(lines) == 24 * 4 * 2
    assert b"nan" not in content
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
    summaries = paper_summaries((("binary", "all"),))
    files = table_files(summaries, Path("folder"))
    assert set(files) == {Path("folder") / name for name in (MARKDOWN_FILE, CSV_FILE, JSON_FILE)}
    document = json.loads(files[Path("folder") / JSON_FILE], parse_constant=pytest.fail)
    flat = [(case["target"], case["size"], one) for case in document["cases"] for one in case["metrics"]]
    for (target, size, one), line in zip(flat, csv_lines(files[Path("folder") / CSV_FILE]), strict=True):
        assert (target, str(size), one["metric"], one["over"]) == (
            line["target"], line["size"], line["metric"], line["over"]
        )  # fmt: skip
        assert one["sigma"] == float(line["sigma"])
    assert [one["claim"] for one in document["findings"]] == [one.claim for one in findings(summaries)]
    assert document["findings"][0]["ratios"][0]["paper"] == pytest.approx(2.56 / 4.27)


def test_findings_on_the_screen() -> None:
    """A line a claim, a column a way of sampling."""
    found = findings(paper_summaries())
    table = findings_table(found)
    assert table.row_count == 12
    assert len(table.columns) == 5
