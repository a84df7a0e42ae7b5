"""What is fixed in the image and no lens of the model: stated against true, and nothing stated where there is none."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import linearise, project, rays
from calib.cameras.camera import Camera
from calib.core.types import Observations, keep_sightings
from calib.solver.accuracy import projected_change
from calib.solver.calibration import Calibration, ImageField
from calib.solver.free_shape import PosedSightings
from calib.solver.image_field import shared_by_photos, with_image_field, with_photo_error
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import CAMERAS, SIZE, board, icosahedron, observe, poses_around

TRUE = Camera("opencv", np.array([2500.0, 2510, 1230, 1010, -0.2, 0.1, 8e-4, -5e-4, -0.05]), SIZE)
NOISE_PX = 0.01


def _seen(seed: int) -> Observations:
    rng = np.random.default_rng(seed)
    seen = observe(TRUE, icosahedron(), poses_around(16, rng, distance_mm=260.0), rng, noise_px=NOISE_PX)
    return replace(seen, cov_px2=np.tile(NOISE_PX**2 * np.eye(2), (len(seen.view), 1, 1)))


def _bump(pixel: Array) -> Array:
    """A shift of .05 px, a tenth of the image wide, beside the middle."""
    apart = (pixel - np.array(SIZE) * [0.6, 0.45]) / (0.1 * SIZE[0])
    bump: Array = 0.05 * np.exp(-0.5 * (apart**2).sum(axis=1))[:, None] * np.array([1.0, 0.5])
    return bump


FIXED = {"no tangential terms": ("p1", "p2"), "a bump": ()}
"""Parameters that the model lacks; no parameter of any follows a bump."""


def _error_and_sigmas_px(one: Calibration, moved: Callable[[Array], Array]) -> tuple[float, float, float]:
    """RMS over sightings of what the camera is off by, less its own turn; the same as stated, in all and by noise."""
    at = np.asarray(one.observations.center_px)[::3]
    ray = rays(TRUE, at - moved(at))
    by_point = linearise(one.camera, np.ascontiguousarray(ray.T)).by_point.transpose(2, 0, 1)
    off_px, by_turn = project(one.camera, ray) - at, np.cross(ray[:, None, :], by_point)
    off_px = off_px - by_turn @ np.linalg.lstsq(by_turn.reshape(-1, 3), off_px.reshape(-1), rcond=None)[0]
    change = projected_change(one.camera, at, over=at)

    def sigma_px(covariance: Array) -> float:
        return float(np.einsum("nip,pq,niq->", change, covariance, change) / len(at))

    field = one.image_field
    assert field is not None
    stated = sigma_px(one.param_covariance + field.param_covariance) + 2 * field.left_px**2
    return float(np.sqrt((off_px**2).sum(axis=1).mean())), np.sqrt(stated), np.sqrt(sigma_px(one.param_covariance))


@pytest.mark.parametrize("case", FIXED)
def test_what_the_lens_model_does_not_follow_is_in_the_stated_uncertainty(case: str) -> None:
    """A camera is off in the image by what noise, what it took of a field and what it leaves of it state, to a quarter.

    By the noise alone it would be surer than it is, and halves of the photos cannot show it.
    """
    fixed = tuple((name, 0.0) for name in FIXED[case])
    moved = _bump if not fixed else np.zeros_like
    told = []
    for seed in range(3):
        seen = _seen(seed)
        seen = replace(seen, center_px=seen.center_px + moved(np.asarray(seen.center_px)))
        one = with_image_field(solve(seen, "opencv", SolveOptions(fixed=fixed)))
        told.append(_error_and_sigmas_px(one, moved))
    off, stated, alone = np.sqrt(np.mean(np.square(told), axis=0))
    assert 0.8 < off / stated < 1.25
    assert off / alone > 1.4


@pytest.mark.parametrize("weighted", [True, False])
def test_noise_alone_is_no_field(weighted: bool) -> None:
    """Where the lens is of the model's kind the covariance stays what it is, whatever the noise."""
    for seed in range(2):
        one = solve(_seen(10 + seed), "opencv", SolveOptions(weighted=weighted))
        told = with_image_field(one)
        assert told.image_field is None
        assert (told.stated_covariance == one.param_covariance).all()


