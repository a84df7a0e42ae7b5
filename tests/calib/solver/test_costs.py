"""What a solution minimises: distances in the image and in space."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import Observations
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.costs import COSTS, IMAGE
from calib.solver.in_space import in_space
from calib.solver.levenberg import move_poses
from calib.solver.metrics.errors import predict
from calib.solver.metrics.intersection import intersection
from calib.solver.problem import Problem, SolveOptions, origin_poses, pack
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.solver_scenes import CAMERAS, SIZE, board, icosahedron, observe, poses_around

IN_SPACE = tuple(name for name in COSTS if name != IMAGE)
WIDE = Camera("ds", np.array([700.0, 701.0, 1230.0, 1010.0, -0.25, 0.57]), SIZE)


def scene(camera: Camera, *, noise_px: float, views: int = 4, seed: int = 0) -> tuple[Observations, Array]:
    """An icosahedron before a camera."""
    rng = np.random.default_rng(seed)
    distance_mm = 400.0 if camera is not WIDE else 150.0
    poses = poses_around(views, rng, distance_mm=distance_mm)
    return observe(camera, icosahedron(), poses, rng, noise_px=noise_px), poses


def spaced(seen: Observations, poses: Array, name: str) -> tuple[Problem, Array]:
    """The problem of a cost, and the poses from its own origin."""
    problem = pack(seen, weighted=False)
    return in_space(problem, name, seen.points, seen.point), origin_poses(problem, poses)


@pytest.mark.parametrize("name", IN_SPACE)
@pytest.mark.parametrize("camera", [CAMERAS["opencv"], WIDE], ids=lambda one: one.model)
def test_gradients_are_the_costs(camera: Camera, name: str) -> None:
    """By parameters and poses, of distances weighed unlike along their axes; of residuals as large as they come."""
    seen, poses = scene(camera, noise_px=3.0)
    problem, poses = spaced(seen, poses, name)
    weights = np.abs(np.random.default_rng(1).normal(1, 0.5, problem.whitener.shape))
    problem = replace(problem, whitener=weights)

    def cost(step: Array) -> float:
        moved = replace(camera, params=camera.params + step[:-6])
        turned = move_poses(poses, np.vstack([step[-6:], np.zeros((len(poses) - 1, 6))]))
        return float(view_blocks(problem, moved, turned, RobustLoss()).cost.sum())

    products = view_blocks(problem, camera, poses, RobustLoss()).products
    size = len(camera.params)
    told = 2 * np.concatenate([products[:, :size, -1].sum(axis=0), products[0, size : size + 6, -1]])
    length = np.array([1e-2] * 4 + [1e-6] * (size - 4) + [1e-5] * 3 + [1e-3] * 3)
    found = [(cost(length[k] * e) - cost(-length[k] * e)) / (2 * length[k]) for k, e in enumerate(np.eye(size + 6))]
    largest = float(np.abs(told * length).max())
    np.testing.assert_allclose(told * length, np.array(found) * length, rtol=2e-5, atol=1e-6 * largest)


def test_distances_are_what_they_are_called() -> None:
    """Of a ray the rest of the point beside it, in the plane the paper's intersection error; over the range, angles."""
    seen, poses = scene(CAMERAS["opencv"], noise_px=2.0)
    camera = CAMERAS["opencv"]
    place = transform(poses[seen.view], seen.points.position_mm[seen.point])
    ray = rays(camera, seen.center_px)
    along = (ray * place).sum(axis=1)
    beside = np.linalg.norm(place - along[:, None] * ray, axis=1)
    known = Calibration(
        camera=camera, observations=seen, cam_from_target=poses, residual_px=np.zeros_like(seen.center_px),
        is_outlier=np.zeros(len(ray), bool), scale=1.0, param_covariance=np.zeros((9, 9)),
        pose_covariance=np.zeros((len(poses), 6, 6)), fixed=(), weighted=False, status="converged", remarks=(),
        iterations=0, seconds=0.0,
    )  # fmt: skip
    in_plane = intersection(predict(known)).size
    in_image = np.linalg.norm(project(camera, place) - seen.center_px, axis=1)
    expected = {"ray": beside, "ray-by-range": beside / along, "intersection": in_plane, "whitened": in_image}
    for name, distance in expected.items():
        problem, moved = spaced(seen, poses, name)
        found = np.hypot(*view_blocks(problem, camera, moved, RobustLoss()).residual_px)
        tolerance = 1e-3 if name == "whitened" else 1e-9  # two pixels are some thousandths of a radian
        np.testing.assert_allclose(found, distance, rtol=tolerance, err_msg=name)


