"""Outliers are found, left out and said; robust losses stand them."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.types import Observations
from calib.solver.problem import Loss, SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Flags
from designer.base.errors import InputError
from tests.support.solver_scenes import CAMERAS, board, icosahedron, observe, poses_around, rows_of, sigma_of

NOISE_PX = 0.02
VIEWS = 12


def scene(target: str = "board", camera: Camera | None = None, distance_mm: float = 400.0) -> Observations:
    """Observations with little noise and no outliers."""
    rng = np.random.default_rng(11)
    half_angle = 180.0 if target == "icosahedron" else 50.0
    points = icosahedron() if target == "icosahedron" else board(21, 21, 10.0)
    poses = poses_around(VIEWS, rng, half_angle_deg=half_angle, distance_mm=distance_mm)
    return observe(camera or CAMERAS["opencv"], points, poses, rng, noise_px=NOISE_PX)


def spoiled(seen: Observations, share: float, how: str) -> tuple[Observations, Flags]:
    """A share of observations measured elsewhere, or named after another point."""
    rng = np.random.default_rng(5)
    bad = rng.random(len(seen.view)) < share
    pixel, point = np.array(seen.center_px), np.array(seen.point)
    if how == "moved":
        step = rng.standard_normal((int(bad.sum()), 2))
        pixel[bad] += step / np.linalg.norm(step, axis=1, keepdims=True) * rng.uniform(2, 300, (len(step), 1))
    else:
        for view in range(seen.view_count):
            rows = np.flatnonzero(bad & (seen.view == view))
            point[rows] = np.roll(point[rows], 1)
            bad[rows] &= len(rows) > 1
    return replace(seen, center_px=pixel, point=point), bad


@pytest.mark.parametrize("how", ["moved", "misnamed"])
@pytest.mark.parametrize("target", ["board", "icosahedron"])
@pytest.mark.parametrize("share", [0.002, 0.2])
def test_gross_outliers_are_all_left_out_and_said(share: float, target: str, how: str) -> None:
    """Up to a fifth of gross outliers: all are left out and counted, next to no good ones, and the camera is right."""
    seen, bad = spoiled(scene(target), share, how)
    found = solve(seen, "opencv", SolveOptions(reject_sigma=4.5))
    assert found.status == "converged"
    assert len(found.cam_from_target) == VIEWS
    assert found.is_outlier[bad].all()
    assert (found.is_outlier & ~bad).mean() < 5e-4
    assert f"{found.is_outlier.sum()} of {len(bad)} observations" in found.remarks[-1]
    assert found.scale == pytest.approx(NOISE_PX, rel=0.05)
    sigma = sigma_of(found.param_covariance)
    assert (np.abs(found.camera.params - CAMERAS["opencv"].params) < 4.5 * sigma).all()
    assert np.linalg.norm(found.residual_px[bad], axis=1).min() > 1


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_robust_losses_stand_outliers(loss: Loss) -> None:
    """With a twentieth of outliers a robust loss still finds the camera, and leaves nothing out."""
    seen, bad = spoiled(scene(), 0.05, "moved")
    plain, robust = solve(seen, "opencv"), solve(seen, "opencv", SolveOptions(loss=loss))
    truth = CAMERAS["opencv"].params
    sigma = sigma_of(robust.param_covariance)
    assert robust.status == "converged"
    assert not robust.is_outlier.any()
    assert (np.abs(robust.camera.params - truth) < 6 * sigma).all()
    assert abs(plain.camera.params[0] - truth[0]) > 20 * abs(robust.camera.params[0] - truth[0])
    assert sigma[0] < 0.2
    assert bad.any()


@pytest.mark.parametrize("loss", ["huber", "cauchy"])
def test_robust_losses_cost_little_on_clean_data(loss: Loss) -> None:
    """Without outliers a robust loss ends within a standard deviation of least squares, and is about as sure."""
    seen = scene()
    plain, robust = solve(seen, "opencv"), solve(seen, "opencv", SolveOptions(loss=loss))
    sigma = sigma_of(plain.param_covariance)
    assert (np.abs(robust.camera.params - plain.camera.params) < sigma).all()
    assert np.abs(sigma_of(robust.param_covariance) / sigma - 1).max() < 0.15
    assert robust.scale == pytest.approx(NOISE_PX, rel=0.05)


def test_clean_data_lose_next_to_nothing() -> None:
    """Of clean observations as many are beyond the limit as a normal distribution says: exp(-k^2/2) of all."""
    seen = scene()
    found = solve(seen, "opencv", SolveOptions(reject_sigma=3.0))
    expected = np.exp(-4.5) * len(seen.view)
    assert abs(found.is_outlier.sum() - expected) < 5 * np.sqrt(expected)


def test_outliers_that_nobody_asked_to_reject_are_said() -> None:
    """Without rejection nothing is left out; a remark counts what noise cannot explain and names the worst photo."""
    seen = scene()
    pixel = np.array(seen.center_px)
    first = int(np.flatnonzero(seen.view == 7)[30])
    pixel[first] += 3.0
    found = solve(replace(seen, center_px=pixel), "opencv")
    assert not found.is_outlier.any()
    assert any("1 of" in remark and "view7.png" in remark for remark in found.remarks)


def test_a_photo_that_makes_no_sense_does_not_spoil_the_others() -> None:
    """One view of random pixels: the others give the right camera, and the view is named or its points left out."""
    seen = scene()
    pixel = np.array(seen.center_px)
    bad = seen.view == 0
    pixel[bad] = np.random.default_rng(1).uniform(0, 2000, (int(bad.sum()), 2))
    found = solve(replace(seen, center_px=pixel), "opencv", SolveOptions(reject_sigma=4.5))
    assert found.status == "converged"
    sigma = sigma_of(found.param_covariance)
    assert (np.abs(found.camera.params - CAMERAS["opencv"].params) < 5 * sigma).all()
    left_out = "view0.png" not in found.observations.view_names
    assert left_out or found.is_outlier[bad].mean() > 0.99
    assert any("view0.png" in remark or "left out" in remark for remark in found.remarks)


@pytest.mark.parametrize("noise_px", [1.0, 30.0, 1000.0])
@pytest.mark.parametrize("target", ["board", "icosahedron"])
def test_a_photo_of_nothing_but_noise_does_not_spoil_the_others(target: str, noise_px: float) -> None:
    """One view too noisy by any amount: the others' camera is found, even if hardly a point of that view is left."""
    seen = scene(target)
    for which in (0, 6):
        rng = np.random.default_rng(which)
        bad = seen.view == which
        pixel = seen.center_px + noise_px * bad[:, None] * rng.standard_normal(seen.center_px.shape)
        found = solve(replace(seen, center_px=pixel), "opencv", SolveOptions(reject_sigma=4.5))
        assert found.status == "converged"
        sigma = sigma_of(found.param_covariance)
        assert (np.abs(found.camera.params - CAMERAS["opencv"].params) < 5 * sigma).all()
        assert found.scale < 1.1 * NOISE_PX


