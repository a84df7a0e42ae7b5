"""The little solver inside the kernels against NumPy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.core.small_solve import cholesky_factor, cholesky_invert, cholesky_solve, diagonalise


def spd(
    size: int, condition: float, seed: int
) -> tuple[np.random.Generator, np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    """A symmetric positive definite matrix with a given condition."""
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.standard_normal((size, size)))
    matrix = (basis * np.geomspace(1, 1 / condition, size)) @ basis.T
    return rng, 0.5 * (matrix + matrix.T)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(size=st.integers(1, 15), exponent=st.floats(0, 8), scale=st.floats(-6, 6), seed=st.integers(0, 10**6))
def test_solve_and_invert_agree_with_numpy(size: int, exponent: float, scale: float, seed: int) -> None:
    """Solution and inverse are NumPy's, at any scale; only the lower triangle is read."""
    rng, matrix = spd(size, 10**exponent, seed)
    matrix = 10**scale * matrix
    right = rng.standard_normal(size)
    lower = np.tril(matrix) + np.triu(np.full((size, size), np.nan), 1)
    x = np.empty(size)
    assert cholesky_solve(lower.copy(), right, x)
    close = 1e-12 * 10**exponent
    expected = np.linalg.solve(matrix, right)
    assert np.linalg.norm(x - expected) <= close * np.linalg.norm(expected)
    work, inverse = np.empty_like(matrix), np.empty_like(matrix)
    assert cholesky_invert(lower, work, inverse)
    expected = np.linalg.inv(matrix)
    assert np.abs(inverse - expected).max() <= close * np.abs(expected).max()
    assert np.array_equal(np.tril(lower), np.tril(matrix))


@pytest.mark.parametrize(
    "matrix",
    [
        np.zeros((3, 3)),
        np.diag([1.0, -1.0, 1.0]),
        np.ones((3, 3)),
        np.diag([1.0, np.nan, 1.0]),
        np.diag([np.inf, 1.0, 1.0]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
    ],
)
def test_matrix_that_is_not_positive_definite_is_refused(
    matrix: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> None:
    """Singular, indefinite or not finite: false, and no exception."""
    size = len(matrix)
    assert not cholesky_factor(matrix.copy())
    assert not cholesky_solve(matrix.copy(), np.ones(size), np.empty(size))
    assert not cholesky_invert(matrix, np.empty_like(matrix), np.empty_like(matrix))


@pytest.mark.parametrize("size", [1, 3, 9])
def test_a_matrix_is_turned_until_it_is_diagonal(size: int) -> None:
    """Its eigenvalues are then NumPy's, and the turned rows of a unit matrix hold the eigenvectors, unit and square."""
    _, matrix = spd(size, 1e6, seed=size)
    turned, vectors = matrix.copy(), np.eye(size)
    diagonalise(turned, vectors)
    np.testing.assert_allclose(np.sort(np.diag(turned)), np.linalg.eigvalsh(matrix), atol=1e-12)
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(size), atol=1e-12)
    np.testing.assert_allclose(vectors @ np.diag(np.diag(turned)) @ vectors.T, matrix, atol=1e-12)
