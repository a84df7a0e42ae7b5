"""What the centres of a photo share: stated so that it covers, and nothing where errors are independent."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.free_shape import PosedSightings
from calib.solver.image_field import shared_by_photos, with_photo_error
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.solver_scenes import CAMERAS, board, observe, poses_around

TRUE, BOARD = CAMERAS["opencv"], board()
NOISE_PX, REACH_MM = 0.02, 40.0
RUNS = 16


def _seen(seed: int, shared: float) -> Observations:
    """Sightings of which so much of the variance neighbours share."""
    rng = np.random.default_rng(seed)
    seen = observe(TRUE, BOARD, poses_around(12, rng), rng)
    place = BOARD.position_mm[:, :2]
    square = ((place[:, None] - place) ** 2).sum(axis=2) / REACH_MM**2
    root = np.linalg.cholesky(np.exp(-square / 2) + 1e-6 * np.eye(len(place)))
    fields = root @ rng.standard_normal((seen.view_count, len(place), 2))
    noise = np.sqrt(1 - shared) * rng.standard_normal(seen.center_px.shape)
    error = noise + np.sqrt(shared) * fields[seen.view, seen.point]
    return replace(seen, center_px=seen.center_px + NOISE_PX * error)


def _covered(solved: list[Calibration], *, alone: bool) -> float:
    """How many of the parameters are within two deviations of the truth."""
    off = [
        np.abs(one.camera.params - TRUE.params)
        < 1.96 * np.sqrt(np.diagonal(one.param_covariance if alone else one.stated_covariance))
        for one in solved
    ]
    return float(np.mean(off))


@pytest.mark.parametrize("shared", [0.0, 0.5])
def test_stated_deviations_cover_whether_or_not_neighbours_err_alike(shared: float) -> None:
    """95 % of parameters are within 1.96 stated deviations; of those of independent errors that is so only without."""
    solved = [with_photo_error(solve(_seen(seed, shared), "opencv", SolveOptions())) for seed in range(RUNS)]
    assert all((one.photo_error is not None) == bool(shared) for one in solved)
    assert 0.89 < _covered(solved, alone=False) < 0.995
    assert (_covered(solved, alone=True) < 0.8) == bool(shared)


def test_nothing_is_added_twice() -> None:
    """What all parts together state already, also of the photos, is as it is: a second time adds nothing."""
    one = with_photo_error(solve(_seen(0, 0.5), "opencv", SolveOptions()))
    assert one.photo_error is not None
    told = np.linalg.eigvalsh(one.photo_error.param_covariance)
    assert told[0] > -1e-9 * told[-1]
    wide = with_photo_error(replace(one, param_covariance=25 * one.param_covariance, photo_error=None))
    assert wide.photo_error is not None
    assert np.trace(wide.photo_error.param_covariance) < 0.1 * np.trace(one.photo_error.param_covariance)


def test_few_photos_and_exact_ones_tell_nothing() -> None:
    """One photo has no other to vary from, and what is left of exact sightings is rounding."""
    rng = np.random.default_rng(0)
    exact = observe(TRUE, BOARD, poses_around(8, rng), rng)
    assert with_photo_error(solve(exact, "opencv", SolveOptions())).photo_error is None


def test_a_direction_that_rounding_leaves_nothing_of_stops_nothing() -> None:
    """A stated covariance of directions that are a rounding of others gives numbers all the same."""
    rng = np.random.default_rng(5)
    views = []
    for _ in range(12):
        by_camera = rng.normal(size=(30, 2, 3))
        shared = by_camera @ rng.normal(size=(3, 1)) + 0.1 * rng.normal(size=(30, 2, 1))
        views.append(
            PosedSightings(np.arange(30), by_camera, shared, rng.normal(size=(30, 2, 6)), np.zeros((30, 2, 3)))
        )
    alike = np.array([[1.0, 1.0, 0.0], [1.0, 1.0 - 1e-12, 0.0], [0.0, 0.0, 1e-30]]) * 1e-3
    found = shared_by_photos(views, alike)
    assert found is not None
    assert np.isfinite(found[1]).all()
