"""Projected centres from two borders (Jiang and Quan)."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from calib.detector.borders import Threshold, find_borders, midpoint_on_line, refine_seeds
from calib.detector.candidates import find_candidates
from tests.support.ring_images import Ring, mosaic, random_rings


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    outer=st.floats(1, 50),
    share=st.floats(0.05, 0.95),
    slope=st.floats(-0.9, 0.9),
    scale=st.floats(0.2, 5),
    shift=st.floats(-100, 100),
)
def test_midpoint_is_the_image_of_the_midpoint(
    outer: float, share: float, slope: float, scale: float, shift: float
) -> None:
    """Under any projective map of the line the chord's middle is found from its four ends."""

    def image(x: float) -> float:
        return scale * x / (1 + slope * x / outer) + shift

    inner = share * outer
    a, b, c, d = (image(x) for x in (-outer, -inner, inner, outer))
    assert midpoint_on_line(a, b, c, d) == pytest.approx(image(0), abs=1e-6 * (d - a))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.lists(st.floats(-100, 100), min_size=4, max_size=4, unique=True), st.booleans())
def test_midpoint_does_not_depend_on_the_direction(ends: list[float], is_moved: bool) -> None:
    """Walking the line the other way, or from elsewhere, finds the same point, or none both times."""
    a, b, c, d = sorted(ends)
    assume(min(b - a, c - b, d - c) > 0.5)
    move = 17.0 if is_moved else 0.0
    there = midpoint_on_line(a + move, b + move, c + move, d + move) - move
    back = -midpoint_on_line(-d, -c, -b, -a)
    assert math.isnan(there) == math.isnan(back)
    assert math.isnan(there) or there == pytest.approx(back, abs=1e-5 * (d - a))


def test_chords_without_perspective_have_their_middle_in_the_middle() -> None:
    """Symmetric ends, where the quadratic has no square term, are no special case."""
    assert midpoint_on_line(-3.0, -1.0, 1.0, 3.0) == pytest.approx(0.0, abs=1e-12)
    assert midpoint_on_line(7.0, 9.0, 11.0, 13.0) == pytest.approx(10.0)


def test_seeds_come_nearer_to_the_projected_centre_than_ellipses() -> None:
    """On strongly tilted rings near the camera the refined seed beats the ellipse's middle, on average threefold."""
    rng = np.random.default_rng(1)
    m = mosaic(random_rings(30, rng, radius_px=40.0, tilt_rad=0.9, focal_px=500.0), columns=6)
    grey = np.pad(m.image, 3, mode="edge").astype(np.uint8)
    found = find_candidates(grey, Threshold(0), 1, 0, 0.45)
    assert found.count == 30
    borders = find_borders(np.where(grey > 120, 255, 0).astype(np.uint8))
    middle = borders.ellipse[borders.is_hole, :2]

    def rms(points: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> float:
        distance = np.linalg.norm(points[:, None] - 3 - m.center_px[None], axis=2).min(axis=1)
        return float(np.sqrt((distance**2).mean()))

    assert rms(found.ellipse[:, :2]) < rms(middle) / 3
    assert rms(found.ellipse[:, :2]) < 0.25


def test_a_bad_first_guess_is_drawn_to_the_centre() -> None:
    """The iteration contracts: from anywhere in the white centre it ends at the projected centre."""
    ring = Ring(radius_px=40.0, tilt_rad=0.8, axis_rad=0.5, focal_px=500.0)
    m = mosaic([ring], columns=1)
    borders = find_borders(np.where(m.image > 120, 255, 0).astype(np.uint8))
    outer = np.flatnonzero(borders.is_hole)
    inner = np.flatnonzero(borders.parent == outer[0])
    for angle in np.arange(0, 6.28, 0.7):
        seed = m.center_px + 8 * np.array([[math.cos(angle), math.sin(angle)]])
        assert refine_seeds(borders.point, borders.first, outer, inner, borders.ellipse, seed).all()
        assert np.abs(seed - m.center_px).max() < 0.5


def test_a_guess_outside_the_borders_is_refused() -> None:
    """A line that misses the inner border gives no seed, and leaves the guess as it was."""
    m = mosaic([Ring(radius_px=40.0)], columns=1)
    borders = find_borders(np.where(m.image > 120, 255, 0).astype(np.uint8))
    outer = np.flatnonzero(borders.is_hole)
    inner = np.flatnonzero(borders.parent == outer[0])
    guess = m.center_px + np.array([[30.0, 0.0]])
    seed = guess.copy()
    assert not refine_seeds(borders.point, borders.first, outer, inner, borders.ellipse, seed).any()
    assert np.array_equal(seed, guess)
