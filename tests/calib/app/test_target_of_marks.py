"""Targets of boards that others made: `calib target --marks`, `--join`, and `--from` Kalibr's files."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.app.target_of_marks import EXAMPLES
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import load_target
from tests.support.command_line import Answer, calib

LINES = {
    "chessboard": "--squares 9x6 --square 25mm",
    "charuco": "--squares 11x8 --square 20 --marker 1.5cm --dictionary 5x5_100",
    "aprilgrid": "--tags 6x5 --tag 88mm --gap 26.4mm",
    "circles": "--circles 4x11 --pitch 40mm --diameter 20mm --asymmetric",
}
MADE: dict[str, FaceMarks] = {
    "chessboard": Chessboard((9, 6), 25.0),
    "charuco": Charuco((11, 8), 20.0, 15.0, "DICT_5X5_100"),
    "aprilgrid": AprilGrid((6, 5), 88.0, 26.4 / 88),
    "circles": Circles((4, 11), 40.0, 20.0, asymmetric=True),
}


def make(marks: str, *more: str, name: str = "b.target.json") -> Answer:
    """A target file of a board as above."""
    return calib("target", "--marks", marks, *LINES[marks].split(), *more, "-o", name)


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("marks", LINES)
def test_a_board_is_as_it_is_told(marks: str) -> None:
    """Of each kind: its counts, and lengths in any unit; its words and how it is numbered are said."""
    answer = make(marks)
    assert answer.code == 0, answer.err
    made = load_target("b.target.json")
    assert made.marks == (MADE[marks],)
    assert f"marks    {MADE[marks].words}\n" in answer.out
    assert "row by row from the" in answer.out
    assert np.abs(made.center_mm.min(axis=0) + made.center_mm.max(axis=0)).max() < 1e-9


def test_corners_are_another_word_for_squares() -> None:
    """Inner corners are one less each way, and are told beside the squares."""
    answer = calib("target", "--marks", "chessboard", "--corners", "8x5", "--square", "25", "-o", "b.target.json")
    assert load_target("b.target.json").marks == (MADE["chessboard"],)
    assert "9 x 6 squares of 25 mm (8 x 5 inner corners)" in answer.out


@pytest.mark.parametrize(("marks", "origin"), [(one, "opencv") for one in LINES] + [("aprilgrid", "kalibr")])
def test_coordinates_are_the_object_points_of_others(marks: str, origin: str) -> None:
    """With --origin they are those that a person has in scripts: grids from 0, ChArUco's of OpenCV, tags of Kalibr."""
    assert make(marks, "--origin", origin).code == 0
    made, face = load_target("b.target.json"), MADE[marks]
    if isinstance(face, Charuco):
        known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
        wanted = np.asarray(cv2.aruco.CharucoBoard((11, 8), 20.0, 15.0, known).getChessboardCorners())
    elif isinstance(face, Chessboard):
        wanted = np.array([[25.0 * i, 25.0 * j, 0] for j in range(5) for i in range(8)])
    elif isinstance(face, Circles):
        wanted = np.array([[(2 * i + j % 2) * 20.0, j * 20.0, 0] for j in range(11) for i in range(4)])
    else:  # as `createGridPoints` of GridCalibrationTargetAprilgrid.cpp, or from its upper left corner down
        corner = [(0, 0), (1, 0), (1, 1), (0, 1)]
        at = [(114.4 * i + 88.0 * x, 114.4 * j + 88.0 * y) for j in range(5) for i in range(6) for x, y in corner]
        wanted = np.array([[x, y if origin == "kalibr" else 4 * 114.4 + 88.0 - y, 0] for x, y in at])
    assert np.allclose(made.center_mm, wanted, atol=1e-6)


def test_a_back_has_the_ids_that_follow() -> None:
    """A two-sided plate shows the same marks from behind, a thickness away."""
    assert make("charuco", "--two-sided", "--thickness", "5mm", "--first-id", "2").code == 0
    made = load_target("b.target.json")
    assert made.marks is not None
    assert [one.marker_ids for one in made.marks] == [range(2, 46), range(46, 90)]
    assert made.has_back
    front, back = np.split(made.center_mm, 2)
    assert np.allclose(back, front * [-1, 1, 1] - [0, 0, 5])


