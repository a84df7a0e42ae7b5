"""Borders of binary images: ellipses from moments, and what is a hole."""

import math
import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.borders import (
    Borders,
    Threshold,
    binarise,
    find_borders,
    noise_level,
    reduced,
    reduction,
    thresholds,
)
from calib.detector.candidates import Candidates, find_candidates, merged, semi_axes_px
from designer.base.arrays import Array
from tests.support.ring_images import mosaic, random_rings

Image = NDArray[np.uint8]


def ellipse_image(shape: tuple[int, int], center: Array, gram: Array, inside: int) -> Image:
    """Pixels whose middle lies in v' gram v <= 1 get a level, the others its opposite."""
    v, u = np.mgrid[: shape[0], : shape[1]]
    offset = np.stack([u, v], axis=-1) - center
    is_in = np.einsum("hwi,ij,hwj->hw", offset, gram, offset) <= 1
    return np.where(is_in, inside, 255 - inside).astype(np.uint8)


def gram_of(large: float, small: float, angle: float) -> Array:
    """E'E of an ellipse."""
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.asarray(turn @ np.diag([large**-2, small**-2]) @ turn.T)


@pytest.mark.parametrize("inside", [0, 255])
def test_ellipse_of_moments_is_the_drawn_one(inside: int) -> None:
    """Centre, semi-axes and direction of a dark or a white ellipse come out, on average to a few hundredths of a pixel.

    Single ones are off by up to a third of a pixel: borders run in whole pixels.
    """
    rng = np.random.default_rng(20)
    off_center, off_axes, off_along = [], [], []
    for _ in range(80):
        large, angle = rng.uniform(7, 30), rng.uniform(0, math.pi)
        small = large * rng.uniform(0.35, 1)
        at = np.array([40.0, 35.0]) + rng.uniform(-0.5, 0.5, 2)
        borders = find_borders(ellipse_image((71, 81), at, gram_of(large, small, angle), inside))
        found = np.flatnonzero(np.isfinite(borders.misfit_px) & (borders.is_hole == (inside == 0)))
        one = found[np.argmin(np.abs(borders.area_px2[found] - math.pi * large * small))]
        ellipse = borders.ellipse[one]
        off_center.append(ellipse[:2] - at)
        off_axes.append(np.ravel(semi_axes_px(ellipse[None, 2:])) - [large, small])
        shape = np.array([[ellipse[2], 0], [ellipse[3], ellipse[4]]])
        off_along.append(1 / np.linalg.norm(shape @ [math.cos(angle), math.sin(angle)]) - large)
        assert borders.misfit_px[one] < 0.5
    assert np.sqrt(np.mean(np.square(off_center))) < 0.08
    assert np.abs(np.mean(off_axes, axis=0)).max() < 0.06
    assert np.abs(np.array(off_axes)).max() < 0.35
    assert np.sqrt(np.mean(np.square(off_along))) < 0.1


def nested_squares(depth: int, side: int = 120) -> Image:
    """A white square, in it a black one, in it a white one ..."""
    image = np.zeros((side, side), dtype=np.uint8)
    for level in range(depth):
        edge = 5 + 8 * level
        image[edge : side - edge, edge : side - edge] = 255 * (1 - level % 2)
    return image


@pytest.mark.parametrize("depth", [1, 2, 3, 4, 5, 6])
def test_holes_are_the_odd_levels_of_the_hierarchy(depth: int) -> None:
    """The border of a dark region in a white one is a hole; that of a white region is none, however deep."""
    borders = find_borders(nested_squares(depth))
    assert len(borders.parent) == depth
    order = np.argsort(-borders.area_px2)
    assert borders.is_hole[order].tolist() == [bool(level % 2) for level in range(depth)]
    assert borders.parent[order].tolist() == [-1, *order[:-1].tolist()]


