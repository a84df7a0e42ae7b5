"""Whether stated covariances of centres hold when neighbouring pixels err together, or residuals cancel."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.detector.measure import ODD_EDGES
from calib.detector.pipeline import detect
from calib.detector.ring_equations import DISTANCE
from calib.detector.ring_fit import RingFits, fit_rings
from calib.detector.ring_model import M0, PARAMETERS, RATIO, parameters_of
from calib.detector.ring_scores import (
    LEAST_OF_A_FACE,
    PLACE,
    REACH_PX,
    SCORES_ROOM,
    STRETCHES,
    Ratios,
    Scores,
    prepare,
    together,
    variance_ratios,
)
from calib.renderer import View
from designer.base.arrays import Array, Rows
from tests.support.ring_images import INK_LEVEL, LIMIT, WHITE_LEVEL, Mosaic, disturbed, mosaic, random_rings
from tests.support.ring_views import board, misplaced, view_of

Image = NDArray[np.float32]

RINGS = 120
NOISE = (WHITE_LEVEL - INK_LEVEL) / 50


@pytest.fixture(scope="module")
def rings() -> Mosaic:
    """Tilted rings in a picture without noise."""
    return mosaic(random_rings(RINGS, np.random.default_rng(1), radius_px=12.0, tilt_rad=0.5), columns=12)


def noise(shape: tuple[int, ...]) -> Image:
    """Of pixels that err alone."""
    return np.asarray(np.random.default_rng(2).normal(0, NOISE, shape), dtype=np.float32)


def as_it_is(image: Image) -> Image:
    """Nothing but noise."""
    return image + noise(image.shape)


def smoothed(image: Image) -> Image:
    """Noise, and a program that smooths it away."""
    return np.asarray(cv2.GaussianBlur(as_it_is(image), (0, 0), 0.9), dtype=np.float32)


def enlarged(image: Image) -> Image:
    """Taken with half as many pixels and brought to size."""
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    small = small + noise(small.shape)
    return np.asarray(cv2.resize(small, image.shape[::-1], interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def moved(image: Image) -> Image:
    """The camera moved across while the shutter was open."""
    return as_it_is(np.asarray(cv2.blur(image, (5, 1)), dtype=np.float32))


def ratios_of(fits: RingFits, face: Rows | None = None, scores: Scores | None = None) -> Ratios:
    """By what the covariances have to be multiplied, all rings on one face if no other is given."""
    face = np.zeros(len(fits.ok), dtype=np.int64) if face is None else face
    return variance_ratios(scores or fits.scores, fits.radii_px, fits.noise / fits.contrast, face)


def fit(rings: Mosaic, image: Image) -> tuple[RingFits, Ratios]:
    """Fits with the vanishing line known, and the ratios of variances."""
    start = disturbed(rings.params, np.random.default_rng(3))
    line, information = rings.params[:, M0 : M0 + 2].copy(), np.tile(1e12 * np.eye(2), (len(start), 1, 1))
    fits = fit_rings(image, start, limit=LIMIT, line=line, line_information=information)
    return fits, ratios_of(fits)


def squared(error: Array, cov: Array) -> float:
    """Squared errors in stated covariances per degree of freedom: 1 if these are true."""
    return float(np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error).mean()) / 2


def test_the_ratio_is_1_if_pixels_err_alone(rings: Mosaic) -> None:
    """What a fit takes up of even noise is foreseen, so that the ratio is 1 and no covariance changes."""
    _, ratios = fit(rings, as_it_is(rings.image))
    assert ratios.photo == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("process", "fails"),
    [(smoothed, True), (enlarged, True), (moved, True), (as_it_is, False)],
    ids=["smoothed", "enlarged", "moved", "plain"],
)
def test_covariances_hold_however_the_photo_was_processed(
    rings: Mosaic, process: Callable[[Image], Image], fails: bool
) -> None:
    """Squared errors are as stated; taken for independent, pixels state too little, or too much."""
    fits, ratios = fit(rings, process(rings.image))
    assert fits.ok.all()
    error = fits.center_px - rings.center_px
    assert 0.6 < squared(error, ratios.ring[:, None, None] * fits.cov_px2) < 1.6
    if fails:
        assert not 0.6 < squared(error, fits.cov_px2) < 1.6


def test_what_all_rings_of_a_face_have_in_common_makes_none_uncertain(rings: Mosaic) -> None:
    """A pattern of the edges that is the same in all rings moves them all alike, and changes no ratio."""
    fits, ratios = fit(rings, as_it_is(rings.image))
    common = np.random.default_rng(4).normal(size=fits.scores.score.shape[1:])
    patterned = replace(fits.scores, score=fits.scores.score + common)
    assert ratios_of(fits, scores=patterned).ring == pytest.approx(ratios.ring, rel=1e-9)


def test_a_disturbed_ring_owns_its_uncertainty(rings: Mosaic) -> None:
    """A reflection across some rings makes their centres uncertain, not those of the others."""
    image = as_it_is(rings.image)
    plain = ratios_of(fit(rings, image)[0]).photo
    disturbed_rings = np.arange(0, RINGS, 10)
    for u, v in rings.center_px[disturbed_rings].astype(int):
        image[v - 9 : v - 3, u + 2 : u + 14] += 80
    _, ratios = fit(rings, image)
    assert ratios.photo == pytest.approx(plain, rel=0.1)
    assert np.median(ratios.ring[disturbed_rings]) > 2 * ratios.photo


def test_too_few_rings_are_taken_for_usual(rings: Mosaic) -> None:
    """Where a face has too few rings to tell, the ratio is what is usual of such photos, 1 if no other is known."""
    fits, _ = fit(rings, smoothed(rings.image))
    faces = np.full(RINGS, -1)
    faces[np.flatnonzero(fits.scores.alone > 0)[: LEAST_OF_A_FACE - 1]] = 0
    assert (ratios_of(fits, faces).ring == 1.0).all()
    usual = variance_ratios(fits.scores, fits.radii_px, fits.noise / fits.contrast, faces, 1.25)
    assert usual.photo == 1.25
    assert (usual.ring == 1.25).all()
    nothing = np.zeros(0)
    assert variance_ratios(Scores.empty(0), np.zeros((0, 2)), nothing, nothing.astype(int)).photo == 1.0


@pytest.mark.parametrize("slant", [-8e-17, -1e-17, 0.0, 1e-17, 8e-17])
def test_every_pixel_has_a_stretch(slant: float) -> None:
    """Also those in the very direction where a turn ends: their numbers are whole and within both edges' stretches."""
    p = np.zeros(PARAMETERS)
    p[:2], p[2:5], p[RATIO] = 30.0, (0.1, slant, 0.1), 0.45
    pixels = np.array([[34.5, 40.0, 25.5, 30.0], [30.0, 30.0, 30.0, 34.5], [0.0] * 4])
    rows = np.zeros(SCORES_ROOM)
    rows[DISTANCE : DISTANCE + 4] = (0.45, 1.0, 0.45, 0.45)
    prepare(parameters_of(p), np.eye(PARAMETERS), pixels, 0, 4, rows)
    place = rows[PLACE : PLACE + 4]
    assert np.array_equal(place, np.floor(place))
    assert np.array_equal(place < STRETCHES, [False, True, False, False])
    assert ((place >= 0) & (place < 2 * STRETCHES)).all()


