"""Chessboards: found, named and measured."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector import boards, pipeline
from designer.marks.chessboard import Chessboard
from designer.target import TargetGeometry, target_of_marks
from tests.support.board_photos import BoardPhoto, checkered, facing, seen_from_the_side

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


def remarks_of(pixels: NDArray[np.uint8], board: Chessboard) -> str:
    """What is said of a photo in which nothing is found."""
    found = pipeline.detect(pixels, target_of(board), name="photo")
    assert not len(found.ring)
    return "; ".join(found.remarks)


def photo_of(board: Chessboard, photo: BoardPhoto) -> NDArray[np.uint8]:
    """With noise that is the same each time."""
    return photo.levels(checkered(board), np.random.default_rng(1))


def test_another_count_of_squares_is_told_as_it_is_seen() -> None:
    """Of a board with fewer or more squares than the target's nothing is named, and what is seen is said."""
    pixels = photo_of(Chessboard((7, 6), 20.0), facing(SIZE, 24, 20.0, tilt_deg=20))
    said = remarks_of(pixels, Chessboard((6, 6), 20.0))
    assert "6 x 5 inner corners are seen, the target has 5 x 5: another board, of 7 x 6 squares?" in said
    assert "6 x 5 inner corners are seen, the target has 8 x 5: covered in part" in remarks_of(
        pixels, Chessboard((9, 6), 20.0)
    )


def test_inner_corners_that_were_counted_as_squares_are_no_smaller_board() -> None:
    """The most common slip: a part of the board seen fits the target, and no wrong cause may be told."""
    pixels = photo_of(Chessboard((7, 5), 20.0), facing(SIZE, 24, 20.0, tilt_deg=20))
    said = remarks_of(pixels, Chessboard((6, 4), 20.0))
    assert said == (
        "6 x 4 inner corners are seen, the target has 5 x 3: were these counted as squares, which are one more each "
        "way: 7 x 5?"
    )


def test_a_board_that_the_image_cuts_is_refused() -> None:
    """A chessboard that goes on beyond the image has no places that could be named."""
    photo = facing(SIZE, 34, 20.0, shift_px=(90.0, 0.0))
    assert "cut by the image's edge?" in remarks_of(photo_of(Chessboard((7, 6), 20.0), photo), Chessboard((7, 6), 20.0))


def test_of_two_equal_boards_none_is_taken() -> None:
    """Which of two boards is meant no photo tells, and they are never mixed."""
    board = Chessboard((7, 6), 20.0)
    one = photo_of(board, facing(SIZE, 18, 20.0, roll_deg=10))
    said = remarks_of(np.hstack([one, one]), board)
    assert "2 boards like the target's are in view" in said


@pytest.mark.parametrize("size", [(8, 8), (17, 40), (240, 320)])
def test_an_empty_photo_holds_no_board(size: tuple[int, int]) -> None:
    """Nothing, and hardly anything, is no error."""
    for pixels in (np.full(size, 90, dtype=np.uint8), np.tril(np.full(size, 200, dtype=np.uint8))):
        assert "no board of this target was found" in remarks_of(pixels, Chessboard((7, 6), 20.0))
    spots = np.full(size, 90, dtype=np.uint8)
    spots[:: size[0] // 2, :: size[1] // 3] = 250
    remarks_of(spots, Chessboard((7, 6), 20.0))


def test_exchanged_colours_are_told() -> None:
    """Where an even number of columns and rows shows that dark and light are exchanged, it is said."""
    pixels = photo_of(Chessboard((6, 8), 20.0), facing(SIZE, 24, 20.0))
    found = pipeline.detect(pixels, target_of(Chessboard((6, 8), 20.0, light_first=True)), name="photo")
    assert len(found.ring) == 35
    assert "dark and light squares are exchanged" in "; ".join(found.remarks)


@pytest.mark.parametrize("tilt_deg", [0, 60])
def test_corners_err_as_they_state(tilt_deg: float) -> None:
    """Errors are those of the pixels' noise, to a hundredth of a pixel, and what is stated."""
    board, squares, errors = Chessboard((8, 7), 20.0), [], []
    for seed in range(2):
        photo = facing(SIZE, 26, 20.0, tilt_deg=tilt_deg, roll_deg=20 + 40 * seed, axis_deg=50, shift_px=(0.3, 0.2))
        pixels = photo.levels(checkered(board), np.random.default_rng(seed))
        found = pipeline.detect(pixels, target_of(board), name="photo")
        error = found.center_px - photo.seen_at(found.position_mm[:, :2])
        errors.append(error)
        squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error))
    assert len(np.concatenate(errors)) == 84
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.012
    assert 0.8 < np.sqrt(np.concatenate(squares).mean() / 2) < 1.25


def test_a_covered_corner_is_not_told_and_the_others_are() -> None:
    """Corners under a finger are missing with their reason; those that the finder lost are predicted and measured."""
    board, photo = Chessboard((8, 7), 20.0), facing(SIZE, 26, 20.0, tilt_deg=25, roll_deg=5)
    pixels = photo_of(board, photo)
    u, v = photo.seen_at(board.position_mm[[16]])[0].round().astype(int)
    pixels[v - 9 : v + 10, u - 9 : u + 10] = 150
    found = pipeline.detect(pixels, target_of(board), name="photo")
    assert 16 not in found.ring
    assert len(found.ring) >= 37
    assert sum(count for _, count in found.faces[0].missing) == 42 - len(found.ring)
    off = found.center_px - photo.seen_at(found.position_mm[:, :2])
    assert np.abs(off).max() < 0.1


@pytest.mark.parametrize(("bend_px", "odd"), [(0.0, [16]), (0.3, [16]), (3.0, [])])
def test_a_corner_beside_its_place_is_told_by_those_around_it(bend_px: float, odd: list[int]) -> None:
    """One corner ten sigma off is refused and no other; where paper or lens bend a board by more, none at all."""
    rng, board = np.random.default_rng(3), Chessboard((8, 7), 20.0)
    sigma = rng.uniform(0.02, 0.08, len(board.position_mm))
    off = rng.normal(size=(len(sigma), 2)) * sigma[:, None]
    off[:, 0] += bend_px * (board.position_mm[:, 0] / 60) ** 2
    off[16] += 10 * sigma[16]
    cov = sigma[:, None, None] ** 2 * np.eye(2)
    assert np.flatnonzero(boards.strays(board.position_mm, off, cov)).tolist() == odd
    assert not boards.strays(board.position_mm[:5], off[:5], cov[:5]).any()


@pytest.mark.parametrize("away_deg", [65, 88])
def test_boards_beside_a_fisheye_are_found_and_measured(away_deg: float) -> None:
    """No lens is known, and half of the board lies behind the camera: all corners are named, to a tenth of a pixel."""
    board = Chessboard((7, 6), 20.0)
    photo = seen_from_the_side((560, 560), away_deg, np.random.default_rng(1))
    assert np.abs(errors_px(photo, board)).max() < 0.1
