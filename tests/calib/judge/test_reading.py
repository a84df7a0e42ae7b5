"""Other readings of a table: named where they explain all, and never of a table that is as it says."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.judge.reading import reading_of, turned, unit_doubt
from calib.solver.solve import solve
from tests.support.solver_scenes import board, observe, poses_around

LENS = np.array([0.0, 0, 0, 0, -0.15, 0.05, 4e-4, -3e-4, 0.0])
NOISE_PX, PHOTOS = 0.05, 10


def _seen(
    size: tuple[int, int] = (1280, 1024), off_px: tuple[float, float] = (13.0, -13.0), seed: int = 0
) -> Observations:
    """Photos of a board by a camera whose principal point lies so far off the image's middle."""
    width, height = size
    params = LENS + np.array([1310.0, 1312, (width - 1) / 2 + off_px[0], (height - 1) / 2 + off_px[1], 0, 0, 0, 0, 0])
    rng = np.random.default_rng(seed)
    poses = poses_around(PHOTOS, rng, distance_mm=300.0, half_angle_deg=45)
    return observe(Camera("opencv", params, size), board(9, 7), poses, rng, noise_px=NOISE_PX)


def _read(seen: Observations) -> str:
    return reading_of(solve(seen, "opencv"))


@pytest.mark.parametrize(
    ("size", "off_px"), [((1280, 1024), (13.0, -13.0)), ((900, 900), (4.0, 9.0)), ((1280, 1024), (140.0, -60.0))]
)
def test_a_table_that_is_as_it_says_has_no_other_reading(size: tuple[int, int], off_px: tuple[float, float]) -> None:
    """Neither a principal point off the middle nor one in it makes a reading."""
    assert _read(_seen(size, off_px)) == ""


@pytest.mark.parametrize("count", [1, 3, 5])
def test_photos_upside_down_are_named(count: int) -> None:
    """All that were turned, and no other; of as many as were not, either half is meant."""
    seen = _seen()
    is_turned = np.isin(np.arange(PHOTOS), np.random.default_rng(count).permutation(PHOTOS)[:count])
    said = _read(turned(seen, 2 * is_turned))
    named = np.array([name in said for name in seen.view_names])
    assert "upside down" in said
    assert (named == is_turned).all() or (count == PHOTOS / 2 and (named == ~is_turned).all())


@pytest.mark.parametrize("turns", [(0, 0, 0, 0, 0, 0, 0, 1, 1, 1), (0, 3, 0, 0, 3, 0, 0, 0, 0, 0)])
def test_square_photos_on_their_side_are_named(turns: tuple[int, ...]) -> None:
    """All that were turned by a quarter, with how they are turned back, and no other; of no square image one is."""
    seen = _seen((1024, 1024), (14.0, -11.0))
    back = -np.array(turns) % 4
    said = _read(turned(seen, np.array(turns)))
    assert "on their side" in said
    named = np.array([name in said for name in seen.view_names])
    assert (named == (back > 0)).all()
    assert f"(by {90 * back.max()} deg clockwise)" in said


def test_photos_that_do_not_fit_either_way_are_not_called_turned() -> None:
    """Half of the photos with another focus leave as much over, and turning does not mend it."""
    seen = _seen()
    middle = np.array([640.0, 512])
    zoomed = np.where((seen.view % 2 == 0)[:, None], middle + 1.01 * (seen.center_px - middle) + 15.0, seen.center_px)
    assert "turned" not in _read(replace(seen, center_px=zoomed))


@pytest.mark.parametrize("size", [(1280, 1024), (1600, 1200), (1920, 1080)])
def test_exchanged_columns_are_named(size: tuple[int, int]) -> None:
    """By the principal point, where the points fit the image laid on its side; else the table is refused anyway."""
    width, height = size
    on_side = _seen((height, width), (9.0, -14.0))
    seen = replace(on_side, image_size=size)
    assert "u and v look exchanged" in _read(seen)


@pytest.mark.parametrize(("times", "unit"), [(1e-3, "metres"), (1 / 25.4, "inches"), (1e3, "micrometres"), (1.0, "")])
def test_lengths_in_another_unit_are_asked_about(times: float, unit: str) -> None:
    """By distance and size; a usual target is not."""
    seen = _seen()
    points = replace(seen.points, position_mm=times * seen.points.position_mm, plane=seen.points.plane)
    doubt = unit_doubt(solve(replace(seen, points=points), "opencv"))
    assert unit in doubt if unit else doubt == ""
