"""Input that makes no sense, and disks that take nothing: one line, no traceback, nothing half-written."""

import errno
import json
import os
import signal
import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from calib.cameras.formats import FORMATS
from calib.core.parallel import interrupts_held
from calib.studies.store import LONGEST_VALUE_BYTES, read_study
from designer.base.errors import InputError
from designer.base.files import parse_json
from tests.calib.studies.test_study_store import path as study_path
from tests.laws.test_exit_codes import CASES, SOLVE, Case, folder
from tests.support import programs
from tests.support.command_line import Answer, calib, refused
from tests.support.foreign_cameras import written
from tests.support.programs import PYTHON
from tests.support.waiting import WITHIN_S

__all__ = ["folder", "study_path"]  # the scene that commands work in, and a study


@pytest.mark.parametrize(("program", "case"), [one for one in CASES if one.values[1].code != 2])
def test_a_link_to_itself_is_refused(program: Callable[..., Answer], case: Case) -> None:
    """Any file or folder on a command line may be a link that leads nowhere; where to is told before any work."""
    for word in case.words:
        if word == "out" and not Path(word).exists():
            Path(word).symlink_to(word)
            answer = program(*("out/x" if one == "out" else one for one in case.words))
            assert (answer.code, answer.err.count("\n"), answer.out) == (2, 1, ""), answer
            Path(word).unlink()
        if not Path(word).exists() or word == "out":
            continue
        kept = Path(word).rename("kept")
        Path(word).symlink_to(word)
        answer = program(*case.words)
        assert (answer.code, answer.err.count("\n")) == (2, 1), answer
        Path(word).unlink()
        kept.rename(word)


@pytest.mark.parametrize(
    "words",
    [
        ("target", "board.target.json"),
        ("diff", "camera.json", "other.json"),
        ("evaluate", "solved/calibration.json"),
        ("evaluate", "solved", "--truth", "truth.json"),
        ("solve", "detections.csv", "--target", "board.target.json", "-o", "out"),
    ],
)
def test_a_key_that_stands_there_twice_is_refused(words: tuple[str, ...]) -> None:
    """In every JSON file: nobody knows which of its values was meant."""
    for word in words:
        if word.endswith(".json") and Path(word).exists():
            text = Path(word).read_text()
            Path(word).write_text(text.replace("{", '{"format": "mine",', 1))
            assert "'format' stands there twice" in refused(*words)
            Path(word).write_text(text)


def test_a_key_within_may_not_stand_there_twice_either() -> None:
    """At any depth; the file is named."""
    with pytest.raises(InputError, match=r"^a\.json: key 'k' stands there twice"):
        parse_json('{"a": [{"k": 1, "k": 1}]}', Path("a.json"), "a file")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("colmap", ("0.01", "1e308")),
        ("colmap", ("1 OPENCV 640 480 500 500 320 240", "1 FULL_OPENCV 640 480 500 500 320 240 0 0 0 0 0 0 1e308")),
        ("metashape", ("<cx>", "<cx></cx><x>")),
        ("metashape", ("<f>", "<f>1e-2</f><x>")),
        ("json", ('"k1": ', '"other": ')),
        ("json", ('"cx_px": ', '"cx_px": -1e8, "k9": ')),
    ],
)
def test_numbers_that_no_camera_has_are_refused(name: str, change: tuple[str, str]) -> None:
    """Whatever the format: beyond all bounds, empty, missing, or of a camera that sees none of its image."""
    text = written(name, "barrel")[1]
    number = next((one for one in text.split() if one.startswith(("-0.", "0."))), "")
    changed = text.replace(change[0] if change[0] in text else number, change[1], 1)
    assert changed != text
    with pytest.raises(InputError) as error:
        FORMATS[name].read(changed, "f.x", None)
    assert str(error.value).startswith("f.x: ")


@pytest.mark.parametrize("cx", [-1e6, 1e8])
def test_a_camera_that_sees_nothing_of_its_image_is_refused(cx: float) -> None:
    """Such as one whose centre lies far beyond the fold of its lens."""
    document = json.loads(Path("camera.json").read_text())
    document["parameters"] |= {"cx_px": cx, "k1": -0.3, "k3": -0.1}
    Path("bad.json").write_text(json.dumps(document))
    assert "0.0 % of the image see" in refused("diff", "camera.json", "bad.json")


def test_a_scale_beyond_reason_is_refused() -> None:
    """And residuals that no image holds: of a calibration that is read."""
    path = Path("solved/calibration.json")
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "scale": 1.8e19}))
    assert "scale" in refused("evaluate", "solved")


