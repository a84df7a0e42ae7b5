"""ChArUco boards and AprilGrids in photos: names are right or none, and what is wrong is said."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from calib.detector.boards import detect_boards
from calib.detector.marks import FINDERS, FoundFace
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.face_marks import FaceMarks
from designer.target import target_of_marks
from tests.support.cluttered_boards import BoardPhoto, Pixels, Pose, photo_of, put

BOARD = Charuco((7, 6), 20.0, 15.0, "DICT_5X5_100")
GRID = AprilGrid((4, 3), 20.0)
NEAR_PX = 1.0
KALIBR = (0xD5D628584, 0xD97F18B49, 0xDD280910E, 0xE479E9C98, 0xEBCBCA822, 0xF31DAB3AC)
"""The first tags of the family 36h11, as published: white bits row by row from the upper left."""


def find(pixels: Pixels, *faces: FaceMarks) -> tuple[FoundFace, ...]:
    """What the kind's finder makes of it."""
    return FINDERS[faces[0].kind](pixels, faces)


def photo(marks: FaceMarks, pose: Pose | None = None, *, seed: int = 1, covers: int = 0) -> BoardPhoto:
    """A small photo."""
    return photo_of(
        marks, pose or Pose(0.75, 0.4, 0.7, 0.2), np.random.default_rng(seed), size=(560, 420), covers=covers
    )


def told(pixels: Pixels, *faces: FaceMarks) -> str:
    """All remarks; nothing may be named."""
    found = find(pixels, *faces)
    assert not any(len(one.row) for one in found)
    return " ".join(remark for one in found for remark in one.remarks)


@pytest.mark.parametrize("marks", [
    BOARD, replace(BOARD, legacy=True), Charuco((5, 8), 20.0, 14.0, "DICT_4X4_50", first_id=7), GRID,
    AprilGrid((4, 3), 20.0, 0.25, first_id=30, border_bits=1, corner_squares=False, from_top=True),
])  # fmt: skip
@pytest.mark.parametrize("pose", [Pose(0.8, 0.9, 2.0, 2.5, k1=-0.3), Pose(1.4, 0.5, 0.3, -0.4, (0.7, 0.4))])
def test_points_have_their_own_names(marks: FaceMarks, pose: Pose) -> None:
    """All corners that a photo shows whole are named, each a pixel from where OpenCV's or Kalibr's board has it."""
    seen = photo(marks, pose, covers=2)
    found = find(seen.pixels, marks)[0]
    off = np.linalg.norm(found.near_px - seen.point_px[found.row], axis=1)
    assert off.max() < NEAR_PX
    inside = ((seen.point_px > 8) & (seen.point_px < np.array([552, 412]))).all(axis=1) & seen.is_visible
    assert np.isin(np.flatnonzero(inside), found.row).mean() > 0.93


