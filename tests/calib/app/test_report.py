"""`calib report DIR`: the page again from what is stored, and one line where there is nothing to build it from."""

import json
import shutil
from pathlib import Path

import pytest

from calib.app.calibration import Run
from calib.judge.folders import read_run
from calib.judge.judge import VERDICT, VERDICT_FILE
from designer.page.page_file import BLOCKS_FILE, PAGE, StoredPage
from designer.target import target_to_json
from tests.support.calibrations import board
from tests.support.command_line import calib, refused
from tests.support.pages import whole_page
from tests.support.run_folders import BLANK, PANEL, solved, write_overlays, write_run


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its page; not to be changed."""
    folder = tmp_path_factory.mktemp("kept") / "run"
    every = solved()
    write_run(folder, every)
    write_overlays(folder, every[0].observations.view_names)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PANEL, lambda *_, **__: BLANK)
        Run(read_run(folder), place=folder).draw_page(folder, "calib run board.target.json 'my photos'")
    return folder


@pytest.fixture(autouse=True)
def _blank_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time."""
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)


@pytest.fixture
def run(kept: Path, tmp_path: Path) -> Path:
    """A copy to change, in a folder of the same name."""
    return Path(shutil.copytree(kept, tmp_path / "run"))


def test_a_calibration_without_a_page_gets_one(run: Path) -> None:
    """It is told by its files; the command that made it is not known."""
    (run / BLOCKS_FILE).unlink()
    assert "stays as it is" in refused("report", run)  # a page without its blocks may be anybody's
    (run / "index.html").unlink()
    assert calib("report", run).code == 0
    assert PAGE.read(run / BLOCKS_FILE).page.made_by == ""


def test_criteria_judge_it(run: Path) -> None:
    """The verdict is stored by the limits asked for, and headline, screen and JSON say it."""
    answer = calib("report", run, "--criteria", "robotics")
    judged = VERDICT.read(run / VERDICT_FILE)
    assert judged.criteria.name == "robotics"
    word = {"good": "good", "usable": "usable", "bad": "do not use"}[judged.verdict.grade]
    assert answer.out.startswith(f"{word}: ")
    again = calib("report", run, "--json")
    document = json.loads(again.out)
    assert document["answer"]["word"] == word
    assert document["answer"]["kind"] == "calibration"
    assert VERDICT.read(run / VERDICT_FILE).criteria.name == "robotics"


def test_halves_are_not_solved_again_for_other_limits(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict stores them; those of another camera are not believed."""
    calls: list[int] = []
    from calib.judge import folders
    from calib.judge.halves import NoHalves

    calib("report", run, "--criteria", "standard")
    monkeypatch.setattr(folders, "half_split", lambda *_: calls.append(1) or NoHalves("asked for"))
    calib("report", run, "--criteria", "metrology")
    assert not calls
    document = json.loads((run / "verdict.json").read_text())
    document["observations_sha256"] = 64 * "0"
    (run / "verdict.json").write_text(json.dumps(document))
    calib("report", run, "--criteria", "metrology")
    assert calls


def test_damaged_results_are_refused_in_one_line(run: Path) -> None:
    """Nothing is written; the page that was there stays."""
    before = (run / "index.html").read_bytes()
    for path in run.glob("*/observations.csv"):
        path.write_text(path.read_text().replace("0", "1", 1))
    assert "observations.csv" in refused("report", run)
    assert (run / "index.html").read_bytes() == before


def test_where_there_is_nothing_to_report(tmp_path: Path) -> None:
    """An empty folder, a file, no folder, a design's folder: each with its remedy."""
    assert "holds nothing to report" in refused("report", tmp_path)
    assert "no such folder" in refused("report", tmp_path / "none")
    design = tmp_path / "design"
    design.mkdir()
    (design / "b.target.json").write_text(target_to_json(board()))
    (design / "b.toml").write_text("")
    assert f"design make b.toml -o {design}" in refused("report", design)
    assert "not a folder" in refused("report", design / "b.toml")


def test_limits_are_for_calibrations(tmp_path: Path) -> None:
    """Of a study nothing is judged."""
    (tmp_path / BLOCKS_FILE).write_bytes(PAGE.text(StoredPage("paper", whole_page())))
    assert "--criteria" in refused("report", tmp_path, "--criteria", "standard")


def test_the_page_works_in_a_browser(
    run: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing on the console; links and pictures resolve; it fits a phone."""
    pytest.importorskip("playwright")
    from tests.support.browser import open_page, overflow_px, unresolved

    monkeypatch.undo()  # with figures
    calib("report", run, "--criteria", "standard")
    browser = request.getfixturevalue("browser")
    with open_page(browser, run / "index.html", width=390, scheme="dark") as page:
        assert unresolved(page, run / "index.html") == []
        assert overflow_px(page) == 0
