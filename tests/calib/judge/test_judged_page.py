"""How `calib run` and `solve` end: with a verdict, an exit code that follows it, and the folder's page.

And the pages that other commands leave: what refreshes them, and that nobody's own page is lost.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.judge.checks import read_criteria
from calib.judge.judge import VERDICT, VERDICT_FILE
from designer.kinds.spec_file import read_spec_file
from designer.page.page_file import PAGE
from designer.target import load_target, target_to_json
from tests.support.calibrations import board
from tests.support.command_line import BLOCKS, JUDGED, LENIENT, calib, files_in, summary_of, write_inputs
from tests.support.command_scene import BOARD, SEEN

RUN = ("run", "board.target.json", "photos", "--model", "opencv", "-o", "out")
SOLVE = ("solve", "detections.csv", "--target", "board.target.json", "--model", "opencv", "-o", "out")
MODEL_FILES = {"calibration.json", "camera.json", "observations.csv"}
WORDS = {"good": "good", "usable": "usable", "bad": "do not use"}
STRICTER = {"good": {}, "usable": {"good": "0px"}, "bad": {"good": "0px", "usable": "0px"}}
"""Limits of the residuals, all others being lenient, and the grade of a camera that leaves anything over."""


@pytest.fixture(autouse=True)
def folder(scene_copy: Path) -> Path:
    """Where the commands work."""
    return scene_copy


def criteria(grade: str) -> tuple[str, str]:
    """The option with limits by which the scene's camera has this grade."""
    limits = dict(read_spec_file(Path(LENIENT[1])))
    residuals = limits["residuals"]
    assert isinstance(residuals, dict)
    limits["residuals"] = residuals | STRICTER[grade]
    lines = [f'title = "{limits.pop("title")}"']
    for name, values in limits.items():
        assert isinstance(values, dict)
        lines += [f"[{name}]", *(f'{key} = "{value}"' for key, value in values.items())]
    Path(f"{grade}.toml").write_text("\n".join(lines))
    return ("--criteria", f"{grade}.toml")


def page_text(place: str = "out") -> str:
    """The page's source."""
    return Path(place, "index.html").read_text()


def calib_report(place: str = "out") -> tuple[int, str]:
    """How `calib report` ends on a folder, and its headline's word."""
    answer = calib("report", place, "--json")
    return answer.code, summary_of(answer)["answer"]["word"]


@pytest.mark.parametrize("words", [RUN, SOLVE])
def test_a_run_ends_with_its_verdict(words: tuple[str, ...], folder: Path) -> None:
    """In the folder, in the answer, and in the list of files; without a page it is `calib report` that draws it."""
    answer = calib(*words, *LENIENT, "--json")
    assert answer.code == 0, answer
    summary, written = summary_of(answer), files_in(folder / "out")
    assert written >= JUDGED | MODEL_FILES | {"target.json"}
    assert not written & BLOCKS
    assert {Path(path).relative_to("out").as_posix() for path in summary["wrote"]} == written
    stored, said = VERDICT.read(Path("out") / VERDICT_FILE).verdict, summary["answer"]["verdict"]
    assert (said["grade"], said["model"], said["sentence"]) == (stored.grade, "opencv", stored.sentence)
    told = [(one["name"], one["grade"], one["value"]) for one in said["checks"]]
    assert told == [(one.name, one.grade, one.value) for one in stored.checks]
    assert load_target(Path("out/target.json")).geometry_id == BOARD.geometry_id
    assert "calib report out" in answer.err
    assert calib_report() == (0, "good")
    assert files_in(folder / "out") == written | BLOCKS
    assert PAGE.read(Path("out/page.json")).kind == "calibration"
    assert stored.sentence[1:40] in page_text()


@pytest.mark.parametrize(("grade", "code"), [("good", 0), ("usable", 0), ("bad", 1)])
def test_the_exit_code_follows_the_verdict(grade: str, code: int) -> None:
    """1 on "do not use", else 0; the screen says it, the page says it, and `calib report` ends alike."""
    answer = calib(*SOLVE, *criteria(grade))
    assert (answer.code, answer.err) == (code, "")
    assert answer.out.startswith(f"{WORDS[grade]}: ")
    assert f"limits: {grade} (" in answer.out
    assert "next     open out/index.html" in answer.out
    assert ("calib convert" in answer.out) == (code == 0)  # a camera that is not to be used is not handed on
    assert VERDICT.read(Path("out") / VERDICT_FILE).verdict.grade == grade
    assert calib_report() == (code, WORDS[grade])


def test_the_limits_are_the_standard_ones_if_nobody_asks(folder: Path) -> None:
    """Without --criteria the verdict is that of the template standard; another template has other limits."""
    for name, asked in (("out", ()), ("named", ("standard",)), ("other", ("metrology",))):
        calib(*SOLVE[:-1], name, "--no-page", *(word for one in asked for word in ("--criteria", one)))
    stored = {name: Path(name, "verdict.json").read_bytes() for name in ("out", "named", "other")}
    kept = VERDICT.read(Path("out") / VERDICT_FILE).criteria
    assert kept.name == "standard"
    assert all(read_criteria("standard")[name] == limits for name, limits in kept.limits.items())
    assert stored["out"] == stored["named"] != stored["other"]