@pytest.mark.parametrize(
    ("marks", "more", "said"),
    [
        ("chessboard", "--tag 3mm", "--tag: belongs to --marks aprilgrid"),
        ("charuco", "--light-first", "--light-first: belongs to --marks chessboard"),
        ("chessboard", "--corners 8x5", "--corners: says the same as --squares"),
        ("aprilgrid", "--spacing .3", "--gap: says the same as --spacing"),
        ("charuco", "--dictionary 5x5_10", "did you mean 'DICT_5X5_100'?"),
        ("charuco", "--first-id 60", "are more than the 100 of DICT_5X5_100; use DICT_5X5_250"),
        ("charuco", "--marker 20mm", "must be smaller than squares of 20 mm"),
        ("charuco", "--squares 2x8", "2 x 8 squares: must be at least 3 x 3"),
        ("chessboard", "--squares 9by6", "must be columns x rows"),
        ("circles", "--diameter 29mm", "must be smaller than their distance"),
        ("chessboard", "--two-sided --thickness 4", "cannot tell two sides of chessboard apart"),
        ("charuco", "--two-sided", "such as --thickness 5mm"),
        ("charuco", "--thickness 5mm", "belongs to --two-sided"),
        ("charuco", "--two-sided --thickness 5mm --dictionary 5x5_50", "use DICT_5X5_100"),
        ("charuco", "--origin kalibr", "is that of AprilGrids"),
        ("charuco", "--planes p.csv", "does not go with --marks"),
    ],
)  # fmt: skip
def test_what_a_board_cannot_be_is_refused(marks: str, more: str, said: str) -> None:
    """Value, rule and remedy in one line, and no file."""
    words = LINES[marks].split()
    for flag in set(words) & set(more.split()):
        if flag.startswith("--"):
            del words[(at := words.index(flag)) : at + 2]
    answer = calib("target", "--marks", marks, *words, *more.split(), "-o", "b.target.json")
    assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1)
    assert said in answer.err
    assert not Path("b.target.json").exists()


@pytest.mark.parametrize("marks", LINES)
def test_what_is_missing_is_named_with_an_example(marks: str) -> None:
    """A kind without what it needs."""
    answer = calib("target", "--marks", marks, "-o", "b.target.json")
    assert answer.code == 2
    assert f"takes {EXAMPLES[LINES[marks].split()[0][2:]]}" in answer.err


@pytest.mark.parametrize(("line", "turn"), [("--squares 8x6", "half a turn"), ("--squares 7x7", "a quarter of a turn")])
def test_a_board_that_looks_the_same_turned_is_said_to(line: str, turn: str) -> None:
    """With what that costs, and what tells which way up it is; of one that does not, nothing is said."""
    answer = calib("target", "--marks", "chessboard", *line.split(), "--square", "20", "-o", "b.target.json", "--json")
    (said,) = json.loads(answer.out)["remarks"]
    assert f"turned by {turn}" in said
    assert "9 x 6" in said
    assert "turned by" not in make("chessboard").out


def test_boards_are_joined_as_they_stand() -> None:
    """A box of boards, each turned about x, then y, then z; two that photos cannot tell apart are refused."""
    make("charuco", name="front.target.json")
    make("charuco", "--first-id", "50", name="side.target.json")
    rows = (
        '[[board]]\nfile = "front.target.json"\nat_mm = [0, 0, 110]\n[[board]]\nfile = "side.target.json"\n'
        "at_mm = [110, 0, 0]\nturn_deg = [0, 90, 0]\n"
    )
    Path("box.toml").write_text(rows)
    answer = calib("target", "--join", "box.toml", "-o", "box.target.json")
    assert answer.code == 0, answer.err
    made = load_target("box.target.json")
    one = MADE["charuco"].position_mm
    front, side = np.split(made.center_mm, 2)
    assert np.allclose(front, np.column_stack([one, np.full(len(one), 110.0)]))
    assert np.allclose(side, np.column_stack([np.full(len(one), 110.0), one[:, 1], -one[:, 0]]))
    for text, said in (
        (rows.replace("side.t", "front.t"), "two faces that photos cannot tell apart"),
        (rows.replace("turn_deg", "turned"), "unknown key 'board.1.turned'"),
        (rows.replace("side.t", "none.t"), "none.target.json"),
        ("", "board is missing"),
    ):
        Path("box.toml").write_text(text)
        answer = calib("target", "--join", "box.toml", "-o", "other.target.json")
        assert (answer.code, answer.err.count("\n")) == (2, 1)
        assert said in answer.err


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ("target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 5\ntagSize: 0.088\ntagSpacing: 0.3\n", MADE["aprilgrid"]),
        (
            "target_type: checkerboard\ntargetCols: 8\ntargetRows: 5\nrowSpacingMeters: .025\ncolSpacingMeters: .025\n",
            MADE["chessboard"],
        ),
        (
            "target_type: circlegrid\ntargetCols: 4\ntargetRows: 11\nspacingMeters: 0.02\nasymmetricGrid: True\n",
            MADE["circles"],
        ),
    ],
)
def test_kalibr_s_targets_are_read(text: str, made: FaceMarks) -> None:
    """Its own files, in metres, with inner corners, and the distance of rows in asymmetric grids."""
    Path("k.yaml").write_text(text)
    more = ("--diameter", "20mm") if isinstance(made, Circles) else ()
    answer = calib("target", "--from", "k.yaml", *more, "-o", "k.target.json")
    assert answer.code == 0, answer.err
    assert load_target("k.target.json").marks == (made,)
    Path("k.yaml").write_text(text.replace("grid", "gird").replace("checker", "checkers"))
    assert "did you mean" in calib("target", "--from", "k.yaml", *more, "-o", "k.target.json").err
    Path("k.yaml").write_text(text.replace("Cols", "Columns"))
    assert "Cols" in calib("target", "--from", "k.yaml", *more, "-o", "k.target.json").err
