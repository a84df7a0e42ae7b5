"""Poses of a target for a known camera."""

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, log_rotation, look_at, rotation_between, transform
from calib.solver.solve import solve
from calib.solver.start import solve_poses
from designer.base.arrays import Array, Rows
from tests.support.solver_scenes import (
    CAMERAS,
    NOISE_PX,
    board,
    icosahedron,
    noisy,
    observe,
    poses_around,
    random_covariances,
    rows_of,
    sigma_of,
    with_one_face,
)

TARGETS = {"board": board(), "icosahedron": icosahedron()}
HALF_ANGLE_DEG = {"board": 60.0, "icosahedron": 180.0}


def errors(found: Array, true: Array) -> Array:
    """Rotation vector (rad) and shift (mm) from the true poses to the found ones, in the camera's axes.  # (V, 6)"""
    turn = log_rotation(found[:, :3, :3] @ true[:, :3, :3].transpose(0, 2, 1))
    return np.concatenate([turn, found[:, :3, 3] - true[:, :3, 3]], axis=1)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("model", CAMERAS)
def test_true_poses_are_found_without_noise(model: str, target: str) -> None:
    """Without noise the true poses come back, to 1e-9 rad and 1e-6 mm."""
    rng = np.random.default_rng(0)
    poses = poses_around(30, rng, half_angle_deg=HALF_ANGLE_DEG[target])
    found = solve_poses(CAMERAS[model], observe(CAMERAS[model], TARGETS[target], poses, rng))
    error = np.abs(errors(found.cam_from_target, poses))
    assert error[:, :3].max() < 1e-9
    assert error[:, 3:].max() < 1e-6
    assert np.abs(found.residual_px).max() < 1e-8


WIDE = {
    "fisheye": Camera("fisheye", np.array([300.0, 300.0, 641.5, 478.5, 0.01, -0.004, 0.001, 0.0]), (1280, 960)),
    "ds": Camera("ds", np.array([260.0, 261.0, 645.0, 482.0, -0.25, 0.57]), (1280, 960)),
    "equirectangular": Camera("equirectangular", np.array([250.0, 250.0, 799.5, 399.5]), (1600, 800)),
}


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("camera", WIDE.values(), ids=WIDE)
def test_poses_beside_and_behind_a_wide_camera_are_found(camera: Camera, target: str) -> None:
    """The true poses come back from 40 to 120 degrees off the axis, without a first guess."""
    rng = np.random.default_rng(1)
    poses = poses_around(24, rng, half_angle_deg=HALF_ANGLE_DEG[target])
    angle, side = np.radians(np.linspace(40, 120, 24)), rng.uniform(0, 2 * np.pi, 24)
    ahead = np.stack([np.sin(angle) * np.cos(side), np.sin(angle) * np.sin(side), np.cos(angle)], axis=1)
    place = poses[:, :3, 3] / np.linalg.norm(poses[:, :3, 3], axis=1, keepdims=True)
    poses[:, :3] = rotation_between(place, ahead) @ poses[:, :3]
    poses = poses[[len(observe(camera, TARGETS[target], pose[None], rng).point) >= 12 for pose in poses]]
    assert (poses[:, 2, 3] < 0).sum() >= 5
    found = solve_poses(camera, observe(camera, TARGETS[target], poses, rng))
    error = np.abs(errors(found.cam_from_target, poses))
    assert error[:, :3].max() < 1e-7
    assert error[:, 3:].max() < 1e-4


@pytest.mark.parametrize("target", TARGETS)
def test_poses_are_those_of_scipy_with_opencv(target: str) -> None:
    """Scipy's least squares over cv2.projectPoints, from the true poses, ends at the same ones."""
    rng = np.random.default_rng(1)
    poses = poses_around(6, rng, half_angle_deg=HALF_ANGLE_DEG[target])
    seen = observe(CAMERAS["opencv"], TARGETS[target], poses, rng, noise_px=NOISE_PX)
    found = solve_poses(CAMERAS["opencv"], seen)
    fx, fy, cx, cy, *lens = CAMERAS["opencv"].params.tolist()
    matrix, distortion = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(lens)
    start = np.concatenate([log_rotation(poses[:, :3, :3]), poses[:, :3, 3]], axis=1)
    for view in range(6):
        rows = np.flatnonzero(seen.view == view)
        position, measured = seen.points.position_mm[seen.point[rows]], seen.center_px[rows]

        def residual(motion: Array, position: Array = position, measured: Array = measured) -> Array:
            pixel, _ = cv2.projectPoints(position, motion[:3], motion[3:], matrix, distortion)
            off: Array = (pixel[:, 0] - measured).ravel()
            return off

        best = least_squares(residual, start[view], jac="3-point", x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15)
        sigma = sigma_of(found.covariance[view])
        rotation = exp_rotation(best.x[:3])
        assert (np.abs(log_rotation(found.cam_from_target[view, :3, :3] @ rotation.T)) < 1e-4 * sigma[:3]).all()
        assert (np.abs(found.cam_from_target[view, :3, 3] - best.x[3:]) < 1e-4 * sigma[3:]).all()
        assert (found.residual_px[rows] ** 2).sum() == pytest.approx(2 * best.cost, rel=1e-9)