def test_scores_go_together_within_reach_only() -> None:
    """S is the sum over all pairs of stretches of one edge that are within reach, around the circle."""
    rng = np.random.default_rng(5)
    score, radii = rng.normal(size=(2, 2, STRETCHES, 2)), np.array([[15.0, 6.75], [4.0, 1.8]])
    for ring in range(2):
        total = 0.0
        for edge in range(2):
            stretch_px = 2 * np.pi * radii[ring, edge] / STRETCHES
            reach = min(max(int(np.ceil(REACH_PX / stretch_px)), 1), STRETCHES // 2 - 1)
            for a in range(STRETCHES):
                for step in range(-reach, reach + 1):
                    total += float(score[ring, edge, a] @ score[ring, edge, (a + step) % STRETCHES])
        assert together(score, radii)[ring] == pytest.approx(total)


def test_a_denoised_photo_states_what_its_centres_err_and_says_so() -> None:
    """Through the whole detector: a smoothed photo has covariances that hold, and a remark; a plain one has none."""
    target = board()
    view: View = view_of(target, 3)
    plain = detect(np.asarray(view.image), target, name="plain.png")
    soft = detect(np.asarray(cv2.GaussianBlur(view.image, (0, 0), 1.2)), target, name="soft.png")
    assert plain.remarks == ()
    assert soft.remarks == (ODD_EDGES,)
    assert misplaced(soft, view).max() < 0.1
    error = soft.center_px - view.center_px[soft.ring]
    assert 0.5 < squared(error, soft.cov_px2) < 2.0