def test_a_field_that_was_there_goes_where_nothing_tells_one() -> None:
    """What is stated is of this calibration alone, also where parameters or residuals cannot tell of a field."""
    one = solve(_seen(3), "opencv")
    there = replace(one, image_field=ImageField(1.0, np.eye(len(one.camera.params))))
    for told in (
        replace(there, param_covariance=np.zeros_like(one.param_covariance)),
        replace(there, residual_px=np.zeros_like(one.residual_px)),
    ):
        assert with_image_field(told).image_field is None


def test_sightings_that_do_not_count_tell_no_field() -> None:
    """Outliers, however far off and wherever, are as if they were not there."""
    seen = _seen(3)
    seen = replace(seen, center_px=seen.center_px + _bump(np.asarray(seen.center_px)))
    is_off = np.random.default_rng(1).random(len(seen.view)) < 0.05
    one = solve(keep_sightings(seen, ~is_off), "opencv")
    residual, outlier = np.full((len(is_off), 2), np.nan), np.array(is_off)
    residual[~is_off] = one.residual_px
    both = replace(one, observations=seen, residual_px=residual, is_outlier=outlier)
    kept, told = with_image_field(one).image_field, with_image_field(both).image_field
    assert kept is not None
    assert told is not None
    assert told.left_px == pytest.approx(kept.left_px, rel=1e-6)
    np.testing.assert_allclose(told.param_covariance, kept.param_covariance, rtol=1e-5)


# What the centres of a photo share.

PLAIN, BOARD = CAMERAS["opencv"], board()
SHARED_PX, REACH_MM, RUNS = 0.02, 40.0, 16


def _sharing(seed: int, shared: float) -> Observations:
    """Sightings of which so much of the variance neighbours share."""
    rng = np.random.default_rng(seed)
    seen = observe(PLAIN, BOARD, poses_around(12, rng), rng)
    place = BOARD.position_mm[:, :2]
    square = ((place[:, None] - place) ** 2).sum(axis=2) / REACH_MM**2
    root = np.linalg.cholesky(np.exp(-square / 2) + 1e-6 * np.eye(len(place)))
    fields = root @ rng.standard_normal((seen.view_count, len(place), 2))
    noise = np.sqrt(1 - shared) * rng.standard_normal(seen.center_px.shape)
    error = noise + np.sqrt(shared) * fields[seen.view, seen.point]
    return replace(seen, center_px=seen.center_px + SHARED_PX * error)


def _covered(solved: list[Calibration], *, alone: bool) -> float:
    """How many of the parameters are within two deviations of the truth."""
    off = [
        np.abs(one.camera.params - PLAIN.params)
        < 1.96 * np.sqrt(np.diagonal(one.param_covariance if alone else one.stated_covariance))
        for one in solved
    ]
    return float(np.mean(off))


@pytest.mark.parametrize("shared", [0.0, 0.5])
def test_stated_deviations_cover_whether_or_not_neighbours_err_alike(shared: float) -> None:
    """95 % of parameters are within 1.96 stated deviations; of those of independent errors that is so only without."""
    solved = [with_photo_error(solve(_sharing(seed, shared), "opencv", SolveOptions())) for seed in range(RUNS)]
    assert all((one.photo_error is not None) == bool(shared) for one in solved)
    assert 0.89 < _covered(solved, alone=False) < 0.995
    assert (_covered(solved, alone=True) < 0.8) == bool(shared)


def test_nothing_is_added_twice() -> None:
    """What all parts together state already, also of the photos, is as it is: a second time adds nothing."""
    one = with_photo_error(solve(_sharing(0, 0.5), "opencv", SolveOptions()))
    assert one.photo_error is not None
    told = np.linalg.eigvalsh(one.photo_error.param_covariance)
    assert told[0] > -1e-9 * told[-1]
    wide = with_photo_error(replace(one, param_covariance=25 * one.param_covariance, photo_error=None))
    assert wide.photo_error is not None
    assert np.trace(wide.photo_error.param_covariance) < 0.1 * np.trace(one.photo_error.param_covariance)


def test_few_photos_and_exact_ones_tell_nothing() -> None:
    """One photo has no other to vary from, and what is left of exact sightings is rounding."""
    rng = np.random.default_rng(0)
    exact = observe(PLAIN, BOARD, poses_around(8, rng), rng)
    assert with_photo_error(solve(exact, "opencv", SolveOptions())).photo_error is None


def test_a_direction_that_rounding_leaves_nothing_of_stops_nothing() -> None:
    """A stated covariance of directions that are a rounding of others, or lost sign by it, gives numbers."""
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
