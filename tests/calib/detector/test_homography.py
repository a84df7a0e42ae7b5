"""Homographies and the vanishing lines they carry."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from calib.core import homography
from calib.detector.ring_model import M0
from designer.base.arrays import Array
from tests.support.ring_images import Ring


def view(seed: int, tilt_rad: float = 0.7) -> tuple[Array, Array, Array]:
    """A plane's homography, points in it far from its origin, and their images."""
    rng = np.random.default_rng(seed)
    ring = Ring(radius_px=15, tilt_rad=tilt_rad, axis_rad=rng.uniform(0, 6.28), offset_px=(600.0, 400.0))
    plane = rng.uniform(-8, 8, (40, 2))
    return ring.plane(), plane, homography.apply(ring.plane(), plane)


def test_exact_points_give_their_homography() -> None:
    """Direct and least-squares solutions of noise-free points are the map itself, also in millimetres far away."""
    matrix, plane, image = view(1)
    for scale, shift in ((1.0, 0.0), (25.0, 3000.0)):
        moved = scale * plane + shift
        expected = matrix @ np.array([[1 / scale, 0, -shift / scale], [0, 1 / scale, -shift / scale], [0, 0, 1]])
        for found in (homography.direct(moved, image), homography.fit(moved, image, np.ones(len(plane)))[0]):
            assert homography.apply(found, moved) == pytest.approx(image, abs=1e-6)
            assert found / found[2, 2] == pytest.approx(expected / expected[2, 2], rel=1e-5, abs=1e-9)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), tilt=st.floats(0, 1.1), noise=st.floats(0.01, 0.5))
def test_fit_is_the_weighted_least_squares_solution(seed: int, tilt: float, noise: float) -> None:
    """No other homography has a smaller weighted sum of squares: SciPy finds the same."""
    rng = np.random.default_rng(seed)
    matrix, plane, exact = view(seed, tilt)
    sigma = noise * rng.uniform(0.3, 3, len(plane))
    image = exact + sigma[:, None] * rng.standard_normal(exact.shape)
    found, _, residual = homography.fit(plane, image, sigma**-2)
    assert residual == pytest.approx(image - homography.apply(found, plane), abs=1e-8)

    def distances(h: Array) -> Array:
        return np.asarray(
            ((homography.apply(np.append(h, 1.0).reshape(3, 3), plane) - image) / sigma[:, None]).ravel(), np.float64
        )

    best = least_squares(distances, (matrix / matrix[2, 2]).ravel()[:8], x_scale="jac", xtol=1e-14, ftol=1e-14).x
    expected = homography.apply(np.append(best, 1.0).reshape(3, 3), plane)
    assert homography.apply(found, plane) == pytest.approx(expected, abs=2e-3 * noise)


def test_fit_agrees_with_opencv() -> None:
    """OpenCV's least-squares homography maps the points to the same places."""
    _, plane, exact = view(3)
    image = exact + np.random.default_rng(3).normal(0, 0.2, exact.shape)
    found, _, _ = homography.fit(plane, image, np.ones(len(plane)))
    theirs = np.asarray(cv2.findHomography(plane, image)[0], dtype=np.float64)
    assert homography.apply(found, plane) == pytest.approx(homography.apply(theirs, plane), abs=1e-3)


def test_equations_are_those_of_the_differences_of_the_map() -> None:
    """J'WJ and J'Wr come from the derivatives of the mapped points by the eight free entries."""
    matrix, plane, image = view(4)
    plane = np.ascontiguousarray(plane / np.abs(plane).max())
    h = (matrix / matrix[2, 2]).ravel()
    rng = np.random.default_rng(4)
    weight = rng.uniform(0.5, 2, len(plane))
    normal, gradient, residual = np.empty((8, 8)), np.empty(8), np.empty(plane.shape)
    homography.equations(plane, image, weight, h, normal, gradient, residual)
    assert residual == pytest.approx(image - homography.apply(h.reshape(3, 3), plane))
    jacobian = np.empty((*plane.shape, 8))
    for k in range(8):
        step = np.zeros(9)
        step[k] = 1e-6 * max(abs(h[k]), 1e-3)
        after, before = (homography.apply((h + s * step).reshape(3, 3), plane) for s in (1, -1))
        jacobian[:, :, k] = (after - before) / (2 * step[k])
    expected = np.einsum("n,nia,nib->ab", weight, jacobian, jacobian)
    scale = np.sqrt(np.diag(expected))
    assert normal / np.outer(scale, scale) == pytest.approx(np.tril(expected / np.outer(scale, scale)), abs=1e-4)
    rough = np.einsum("n,nia,ni->a", weight, jacobian, residual)
    assert gradient / scale == pytest.approx(rough / scale, rel=1e-4, abs=1e-4 * np.abs(rough / scale).max())


