"""The inverse of the Brown polynomial for many points, against the inverse point by point."""

import numpy as np
import pytest

from calib.cameras.brown import BLOCK, distort, fold_radius, sure_square, undistort, undistort_block
from designer.base.arrays import Array

LENSES = {
    "none": (0.0, 0.0, 0.0, 0.0, 0.0),
    "mild": (-0.12, 0.05, 4e-4, -3e-4, 0.01),
    "barrel": (-0.3, 0.1, 0.002, -0.001, -0.012),
    "pincushion": (0.2, 0.05, -0.001, 0.003, 0.01),
    "folds at 1/sqrt(0.9)": (-0.3, 0.0, 0.0, 0.0, 0.0),
    "folds over within the picture": (-3.0, 0.0, 0.0, 0.0, 0.0),
    "badly centred": (-0.1, 0.0, 0.08, -0.05, 0.0),
    "tangential alone": (0.0, 0.0, 0.01, 0.02, 0.0),
}


def points_for(coefficients: Array, seed: int = 0) -> tuple[Array, Array]:
    """Points all over a picture and beyond, the images of points next to the fold, and those that are none."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1.2, 1.2, (2, 600))
    fold = min(fold_radius(coefficients), 2.0)
    angle, radius = rng.uniform(0, 2 * np.pi, 200), fold * (1 - 10.0 ** rng.uniform(-12, -0.5, 200))
    close = zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True)
    near = [distort(coefficients, fold, a, b) for a, b in close]
    near += [(0.0, 0.0), (-0.0, 0.1), (1e-200, 0.0), (np.nan, 0.1), (0.1, np.inf), (-np.inf, np.nan), (1e9, -1e9)]
    return np.concatenate([x, [a for a, _ in near]]), np.concatenate([y, [b for _, b in near]])


def in_block(coefficients: Array, x: Array, y: Array) -> tuple[Array, Array]:
    x, y = x.copy(), y.copy()
    undistort_block(coefficients, fold_radius(coefficients), x, y)
    return x, y


def random_lens(seed: int) -> Array:
    """Coefficients from nearly none to absurd ones."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-3, 0.5)
    return rng.normal(size=5) * scale * np.array([1, 1, 0.1, 0.1, 1])


def all_lenses() -> list[Array]:
    return [*(np.array(lens) for lens in LENSES.values()), *map(random_lens, range(40))]


def test_many_points_are_inverted_as_each_of_them() -> None:
    """The same points have an inverse, and it is the same to rounding, whatever the lens and also next to its fold."""
    for coefficients in all_lenses():
        x, y = points_for(coefficients)
        fold = fold_radius(coefficients)
        a, b = in_block(coefficients, x, y)
        one = np.array([undistort(coefficients, fold, *point) for point in zip(x, y, strict=True)])
        np.testing.assert_array_equal(np.isnan(a), np.isnan(one[:, 0]))
        with np.errstate(invalid="ignore"):
            far = np.hypot(a - one[:, 0], b - one[:, 1]) > 2e-15 * np.hypot(*one.T) + 1e-100
        # Where the inverse is steep, rounding is blown up: both are asked whether they come back.
        for k in np.flatnonzero(far):
            assert np.hypot(a[k], b[k]) ** 2 >= sure_square(coefficients)
            back = distort(coefficients, fold, a[k], b[k])
            assert np.hypot(back[0] - x[k], back[1] - y[k]) <= 2e-12 * np.hypot(x[k], y[k])


@pytest.mark.parametrize("lens", LENSES)
def test_what_is_inverted_comes_back(lens: str) -> None:
    """`D` of the inverse is the point, to a few units in the last place, where `D` is known to be one-to-one."""
    coefficients = np.array(LENSES[lens])
    x, y = points_for(coefficients)
    a, b = in_block(coefficients, x, y)
    for k in np.flatnonzero(a * a + b * b < sure_square(coefficients)):
        back = distort(coefficients, fold_radius(coefficients), a[k], b[k])
        assert np.hypot(back[0] - x[k], back[1] - y[k]) <= 6e-16 * np.hypot(x[k], y[k])


def test_neighbours_do_not_matter() -> None:
    """A point has the same inverse to the last bit in any company: what a study keeps depends on it."""
    for coefficients in map(np.array, LENSES.values()):
        x, y = points_for(coefficients)
        whole = np.array(in_block(coefficients, x, y))
        order = np.random.default_rng(1).permutation(len(x))
        for size in (1, 3, 8, 61, BLOCK):
            rows = [order[k : k + size] for k in range(0, 600, size)]
            parts = np.concatenate([np.array(in_block(coefficients, x[some], y[some])) for some in rows], axis=1)
            np.testing.assert_array_equal(parts, whole[:, np.concatenate(rows)])


def test_where_it_is_sure_the_polynomial_is_one_to_one() -> None:
    """In the disc, `D` has a symmetric, positive definite Jacobian with eigenvalues of at least 1/8."""
    rng = np.random.default_rng(2)
    for coefficients in all_lenses():
        radius = min(np.sqrt(sure_square(coefficients)), 3.0)
        assert 0 < radius <= fold_radius(coefficients)
        at, angle = radius * np.sqrt(rng.random(300)), rng.uniform(0, 2 * np.pi, 300)
        for a, b in zip((at * np.cos(angle)).tolist(), (at * np.sin(angle)).tolist(), strict=True):
            k1, k2, p1, p2, k3 = coefficients
            s = a * a + b * b
            z, p = np.array([a, b]), np.array([p2, p1])
            jacobian = (
                np.eye(2) * (1 + k1 * s + k2 * s**2 + k3 * s**3)
                + np.outer(z, z) * (2 * k1 + 4 * k2 * s + 6 * k3 * s**2)
                + 2 * (np.outer(p, z) + np.outer(z, p) + p @ z * np.eye(2))
            )
            assert np.linalg.eigvalsh(jacobian)[0] >= 1 / 8 - 1e-9


def radial_lens(rng: np.random.Generator, tangential: float) -> Array:
    """From weak to wild, some of the coefficients zero."""
    k1, k2, k3 = rng.standard_normal(3) * 10.0 ** rng.uniform(-3, 1, 3) * rng.integers(0, 2, 3)
    return np.array([k1, k2, *(tangential * rng.standard_normal(2)), k3])


def test_the_fold_is_the_first_root_of_the_slope() -> None:
    """`fold_radius` is the smallest positive root of the radial part's slope, or infinity, as numpy.roots has it."""
    rng = np.random.default_rng(0)
    for _ in range(500):
        k1, k2, _, _, k3 = coefficients = radial_lens(rng, 0.0)
        roots = np.roots(np.array([7 * k3, 5 * k2, 3 * k1, 1.0]))
        real = roots[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)].real
        assert fold_radius(coefficients) == pytest.approx(np.sqrt(real.min(initial=np.inf)), rel=1e-6)


def test_every_point_short_of_the_fold_is_found_again() -> None:
    """`undistort(distort(p))` is p wherever the polynomial grows, however strong the lens."""
    rng = np.random.default_rng(1)
    for _ in range(1000):
        coefficients, turn = radial_lens(rng, 1e-4), rng.uniform(0, 2 * np.pi)
        fold = fold_radius(coefficients)
        point = rng.uniform(0, 0.9) * min(fold, 3.0) * np.array([np.cos(turn), np.sin(turn)])
        found = undistort(coefficients, fold, *distort(coefficients, fold, point[0], point[1]))
        assert np.abs(found - point).max() < 1e-9 * (1 + np.linalg.norm(point)), coefficients
