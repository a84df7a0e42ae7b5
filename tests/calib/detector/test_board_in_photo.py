"""Boards that one photo tells: dictionary, ids and layout; lengths are a ruler's."""

import json
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.board_in_photo import boards_in
from calib.detector.marks import FINDERS
from calib.detector.saddles import find_lattices
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import load_target
from tests.support.boards import BOARDS, picture_of
from tests.support.command_line import calib

SIZE = 900, 700
SEEN = {
    **{name: BOARDS[name] for name in ("chessboard", "square", "legacy", "aprilgrid", "circles", "asymmetric")},
    "charuco": Charuco((7, 6), 20.0, 14.4, "DICT_6X6_50"),
    "upright": AprilGrid((4, 3), 16.0, 0.25, border_bits=1, corner_squares=False, from_top=True, upright=True),
    "opencv": AprilGrid((4, 3), 18.0, 0.5, "DICT_4X4_50", border_bits=1, corner_squares=False, from_top=True),
}


def photo_of(marks: FaceMarks, angle_deg: float = 160.0, rows_cut: int = 0) -> NDArray[np.uint8]:
    """A board turned and aslant on grey, with noise; without rows at its top if they are cut."""
    if isinstance(marks, Circles):
        width, height = (round(4 * side) for side in marks.size_mm)
        flat = np.full((height, width), 255, np.uint8)
        for x, y in (marks.position_mm * [1, -1] + np.array(marks.size_mm) / 2).tolist():
            cv2.circle(flat, (round(64 * x), round(64 * y)), round(64 * marks.radius_mm), 0, -1, cv2.LINE_AA, 4)
    else:
        flat = picture_of(marks, 5)[rows_cut:]
    flat = cv2.copyMakeBorder(flat, 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255).astype(np.uint8)
    height, width = flat.shape
    turn = np.radians(angle_deg)
    corner = np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / max(width, height)
    seen = corner @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * [0.7, 1.0]
    seen = seen / (1 + 0.15 * seen[:, :1]) * 300 + np.array(SIZE) / 2
    plane = np.array([[0, 0], [width, 0], [width, height], [0, height]], np.float32)
    matrix = cv2.getPerspectiveTransform(plane, seen.astype(np.float32))
    photo = cv2.warpPerspective(flat, matrix, SIZE, flags=cv2.INTER_AREA, borderValue=110).astype(float)
    noise = np.random.default_rng(0).normal(0, 3, photo.shape)
    return np.clip(30 + 0.8 * cv2.GaussianBlur(photo, (0, 0), 0.8) + noise, 0, 255).astype(np.uint8)


@cache
def proposed_of(name: str) -> tuple[NDArray[np.uint8], FaceMarks]:
    """A photo of a board, and the one board that it tells."""
    photo = photo_of(SEEN[name])
    (found,) = boards_in(photo)
    return photo, found.marks


def layout(marks: FaceMarks) -> dict[str, object]:
    """All but lengths."""
    return {one.name: getattr(marks, one.name) for one in fields(marks) if not one.name.endswith(("_mm", "spacing"))}


@pytest.mark.parametrize("name", SEEN)
def test_a_photo_tells_the_layout(name: str) -> None:
    """Kind, dictionary, ids, columns and rows, border, and how tags stand, of a board that is turned and aslant."""
    (_, found), truth = proposed_of(name), SEEN[name]
    assert layout(found) == layout(truth)
    if isinstance(truth, Charuco) and isinstance(found, Charuco):
        assert found.marker_mm == pytest.approx(truth.marker_mm / truth.square_mm, rel=0.03)
    if isinstance(truth, AprilGrid) and isinstance(found, AprilGrid):
        assert found.spacing == pytest.approx(truth.spacing, abs=0.015)
    if isinstance(truth, Circles) and isinstance(found, Circles):
        assert found.diameter_mm == pytest.approx(truth.diameter_mm / truth.pitch_mm, rel=0.08)


@pytest.mark.parametrize("name", SEEN)
def test_what_is_proposed_is_found(name: str) -> None:
    """The detector names the same points at the same places by what a photo proposed as by what was printed."""
    photo, proposed = proposed_of(name)
    (found,), (wanted,) = (FINDERS[one.kind](photo, [one]) for one in (proposed, SEEN[name]))
    assert len(found.row) >= 0.9 * len(SEEN[name].index)
    both, of_found, of_wanted = np.intersect1d(found.row, wanted.row, return_indices=True)
    assert len(both) >= 0.97 * len(wanted.row)
    assert np.abs(found.near_px[of_found] - wanted.near_px[of_wanted]).max() < 1
    assert {*found.remarks} == {*wanted.remarks}


def test_what_two_boards_explain_is_told_twice() -> None:
    """A board whose first id is not 0 may be a part of a larger one: both are proposed, and none is made."""
    later = replace(BOARDS["charuco"], first_id=3) if isinstance(BOARDS["charuco"], Charuco) else None
    assert later is not None
    found = [board.marks for board in boards_in(photo_of(later))]
    assert layout(later) in map(layout, found)
    assert len(found) == 2


def test_a_part_of_a_board_is_not_taken_for_all() -> None:
    """Of a board whose first rows are out of the photo the ids tell how many there are."""
    whole = SEEN["charuco"]
    found = boards_in(photo_of(whole, rows_cut=200))
    assert layout(whole) in [layout(board.marks) for board in found]


