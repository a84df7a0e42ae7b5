"""Reading rings, dots and nothing at given places."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.ring_marks import DOT, RING, UNREADABLE, read_marks
from tests.support.ring_images import INK_LEVEL, WHITE_LEVEL, Mosaic, mosaic, random_rings


def read(
    image: NDArray[np.generic], m: Mosaic, off_px: float = 0.0, contrast: float = WHITE_LEVEL - INK_LEVEL
) -> list[int]:
    """The marks at the mosaic's places, shifted by up to so many pixels."""
    ellipse = m.params[:, :5].copy()
    ellipse[:, :2] += np.random.default_rng(0).uniform(-off_px, off_px, (len(ellipse), 2))
    return list(read_marks(image, ellipse, ratio=0.45, around=1.3, contrast=WHITE_LEVEL - INK_LEVEL))


@pytest.mark.parametrize(("radius", "blur"), [(6.0, 0.6), (10.0, 1.5), (25.0, 0.7)])
@pytest.mark.parametrize("tilt", [0.0, 0.9])
def test_rings_and_dots_are_read(radius: float, blur: float, tilt: float) -> None:
    """A ring is read as a ring and a dot as a dot, at any tilt, with noise, and from places half a pixel off."""
    rng = np.random.default_rng(1)
    for ratio, mark in ((0.45, RING), (0.0, DOT)):
        m = mosaic(random_rings(12, rng, radius_px=radius, tilt_rad=tilt, blur_px=blur, ratio=ratio))
        noisy = m.image + rng.normal(0, 5, m.image.shape)
        for image in (noisy.clip(0, 255).astype(np.uint8), noisy.astype(np.float32)):
            assert read(image, m, 0.5) == [mark] * 12


def test_nothing_and_faint_things_are_unreadable() -> None:
    """Even grey, noise, and rings with a fifth of the usual contrast are not guessed at."""
    rng = np.random.default_rng(2)
    m = mosaic(random_rings(12, rng))
    even = np.full(m.image.shape, 128, dtype=np.uint8)
    assert read(even, m) == [UNREADABLE] * 12
    assert read((even + rng.normal(0, 8, even.shape)).astype(np.uint8), m) == [UNREADABLE] * 12
    assert read((160 + 0.2 * (m.image - 160)).astype(np.uint8), m) == [UNREADABLE] * 12


def test_inverted_rings_are_unreadable() -> None:
    """White rings on black are none of ours."""
    m = mosaic(random_rings(12, np.random.default_rng(3)))
    assert read((255 - m.image).astype(np.uint8), m) == [UNREADABLE] * 12


def test_half_covered_marks_are_unreadable() -> None:
    """A ring or dot under a white or black strip is neither."""
    rng = np.random.default_rng(4)
    for ratio in (0.45, 0.0):
        m = mosaic(random_rings(12, rng, ratio=ratio))
        for level in (0, 255):
            covered = m.image.astype(np.uint8)
            for u, v in m.center_px:
                covered[int(v) - 24 : int(v) + 24, int(u) + 2 : int(u) + 24] = level
            assert read(covered, m) == [UNREADABLE] * 12


def test_places_at_and_beyond_the_border_are_unreadable() -> None:
    """A mark that does not lie wholly in the image is not read, wherever it lies."""
    m = mosaic(random_rings(1, np.random.default_rng(5)), columns=1)
    image = np.ascontiguousarray(m.image[:, 20:])
    ellipse = np.repeat(m.params[:, :5], 5, axis=0)
    ellipse[:, :2] = m.center_px[0] - (20, 0), (-100, 30), (30, -100), (1e6, 30), (30, 61)
    assert list(read_marks(image, ellipse, ratio=0.45, around=1.3, contrast=160)) == [UNREADABLE] * 5
    assert len(read_marks(image, np.zeros((0, 5)), ratio=0.45, around=1.3, contrast=160)) == 0


def test_wrong_place_is_not_read_as_a_dot() -> None:
    """Between rings there is white, which is neither ring nor dot."""
    m = mosaic(random_rings(12, np.random.default_rng(6)))
    ellipse = m.params[:, :5].copy()
    ellipse[:, 0] += 30
    assert DOT not in read_marks(
        np.pad(m.image, ((0, 0), (0, 40)), mode="edge"), ellipse, ratio=0.45, around=1.3, contrast=160
    )
