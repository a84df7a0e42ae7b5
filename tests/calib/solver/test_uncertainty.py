"""Stated deviations against repeated measurement.

The noise of the runs is drawn so that its sample mean is zero and its sample covariance unity. What is linear in it
then scatters exactly as it would in endlessly many runs, and a difference of a few per cent can be told.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calib.cameras import parameter_names, project, rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import moved_covariance
from calib.core.se3 import exp_rotation, log_rotation
from calib.solver.accuracy import GRID, projected_change, projected_sigma_px
from calib.solver.calibration import Calibration
from calib.solver.problem import Loss, SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import (
    CAMERAS,
    NOISE_PX,
    board,
    icosahedron,
    observe,
    poses_around,
    random_covariances,
    rows_of,
)

RUNS = 202
"""One more than numbers of noise, which is the least."""
VIEWS = 5
POINTS_SEEN = 100
POINTS = {"board": board(8, 7, 25.0), "icosahedron": icosahedron(100.0, 5)}
CASES: dict[str, tuple[str, str, SolveOptions]] = {
    "opencv": ("opencv", "board", SolveOptions()),
    "luhmann weighted": ("luhmann", "icosahedron", SolveOptions(weighted=True)),
    "fixed and shared": (
        "opencv", "board", SolveOptions(fixed=(("k3", 0.01),), shared=(("cx_px", "cy_px"), ("p1", "p2"))),
    ),
}  # fmt: skip


def true_camera(case: str) -> Camera:
    """A camera that a case's choices fit."""
    camera = CAMERAS[CASES[case][0]]
    if case == "fixed and shared":
        camera = replace(camera, params=np.array([2500.0, 2510, 1100, 1100, -0.12, 0.05, 3e-4, 3e-4, 0.01]))
    return camera


def spread_noise(numbers: int, rng: np.random.Generator) -> Array:
    """Normal noise (runs, numbers) whose columns have no mean, a mean square of one, and no correlation."""
    columns = np.concatenate([np.ones((RUNS, 1)), rng.standard_normal((RUNS, numbers))], axis=1)
    noise: Array = np.sqrt(RUNS) * np.linalg.qr(columns)[0][:, 1:]
    return noise


@cache
def repeated(case: str, loss: Loss = "squares") -> tuple[list[Calibration], Array]:
    """The same views measured many times with fresh noise, and the true poses."""
    _, target, options = CASES[case]
    rng = np.random.default_rng(12)
    camera = true_camera(case)
    poses = poses_around(VIEWS, rng, half_angle_deg=180 if target == "icosahedron" else 50, distance_mm=250)
    exact = observe(camera, POINTS[target], poses, rng, kept_share=0.6)
    exact = rows_of(exact, np.sort(rng.permutation(len(exact.view))[:POINTS_SEEN]))
    covariance = random_covariances(len(exact.view), rng)
    factor = np.linalg.cholesky(covariance) if options.weighted else NOISE_PX * np.eye(2)
    found = []
    for noise in spread_noise(2 * len(exact.view), rng).reshape(RUNS, -1, 2, 1):
        step = (factor @ noise)[:, :, 0]
        seen = replace(exact, center_px=exact.center_px + step, cov_px2=covariance)
        found.append(solve(seen, camera.model, replace(options, loss=loss)))
    return found, poses


def mean_squares(error: Array, covariance: Array) -> Array:
    """`e' C^-1 e` of each run, after scaling the covariances to a diagonal of ones.  # (runs,)"""
    scale = 1 / np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    scaled = covariance * scale[..., :, None] * scale[..., None, :]
    unit = error * scale
    squares: Array = np.einsum("...i,...i->...", unit, np.linalg.solve(scaled, unit[..., None])[..., 0])
    return squares


@pytest.mark.parametrize("case", CASES)
def test_stated_deviations_of_parameters_are_true(case: str) -> None:
    """Parameters scatter by their stated deviations within 1 %, about the truth, and by the whole covariance."""
    found, _ = repeated(case)
    model, _, options = CASES[case]
    params = np.array([one.camera.params for one in found])
    covariance = np.array([one.param_covariance for one in found])
    fixed = {name for name, _ in options.fixed}
    followers = {name for group in options.shared for name in group[1:]}
    free = np.array([name not in fixed | followers for name in parameter_names(model)])
    error = (params - true_camera(case).params)[:, free]
    covariance = covariance[:, free][:, :, free]
    stated = np.sqrt(np.diagonal(covariance.mean(axis=0)))
    assert np.abs(error.std(axis=0) / stated - 1).max() < 0.01
    assert (np.abs(error.mean(axis=0)) < 0.1 * stated).all()
    redundancy = found[0].residual_px.size - free.sum() - 6 * VIEWS
    expected = free.sum() * redundancy / (redundancy - 2)
    assert mean_squares(error, covariance).mean() == pytest.approx(expected, rel=0.05)
    assert all(one.status == "converged" for one in found)


