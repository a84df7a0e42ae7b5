"""The Brown polynomial and its inverse, for any coefficients."""

import numpy as np
import pytest

from calib.cameras.brown import distort, fold_radius, undistort
from designer.base.arrays import Array


def random_coefficients(rng: np.random.Generator, tangential: float) -> Array:
    """k1 k2 p1 p2 k3 from weak to wild, some of them zero."""
    k1, k2, k3 = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 1, 3) * rng.integers(0, 2, 3)
    p1, p2 = tangential * rng.standard_normal(2)
    return np.array([k1, k2, p1, p2, k3])


def test_the_fold_is_the_first_root_of_the_slope() -> None:
    """`fold_radius` is the smallest positive root of the radial part's slope, or infinity, as numpy.roots has it."""
    rng = np.random.default_rng(0)
    for _ in range(3000):
        coefficients = random_coefficients(rng, 0.0)
        k1, k2, _, _, k3 = coefficients
        roots = np.roots(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]))
        real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
        expected = np.sqrt(real.min()) if len(real) else np.inf
        assert fold_radius(coefficients) == pytest.approx(expected, rel=1e-6)


def test_every_point_short_of_the_fold_is_found_again() -> None:
    """`undistort(distort(p))` is p wherever the polynomial grows, however strong the lens."""
    rng = np.random.default_rng(1)
    for _ in range(5000):
        coefficients = random_coefficients(rng, 1e-4)
        fold = fold_radius(coefficients)
        direction = rng.uniform(0, 2 * np.pi)
        point = rng.uniform(0, 0.9) * min(fold, 3.0) * np.array([np.cos(direction), np.sin(direction)])
        shown = distort(coefficients, fold, point[0], point[1])
        found = np.array(undistort(coefficients, fold, *shown))
        assert np.abs(found - point).max() < 1e-9 * (1 + np.linalg.norm(point)), coefficients