def test_tags_stand_as_published() -> None:
    """A grid drawn from AprilTag's own code words, tags row by row from the lower left, has Kalibr's corner order."""
    marks, bit = AprilGrid((3, 2), 20.0), 8
    side, gap = 10 * bit, 3 * bit
    page = np.full((2 * side + 5 * gap, 3 * side + 6 * gap), 255, np.uint8)
    lower_left = []
    for number, code in enumerate(KALIBR):
        white = np.array([code >> (35 - k) & 1 for k in range(36)]).reshape(6, 6)
        tag = np.pad(white, 2).repeat(bit, axis=0).repeat(bit, axis=1).astype(np.uint8) * 255
        x, y = 2 * gap + number % 3 * (side + gap), 2 * gap + (1 - number // 3) * (side + gap)
        page[y : y + side, x : x + side] = tag
        lower_left.append((x - 0.5, y + side - 0.5))
        for u, v in ((x - gap, y - gap), (x + side, y - gap), (x + side, y + side), (x - gap, y + side)):
            page[v : v + gap, u : u + gap] = 0
    found = find(page, marks)[0]
    assert len(found.row) == 24
    assert np.abs(found.near_px[::4] - lower_left).max() < NEAR_PX
    assert np.abs(found.near_px[1::4] - lower_left - [side, 0]).max() < NEAR_PX
    upright = find(page, replace(marks, upright=True))
    assert not len(upright[0].row)
    assert "as AprilTag and Kalibr print them" in upright[0].remarks[0]


def test_what_is_wrong_is_said() -> None:
    """Another pattern, dictionary, size or first marker, and mirrored photos, are told, and nothing is named."""
    seen = photo(BOARD).pixels
    assert "make the target without --legacy" in told(seen, replace(BOARD, legacy=True))
    assert "make the target with --legacy" in told(photo(replace(BOARD, legacy=True)).pixels, BOARD)
    wide = replace(BOARD, squares=(11, 6))
    assert "make the target without --legacy" in told(photo(wide).pixels, replace(wide, legacy=True))
    assert "of DICT_5X5_50 there are 21, 0 to 20" in told(seen, replace(BOARD, dictionary="DICT_4X4_50"))
    assert "on a board of 7 columns of squares, not 8" in told(seen, replace(BOARD, squares=(8, 6)))
    assert "with 0 as the first one, not 10" in told(seen, replace(BOARD, first_id=10))
    assert "flip it back" in told(np.ascontiguousarray(seen[:, ::-1]), BOARD)
    grid = photo(GRID).pixels
    assert "on a grid of 4 columns, not 5" in told(grid, replace(GRID, tags=(5, 3)))
    assert "numbered from the lower left" in told(grid, replace(GRID, from_top=True))
    bare = replace(GRID, corner_squares=False)
    assert "printed with small squares" in told(grid, bare)
    assert "printed without small squares" in told(photo(bare).pixels, GRID)
    one = replace(GRID, border_bits=1)
    assert "with borders of 2 cells no marker is seen" in (said := told(photo(one).pixels, GRID))
    assert "with borders of 1 cell there are" in said
    assert "with borders of 2 cells there are" in told(photo(GRID).pixels, one)


def test_inverted_boards_are_named_and_said() -> None:
    """A board printed white on black has the same names."""
    seen = photo(BOARD)
    found = find(np.asarray(cv2.bitwise_not(seen.pixels)), BOARD)[0]
    assert len(found.row) == 30
    assert "inverted" in found.remarks[0]
    assert np.linalg.norm(found.near_px - seen.point_px[found.row], axis=1).max() < NEAR_PX


def test_equal_boards_are_never_mixed() -> None:
    """Of two boards with the same markers none is named where either could be meant; two with others both are."""
    other = replace(BOARD, first_id=40)
    left, right = Pose(0.45, middle=(0.25, 0.5)), Pose(0.45, middle=(0.75, 0.5))
    for second, count in ((BOARD, 0), (other, 30)):
        canvas = np.full((840, 1120), 90, np.uint8)
        put(canvas, BOARD, left, 2)
        put(canvas, second, right, 2)
        pixels = np.asarray(cv2.resize(canvas, (560, 420), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        found = find(pixels, BOARD, other)
        assert [len(one.row) for one in found] == ([count, count] if count else [0])
        assert count or "two boards" in found[0].remarks[0]
    assert find(pixels, BOARD, BOARD)[0].remarks


def test_a_tone_curve_leaves_tags_their_certainty() -> None:
    """Through a curve all edges move alike: what the corners of one kind share is no noise of each of them."""
    seen = photo(GRID)
    levels = 255 * (seen.pixels / 255) ** (1 / 2.2) + np.random.default_rng(1).normal(0, 1, seen.pixels.shape)
    found = detect_boards(levels.astype(np.float32), target_of_marks([GRID], np.eye(4)[None]), name="photo")
    off = (found.center_px - seen.point_px[found.ring]) / np.sqrt(found.cov_px2[:, 0, 0])[:, None]
    assert len(found.ring) == len(GRID.position_mm)
    assert 0.4 < np.sqrt((off**2).mean()) < 1.5


def test_corners_close_to_markers_are_told_with_what_they_are_worth() -> None:
    """Where no edges are free around corners, these stay where the finder has them, with a sigma that holds."""
    board = replace(BOARD, marker_mm=18.8)
    seen = photo(board, Pose(0.5, 0.4, 1.3, 0.2))
    found = detect_boards(seen.pixels, target_of_marks([board], np.eye(4)[None]), name="photo")
    assert "markers are so close" in found.remarks[0]
    off = (found.center_px - seen.point_px[found.ring]) / np.sqrt(found.cov_px2[:, 0, 0])[:, None]
    assert len(found.ring) > 3
    assert np.sqrt((off**2).mean()) < 1.5


@pytest.mark.parametrize("pixels", [
    np.random.default_rng(1).integers(0, 256, (500, 700)).astype(np.uint8), np.zeros((400, 400), np.uint8),
    np.full((400, 400), 255, np.uint8), np.zeros((1, 500), np.uint8), np.zeros((500, 1), np.uint8),
    np.where((np.add.outer(np.arange(600), np.arange(600)) // 3) % 2, 30, 220).astype(np.uint8),
    np.tile(np.kron(np.eye(2), np.ones((12, 12))).astype(np.uint8) * 200, (25, 25)),
])  # fmt: skip
def test_there_is_nothing_in_hostile_images(pixels: Pixels) -> None:
    """Noise, moire, one colour, a line of pixels and checks without markers give no names."""
    for marks in (BOARD, GRID):
        assert told(pixels, marks) == ""
