"""How much of the image sightings surround."""

import cv2
import numpy as np
import pytest

from calib.judge.coverage import COLUMNS, Coverage, coverage, region_words

SIZE = (800, 600)


def _grid(left: float, right: float, size: tuple[int, int] = SIZE, steps: int = 9) -> np.ndarray:
    """A grid of sightings from one part of the width to another, over the whole height."""
    width, height = size
    u, v = np.meshgrid(
        np.linspace(left * width - 0.5, right * width - 0.5, steps), np.linspace(-0.5, height - 0.5, steps)
    )
    return np.stack([u, v], axis=-1).reshape(-1, 2)


def _of(*views: np.ndarray, size: tuple[int, int] = SIZE) -> Coverage:
    view = np.repeat(np.arange(len(views)), [len(one) for one in views])
    return coverage(size, np.concatenate(views), view, np.zeros(len(view), dtype=np.int64))


@pytest.mark.parametrize("size", [(800, 600), (600, 800), (2448, 2048), (11608, 8708), (97, 61)])
@pytest.mark.parametrize("steps", [2, 15])
def test_a_full_grid_covers_all_and_half_of_it_half(size: tuple[int, int], steps: int) -> None:
    """Coverage is a share of area: it depends neither on the image's size nor on how many rings a target has."""
    assert _of(_grid(0, 1, size, steps), size=size).share == pytest.approx(1, abs=1e-9)
    assert _of(_grid(0, 0.5, size, steps), size=size).share == pytest.approx(0.5, abs=1 / COLUMNS)


def test_views_add_up() -> None:
    """The union of the hulls counts, overlaps once; how many views cover a cell is kept."""
    seen = _of(_grid(0, 0.5), _grid(0.25, 0.75))
    assert seen.share == pytest.approx(0.75, abs=1 / COLUMNS)
    assert set(np.unique(seen.views)) == {0, 1, 2}
    assert (seen.views == 2).mean() == pytest.approx(0.25, abs=2 / COLUMNS)


def test_what_lies_between_two_faces_is_not_covered() -> None:
    """Each face has its own hull: the air between two of them was not seen."""
    pixel = np.concatenate([_grid(0, 0.25), _grid(0.75, 1)])
    view, face = np.zeros(len(pixel), dtype=np.int64), np.repeat([0, 1], len(pixel) // 2)
    assert coverage(SIZE, pixel, view, face).share == pytest.approx(0.5, abs=2 / COLUMNS)
    assert coverage(SIZE, pixel, view, np.zeros_like(face)).share == pytest.approx(1)


def test_cells_are_those_whose_middles_the_hull_holds() -> None:
    """Oracle: OpenCV's point-in-polygon test, for a cloud of points."""
    rng = np.random.default_rng(3)
    pixel = rng.normal([400, 300], [150, 90], (40, 2))
    seen = _of(pixel)
    hull = cv2.convexHull(pixel.astype(np.float32))
    away = np.array([cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in seen.middle_px.reshape(-1, 2)])
    clear = np.abs(away) > 1e-3
    assert np.array_equal(seen.is_covered.reshape(-1)[clear], away[clear] > 0)


def test_too_few_sightings_cover_nothing() -> None:
    """One or two sightings, or those on a line, surround no area."""
    assert _of(np.array([[10.0, 10], [700, 500]])).share == 0
    assert _of(np.stack([np.linspace(0, 799, 9), np.linspace(0, 599, 9)], axis=1)).share < 2 / COLUMNS
    assert coverage(SIZE, np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64)).share == 0


def test_regions_tell_what_is_missing() -> None:
    """Corners, edges and the centre are named, and their areas add up to the image."""
    seen = _of(_grid(0, 0.76))
    assert sum(region.area for region in seen.regions) == pytest.approx(1)
    assert sum(region.area * region.covered for region in seen.regions) == pytest.approx(seen.share)
    missing = tuple(region.name for region in seen.not_covered)
    assert missing == ("top right corner", "right edge", "bottom right corner")
    assert region_words(missing) == "the top right corner, the bottom right corner and the right edge"
    everything = tuple(region.name for region in seen.regions)
    assert region_words(everything) == "all corners, all edges and the centre"
    assert region_words(()) == ""
