"""What may not change a solution, or changes it in a known way."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.core.se3 import compose, exp_rotation, make_pose
from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.solver_scenes import (
    CAMERAS,
    NOISE_PX,
    board,
    icosahedron,
    moved_points,
    observe,
    poses_around,
    random_covariances,
    sigma_of,
)

LENSES = ("opencv", "luhmann")
SAME = 1e-3
"""Two descents end so near the minimum, in standard deviations."""
RUNS = settings(max_examples=6, deadline=None, derandomize=True)
SEEDS = st.integers(0, 2**32 - 1)


def scene(rng: np.random.Generator, views: int = 7, model: str = "opencv") -> Observations:
    """Noisy observations of a board or an icosahedron."""
    solid = bool(rng.integers(2))
    poses = poses_around(views, rng, half_angle_deg=180 if solid else 50)
    points = icosahedron() if solid else board()
    return observe(CAMERAS[model], points, poses, rng, noise_px=NOISE_PX, kept_share=0.5)


def assert_same_camera(one: Calibration, other: Calibration) -> None:
    """Parameters within a thousandth of their deviations, and covariances within rounding."""
    sigma = sigma_of(one.param_covariance)
    assert one.status == other.status == "converged"
    assert (np.abs(one.camera.params - other.camera.params) < SAME * sigma).all()
    assert (np.abs(other.param_covariance - one.param_covariance) < 1e-3 * sigma[:, None] * sigma).all()


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES))
def test_the_order_of_views_does_not_matter(seed: int, model: str) -> None:
    """Views in another order give the same camera, and their own poses and residuals."""
    rng = np.random.default_rng(seed)
    seen = scene(rng, model=model)
    order = rng.permutation(seen.view_count)
    rows = np.concatenate([np.flatnonzero(seen.view == view) for view in order])
    shuffled = replace(
        seen,
        view_names=tuple(seen.view_names[view] for view in order),
        view=np.argsort(order)[seen.view[rows]],
        point=seen.point[rows],
        center_px=seen.center_px[rows],
    )
    one, other = solve(seen, model), solve(shuffled, model)
    assert_same_camera(one, other)
    assert np.abs(other.cam_from_target - one.cam_from_target[order]).max() < 1e-3
    assert np.abs(other.residual_px - one.residual_px[rows]).max() < 1e-4


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES), distance=st.floats(0, 1000))
def test_the_frame_of_the_target_does_not_matter(seed: int, model: str, distance: float) -> None:
    """Points in a turned and shifted frame give the same camera, and poses that undo the motion."""
    rng = np.random.default_rng(seed)
    seen = scene(rng, model=model)
    direction = rng.standard_normal(3)
    motion = make_pose(exp_rotation(rng.uniform(-3, 3, 3)), distance * direction / np.linalg.norm(direction))
    one = solve(seen, model)
    other = solve(replace(seen, points=moved_points(seen.points, motion)), model)
    assert_same_camera(one, other)
    here = compose(other.cam_from_target, motion)
    assert np.abs(here[:, :3, 3] - one.cam_from_target[:, :3, 3]).max() < 1e-3
    assert np.abs(here[:, :3, :3] - one.cam_from_target[:, :3, :3]).max() < 1e-6


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES), scale=st.floats(1e-3, 1e3))
def test_the_size_of_the_target_does_not_matter(seed: int, model: str, scale: float) -> None:
    """A target of another size gives the same camera; distances and their deviations grow with it, angles do not."""
    seen = scene(np.random.default_rng(seed), model=model)
    one = solve(seen, model)
    other = solve(replace(seen, points=moved_points(seen.points, np.eye(4), scale)), model)
    assert_same_camera(one, other)
    far = np.linalg.norm(one.cam_from_target[:, :3, 3], axis=1, keepdims=True)
    assert np.abs((other.cam_from_target[:, :3, 3] / scale - one.cam_from_target[:, :3, 3]) / far).max() < 1e-6
    growth = np.repeat([1.0, scale], 3)
    expected = one.pose_covariance * growth[:, None] * growth
    size = sigma_of(expected)
    assert (np.abs(other.pose_covariance - expected) < 1e-3 * size[:, :, None] * size[:, None, :]).all()


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES))
def test_the_resolution_of_the_image_does_not_matter(seed: int, model: str) -> None:
    """With twice the pixels, u' = 2u + 0.5: focal lengths double, the centre follows, lens and poses stay."""
    seen = scene(np.random.default_rng(seed), model=model)
    width, height = seen.image_size
    finer = replace(seen, image_size=(2 * width, 2 * height), center_px=2 * seen.center_px + 0.5)
    one, other = solve(seen, model), solve(finer, model)
    params = np.array(other.camera.params)
    params[2:4] -= 0.5
    params[:4] /= 2
    assert (np.abs(params - one.camera.params) < SAME * sigma_of(one.param_covariance)).all()
    assert np.abs(other.cam_from_target - one.cam_from_target).max() < 1e-3
    assert other.scale == pytest.approx(2 * one.scale, rel=1e-6)


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES), sigma_px=st.floats(1e-3, 10))
def test_equal_weights_are_no_weights(seed: int, model: str, sigma_px: float) -> None:
    """Covariances that are all alike change nothing but the scale, which is then in their unit."""
    seen = scene(np.random.default_rng(seed), model=model)
    alike = replace(seen, cov_px2=np.tile(sigma_px**2 * np.eye(2), (len(seen.view), 1, 1)))
    one, other = solve(seen, model), solve(alike, model, SolveOptions(weighted=True))
    assert_same_camera(one, other)
    assert other.weighted
    assert other.scale == pytest.approx(one.scale / sigma_px, rel=1e-6)


