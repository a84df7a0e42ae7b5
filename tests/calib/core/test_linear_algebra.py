"""Inverses of matrices that data may leave singular."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.core.linear_algebra import (
    covariance_with_prior,
    least_squares,
    pseudo_inverse,
    solve_square,
    symmetric_inverse,
)
from designer.base.arrays import Array

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 9)


def normal_matrix(rng: np.random.Generator, size: int, rank: int, units: float = 0.0) -> Array:
    """A normal matrix of this rank, its unknowns in units that differ by up to so many powers of ten."""
    rows = rng.standard_normal((3 * size, rank)) @ np.linalg.qr(rng.standard_normal((size, size)))[0][:rank]
    rows = rows * 10.0 ** rng.uniform(-units, units, size)
    return np.asarray(rows.T @ rows)


@given(seeds, sizes)
@settings(max_examples=60, deadline=None)
def test_well_conditioned_matrices_have_their_inverse(seed: int, size: int) -> None:
    """To rounding that of `inv`, whatever the units of the unknowns, alone and in a stack."""
    rng = np.random.default_rng(seed)
    unit = 10.0 ** rng.uniform(-8, 8, size)
    well = normal_matrix(rng, size, size) + 3 * size * np.eye(size)
    sure = symmetric_inverse(well * unit[:, None] * unit)
    np.testing.assert_allclose(sure.inverse * unit[:, None] * unit, np.linalg.inv(well), rtol=0, atol=1e-12)
    assert sure.rank == size
    assert sure.is_determined.all()
    np.testing.assert_array_equal(sure.covariance, sure.inverse)
    stack = np.stack([np.eye(size), well * unit[:, None] * unit])
    np.testing.assert_allclose(symmetric_inverse(stack).inverse[1], sure.inverse, rtol=1e-9)


@given(seeds, st.integers(2, 9), st.data())
@settings(max_examples=60, deadline=None)
def test_what_is_not_determined_is_told_and_left_alone(seed: int, size: int, data: st.DataObject) -> None:
    """Of a singular normal matrix the rank, in any units; its inverse solves what has a solution."""
    rng = np.random.default_rng(seed)
    rank = data.draw(st.integers(0, size - 1))
    matrix = normal_matrix(rng, size, rank, units=4)
    sure = symmetric_inverse(matrix)
    assert sure.rank == rank
    assert not sure.is_determined.all()
    root = np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    gradient = matrix @ (rng.standard_normal(size) / root)
    np.testing.assert_allclose((matrix @ sure.inverse @ gradient) / root, gradient / root, atol=1e-6)
    assert np.isnan(np.diagonal(sure.covariance)[~sure.is_determined]).all()


def test_unknowns_beside_what_is_not_determined_keep_their_accuracy() -> None:
    """Two unknowns that cannot be told apart, one nobody asked about, and one well known."""
    matrix = np.array([[4.0, 4, 0, 0], [4, 4, 0, 0], [0, 0, 0, 0], [0, 0, 0, 16]])
    sure = symmetric_inverse(matrix)
    assert sure.rank == 2
    np.testing.assert_array_equal(sure.is_determined, [False, False, False, True])
    assert sure.covariance[3, 3] == pytest.approx(1 / 16)
    assert np.isnan(sure.covariance[:3]).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_none_determine_nothing(bad: float) -> None:
    """And cost the other matrices of a stack nothing; no function raises."""
    spoilt = np.eye(3)
    spoilt[1, 0] = spoilt[0, 1] = bad
    stack = np.stack([2 * np.eye(3), spoilt])
    sure = symmetric_inverse(stack)
    np.testing.assert_array_equal(sure.rank, [3, 0])
    np.testing.assert_allclose(sure.inverse, [0.5 * np.eye(3), np.zeros((3, 3))])
    np.testing.assert_allclose(covariance_with_prior(stack), [np.eye(3) / 3, np.eye(3)])
    solved = solve_square(stack, np.eye(3)[None])
    np.testing.assert_allclose(solved[0], 0.5 * np.eye(3))
    assert np.isnan(solved[1]).all()
    assert np.isnan(least_squares(spoilt, np.ones(3))).all()
    assert np.isnan(pseudo_inverse(spoilt)).all()


@given(seeds, sizes, st.floats(-6, 30))
@settings(max_examples=60, deadline=None)
def test_information_never_takes_from_what_was_known(seed: int, size: int, power: float) -> None:
    """`(1 + X)^-1` of X of any rank and size: no direction above the prior's variance, none lost."""
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(0, size + 1))
    information = 10.0**power * normal_matrix(rng, size, rank)
    value, vector = np.linalg.eigh(covariance_with_prior(information))
    assert value[0] > -1e-9
    assert value[-1] < 1 + 1e-9
    if power < 3:
        oracle = np.linalg.inv(np.eye(size) + information)
        np.testing.assert_allclose((vector * value) @ vector.T, oracle, atol=1e-10)
    if power > 12:
        assert (value > 0.99).sum() == size - rank  # what X does not tell is known as before


@given(seeds, st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_square_equations(seed: int, size: int) -> None:
    """As `solve`, row by row of a stack, in which singular ones give nan."""
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((5, size, size)) * 10.0 ** rng.uniform(-6, 6, (5, size, 1))
    matrix[2, -1] = 3 * matrix[2, 0] if size > 1 else 0.0
    right = rng.standard_normal((5, size, 2))
    solved = solve_square(matrix, right)
    well = [0, 1, 3, 4]
    oracle = np.linalg.solve(matrix[well], right[well])
    np.testing.assert_allclose(solved[well], oracle, rtol=1e-6, atol=1e-9 * np.abs(oracle).max())
    assert np.isnan(solved[2]).all()


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_least_squares_in_any_units(seed: int) -> None:
    """A column of another unit changes only its own number; of two equal columns each takes half."""
    rng = np.random.default_rng(seed)
    design, right = rng.standard_normal((12, 3)), rng.standard_normal(12)
    expected = np.linalg.lstsq(design, right, rcond=None)[0]
    unit = 10.0 ** rng.uniform(-12, 12, 3)
    np.testing.assert_allclose(least_squares(design * unit, right) * unit, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(pseudo_inverse(design * unit) @ right * unit, expected, rtol=1e-9, atol=1e-12)
    double = least_squares(design[:, [0, 1, 2, 2]], np.stack([right, right], axis=1))
    np.testing.assert_allclose(double[:, 0], [*expected[:2], *np.repeat(0.5 * expected[2], 2)], rtol=1e-9, atol=1e-12)
