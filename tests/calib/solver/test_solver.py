"""The solver finds the truth, and the same minimum as other solvers."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from calib.cameras import parameter_names, project
from calib.cameras.camera import Camera
from calib.core.se3 import make_pose, transform
from calib.core.types import KnownPoints, Observations, keep_views
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from tests.support.solver_scenes import (
    CAMERAS,
    NOISE_PX,
    board,
    icosahedron,
    observe,
    pose_from,
    poses_around,
    random_covariances,
    rows_of,
    sigma_of,
    with_one_face,
)

TARGETS = {"board": board(), "icosahedron": icosahedron()}
ICO_HALF_ANGLE_DEG = 180.0


def scene(
    model: str, target: str, views: int = 6, noise_px: float = 0.0, kept_share: float = 1.0
) -> tuple[Observations, Array]:
    """Observations of a known camera, and the true poses."""
    rng = np.random.default_rng(7)
    half_angle = ICO_HALF_ANGLE_DEG if target == "icosahedron" else 50.0
    poses = poses_around(views, rng, half_angle_deg=half_angle)
    return observe(CAMERAS[model], TARGETS[target], poses, rng, noise_px=noise_px, kept_share=kept_share), poses


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("model", CAMERAS)
def test_truth_is_found_without_noise(model: str, target: str) -> None:
    """Without noise the true camera and poses come back: parameters to 1e-8 of themselves, poses to 1e-8 rad and mm."""
    seen, poses = scene(model, target)
    found = solve(seen, model)
    assert found.status == "converged"
    assert found.remarks == ()
    true = CAMERAS[model].params
    assert np.abs(found.camera.params / true - 1).max() < 1e-8
    assert np.abs(found.cam_from_target[:, :3, :3] - poses[:, :3, :3]).max() < 1e-8
    assert np.abs(found.cam_from_target[:, :3, 3] - poses[:, :3, 3]).max() < 1e-6
    assert np.abs(found.residual_px).max() < 1e-8


@pytest.mark.parametrize("model", CAMERAS)
def test_one_photo_of_an_icosahedron_is_enough(model: str) -> None:
    """A single photo of an icosahedron gives its camera, and with noise one within four standard deviations of it."""
    rng = np.random.default_rng(3)
    poses = pose_from((130.0, 250.0, 260.0))
    exact = observe(CAMERAS[model], TARGETS["icosahedron"], poses, rng)
    true = CAMERAS[model].params
    found = solve(exact, model)
    assert found.status == "converged"
    assert np.abs(found.camera.params / true - 1).max() < 1e-7
    noisy = solve(replace(exact, center_px=exact.center_px + 0.02 * rng.standard_normal(exact.center_px.shape)), model)
    assert noisy.status == "converged"
    sigma = sigma_of(noisy.param_covariance)
    assert (np.abs(noisy.camera.params - true) < 4 * sigma).all()
    assert sigma[0] < 0.002 * true[0]


def test_the_minimum_is_that_of_opencv() -> None:
    """cv2.calibrateCamera, fed the same numbers, ends at the same parameters, to 1e-6 of each or 1e-4 sigma."""
    seen, _ = scene("opencv", "board", views=12, noise_px=NOISE_PX)
    seen = replace(seen, center_px=seen.center_px.astype(np.float32).astype(np.float64))
    ours = solve(seen, "opencv")
    rows = [np.flatnonzero(seen.view == view) for view in range(seen.view_count)]
    position = [seen.points.position_mm[seen.point[row]].astype(np.float32) for row in rows]
    pixel = [seen.center_px[row].astype(np.float32) for row in rows]
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-15)
    rms, matrix, lens, turns, shifts = cv2.calibrateCamera(position, pixel, seen.image_size, None, None, criteria=stop)
    theirs = np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *lens.ravel()])
    difference = np.abs(ours.camera.params - theirs)
    assert (difference < np.maximum(1e-6 * np.abs(theirs), 1e-4 * sigma_of(ours.param_covariance))).all()
    assert np.sqrt((ours.residual_px**2).sum(axis=1).mean()) == pytest.approx(rms, rel=1e-9)
    rotation = Rotation.from_rotvec(np.array(turns)[:, :, 0]).as_matrix()
    assert np.abs(ours.cam_from_target[:, :3, :3] - rotation).max() < 1e-6
    assert np.abs(ours.cam_from_target[:, :3, 3] - np.array(shifts)[:, :, 0]).max() < 1e-4


def photogrammetric_pixels(params: Array, point: Array) -> Array:
    """Model `luhmann` as published, y up: the measured point is the ideal one plus the offset *there*; by iteration."""
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = params
    ideal = np.stack([point[:, 0] / point[:, 2], -point[:, 1] / point[:, 2]])
    x, y = ideal
    for _ in range(60):
        square = x**2 + y**2
        radial = square * (k1 + square * (k2 + square * k3))
        x, y = (
            ideal[0] + radial * x + p1 * (square + 2 * x**2) + 2 * p2 * x * y,
            ideal[1] + radial * y + p2 * (square + 2 * y**2) + 2 * p1 * x * y,
        )
    return np.stack([cx + fx * x, cy - fy * y], axis=1)


def scipy_minimum(
    seen: Observations, start: Array, poses: Array, free: Array, *, weighted: bool
) -> tuple[Array, float]:
    """Parameters and sum of squares by scipy.optimize.least_squares.

    Args:
        seen: what was seen.
        start: parameters to start from; fixed ones keep their values.
        poses: to start from.
        free: which of the first unknowns each parameter follows (P,); -1: fixed.
        weighted: by the covariances.
    """
    count = int(free.max()) + 1
    position = seen.points.position_mm[seen.point]
    whitener = np.tile(np.eye(2), (len(position), 1, 1))
    if weighted and seen.cov_px2 is not None:
        whitener = np.linalg.inv(np.linalg.cholesky(seen.cov_px2))

    def params_of(unknown: Array) -> Array:
        return np.where(free >= 0, unknown[free], start)

    def residual(unknown: Array) -> Array:
        motion = unknown[count:].reshape(-1, 6)
        pose = make_pose(Rotation.from_rotvec(motion[:, :3]).as_matrix(), motion[:, 3:])
        pixel = photogrammetric_pixels(params_of(unknown), transform(pose[seen.view], position))
        whitened: Array = (whitener @ (pixel - seen.center_px)[:, :, None]).ravel()
        return whitened

    first = [start[free == k].mean() for k in range(count)]
    turn = Rotation.from_matrix(poses[:, :3, :3]).as_rotvec()
    unknown = np.concatenate([first, np.concatenate([turn, poses[:, :3, 3]], axis=1).ravel()])
    found = least_squares(residual, unknown, jac="3-point", x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15)
    return params_of(found.x), 2 * float(found.cost)


SCIPY_CASES = {
    "free": SolveOptions(),
    "all three": SolveOptions(
        weighted=True, fixed=(("k3", 0.0), ("cy_px", 1005.0)), shared=(("p1", "p2"), ("fx_px", "fy_px"))
    ),
}


@pytest.mark.parametrize("case", SCIPY_CASES)
def test_the_minimum_is_that_of_scipy(case: str) -> None:
    """Model `luhmann` ends where scipy ends with the published formula, also weighted, with fixed and shared values."""
    options = SCIPY_CASES[case]
    rng = np.random.default_rng(7)
    camera = replace(CAMERAS["luhmann"], params=np.array([2500.0, 2500, 1230, 1010, -0.12, 0.05, 0.01, 3e-4, 3e-4]))
    poses = poses_around(3, rng, half_angle_deg=ICO_HALF_ANGLE_DEG)
    seen = observe(camera, TARGETS["icosahedron"], poses, rng, noise_px=NOISE_PX, kept_share=0.2)
    seen = replace(seen, cov_px2=random_covariances(len(seen.view), np.random.default_rng(2)))
    ours = solve(seen, "luhmann", options)
    names, start = parameter_names("luhmann"), np.array(camera.params)
    fixed = dict(options.fixed)
    follows = {name: group[0] for group in options.shared for name in group}
    leaders = [name for name in names if name not in fixed and follows.get(name, name) == name]
    free = np.array([-1 if name in fixed else leaders.index(follows.get(name, name)) for name in names])
    for name, value in fixed.items():
        start[names.index(name)] = value
    # By the covariances as the residuals have them.
    theirs, squares = scipy_minimum(ours.observations, start, poses, free, weighted=options.weighted)
    sigma = np.maximum(sigma_of(ours.param_covariance), 1e-300)
    assert ours.status == "converged"
    assert (np.abs(ours.camera.params - theirs) <= 3e-5 * sigma).all()
    assert squares_of(ours) == pytest.approx(squares, rel=1e-9)


def squares_of(found: Calibration) -> float:
    """Sum of the whitened squared residuals."""
    if not found.weighted or found.observations.cov_px2 is None:
        return float((found.residual_px**2).sum())
    inverse = np.linalg.inv(found.observations.cov_px2)
    return float(np.einsum("mi,mij,mj", found.residual_px, inverse, found.residual_px))


def test_fixed_parameters_keep_their_values() -> None:
    """Fixed parameters have exactly their values and no uncertainty, shared ones one value, and both are named."""
    seen, _ = scene("opencv", "board", noise_px=NOISE_PX)
    options = SolveOptions(fixed=(("k3", 0.0), ("cx_px", 1231.5)), shared=(("fx_px", "fy_px"),))
    found = solve(seen, "opencv", options)
    assert found.fixed == ("k3", "cx_px")
    assert found.camera.params[[2, 8]].tolist() == [1231.5, 0.0]
    assert np.abs(found.param_covariance[[2, 8]]).max() == 0
    assert found.camera.params[0] == found.camera.params[1]
    assert found.param_covariance[0, 0] == pytest.approx(found.param_covariance[0, 1], rel=1e-12)


def test_residuals_are_predicted_minus_measured() -> None:
    """Residuals are the projected points less the measured ones, and the scale is their posterior deviation."""
    seen, _ = scene("luhmann", "board", views=8, noise_px=NOISE_PX)
    found = solve(seen, "luhmann")
    point = transform(found.cam_from_target[seen.view], seen.points.position_mm[seen.point])
    assert np.abs(project(found.camera, point) - seen.center_px - found.residual_px).max() < 1e-9
    redundancy = found.residual_px.size - 9 - 6 * 8
    assert found.scale == pytest.approx(np.sqrt((found.residual_px**2).sum() / redundancy), rel=1e-9)
    assert found.scale == pytest.approx(NOISE_PX, rel=0.05)


def random_scene(rng: np.random.Generator) -> Observations:
    """A camera from wide to long, with up to a quarter of distortion, before any of three targets."""
    name = str(rng.choice(["board", "icosahedron", "few points"]))
    points = {"few points": board(10, 7, 10.0), **TARGETS}[name]
    width, height = ((2448, 2048), (1024, 768), (640, 480), (4000, 3000))[rng.integers(4)]
    focal = width * np.exp(rng.uniform(np.log(0.5), np.log(5)))
    corner = np.hypot(width, height) / 2 / focal
    lens = [rng.uniform(-0.25, 0.15) / corner**2, rng.uniform(-0.03, 0.03) / corner**4, 0.0]
    middle = np.array([width, height]) / 2 + 0.02 * width * rng.normal(size=2)
    params = [focal, focal * rng.uniform(0.98, 1.02), *middle, *lens, *(1e-3 / corner * rng.normal(size=2))]
    extent = {"board": 220.0, "icosahedron": 190.0, "few points": 100.0}[name]
    distance = extent * focal / width * rng.uniform(1.0, 1.6) + (95.0 if name == "icosahedron" else 0.0)
    half_angle = ICO_HALF_ANGLE_DEG if name == "icosahedron" else rng.uniform(25, 60)
    poses = poses_around(
        int(rng.choice([3, 5, 10, 40])), rng, half_angle_deg=half_angle, distance_mm=distance, aim_mm=0.1 * extent
    )
    camera = Camera("luhmann", np.array(params), (width, height))
    seen = observe(camera, points, poses, rng, noise_px=NOISE_PX, kept_share=rng.uniform(0.3, 1))
    return keep_views(seen, np.bincount(seen.view, minlength=len(poses)) >= 8)


LONG_DESCENTS = (70, 169, 301, 309, 487, 897)
"""Scenes with a curved valley (a long lens, three radial terms, little of the image used) that cost many steps."""


@pytest.mark.parametrize("seed", [*range(12), *LONG_DESCENTS])
def test_random_scenes_are_solved_from_scratch(seed: int) -> None:
    """Any lens from wide to long, 3 to 40 views of any target: no view is lost and noise is all that is left.

    The other lens model cannot fit as well, but well enough never to lose a view or stop short.
    """
    seen = random_scene(np.random.default_rng(1000 + seed))
    right, other = solve(seen, "luhmann"), solve(seen, "opencv")
    assert right.remarks == ()
    assert right.scale < 1.2 * NOISE_PX
    assert other.status == "converged"
    assert len(other.cam_from_target) == seen.view_count
    assert other.scale < 10 * NOISE_PX


@pytest.mark.parametrize(("columns", "rows", "views"), [(15, 24, 40), (50, 50, 16)])
def test_boards_of_any_count_are_started(columns: int, rows: int, views: int) -> None:
    """Whatever the numbers of rings and views, the few points a start is made from span the board."""
    pitch = 220 / max(columns, rows)
    points = board(columns, rows, pitch)
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], points, poses_around(views, rng), rng, noise_px=NOISE_PX)
    found = solve(seen, "opencv")
    assert found.remarks == ()
    assert found.scale < 1.1 * NOISE_PX


def test_views_of_the_middle_do_not_spoil_those_of_the_corners() -> None:
    """Where only some views reach the image's corners, the lens guessed from the others loses none of them."""
    rng = np.random.default_rng(0)
    for _ in range(2):
        seen = observe(CAMERAS["opencv"], TARGETS["board"], poses_around(32, rng), rng, noise_px=NOISE_PX)
        middle = np.linalg.norm(seen.center_px - [1230, 1010], axis=1) < 300
        found = solve(rows_of(seen, (seen.view % 2 == 0) | middle), "opencv")
        assert found.remarks == ()
        assert found.scale < 1.1 * NOISE_PX