@settings(max_examples=30, deadline=None, derandomize=True)
@given(tilt=st.floats(0, 1.2), axis=st.floats(0, 6.28), focal=st.floats(300, 5000), scale=st.floats(0.1, 50))
def test_vanishing_term_is_that_of_the_tilted_plane(tilt: float, axis: float, focal: float, scale: float) -> None:
    """The term at a projected centre is the ring model's, whatever the unit in the plane; it is 0 seen straight on."""
    ring = Ring(tilt_rad=tilt, axis_rad=axis, focal_px=focal, offset_px=(3.0, -2.0))
    matrix = ring.plane() @ np.diag([scale, scale, 1.0])
    p = ring.parameters()
    term = homography.vanishing_terms(matrix, p[None, :2])[0]
    assert term == pytest.approx(p[M0 : M0 + 2], rel=1e-6, abs=1e-12)


def test_vanishing_line_holds_the_images_of_points_far_away() -> None:
    """Seen from any point, m . (u - point) = 1 for the images of directions of the plane."""
    matrix, _, image = view(5)
    terms = homography.vanishing_terms(matrix, image)
    for angle in (0.2, 1.3):
        far = matrix @ [np.cos(angle), np.sin(angle), 0.0]
        assert ((far[:2] / far[2] - image) * terms).sum(axis=1) == pytest.approx(np.ones(len(image)))


def test_covariance_of_the_vanishing_term_is_its_scatter() -> None:
    """Over many noisy sets of points m scatters by the covariance that each fit reports."""
    rng = np.random.default_rng(6)
    _, plane, exact = view(6)
    plane = plane * 10 + 700
    at = exact[:3]
    sigma = rng.uniform(0.02, 0.08, len(plane))
    terms, spread = [], []
    for _ in range(400):
        image = exact + sigma[:, None] * rng.standard_normal(exact.shape)
        found, covariance, _ = homography.fit(plane, image, sigma**-2)
        terms.append(homography.vanishing_terms(found, at))
        spread.append(homography.vanishing_covariance(found, plane, covariance, at))
    reported = np.mean(spread, axis=0)
    for n in range(len(at)):
        off = np.array(terms)[:, n] - np.mean(terms, axis=0)[n]
        chi_square = np.einsum("si,ij,sj->s", off, np.linalg.inv(reported[n]), off)
        assert chi_square.mean() / 2 == pytest.approx(1, abs=0.15)
        assert (off.T @ off / len(off))[0, 1] == pytest.approx(reported[n][0, 1], abs=0.2 * np.trace(reported[n]))


def test_direct_has_a_positive_denominator() -> None:
    """It is 1 at the points' mean, where they are seen from the front."""
    _, plane, image = view(7)
    found = homography.direct(plane, image)
    assert homography.apply(found, plane) == pytest.approx(image)
    assert found[2] @ [*plane.mean(axis=0), 1] == pytest.approx(1)


@pytest.mark.filterwarnings("error")
def test_points_on_a_line_crash_nothing() -> None:
    """A grid of one row fixes no homography, on any processor: nothing is known, without exception or warning."""
    row = np.column_stack([np.arange(8.0), np.zeros(8)])
    matrix, covariance, residual = homography.fit(row, 20 * row + 100, np.ones(8))
    for unknown, shape in ((matrix, (3, 3)), (covariance, (8, 8)), (residual, (8, 2))):
        assert unknown.shape == shape
        assert np.isnan(unknown).all()


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_four_points_in_general_position_determine_a_homography(turn: float) -> None:
    """A row, bent by printing or not, or a row and one point leave it open; two points off the row fix it."""
    row = np.column_stack([np.arange(8.0), np.zeros(8)])
    bent = row + np.random.default_rng(1).normal(0, 1e-3, row.shape)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for points in (row[:3], row, bent, np.vstack([row, [3, 1]])):
        assert not homography.is_determined(100 + 10 * points @ matrix.T)
    long = np.column_stack([np.repeat(np.arange(100.0), 2), np.tile([0.0, 1.0], 100)])
    for points in (np.vstack([row, [[3, 1], [4, 1]]]), long, np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])):
        assert homography.is_determined(100 + 10 * points @ matrix.T)