def test_what_would_not_be_read_again_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solution that makes no sense is refused before a file of it is there."""
    from dataclasses import replace

    from calib.judge import solutions as solving

    original = solving.calibrate

    def absurd(*arguments: object) -> object:
        one = original(*arguments)  # type: ignore[arg-type]
        return replace(one, scale=1.8e19)

    monkeypatch.setattr(solving, "calibrate", absurd)
    assert "makes no sense and is not written" in refused(*SOLVE, "detections.csv")
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("words", "head", "row"),
    [
        (("hand-eye", "board.target.json", "photos", "--robot"), "image,x_mm,y_mm,z_mm,qx,qy,qz,qw", "v,1,2,3,0,0,0,1"),
        (
            ("hand-eye", "board.target.json", "photos", "--robot"),
            "image,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg",
            "v,1,2,3,4,5,6",
        ),
        (("target", "--from", "points.csv", "--planes"), "plane,nx,ny,nz,d", "a,0,0,1,0"),
    ],
)
def test_numbers_at_the_end_of_all_are_refused_in_one_line(words: tuple[str, ...], head: str, row: str) -> None:
    """Of every column, without a word of what computes with them."""
    Path("points.csv").write_text("id,x_mm,y_mm,z_mm,plane\n" + "".join(f"{n},{n},{n * n},0,a\n" for n in range(5)))
    for column in range(1, head.count(",") + 1):
        values = row.split(",")
        values[column] = "1e308"
        Path("table.csv").write_text(f"{head}\n{','.join(values)}\n{row.replace('v', 'w').replace('a,', 'b,')}\n")
        answer = calib(*words, "table.csv", "-o", "out.target.json")
        assert (answer.code, answer.err.count("\n")) == (2, 1), (column, answer)


@pytest.mark.parametrize("value", [-1.0, float("inf")])
def test_a_study_of_impossible_errors_is_refused(study_path: Path, value: float) -> None:
    """No reprojection error is negative or endless."""
    with sqlite3.connect(study_path) as connection:
        connection.execute("UPDATE sample SET reprojection_px = ? WHERE number = 1", (value,))
    with read_study(study_path) as study, pytest.raises(InputError, match="is damaged"):
        study.load(study.cases()[0].case.name)


def test_a_study_of_huge_values_is_refused_unread(study_path: Path) -> None:
    """SQLite itself holds no value in memory that is longer than any of a study."""
    with sqlite3.connect(study_path) as connection:
        connection.execute("UPDATE sample SET params = zeroblob(?) WHERE number = 1", (LONGEST_VALUE_BYTES + 1,))
    with read_study(study_path) as study, pytest.raises(InputError, match=r"too big|damaged"):
        study.load(study.cases()[0].case.name)


def test_reading_a_study_leaves_no_file_beside_it(study_path: Path) -> None:
    """Not even of one that was copied while a run held it open."""
    with sqlite3.connect(study_path) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("UPDATE sample SET iterations = 7")
    connection.close()
    copy = study_path.with_name("copy") / "study.sqlite"
    copy.parent.mkdir()
    copy.write_bytes(study_path.read_bytes())
    with read_study(copy) as study:
        study.load(study.cases()[0].case.name)
        assert [one.name for one in copy.parent.iterdir()] == ["study.sqlite"]
    assert [one.name for one in copy.parent.iterdir()] == ["study.sqlite"]


def test_a_disk_that_is_full_at_the_page_is_no_success(monkeypatch: pytest.MonkeyPatch) -> None:
    """The results are written and stay; one line says what is missing, and the code is not 0."""
    real = os.fsync

    def full(number: int) -> None:
        if b"<!doctype html>" in Path(f"/proc/self/fd/{number}").read_bytes()[:20]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(number)

    monkeypatch.setattr(os, "fsync", full)
    answer = calib(*SOLVE, "detections.csv")
    assert answer.code == 2
    last = answer.err.splitlines()[-1]
    assert last.startswith("error: ")
    assert "No space left on device" in last
    assert not list(Path().rglob("index.html"))
    assert not list(Path().rglob(".unfinished*"))


@pytest.mark.parametrize("option", [[], ["--json"]])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_standard_output_is_one_line(option: list[str]) -> None:
    """Words that cannot be written anywhere: one line on standard error says so, and the code is 2."""
    with Path("/dev/full").open("w") as full:
        program = programs.start(PYTHON, "-m", "designer.cli", "templates", *option, stdout=full)
        _, said = program.communicate(timeout=WITHIN_S)
    lines = [line for line in said.splitlines() if line.startswith("error: ")]
    assert program.returncode == 2
    assert lines == [
        "error: standard output cannot be written: No space left on device; make room, or send it elsewhere"
    ]
    assert "Traceback" not in said
    assert "Exception" not in said


@pytest.mark.skipif(sys.platform == "win32", reason="no signal masks")
def test_processes_started_while_ctrl_c_is_held_never_see_it() -> None:
    """Not even the first, with which Python starts a tracker that would let it through again."""
    script = (
        "import multiprocessing as m, signal\n"
        "from calib.core.parallel import interrupts_held\n"
        "with interrupts_held():\n"
        "    for _ in range(2):\n"
        "        p = m.get_context('spawn').Process(target=print); p.start(); p.join()\n"
        "        print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"
        "print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"
    )
    assert programs.run(PYTHON, "-c", script).stdout.split() == ["True", "True", "False"]
    with interrupts_held():
        assert signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])