@pytest.mark.parametrize("extra", [0, 1, 3])
def test_a_face_and_a_few_rings_beside_it(extra: int) -> None:
    """Views that show one face of an icosahedron and a ring or two of another are solved; none is left out."""
    rng = np.random.default_rng(5)
    poses = poses_around(20, rng, half_angle_deg=180)
    seen = observe(CAMERAS["opencv"], TARGETS["icosahedron"], poses, rng, noise_px=NOISE_PX)
    found = solve(with_one_face(seen, extra, rng), "opencv")
    assert found.remarks == ()
    assert found.scale < 1.2 * NOISE_PX


def test_the_origin_may_be_far_from_the_target() -> None:
    """Points given in a frame whose origin is far away are solved as well."""
    seen, _ = scene("opencv", "board", views=8, noise_px=NOISE_PX)
    here = solve(seen, "opencv")
    points = seen.points
    far = replace(points, position_mm=points.position_mm + 1e6 * np.array([1.0, -0.5, 0.3]))
    there = solve(replace(seen, points=far), "opencv")
    assert there.status == "converged"
    assert there.scale == pytest.approx(here.scale, rel=1e-6)
    assert (np.abs(there.camera.params - here.camera.params) < 1e-2 * sigma_of(here.param_covariance)).all()


def test_points_on_no_plane_are_solved() -> None:
    """Points anywhere in space serve as well as those of a target."""
    rng = np.random.default_rng(4)
    points = KnownPoints(rng.uniform(-60, 60, (200, 3)), np.zeros(200, dtype=np.int64), np.array([[0, 0, 1.0, 0]]))
    seen = observe(CAMERAS["opencv"], points, poses_around(5, rng), rng, noise_px=NOISE_PX)
    seen = replace(seen, points=replace(points, face=np.full(200, -1), plane=np.zeros((0, 4))))
    found = solve(seen, "opencv")
    assert found.status == "converged"
    assert found.scale == pytest.approx(NOISE_PX, rel=0.1)