def test_borders_of_many_regions_keep_their_own_points() -> None:
    """Each border's points lie around its own centre, between `first` and the next `first`."""
    image = np.zeros((200, 200), dtype=np.uint8)
    for n in range(4):
        image[20 + 45 * n : 50 + 45 * n, 10:190] = 255
        image[30 + 45 * n : 40 + 45 * n, 50:90] = 0
    borders = find_borders(image)
    assert len(borders.parent) == 8
    assert borders.first[-1] == len(borders.point)
    for b in range(8):
        points = borders.point[borders.first[b] : borders.first[b + 1]]
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        assert borders.ellipse[b, :2] == pytest.approx(middle, abs=0.05)


@pytest.mark.parametrize("level", [0, 255])
@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (40, 60)])
def test_even_images_hold_no_ellipse(level: int, shape: tuple[int, int]) -> None:
    """An image of one level has no border but perhaps its own edge."""
    borders: Borders = find_borders(np.full(shape, level, dtype=np.uint8))
    assert len(borders.first) == len(borders.parent) + 1 == len(borders.misfit_px) + 1
    assert not borders.is_hole.any()


def test_thin_and_small_borders_are_no_candidates() -> None:
    """Lines, specks and squares of two pixels are no ellipses, and nothing is divided by zero."""
    image = np.full((60, 60), 255, dtype=np.uint8)
    image[10, 5:50] = image[20:50, 7] = image[30, 30] = 0
    image[40:42, 20:22] = 0
    with np.errstate(all="raise"):
        assert find_borders(image).is_hole.sum() == 4
        assert candidates_in(image).count == 0


def candidates_in(image: NDArray[np.float32] | Image, factor: int = 1) -> Candidates:
    """Candidates by Otsu's threshold in an image reduced by a factor."""
    return find_candidates(reduced(np.asarray(image, dtype=np.uint8), factor), Threshold(0), factor, 0, 0.45)


def test_rings_and_dots_are_told_apart_and_placed() -> None:
    """A ring has the ratio of its radii, a dot 0; places are right to a fraction of a pixel, axes to a twentieth."""
    rng = np.random.default_rng(1)
    rings = [*random_rings(10, rng, tilt_rad=0.7), *random_rings(10, rng, tilt_rad=0.7, ratio=0.0)]
    m = mosaic(rings)
    found = candidates_in(np.pad(m.image, 3, mode="edge"))
    assert found.count == 20
    at = found.ellipse[:, :2] - 3
    nearest = np.argmin(np.linalg.norm(at[:, None] - m.center_px[None], axis=2), axis=1)
    assert sorted(nearest.tolist()) == list(range(20))
    is_ring = nearest < 10
    assert ((found.ratio > 0) == is_ring).all()
    assert found.ratio[is_ring] == pytest.approx(np.full(10, 0.45), abs=0.06)
    error = np.linalg.norm(at - m.center_px[nearest], axis=1)
    assert np.sqrt((error[is_ring] ** 2).mean()) < 0.17
    assert error[is_ring].max() < 0.35
    assert found.ellipse[:, 2:] == pytest.approx(m.params[nearest, 2:5], abs=0.05 / 15)


def test_reduced_images_place_candidates_in_pixels_of_the_full_one() -> None:
    """Half a pixel must not get lost between the scales."""
    rng = np.random.default_rng(2)
    m = mosaic(random_rings(16, rng, radius_px=40.0, tilt_rad=0.5), columns=4)
    for factor in (1, 2, 4):
        found = candidates_in(np.pad(m.image, 8, mode="edge"), factor)
        assert found.count == 16
        at = found.ellipse[:, :2] - 8
        nearest = np.argmin(np.linalg.norm(at[:, None] - m.center_px[None], axis=2), axis=1)
        error = at - m.center_px[nearest]
        assert np.abs(error.mean(axis=0)).max() < 0.08 * factor
        assert np.abs(error).max() < 0.4 * factor
        assert found.radius_px == pytest.approx(1 / np.sqrt(m.params[nearest, 2] * m.params[nearest, 4]), rel=0.02)