@pytest.mark.parametrize("case", CASES)
def test_stated_deviations_of_poses_are_true(case: str) -> None:
    """Poses scatter by their stated deviations within 1 %, the camera's own uncertainty in them."""
    found, poses = repeated(case)
    pose = np.array([one.cam_from_target for one in found])
    turn = log_rotation(pose[..., :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1))
    error = np.concatenate([turn, pose[..., :3, 3] - poses[:, :3, 3]], axis=-1)
    covariance = np.array([one.pose_covariance for one in found])
    stated = np.sqrt(np.diagonal(covariance.mean(axis=0), axis1=-2, axis2=-1))
    assert np.abs(error.std(axis=0) / stated - 1).max() < 0.01
    assert mean_squares(error, covariance).mean() == pytest.approx(6, rel=0.05)


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_stated_deviations_of_robust_solutions(loss: Loss) -> None:
    """On normal noise a robust loss loses a twentieth or so, and its deviations are within 10 %."""
    found, _ = repeated("opencv", loss)
    params = np.array([one.camera.params for one in found])
    stated = np.sqrt(np.mean([np.diag(one.param_covariance) for one in found], axis=0))
    assert np.abs(params.std(axis=0) / stated - 1).max() < 0.1
    plain = np.array([one.camera.params for one in repeated("opencv")[0]])
    efficiency = (plain.std(axis=0) / params.std(axis=0)) ** 2
    assert 0.85 < efficiency.min() < efficiency.max() < 1.05


def best_rotation(camera: Camera, true: Camera) -> Array:
    """The rotation by which a camera shows the true rays nearest to their pixels over the image; Gauss-Newton."""
    pixel = image_grid(true.image_size, *GRID).reshape(-1, 2)
    ray = rays(true, pixel)
    rotation = np.eye(3)
    for _ in range(4):
        here = project(camera, ray @ rotation.T)
        steps = [project(camera, ray @ (exp_rotation(1e-6 * axis) @ rotation).T) for axis in np.eye(3)]
        slope = np.stack([(step - here).ravel() / 1e-6 for step in steps], axis=1)
        turn, *_ = np.linalg.lstsq(slope, (pixel - here).ravel(), rcond=None)
        rotation = exp_rotation(np.asarray(turn, dtype=np.float64)) @ rotation
    return rotation


@pytest.mark.parametrize("case", ["opencv", "luhmann weighted"])
def test_stated_uncertainty_over_the_image_is_true(case: str) -> None:
    """Where solved cameras show the true directions, turned to fit best, scatters as stated: within 5 %, all over."""
    found, _ = repeated(case)
    true = true_camera(case)
    pixel = image_grid(true.image_size, 5, 4).reshape(-1, 2)
    shown = np.array([project(one.camera, rays(true, pixel) @ best_rotation(one.camera, true).T) for one in found])
    stated = np.mean(
        [moved_covariance(projected_change(one.camera, pixel), one.param_covariance) for one in found], axis=0
    )
    scatter = np.einsum("rni,rnj->nij", shown - pixel, shown - pixel) / RUNS
    assert np.abs(np.sqrt(np.trace(scatter, axis1=1, axis2=2) / np.trace(stated, axis1=1, axis2=2)) - 1).max() < 0.05
    size = np.sqrt(np.einsum("nii,njj->nij", stated, stated))
    assert (np.abs(scatter - stated) < 0.1 * size).all()


def test_the_worse_axis_is_stated() -> None:
    """`projected_sigma_px` is the root of the covariance's larger eigenvalue."""
    found, _ = repeated("opencv")
    one = found[0]
    pixel = image_grid(one.camera.image_size, 7, 5).reshape(-1, 2)
    covariance = moved_covariance(projected_change(one.camera, pixel), one.param_covariance)
    expected = np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])
    assert np.abs(projected_sigma_px(one.camera, one.param_covariance, pixel) - expected).max() < 1e-9


def test_uncertainty_is_unknown_where_the_camera_shows_nothing() -> None:
    """Beyond the lens's fold the deviation is nan, and it spoils nothing elsewhere."""
    lens = np.array([600.0, 600, 499.5, 399.5, -0.9, 0, 0, 0, 0])
    folding = Camera("opencv", lens, (1000, 800))
    covariance = 1e-6 * np.diag([1.0, 1, 1, 1, 1, 1, 1, 1, 1])
    sigma = projected_sigma_px(folding, covariance, np.array([[499.5, 399.5], [0.0, 0.0]]))
    assert np.isfinite(sigma).tolist() == [True, False]


def test_a_pure_turn_of_the_camera_is_no_uncertainty() -> None:
    """A change of the principal point that a turn undoes is removed: of a long lens next to nothing of it remains."""
    for focal, most in ((1e6, 1e-3), (2500.0, 0.5)):
        camera = Camera("pinhole", np.array([focal, focal, 1223.5, 1023.5]), (2448, 2048))
        sigma = projected_sigma_px(camera, np.diag([0.0, 0, 1, 1]), image_grid(camera.image_size, 5, 5).reshape(-1, 2))
        assert sigma.max() < most