def test_a_verdict_is_on_what_was_solved_last() -> None:
    """Solved again into the same folder, from better detections: all of the verdict is that of a fresh folder."""
    noise = np.random.default_rng(8).standard_normal(SEEN.center_px.shape)
    write_inputs(replace(SEEN, center_px=SEEN.center_px + noise), BOARD)
    calib(*SOLVE, "--no-page")
    rough = Path("out/verdict.json").read_bytes()
    write_inputs(SEEN, BOARD)
    calib(*SOLVE, "--no-page")
    calib(*SOLVE[:-1], "fresh", "--no-page")
    assert Path("out/verdict.json").read_bytes() == Path("fresh/verdict.json").read_bytes() != rough


@pytest.mark.parametrize(("place", "page"), [("out", "out"), ("all/opencv", "all")])
def test_evaluate_draws_the_page_of_a_run_again(place: str, page: str) -> None:
    """With the errors that it measured, in a model's folder of a run too; what it says of its origin stays."""
    models = SOLVE[:-1] if page == "out" else SOLVE[:4]
    calib(*models, *(() if page == "out" else ("-o",)), page, *LENIENT[:2])
    before, origin = page_text(page), PAGE.read(Path(page, "page.json")).page.made_by
    assert "pose error" not in before.lower()
    answer = calib("evaluate", place, "--truth", "truth.json", "--no-figures", "--json")
    assert answer.code == 0
    assert f"{page}/index.html" in summary_of(answer)["wrote"]
    after = page_text(page)
    assert after != before
    assert PAGE.read(Path(page, "page.json")).page.made_by == origin
    assert origin.startswith("calib solve ")
    calib("report", page)
    assert page_text(page) == after


def test_evaluate_elsewhere_leaves_pages_alone(folder: Path) -> None:
    """Tables for another folder do not touch the run's page, and a folder without a page gets none."""
    calib(*SOLVE, *LENIENT[:2])
    before = page_text()
    answer = calib("evaluate", "out", "--truth", "truth.json", "--no-figures", "-o", "tables")
    assert answer.code == 0
    assert page_text() == before
    assert calib("evaluate", "solved", "--no-figures").code == 0
    assert not (files_in(folder / "tables") | files_in(folder / "solved")) & BLOCKS


MINE = "<p>mine"
"""A page that somebody wrote."""


@pytest.mark.parametrize(
    "words",
    [
        (*SOLVE, *LENIENT[:2]),
        ("detect", "board.target.json", "photos", "-o", "d.csv", "--overlay", "out"),
        ("undistort", "camera.json", "photos", "-o", "out"),
        ("measure", "board.target.json", "detections.csv", "--held-out", "0", "-o", "out/m.target.json"),
    ],
    ids=lambda words: words[0],
)
def test_nobodys_own_page_is_replaced(words: tuple[str, ...]) -> None:
    """An index.html without page.json stays; the command does its work, and a remark says why there is no page."""
    Path("out").mkdir()
    Path("out/index.html").write_text(MINE)
    answer = calib(*words, "--json")
    assert answer.code == 0, answer
    assert page_text() == MINE
    assert not Path("out/page.json").exists()
    assert "index.html: is there already and stays as it is" in answer.err
    summary = summary_of(answer)
    assert any("stays as it is" in one for one in summary["remarks"])
    assert not [path for path in summary["wrote"] if path.endswith("index.html")]
    assert summary["answer"]


def test_a_plot_draws_the_studys_page_again_and_no_other() -> None:
    """`calib study plot` keeps a study's own page fresh; one of somebody's own, or of another kind, stays."""
    taken = ("--target", "board.target.json", "--detections", "detections.csv", "--sizes", "6", "--samples", "4")
    assert calib("study", "bootstrap", *taken, "--jobs", "1", "-o", "study").code == 0
    first = page_text("study")
    Path("study/index.html").write_text('<!doctype html><meta name="generator" content="ringsolid 0">an older page')
    assert "study/index.html" in summary_of(calib("study", "plot", "study", "--json"))["wrote"]
    body, drawn_again = (text.split("<footer")[0] for text in (first, page_text("study")))
    assert drawn_again == re.sub(r"<div><dt>computed</dt>.*?</div>\s*", "", body)
    calib(*SOLVE, *LENIENT[:2])
    run = page_text()
    Path("mine").mkdir()
    Path("mine/index.html").write_text(MINE)
    for place in ("mine", "out"):
        answer = calib("study", "plot", "study", "-o", place, "--json")
        assert answer.code == 0
        assert (page_text("mine"), page_text()) == (MINE, run), place
        assert any("stays as it is" in one for one in summary_of(answer)["remarks"]), place


@pytest.mark.parametrize("words", [RUN, SOLVE])
def test_another_target_of_ours_in_the_folder_stays(words: tuple[str, ...]) -> None:
    """It is not replaced by the one that was solved with, though both are of this program's making."""
    Path("out").mkdir()
    other = target_to_json(board(8, 6))
    Path("out/target.json").write_text(other)
    calib(*words, *LENIENT, "--model", "pinhole")
    assert Path("out/target.json").read_text() == other


def test_photos_that_show_nothing_have_a_page_to_look_at(folder: Path) -> None:
    """A run that found nothing judges nothing, and leaves a page with the photos."""
    answer = calib("run", "board.target.json", "blank", "-o", "out", "--json")
    assert answer.code == 1
    summary = summary_of(answer)
    assert summary["answer"]["verdict"] is None
    assert not files_in(folder / "out") & JUDGED
    (page,) = (Path(path) for path in summary["wrote"] if path.endswith("index.html"))
    assert PAGE.read(page.parent / "page.json").kind == "detections"
    assert "none.png" in page.read_text()