@pytest.mark.parametrize("weighted", [False, True])
def test_stated_deviations_of_poses_are_true(weighted: bool) -> None:
    """Standard deviations of poses agree with repeated measurement within 10 %, and so does the whole covariance."""
    rng = np.random.default_rng(2)
    poses = poses_around(400, rng, half_angle_deg=55)
    camera = CAMERAS["opencv"]
    seen = observe(camera, board(6, 5, 30.0), poses, rng)
    if weighted:
        covariance = random_covariances(len(seen.view), rng)
        step = np.linalg.cholesky(covariance) @ rng.standard_normal((len(seen.view), 2, 1))
        seen = replace(seen, cov_px2=covariance, center_px=seen.center_px + step[:, :, 0])
    else:
        seen = noisy(seen, NOISE_PX, rng)
    found = solve_poses(camera, seen, weighted=weighted)
    error = errors(found.cam_from_target, poses)
    standard = error / sigma_of(found.covariance)
    assert np.abs(np.sqrt((standard**2).mean(axis=0)) - 1).max() < 0.1
    squares = np.einsum("vi,vij,vj->v", error, np.linalg.inv(found.covariance), error)
    assert squares.mean() == pytest.approx(6, rel=0.1)
    assert found.scale == pytest.approx(1.0 if weighted else NOISE_PX, rel=0.02)


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), focal_times=st.floats(1, 12), tilt_deg=st.floats(15, 60))
def test_far_planes_are_not_turned_over(seed: int, focal_times: float, tilt_deg: float) -> None:
    """Of the two poses that a distant plane leaves, the better is found, also with a long lens and from any side."""
    rng = np.random.default_rng(seed)
    width, height = 2448, 2048
    focal = focal_times * width
    camera = Camera("pinhole", np.array([focal, focal, width / 2, height / 2]), (width, height))
    angle = rng.uniform(0, 2 * np.pi, 10)
    distance = 200.0 * focal / height
    tilt = np.radians(tilt_deg)
    eye = distance * np.column_stack(
        [np.sin(tilt) * np.cos(angle), np.sin(tilt) * np.sin(angle), np.full(10, np.cos(tilt))]
    )
    poses = look_at(eye, rng.normal(0, 5, (10, 3)), rng.uniform(-np.pi, np.pi, 10))
    seen = observe(camera, board(9, 7, 18.0), poses, rng, noise_px=0.02)
    found = solve_poses(camera, seen)
    assert np.abs(errors(found.cam_from_target, poses)[:, :3]).max() < np.radians(3)
    at_truth = project(camera, transform(poses[seen.view], seen.points.position_mm[seen.point])) - seen.center_px
    for view in range(10):
        rows = seen.view == view
        assert (found.residual_px[rows] ** 2).sum() <= (at_truth[rows] ** 2).sum()


