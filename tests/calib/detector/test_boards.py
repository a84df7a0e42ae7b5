"""Chessboards: found, named and measured."""

import numpy as np
import pytest

from calib.detector import pipeline
from designer.marks.chessboard import Chessboard
from designer.target import TargetGeometry, target_of_marks
from tests.support.board_photos import BoardPhoto, checkered, facing

SIZE = 320, 240


def target_of(board: Chessboard) -> TargetGeometry:
    """One face with the board."""
    return target_of_marks([board], np.eye(4)[None], 5.0)


def errors_px(photo: BoardPhoto, board: Chessboard, seed: int = 0) -> np.ndarray:
    """Of all corners, as the photo is searched for its board."""
    pixels = photo.levels(checkered(board), np.random.default_rng(seed))
    found = pipeline.detect(pixels, target_of(board), name="photo")
    assert len(found.ring) == len(board.index), found.remarks
    return np.asarray(found.center_px - photo.seen_at(found.position_mm[:, :2]))


@pytest.mark.parametrize("light_first", [False, True])
@pytest.mark.parametrize("roll_deg", [0, 90, 200])
def test_colours_tell_which_corner_is_the_first(roll_deg: float, light_first: bool) -> None:
    """A board whose squares sum to an odd number is named alike however it is turned."""
    board = Chessboard((7, 6), 20.0, light_first)
    photo = facing(SIZE, 24, 20.0, tilt_deg=20, roll_deg=roll_deg)
    assert np.abs(errors_px(photo, board)).max() < 0.15