def test_two_boards_of_the_same_markers_are_none() -> None:
    """Each of a pair, one on its head, explains half of the markers: nothing is proposed, and no chessboard either."""
    one = cv2.resize(photo_of(SEEN["charuco"], angle_deg=0.0), None, fx=0.8, fy=0.8, interpolation=cv2.INTER_AREA)
    assert boards_in(np.hstack([one, one[::-1, ::-1]])) == ()


def test_rings_and_nothing_are_no_board(tmp_path: Path) -> None:
    """White rings are no grid of circles; an empty photo is no board, and ends with exit code 1."""
    empty = np.full(SIZE[::-1], 128, np.uint8)
    assert boards_in(empty) == ()
    flat = np.full((700, 900), 230, np.uint8)
    for x, y in np.ndindex(8, 6):
        cv2.circle(flat, (100 + 100 * x, 100 + 100 * y), 35, 0, -1, cv2.LINE_AA)
        cv2.circle(flat, (100 + 100 * x, 100 + 100 * y), 16, 230, -1, cv2.LINE_AA)
    assert boards_in(flat) == ()
    cv2.imwrite(str(tmp_path / "empty.png"), empty)
    answer = calib("target", "--from-photo", tmp_path / "empty.png")
    assert answer.code == 1
    assert "shows no chessboard" in answer.out + answer.err


def squares_of(columns: int, rows: int, side: int) -> NDArray[np.uint8]:
    """A chessboard seen from in front."""
    dark = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0).repeat(side, axis=0).repeat(side, axis=1)
    return np.where(dark, 40, 220).astype(np.uint8)


@pytest.mark.parametrize("diameter", [22, 26, 31])
def test_the_ground_between_circles_is_no_chessboard(diameter: int) -> None:
    """Bridges between large circles look like corners from afar, but are as light as the ground is."""
    photo = np.full((260, 320), 200, np.uint8)
    for x, y in np.ndindex(6, 6):
        cv2.circle(photo, (16 * (60 + 37 * x), 16 * (35 + 37 * y)), 8 * diameter, 40, -1, cv2.LINE_AA, 4)
    (found,) = boards_in(cv2.GaussianBlur(photo, (0, 0), 1.0).astype(np.uint8))
    assert layout(found.marks) == layout(Circles((6, 6), 37.0, float(diameter)))


def test_a_drawn_board_is_one_lattice() -> None:
    """A corner just between pixels, as in pictures without noise, is one corner."""
    photo = np.full((330, 450), 230, np.uint8)
    photo[30:310, 30:430] = squares_of(10, 7, 40)
    assert [one.size for one in find_lattices(cv2.GaussianBlur(photo, (0, 0), 0.8).astype(np.uint8))] == [(9, 6)]


def test_a_board_in_the_hand_is_meant_not_one_on_a_screen_behind() -> None:
    """Of two chessboards the one with large squares is proposed, though the other has more corners."""
    photo = np.full((480, 640), 230, np.uint8)
    photo[40:320, 200:600] = squares_of(10, 7, 40)
    photo[350:430, 10:122] = squares_of(14, 10, 8)
    (found,) = boards_in(cv2.GaussianBlur(photo, (0, 0), 0.8).astype(np.uint8))
    assert layout(found.marks) == layout(Chessboard((10, 7), 40.0))


def test_markers_of_no_board_are_told(tmp_path: Path) -> None:
    """Markers that lie anywhere are named by their dictionary, rather than that nothing was found."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    photo = np.full((400, 700), 230, np.uint8)
    for number, at in ((3, (40, 50)), (117, (90, 300)), (8, (210, 190)), (61, (240, 520))):
        photo[at[0] : at[0] + 84, at[1] : at[1] + 84] = cv2.aruco.generateImageMarker(known, number, 84)
    cv2.imwrite(str(tmp_path / "loose.png"), photo)
    answer = calib("target", "--from-photo", tmp_path / "loose.png")
    assert answer.code == 1
    assert "shows 4 markers of DICT_5X5_1000, but no one board explains them" in answer.out + answer.err


def test_a_ruler_makes_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With lengths the file is written; without, the line that makes it is told, and -o says what is missing."""
    monkeypatch.chdir(tmp_path)
    photo = photo_of(SEEN["charuco"])
    cv2.imwrite("photo.png", photo)
    found = boards_in(photo)  # which every line would seek again
    monkeypatch.setattr("calib.detector.board_in_photo.boards_in", lambda pixels: found if len(pixels) else ())
    words = ("target", "--from-photo", "photo.png")
    (told,) = json.loads(calib(*words, "--json").out)["answer"]["boards"]
    assert told["missing"] == ["--square"]
    assert "--marks charuco --squares 7x6 --square ...mm" in told["line"]
    answer = calib(*words, "-o", "b.target.json")
    assert answer.code == 2
    assert "give --square" in answer.err
    answer = calib(*words, "--square", "20mm", "--marker", "14.4mm", "-o", "b.target.json")
    assert answer.code == 0, answer.err
    assert load_target("b.target.json").marks == (SEEN["charuco"],)
    assert "--squares: --from-photo tells that itself" in calib(*words, "--squares", "7x6").err
    assert "--tag: the photo shows charuco" in calib(*words, "--tag", "3").err
