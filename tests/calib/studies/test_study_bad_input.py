"""What `calib study` refuses, and what it leaves alone."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.core.types import Observations, keep_sightings
from calib.observe.dataset import write_detections
from calib.studies import bootstrap as pool
from tests.support.calibrations import board
from tests.support.command_line import detections_of, files_in, refused, write_correspondences, write_inputs
from tests.support.study_commands import (
    BOARD,
    SEEN,
    TAKEN,
    bootstrap,
    contents,
    edit,
    rows_of,
    seconds_at_most,
    without_pictures,
    work_in,
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target, detections and their truth."""
    return work_in(tmp_path, monkeypatch)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without pictures."""
    without_pictures(monkeypatch)


BAD = {
    "sizes 0": (("--sizes", "0"), "0"),
    "negative": (("--sizes=-1",), "-1"),
    "a word": (("--sizes", "many"), "many"),
    "none": (("--sizes", ""), "''"),
    "a gap": (("--sizes", "20,,50"), "'20,,50'"),
    "twice": (("--sizes", "20,50,020"), "twice"),
    "no digits": (("--sizes", "1e3"), "1e3"),
    "other digits": (("--sizes", "２０"), "２０"),
    "huge": (("--sizes", "9" * 5000), "100000"),
    "samples": (("--samples", "0"), "samples"),
    "fewer": (("--samples", "-1"), "samples"),
    "jobs": (("--jobs", "0"), "jobs"),
    "seed": (("--seed", "-1"), "seed"),
    "all models": (("--model", "all"), "'all' is unknown"),
    "no model": (("--model", "periscope"), "periscope"),
    "no parameter": (("--fix", "k9=0"), "k9"),
    "no target": (("--target", "nowhere.json"), "nowhere.json"),
    "no detections": (("--detections", "nowhere.csv"), "nowhere.csv"),
    "a folder": (("--detections", "."), "folder"),
    "no truth": (("--truth", "nowhere.json"), "nowhere.json"),
    "no such truth": (("--truth", "board.target.json"), "ringsolid.truth"),
    "a file": (("-o", "truth.json"), "truth.json"),
    "no folder": (("-o", "truth.json/x"), "truth.json: is a file"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_options_are_refused(folder: Path, case: str) -> None:
    """One line that names what is wrong, and nothing is written."""
    before = contents(folder)
    options, says = BAD[case]
    assert says in refused(*TAKEN, "-o", "out", *options)
    assert contents(folder) == before
    assert not Path("out").exists()


def some(views: int) -> Observations:
    """What the first few views see."""
    return keep_sightings(SEEN, SEEN.view < views)


def other_target() -> None:
    Path("board.target.json").unlink()
    write_inputs(SEEN, board(11, 9))
    write_detections(Path("detections.csv"), detections_of(SEEN, BOARD), BOARD)


def other_photos() -> None:
    text = Path("truth.json").read_text()
    Path("truth.json").write_text(text.replace('"view_', '"photo_'))


def one_view() -> None:
    write_inputs(some(1), BOARD)


def few_points() -> None:
    """Seven rings a view: eight equations beside those for its pose, and the camera has nine parameters."""
    rng = np.random.default_rng(0)
    rows = np.concatenate([rng.choice(np.flatnonzero(SEEN.view == view), 7, replace=False) for view in range(14)])
    write_inputs(keep_sightings(SEEN, np.isin(np.arange(len(SEEN.view)), rows)), BOARD)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [(other_target, "layout"), (other_photos, "photo_0000.png"), (one_view, "more photos"), (few_points,
     "size 1: so few views give at most 8 equations for 9 parameters of the camera; draw 2 or more")],
)  # fmt: skip
def test_inputs_that_do_not_fit_are_refused(spoil: Callable[[], None], says: str) -> None:
    """Detections of another target, the truth of other photos, too few views or points: one line, no study."""
    spoil()
    assert says in refused(*TAKEN, "--truth", "truth.json", "--sizes", "1", "-o", "out")
    assert not Path("out").exists()


def test_points_without_an_image_size_need_one() -> None:
    """A CSV of points says no image size; the one line says how to give it."""
    write_correspondences(Path("points.csv"), SEEN, has_size=False)
    assert "--image-size" in refused("study", "bootstrap", "--detections", "points.csv", "-o", "out")
    assert not Path("out").exists()


def test_a_truth_without_end_is_refused() -> None:
    """A pipe that nobody writes to is no truth; it is not waited for."""
    os.mkfifo("pipe")
    with seconds_at_most(60):
        assert "pipe" in refused(*TAKEN, "--truth", "pipe", "-o", "out")


def test_a_scheduler_that_is_not_there_is_refused() -> None:
    """An address that is none ends in one line before anything is computed."""
    pytest.importorskip("distributed")
    assert "nonsense" in refused(*TAKEN, "--sizes", "6", "--dask", "nonsense", "-o", "out")
    assert not Path("out").exists()


def test_a_study_is_not_changed_by_another(quick: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without --resume, or with another seed, option or input, a study stays as it is; a line says why, at once."""
    bootstrap("--truth", "truth.json", samples=3)
    before = contents("out")
    truth = ("--truth", "truth.json")
    solve = pool.make_pool
    monkeypatch.setattr(pool, "make_pool", lambda *_: pytest.fail("nothing is to be solved"))
    for options, says in (
        (truth, "--resume"),
        ((*truth, "--resume", "--seed", "2"), "seed 1, not 2"),
        ((*truth, "--resume", "--model", "opencv"), "'opencv'"),
        ((*truth, "--resume", "--unweighted"), "weighted"),
        ((*truth, "--resume", "--fix", "k3=0"), "k3=0"),
    ):
        assert says in refused(*TAKEN, *options, "--sizes", "6", "-o", "out")
    monkeypatch.setattr(pool, "make_pool", solve)
    assert "truth" in refused(*TAKEN, "--resume", "--sizes", "6", "-o", "out")
    for name in ("detections.csv", "board.target.json", "truth.json"):
        Path(name).write_text(Path(name).read_text() + "\n")
        assert "has changed" in refused(*TAKEN, *truth, "--resume", "--sizes", "6", "-o", "out")
        Path(name).write_text(Path(name).read_text()[:-1])
    refused("study", "paper", "-o", "out")
    refused("study", "paper", "--resume", "-o", "out")
    assert contents("out") == before
    bootstrap(*truth, "--resume", samples=3)


