"""The laws of other makers' marks: every line of their registry keeps them."""

import json
from pathlib import Path

import cv2
import jsonschema
import numpy as np
import pytest

from calib.observe.point_target import read_kalibr_target
from designer.base.errors import InputError
from designer.formats.point_lists import POINT_FORMATS
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.dictionaries import MARKERS, dictionary_named, marker_cells
from designer.marks.face_marks import MARKS, FaceMarks, marks_from_mapping, marks_named, marks_to_mapping
from designer.target import target_from_json, target_of_marks, target_to_json
from tests.support.boards import BOARDS, picture_of

ROOT = Path(__file__).parents[2]
each_board = pytest.mark.parametrize("marks", BOARDS.values(), ids=BOARDS)


def test_each_kind_is_one_file_and_one_line() -> None:
    """The files of `designer/marks` with marks are the registry's, each of its name; the tests have some of each."""
    files = {path.stem for path in (ROOT / "designer/marks").glob("*.py") if "\nMARKS = " in path.read_text()}
    assert files - {"__init__"} == set(MARKS) == {marks.kind for marks in BOARDS.values()}
    assert [marks_named(name).kind for name in MARKS] == list(MARKS)


@each_board
def test_what_a_file_holds_is_read_back(marks: FaceMarks) -> None:
    """Marks, and targets with them, are the same when they are read back, with the same ids, as the schema has them."""
    assert marks_from_mapping(marks_to_mapping(marks)) == marks
    faces = [marks] if marks.following is None else [marks, marks.following]
    target = target_of_marks(faces, np.stack([np.eye(4), np.diag([-1.0, 1.0, -1.0, 1.0])])[: len(faces)])
    again = target_from_json(target_to_json(target))
    jsonschema.validate(
        json.loads(target_to_json(target)), json.loads((ROOT / "designer/target.schema.json").read_text())
    )
    assert again.marks == target.marks
    assert (again.layout_id, again.geometry_id) == (target.layout_id, target.geometry_id)


@each_board
def test_what_is_written_for_kalibr_is_read_back(marks: FaceMarks, tmp_path: Path) -> None:
    """By Kalibr's own names and in metres; a board that Kalibr does not find is refused."""
    target = target_of_marks([marks], np.eye(4)[None])
    write = POINT_FORMATS["kalibr"].write
    if not marks.kalibr_fields:
        with pytest.raises(InputError, match="--to kalibr: finds none like"):
            write(target)
        return
    (tmp_path / "k.yaml").write_text(write(target))
    read, _ = read_kalibr_target(tmp_path / "k.yaml", 2 * marks.radius_mm or None)
    named = {**marks_to_mapping(marks)}
    named.pop("light_first", None)
    named.pop("light", None)
    assert named.items() <= marks_to_mapping(read).items()


@each_board
def test_points_and_polygons_lie_within_the_marks(marks: FaceMarks) -> None:
    """Points are in the middle of the marks, polygons counter-clockwise, convex, and as wide as it is said."""
    half = np.array(marks.size_mm) / 2
    assert np.allclose(marks.position_mm.min(axis=0), -marks.position_mm.max(axis=0))
    assert (np.abs(marks.position_mm) + marks.radius_mm <= half + 1e-9).all()
    assert len(np.unique(marks.index, axis=0)) == len(marks.index) == len(marks.position_mm)
    assert bool(marks.polygons_mm) == (marks.radius_mm == 0)
    if marks.polygons_mm:
        corners = np.concatenate(marks.polygons_mm)
        assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [-half, half])
    for polygon in marks.polygons_mm:
        edge = np.roll(polygon, -1, axis=0) - polygon
        assert (edge[:, 0] * np.roll(edge[:, 1], -1) > edge[:, 1] * np.roll(edge[:, 0], -1)).all()


@each_board
def test_turned_it_looks_the_same_or_not(marks: FaceMarks) -> None:
    """What is said to look the same turned by a part of a turn does, and nothing else: its points and its polygons."""
    shapes = [polygon.mean(axis=0) for polygon in marks.polygons_mm] or [*marks.position_mm]
    here = {tuple(np.round(at, 6) + 0.0) for at in shapes}
    for quarters, turn in ((1, [[0, -1], [1, 0]]), (2, [[-1, 0], [0, -1]])):
        there = {tuple(np.round(np.array(turn) @ at, 6) + 0.0) for at in shapes}
        assert (there == here) == (marks.alike * quarters >= 4)


@pytest.mark.parametrize("squares", [(5, 7), (6, 6), (7, 5), (8, 5), (5, 8)])
@pytest.mark.parametrize("is_legacy", [False, True])
def test_charuco_is_opencv_s(squares: tuple[int, int], is_legacy: bool) -> None:
    """A ChArUco board is pixel for pixel what OpenCV draws, also as it did before version 4.6; so are its corners."""
    marks = Charuco(squares, 10.0, 6.0, "DICT_4X4_50", first_id=3, legacy=is_legacy)
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard(squares, 10.0, 6.0, known, np.array(marks.marker_ids))
    board.setLegacyPattern(is_legacy)
    wanted = board.generateImage((squares[0] * 30, squares[1] * 30), marginSize=0, borderBits=1)
    assert np.array_equal(picture_of(marks, 3), wanted)
    corners = np.asarray(board.getChessboardCorners())[:, :2]
    assert np.allclose(marks.position_mm * [1, -1] + np.array(marks.size_mm) / 2, corners)


@pytest.mark.parametrize("marks", [one for one in BOARDS.values() if isinstance(one, AprilGrid)])
def test_tags_are_found_where_they_are(marks: AprilGrid) -> None:
    """OpenCV's detector names each tag as the grid does; its first corner is the lower right of a turned tag."""
    picture = cv2.copyMakeBorder(picture_of(marks, 10), 100, 100, 100, 100, cv2.BORDER_CONSTANT, value=255)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = marks.border_bits
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, marks.dictionary))
    corners, ids, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(picture)
    assert sorted(ids.ravel()) == list(marks.marker_ids)
    middle = np.array(picture.shape[::-1]) / 2
    ccw = [1, 0, 3, 2] if marks.is_turned else [3, 2, 1, 0]
    for four, number in zip(corners, ids.ravel(), strict=True):
        row = 4 * (number - marks.first_id)
        assert np.allclose(four[0][ccw] + 0.5, marks.position_mm[row : row + 4] * [10, -10] + middle, atol=3)


def test_aprilgrid_is_kalibr_s() -> None:
    """The bits of tag 0 of 36h11 (0xd5d628584) stand from the upper left on, a set bit white, as Kalibr prints them."""
    marks = AprilGrid((2, 1), 20.0)  # 10 cells of 2 mm, 2 of which are border; the squares around are 6 mm
    bits = picture_of(marks, 1)[10:22:2, 10:22:2] > 0
    assert int("".join(map(str, bits.ravel().astype(int))), 2) == 0xD5D628584


def test_dictionaries_are_opencv_s() -> None:
    """Each name is OpenCV's, in any letters and without its beginning, and holds as many markers as there."""
    for name, count in MARKERS.items():
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert len(known.bytesList) == count
        assert dictionary_named(name.lower()) == dictionary_named(name.removeprefix("DICT_")) == name
        assert marker_cells(name, count - 1).shape == (known.markerSize + 2,) * 2