@RUNS
@given(seed=SEEDS, model=st.sampled_from(LENSES))
def test_a_view_twice_counts_twice(seed: int, model: str) -> None:
    """All views twice give the same camera, and half its covariance per unit of scale."""
    seen = scene(np.random.default_rng(seed), model=model)
    views = seen.view_count
    twice = replace(
        seen,
        view_names=seen.view_names + tuple(f"again {name}" for name in seen.view_names),
        view=np.concatenate([seen.view, seen.view + views]),
        point=np.tile(seen.point, 2),
        center_px=np.tile(seen.center_px, (2, 1)),
    )
    one, other = solve(seen, model), solve(twice, model)
    sigma = sigma_of(one.param_covariance)
    assert (np.abs(one.camera.params - other.camera.params) < SAME * sigma).all()
    half = one.param_covariance / one.scale**2 / 2
    assert (
        np.abs(other.param_covariance / other.scale**2 - half) < 1e-3 * sigma_of(half)[:, None] * sigma_of(half)
    ).all()


@pytest.mark.parametrize(
    "options",
    [SolveOptions(), SolveOptions(weighted=True), SolveOptions(reject_sigma=4.0), SolveOptions(loss="cauchy")],
    ids=["squares", "weighted", "reject", "cauchy"],
)
def test_two_runs_are_bit_for_bit_the_same(options: SolveOptions) -> None:
    """The same observations give the same bits, whatever was solved between."""
    rng = np.random.default_rng(0)
    seen = scene(rng, views=20)
    seen = replace(seen, cov_px2=random_covariances(len(seen.view), rng))
    one = solve(seen, "opencv", options)
    solve(scene(rng), "luhmann")
    other = solve(seen, "opencv", options)
    assert np.array_equal(one.camera.params, other.camera.params)
    for name in ("cam_from_target", "residual_px", "param_covariance", "pose_covariance", "is_outlier"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def test_the_first_guess_of_the_focal_length_does_not_matter() -> None:
    """A person's guess, good or bad, changes the start only."""
    seen = scene(np.random.default_rng(8))
    one = solve(seen, "opencv")
    for guess in (300.0, 2000.0, 30000.0):
        assert_same_camera(one, solve(seen, "opencv", SolveOptions(focal_px=guess)))