def test_a_long_lens_is_calibrated_without_views_turned_over() -> None:
    """Calibrated from scratch through a long lens, every view of a plane is tilted to the side it was."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        focal = float(rng.uniform(6, 12)) * 2448
        camera = Camera("opencv", np.array([focal, focal, 1230, 1010, -0.5, 0, 0, 0, 0]), (2448, 2048))
        poses = poses_around(12, rng, half_angle_deg=45, distance_mm=200 * focal / 2048)
        seen = observe(camera, board(15, 15, 10.0), poses, rng, noise_px=0.02)
        found = solve(seen, "opencv")
        assert found.scale == pytest.approx(0.02, rel=0.1)
        assert np.abs(errors(found.cam_from_target, poses)[:, :3]).max() < np.radians(2)


def test_a_view_without_pose_is_nan_and_the_others_are_not_touched() -> None:
    """Three points, or points on a line, give nan for that view alone."""
    rng = np.random.default_rng(3)
    seen = observe(CAMERAS["opencv"], TARGETS["board"], poses_around(5, rng), rng, noise_px=NOISE_PX)
    whole = solve_poses(CAMERAS["opencv"], seen)
    few = np.flatnonzero(seen.view == 1)[:3]
    line = np.flatnonzero((seen.view == 3) & (seen.points.position_mm[seen.point, 0] == 0))
    rows = np.sort(np.concatenate([np.flatnonzero((seen.view != 1) & (seen.view != 3)), few, line]))
    part = rows_of(seen, rows)
    found = solve_poses(CAMERAS["opencv"], part)
    lost = np.isnan(found.cam_from_target[:, 0, 0])
    assert lost.tolist() == [False, True, False, True, False]
    assert np.isnan(found.covariance).all(axis=(1, 2)).tolist() == lost.tolist()
    assert np.array_equal(np.isnan(found.residual_px).all(axis=1), lost[part.view])
    assert np.abs(found.cam_from_target[~lost] - whole.cam_from_target[~lost]).max() < 1e-8
    assert np.isfinite(found.scale)


def test_nothing_but_lost_views_has_no_scale() -> None:
    """If no view has a pose, all is nan and nothing fails."""
    rng = np.random.default_rng(3)
    seen = observe(CAMERAS["opencv"], TARGETS["board"], poses_around(1, rng), rng)
    found = solve_poses(CAMERAS["opencv"], rows_of(seen, np.arange(3)))
    assert np.isnan(found.cam_from_target).all()
    assert np.isnan(found.scale)


@pytest.mark.parametrize("points", [4, 5, 6, 8])
@pytest.mark.parametrize("target", TARGETS)
def test_a_few_points_are_enough(target: str, points: int) -> None:
    """Four points or more, no three on a line, give a pose, in a plane or not."""
    rng = np.random.default_rng(4)
    poses = poses_around(40, rng, half_angle_deg=HALF_ANGLE_DEG[target])
    seen = observe(CAMERAS["opencv"], TARGETS[target], poses, rng, noise_px=0.001)
    rows = []
    for view in range(40):
        of_view = np.flatnonzero(seen.view == view)
        rows.append(spread_points(seen.center_px[of_view], points, rng, of_view))
    part = rows_of(seen, np.sort(np.concatenate(rows)))
    found = solve_poses(CAMERAS["opencv"], part)
    assert np.isfinite(found.cam_from_target).all()
    error = np.abs(errors(found.cam_from_target, poses))
    assert np.median(error[:, 3:].max(axis=1)) < 0.05
    assert error[:, :3].max() < np.radians(1)


def spread_points(pixel: Array, count: int, rng: np.random.Generator, rows: Rows) -> Rows:
    """Of many random choices of points the one whose flattest triangle is largest: no three on a line."""

    def flattest(choice: Rows) -> float:
        corners = np.array(list(combinations(pixel[choice], 3)))
        one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        return float(np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).min())

    choices = [rng.choice(len(pixel), count, replace=False) for _ in range(30)]
    return rows[max(choices, key=flattest)]


@pytest.mark.parametrize("extra", [1, 3])
def test_one_ring_beside_a_plane_does_not_cost_the_pose(extra: int) -> None:
    """A whole face and a ring or two of another have a pose as good as the face alone."""
    rng = np.random.default_rng(5)
    poses = poses_around(20, rng, half_angle_deg=180)
    seen = observe(CAMERAS["opencv"], TARGETS["icosahedron"], poses, rng, noise_px=NOISE_PX)
    found = solve_poses(CAMERAS["opencv"], with_one_face(seen, extra, rng))
    assert np.isfinite(found.cam_from_target).all()
    standard = errors(found.cam_from_target, poses) / sigma_of(found.covariance)
    assert np.abs(standard).max() < 5


def test_poses_from_a_far_origin() -> None:
    """Points in a frame with a far origin have the same camera centre's place among them."""
    rng = np.random.default_rng(6)
    poses = poses_around(10, rng)
    seen = observe(CAMERAS["opencv"], TARGETS["board"], poses, rng, noise_px=NOISE_PX)
    offset = 1e6 * np.array([1.0, -0.5, 0.3])
    here = solve_poses(CAMERAS["opencv"], seen)
    points = replace(seen.points, position_mm=seen.points.position_mm + offset)
    there = solve_poses(CAMERAS["opencv"], replace(seen, points=points))
    middle = there.cam_from_target[:, :3, :3] @ offset + there.cam_from_target[:, :3, 3]
    assert there.scale == pytest.approx(here.scale, rel=1e-6)
    assert np.abs(middle - here.cam_from_target[:, :3, 3]).max() < 1e-3
    assert np.abs(there.cam_from_target[:, :3, :3] - here.cam_from_target[:, :3, :3]).max() < 1e-6