@pytest.mark.parametrize("share", [0.01, 0.2])
def test_points_named_wrong_that_the_lens_cannot_show(share: float) -> None:
    """Wide lens, board larger than the image: wrong names of points beyond the lens's fold are outliers like others."""
    lens = np.array([900.0, 900, 1230, 1010, -0.25, 0.06, 0, 0, -0.006])
    camera = Camera("opencv", lens, (2448, 2048))
    seen = scene("board", camera, 100.0)
    rng = np.random.default_rng(2)
    bad = rng.random(len(seen.view)) < share
    point = np.array(seen.point)
    point[bad] = rng.integers(0, 441, int(bad.sum()))
    bad &= point != seen.point
    found = solve(replace(seen, point=point), "opencv", SolveOptions(reject_sigma=4.5))
    assert found.status == "converged"
    assert len(found.cam_from_target) == VIEWS
    assert found.is_outlier[bad].all()
    assert (found.is_outlier & ~bad).mean() < 1e-3


@pytest.mark.parametrize("options", [SolveOptions(), SolveOptions(reject_sigma=4.0), SolveOptions(loss="huber")])
def test_nonsense_is_called_so(options: SolveOptions) -> None:
    """Random pixels give no camera: degenerate with a reason, or refused; never a converged result."""
    seen = rows_of(scene(), np.arange(0, len(scene().view), 5))
    pixel = np.random.default_rng(3).uniform(0, 2000, seen.center_px.shape)
    try:
        found = solve(replace(seen, center_px=pixel), "opencv", options)
    except InputError as error:
        said = str(error)
    else:
        assert found.status == "degenerate"
        said = found.remarks[0]
    assert "belong together" in said


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_limit_that_leaves_nothing_is_refused(limit: float) -> None:
    """A rejection limit must be more than zero."""
    with pytest.raises(InputError):
        solve(scene(), "opencv", SolveOptions(reject_sigma=limit))
