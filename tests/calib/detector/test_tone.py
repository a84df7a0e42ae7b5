"""Photos whose levels are no light: a tone curve is told from the rings and undone, and light is left as it is."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.measure import without_tone
from calib.detector.pipeline import detect
from calib.detector.ring_fit import RingFits, fit_rings
from calib.renderer import RenderOptions
from designer.base.arrays import Array, Rows
from tests.support.ring_images import LIMIT, WHITE_LEVEL, Mosaic, disturbed, mosaic, random_rings
from tests.support.ring_views import board, view_of

Image = NDArray[np.float32]

FULL = 1.2 * WHITE_LEVEL


@pytest.fixture(scope="module")
def rings() -> Mosaic:
    """Tilted rings, as light, with a hundredth of white as noise."""
    clean = mosaic(random_rings(40, np.random.default_rng(1), radius_px=12.0, tilt_rad=0.5), columns=8)
    noise = np.random.default_rng(2).normal(0, 0.01 * WHITE_LEVEL, clean.image.shape)
    return replace(clean, image=np.asarray(clean.image + noise, dtype=np.float32))


def taken(image: Image, exponent: float) -> Image:
    """Through a curve, so that `light = level ** exponent`."""
    return np.asarray(FULL * np.clip(image / FULL, 0, 1) ** (1 / exponent), dtype=np.float32)


def undone(rings: Mosaic, image: Image) -> Image | None:
    """The photo as light, if a curve is seen."""

    def fit(image: NDArray[np.generic], start: Array, rows: Rows) -> RingFits:
        return fit_rings(image, start, limit=LIMIT, tone_asked=np.ones(len(rows), dtype=np.bool_))

    fits = fit(image, disturbed(rings.params, np.random.default_rng(3)), np.arange(len(rings.params)))
    there = without_tone(image, fits, fits.ok, fit)
    return None if there is None else there[0]


@pytest.mark.parametrize("exponent", [2.0, 2.4])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_a_power_is_told_to_a_tenth(rings: Mosaic, exponent: float, kind: type[np.generic]) -> None:
    """Of bytes and floats: what comes out is light, in proportion."""
    image = taken(rings.image, exponent)
    light = undone(rings, np.asarray(np.rint(image).astype(kind)))
    assert light is not None
    some = (image > 0.3 * FULL) & (image < 0.9 * FULL)
    assert np.log(light[some]).std() / np.log(image[some]).std() == pytest.approx(exponent, rel=0.1)


def box(image: Image) -> Image:
    """The camera moved while the shutter was open."""
    return np.asarray(cv2.blur(image, (3, 1)), dtype=np.float32)


def disc(image: Image) -> Image:
    """Out of focus."""
    y, x = np.mgrid[-2:3, -2:3]
    kernel = (np.hypot(x, y) < 2.3).astype(np.float32)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), dtype=np.float32)


def smooth(image: Image) -> Image:
    """A program smoothed it."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 0.8), dtype=np.float32)


def plain(image: Image) -> Image:
    """As it is."""
    return image


@pytest.mark.parametrize("process", [plain, box, disc, smooth])
def test_light_is_left_as_it_is(rings: Mosaic, process: Callable[[Image], Image]) -> None:
    """Whatever blurred it: no curve is seen, and nothing is changed."""
    assert undone(rings, process(rings.image)) is None


def test_centres_of_a_photo_with_a_curve_are_as_good_as_of_light() -> None:
    """And as sure: within a tenth of the linear photo's error, and stated as it is."""
    error = {}
    for gamma in (1.0, 2.2):
        view = view_of(board(), 3, options=RenderOptions(blur_px=0.7, contrast_to_noise=60, gamma=gamma))
        found = detect(view.image, board(), name="photo")
        off = found.center_px - view.center_px[found.ring]
        error[gamma] = float(np.sqrt((off**2).mean()))
        square = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.cov_px2), off)
        assert 0.7 < square.mean() / 2 < 1.4
    assert error[2.2] < 1.1 * error[1.0]