@pytest.mark.parametrize("name", IN_SPACE)
def test_perfect_photos_give_the_camera_whatever_is_minimised(name: str) -> None:
    """Without noise all costs have the same minimum."""
    seen, poses = scene(WIDE, noise_px=0.0, views=6)
    found = solve(seen, "ds", SolveOptions(minimise=name))
    assert found.status == "converged"
    np.testing.assert_allclose(found.camera.params, WIDE.params, rtol=1e-8)
    np.testing.assert_allclose(found.cam_from_target, poses, atol=1e-6)


@pytest.mark.parametrize("loss", ["squares", "huber"])
def test_whitened_is_the_image_to_first_order(loss: str) -> None:
    """A wrong covariance of the rays would show as hundredths of a standard deviation, as distances without it do."""
    seen, _ = scene(WIDE, noise_px=0.2, views=8)
    image, whitened, plain = (
        solve(seen, "ds", SolveOptions(minimise=name, loss="huber" if loss == "huber" else "squares"))
        for name in (IMAGE, "whitened", "ray")
    )
    sigma = np.sqrt(np.diagonal(image.param_covariance))
    assert (np.abs(whitened.camera.params - image.camera.params) < 2e-3 * sigma).all()
    assert (np.abs(plain.camera.params - image.camera.params) > 2e-2 * sigma).any()


def test_what_a_cost_does_to_the_camera_is_stated() -> None:
    """Distances in planes pull the camera by several standard deviations of the noise; the covariance has it."""
    camera, squares = CAMERAS["opencv"], []
    for seed in range(6):
        seen, _ = scene(camera, noise_px=0.1, views=8, seed=seed)
        found = solve(seen, "opencv", SolveOptions(minimise="intersection"))
        off = found.camera.params - camera.params
        squares.append(float(off @ np.linalg.solve(found.param_covariance, off)))
    assert np.mean(squares) < 1.6 * len(camera.params)


def test_outliers_of_the_image_stay_out_of_space() -> None:
    """What is rejected in pixels is not minimised in mm."""
    seen, _ = scene(CAMERAS["opencv"], noise_px=0.1, views=8)
    wrong = np.arange(0, len(seen.view), 37)
    pixel = np.array(seen.center_px)
    pixel[wrong] += 30.0
    found = solve(replace(seen, center_px=pixel), "opencv", SolveOptions(minimise="ray", reject_sigma=5.0))
    assert set(np.flatnonzero(found.is_outlier)) >= set(wrong)
    clean = solve(seen, "opencv", SolveOptions(minimise="ray"))
    sigma = np.sqrt(np.diagonal(clean.param_covariance))
    assert (np.abs(found.camera.params - clean.camera.params) < sigma).all()


def test_planes_that_are_not_known_are_asked_for() -> None:
    """A point on no face cannot be intersected with; rays do without."""
    rng = np.random.default_rng(0)
    seen = observe(CAMERAS["opencv"], board(), poses_around(6, rng), rng, noise_px=0.1)
    bare = replace(seen, points=replace(seen.points, face=np.full_like(seen.points.face, -1)))
    with pytest.raises(InputError, match="lie on no known plane; take ray"):
        solve(bare, "opencv", SolveOptions(minimise="intersection"))
    assert solve(bare, "opencv", SolveOptions(minimise="ray")).status == "converged"
    with pytest.raises(InputError, match=r"minimise 'rays': there are image, ray"):
        solve(seen, "opencv", SolveOptions(minimise="rays"))