def test_a_target_of_another_name_is_another_study(quick: None) -> None:
    """The name decides what is drawn, so a study that is gone on with keeps it: no second set of samples beside."""
    bootstrap(samples=3)
    Path("board.target.json").rename("plate.target.json")
    options = ("--target", "plate.target.json", "--sizes", "6", "--samples", "3", "--resume", "-o", "out")
    assert "plate" in refused(*TAKEN, *options)
    assert len(rows_of()) == 3


def text(path: Path) -> None:
    path.write_text("no database\n" * 100)


def half(path: Path) -> None:
    path.write_bytes(Path("out/study.sqlite").read_bytes()[:5000])


def other_database(path: Path) -> None:
    edit("CREATE TABLE t (a)", path=str(path))


def with_trigger(path: Path) -> None:
    path.write_bytes(Path("out/study.sqlite").read_bytes())
    edit("CREATE TRIGGER t AFTER INSERT ON sample BEGIN DELETE FROM sample; END", path=str(path))


def a_folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [text, half, other_database, with_trigger, a_folder])
def test_what_is_no_study_is_left_alone(quick: None, make: Callable[[Path], None]) -> None:
    """Anything else by the name of a study is neither gone on with, nor drawn, nor written over."""
    bootstrap(samples=2)
    Path("bad").mkdir()
    make(Path("bad/study.sqlite"))
    before = contents("bad")
    for command in ((*TAKEN, "--resume", "-o", "bad"), (*TAKEN, "-o", "bad"), ("study", "plot", "bad")):
        assert "study.sqlite" in refused(*command)
    assert contents("bad") == before


@pytest.mark.parametrize(
    ("statement", "says"),
    [
        ("DELETE FROM sample", "no samples"),
        ("UPDATE sample SET intersection_mm = 'x' WHERE number = 1", "damaged"),
        ("UPDATE sample SET status = '[bold]' WHERE number = 1", "damaged"),
        ("UPDATE sample SET params = x'00' WHERE number = 1", "damaged"),
        ("UPDATE cases SET model = 'periscope'", "periscope"),
        ("UPDATE cases SET size = -6", "damaged"),
        ("DELETE FROM identity", "does not say"),
    ],
)
def test_rows_that_no_study_has_written_are_refused(quick: None, statement: str, says: str) -> None:
    """A study that was changed by hand is refused in one line, and its tables stay as they were."""
    bootstrap(samples=3)
    edit(statement)
    before = contents("out")
    assert says in refused("study", "plot", "out")
    assert contents("out") == before


def test_plot_needs_a_study_and_a_place(quick: None) -> None:
    """A folder without a study, another file, and a place that takes no files are refused."""
    bootstrap(samples=2)
    Path("empty").mkdir()
    for arguments in (("empty",), ("nowhere",), ("truth.json",), ("out", "-o", "truth.json")):
        refused("study", "plot", *arguments)
    assert files_in(Path("empty")) == {"."} or not list(Path("empty").iterdir())
