"""Rational lenses, thin prisms and tilted fisheyes: where they end."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import ABILITIES, project, rays
from calib.cameras.camera import Camera
from calib.cameras.polynomial import first_change, value_at
from tests.support.lenses import SIZE, conventional

RATIONAL = ("rational barrel", "rational with a pole", "prism")


@pytest.mark.parametrize("seed", range(40))
def test_a_polynomial_changes_its_sign_where_numpy_has_its_root(seed: int) -> None:
    """The first positive root of odd order, of random polynomials with roots of all kinds; infinity where none is."""
    rng = np.random.default_rng(seed)
    roots = rng.uniform(-3, 3, rng.integers(0, 5)).tolist()
    pairs = rng.uniform(-2, 2, (rng.integers(0, 2), 2))
    coefficients = np.array([1.0])
    for factor in [*([1, -1 / root] for root in roots), *([1, 2 * a, a * a + b * b + 0.1] for a, b in pairs)]:
        coefficients = np.convolve(coefficients, factor)
    coefficients = np.append(coefficients, np.zeros(rng.integers(0, 3)))
    expected = min((root for root in roots if root > 0), default=np.inf)
    assert first_change(coefficients) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ((1.0, -2.0, 1.0), 1.0),  # touches zero
        ((1.0, -3.0, 3.0, -1.0), 1.0),  # a change of sign all the same
        ((1.0, 1e30, -1e-30), np.inf),  # so far out that it is none
        ((1.0,), np.inf),
    ],
)
def test_roots_that_are_special(coefficients: tuple[float, ...], expected: float) -> None:
    """Double and triple roots, constants, and roots that are out of reach."""
    assert first_change(np.array(coefficients)) == pytest.approx(expected, rel=1e-4)
    assert value_at(np.array([1.0, 2.0, 3.0]), 2.0) == 17


@pytest.mark.parametrize("lens", [*RATIONAL, "tilted fisheye"])
def test_a_lens_ends_where_it_folds_or_has_a_pole(lens: str) -> None:
    """Along each direction the image moves outwards up to the first point without one; no point beyond has one."""
    camera = conventional(lens)
    camera = replace(camera, params=np.where(np.arange(len(camera.params)) < 4, camera.params, 3 * camera.params))
    end = 3.1 if ABILITIES[camera.model].is_wide else 1.5
    theta = np.linspace(0.01, end, 3000)
    for azimuth in np.linspace(0, 2 * np.pi, 12):
        x, y = np.cos(azimuth), np.sin(azimuth)
        point = np.column_stack([x * np.sin(theta), y * np.sin(theta), np.cos(theta)])
        seen = project(camera, point)
        inside = np.isfinite(seen).all(axis=1)
        last = int(np.argmin(inside)) if not inside.all() else len(theta)
        assert last > 100
        assert not inside[last:].any()
        along = (np.diff(seen[:last], axis=0) / camera.params[:2]) @ (x, y)
        assert (along > 0).all()


def test_a_quotient_ends_at_its_pole() -> None:
    """With 1 / (1 - s) no light comes from beyond 45 degrees, and all of the plane has a ray."""
    params = np.zeros(12)
    params[:4], params[9] = (500, 500, 500, 400), -1.0
    camera = Camera("opencv8", params, SIZE)
    seen = project(camera, np.array([[0.999, 0, 1], [1.001, 0, 1], [20.0, 0, 1]]))
    assert np.isfinite(seen).all(axis=1).tolist() == [True, False, False]
    far = rays(camera, np.array([[1e5, 0.0], [-1e4, 1e4]]))
    assert (far[:, 2] >= np.sqrt(0.5)).all()