def test_merging_adds_only_what_is_new() -> None:
    """The same ring twice stays one; a ring takes the place of a blob; two rings side by side stay two."""
    one = 1 / 10

    def blobs(places: list[tuple[float, float]], ratio: float) -> Candidates:
        ellipse = np.array([[u, v, one, 0.0, one] for u, v in places])
        count = len(places)
        return Candidates(ellipse, np.full(count, ratio), np.arange(count), np.full(count, 0.1))

    rings = merged(blobs([(50, 50), (80, 50)], 0.45), blobs([(51, 50), (80, 81)], 0.45))
    assert sorted(map(tuple, rings.ellipse[:, :2].tolist())) == [(50, 50), (80, 50), (80, 81)]
    better = merged(blobs([(50, 50), (80, 50)], 0.0), blobs([(51, 50)], 0.45))
    assert sorted(zip(better.ellipse[:, 0].tolist(), better.ratio.tolist(), strict=True)) == [(51, 0.45), (80, 0.0)]
    worse = merged(blobs([(50, 50)], 0.45), blobs([(51, 50)], 0.0))
    assert worse.ellipse[:, 0].tolist() == [50]


def test_many_candidates_are_merged_by_neighbourhoods() -> None:
    """Twenty thousand blobs, as a fine checkerboard gives, are not all held against all: memory is as their number."""
    place = np.stack(np.meshgrid(8.0 * np.arange(160), 8.0 * np.arange(125)), axis=-1).reshape(-1, 2)
    shape = np.tile([0.25, 0.0, 0.25], (len(place), 1))
    many = Candidates(np.hstack([place, shape]), np.zeros(len(place)), np.arange(len(place)), np.zeros(len(place)))
    tracemalloc.start()
    assert merged(many, many).count == len(place)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5000 * len(place)  # bytes; all pairs would take twenty thousand for each, as truth values


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_reduced_keeps_order_and_size(kind: type[np.generic]) -> None:
    """Reduction to 8 bit keeps what is brighter brighter, for all types, and drops incomplete rows and columns."""
    ramp = np.add.outer(np.arange(43), np.arange(61)).astype(np.float64)
    small = reduced((ramp * (2 if kind == np.uint8 else 400)).astype(kind), 2)
    assert small.shape == (21, 30)
    assert small.dtype == np.uint8
    assert (np.diff(small.astype(int), axis=1) >= 0).all()
    assert int(small.max()) - int(small.min()) > 150


def test_reduction_is_a_power_of_two_that_suffices() -> None:
    """8 million pixels stay; a hundred million are reduced fourfold each way."""
    assert reduction((2000, 4000)) == 1
    assert reduction((2001, 4000)) == 2
    assert reduction((8708, 11608)) == 4


def test_noise_level_is_the_noise_on_a_slope_with_rings() -> None:
    """Neither slopes nor edges count as noise."""
    rng = np.random.default_rng(3)
    m = mosaic(random_rings(40, rng))
    ramp = np.linspace(-30, 30, m.image.shape[1])
    for sigma in (2.0, 6.0):
        noisy = m.image + ramp + rng.normal(0, sigma, m.image.shape)
        assert noise_level(np.clip(noisy, 0, 255).astype(np.uint8)) == pytest.approx(sigma, rel=0.25)


def test_local_thresholds_find_rings_where_light_falls_off() -> None:
    """Where the light drops to a fifth across the image, some local threshold finds every ring that Otsu cannot."""
    rng = np.random.default_rng(4)
    m = mosaic(random_rings(60, rng))
    grey = (m.image * np.linspace(0.18, 1.2, m.image.shape[1])).clip(0, 255).astype(np.uint8)
    grey = np.pad(grey, 3, mode="edge")
    found = [int((find_candidates(grey, way, 1, 0, 0.45).ratio > 0).sum()) for way in thresholds(grey)]
    assert found[0] < 60
    assert max(found[1:]) == 60


def test_even_noise_stays_white_under_local_thresholds() -> None:
    """Noise on an even area is no speckle of candidates."""
    rng = np.random.default_rng(5)
    grey = rng.normal(160, 8, (400, 400)).clip(0, 255).astype(np.uint8)
    for way in list(thresholds(grey))[1:]:
        assert (binarise(grey, way) == 0).mean() < 1e-3
