"""The solver's kernels against dense linear algebra and finite differences."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import parameter_names, project
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, make_pose, transform
from calib.core.types import KnownPoints, Observations
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import KNEE, RobustLoss, view_blocks, view_misfit
from calib.solver.levenberg import move_poses
from calib.solver.linear_pose import LinearViews, poses_of
from calib.solver.problem import Loss, SolveOptions, few_per_view, pack, select, tie_parameters
from calib.solver.schur import damped_step, reduced_blocks
from calib.solver.start import coarse_camera
from designer.base.arrays import Array, Rows
from tests.support.solver_scenes import CAMERAS, board, observe, poses_around, random_covariances

VIEWS = 4


def scene(model: str) -> tuple[Observations, Array]:
    """Observations with covariances, and poses a little off the true ones."""
    rng = np.random.default_rng(1)
    poses = poses_around(VIEWS, rng)
    seen = observe(CAMERAS[model], board(5, 4, 40.0), poses, rng, noise_px=0.5, kept_share=0.8)
    seen = replace(seen, cov_px2=random_covariances(len(seen.view), rng))
    return seen, move_poses(poses, 1e-3 * rng.standard_normal((VIEWS, 6)))


def whitened(seen: Observations, camera: Camera, poses: Array) -> Array:
    """Residuals (M, 2) in standard deviations, straight from their definition."""
    pixel = project(camera, transform(poses[seen.view], seen.points.position_mm[seen.point]))
    residual: Array = np.zeros_like(pixel)
    assert seen.cov_px2 is not None
    for m, covariance in enumerate(seen.cov_px2):
        residual[m] = np.linalg.solve(np.linalg.cholesky(covariance), pixel[m] - seen.center_px[m])
    return residual


def jacobian(seen: Observations, camera: Camera, poses: Array) -> Array:
    """Derivatives (M, 2, P + 6 V) of the whitened residuals by parameters and poses, by central differences."""
    parameters = len(camera.params)
    columns = []
    for k, value in enumerate(camera.params.tolist()):
        h = 1e-5 * max(abs(value), 1.0)
        step = h * np.eye(parameters)[k]
        ends = [whitened(seen, replace(camera, params=camera.params + sign * step), poses) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * h))
    for view in range(len(poses)):
        for k in range(6):
            ends = [whitened(seen, camera, moved_by_definition(poses, view, k, sign * 1e-5)) for sign in (1, -1)]
            columns.append((ends[0] - ends[1]) / 2e-5)
    return np.stack(columns, axis=2)


def moved_by_definition(poses: Array, view: int, axis: int, amount: float) -> Array:
    """Poses with one of them turned about a camera axis, the target's origin standing still, or shifted along one."""
    moved = np.array(poses)
    if axis < 3:
        moved[view, :3, :3] = exp_rotation(amount * np.eye(3)[axis]) @ poses[view, :3, :3]
    else:
        moved[view, axis - 3, 3] += amount
    return moved


def loss_and_weight(kind: Loss, knee: float, length: Array) -> tuple[Array, Array]:
    """Huber's and Cauchy's losses as published, in the scale of squares, and their derivatives by the square."""
    square = length**2
    if kind == "huber":
        return np.where(length <= knee, square, 2 * knee * length - knee**2), np.minimum(1, knee / length)
    if kind == "cauchy":
        return knee**2 * np.log(1 + square / knee**2), 1 / (1 + square / knee**2)
    return square, np.ones_like(length)


@pytest.mark.parametrize("kind", KNEE)
@pytest.mark.parametrize("model", CAMERAS)
def test_blocks_are_the_products_of_jacobians(model: str, kind: Loss) -> None:
    """A view's block is `[J r]' W [J r]` of its used observations, J by differences, W the robust weights."""
    seen, poses = scene(model)
    camera = CAMERAS[model]
    is_used = np.random.default_rng(3).random(len(seen.view)) < 0.8
    loss = RobustLoss(kind, 4.0)
    blocks = view_blocks(replace(pack(seen, weighted=True), is_used=is_used), camera, poses, loss)
    residual, slope = whitened(seen, camera, poses), jacobian(seen, camera, poses)
    cost, weight = loss_and_weight(kind, KNEE[kind] * loss.sigma, np.linalg.norm(residual, axis=1))
    assert kind == "squares" or 0.1 < (weight < 1).mean() < 1.1
    parameters = len(camera.params)
    for view in range(VIEWS):
        rows = is_used & (seen.view == view)
        first = parameters + 6 * view
        own = np.r_[0:parameters, first : first + 6]
        j = np.concatenate([slope[rows][:, :, own], residual[rows][:, :, None]], axis=2)
        expected = np.einsum("m,mai,maj->ij", weight[rows], j, j)
        size = np.sqrt(np.diag(expected))
        assert (np.abs(blocks.products[view] - expected) < 3e-6 * size[:, None] * size).all()  # of the differences
        assert blocks.cost[view] == pytest.approx(cost[rows].sum(), rel=1e-9)
    pixel = project(camera, transform(poses[seen.view], seen.points.position_mm[seen.point]))
    assert np.abs(blocks.residual_px.T - (pixel - seen.center_px)).max() < 1e-9


@pytest.mark.parametrize("kind", KNEE)
@pytest.mark.parametrize("model", CAMERAS)
def test_parts_of_the_blocks_are_those_of_the_whole(model: str, kind: Loss) -> None:
    """Residuals, poses or gradients alone are the same as in whole blocks, also of points without an image."""
    seen, poses = scene(model)
    hidden = np.array(poses)
    hidden[0, 2, 3] = -hidden[0, 2, 3]  # behind the camera
    problem = replace(pack(seen, weighted=True), is_used=(seen.view != 0) | (kind != "squares"))
    camera, loss = CAMERAS[model], RobustLoss(kind, 4.0)
    whole = view_blocks(problem, camera, hidden, loss)
    misfit = view_misfit(problem, camera, hidden, loss)
    assert np.isnan(misfit.residual_px[:, seen.view == 0]).all()
    np.testing.assert_allclose(misfit.residual_px, whole.residual_px, rtol=0, atol=1e-9)
    np.testing.assert_allclose(misfit.cost, whole.cost, rtol=1e-9)
    of_poses = view_blocks(problem, camera, hidden, loss, of_poses=True)
    np.testing.assert_allclose(of_poses.products, whole.products[:, -7:, -7:], rtol=1e-12)
    elsewhere = view_blocks(problem, camera, poses, loss).products
    renewed = view_blocks(problem, camera, hidden, loss, near=elsewhere).products
    np.testing.assert_array_equal(renewed[:, :-1, :-1], elsewhere[:, :-1, :-1])
    size = np.sqrt(np.einsum("vii->vi", whole.products) * whole.products[:, -1:, -1]) + 1e-300
    for gradient in (renewed[:, -1], renewed[:, :, -1]):
        assert (np.abs(gradient - whole.products[:, -1]) <= 1e-12 * size).all()


def dense(products: Array, free: Rows) -> tuple[Array, Array]:
    """The whole normal matrix and gradient over free parameters and all poses, put together from the blocks."""
    views, parameters, count = len(products), len(free), int(free.max(initial=-1)) + 1
    normal, gradient = np.zeros((count + 6 * views,) * 2), np.zeros(count + 6 * views)
    for view, block in enumerate(products):
        spread = np.zeros((parameters + 6, count + 6 * views))
        spread[np.flatnonzero(free >= 0), free[free >= 0]] = 1
        spread[parameters:, count + 6 * view : count + 6 * view + 6] = np.eye(6)
        normal += spread.T @ block[:-1, :-1] @ spread
        gradient += spread.T @ block[:-1, -1]
    return normal, gradient


TIES = {
    "free": SolveOptions(),
    "fixed": SolveOptions(fixed=(("k2", 0.0), ("fx_px", 2500.0))),
    "shared": SolveOptions(shared=(("fx_px", "fy_px"), ("p1", "p2"))),
    "all fixed": SolveOptions(fixed=tuple((name, None) for name in parameter_names("opencv"))),
}


@pytest.mark.parametrize("damping", [0.0, 1e-3, 10.0])
@pytest.mark.parametrize("case", TIES)
def test_the_step_is_that_of_the_dense_equations(case: str, damping: float) -> None:
    """With the poses eliminated, the step and what it promises are those of the damped dense normal equations."""
    seen, poses = scene("opencv")
    blocks = view_blocks(pack(seen, weighted=True), CAMERAS["opencv"], poses, RobustLoss())
    free = tie_parameters("opencv", TIES[case]).row
    normal, gradient = dense(blocks.products, free)
    damped = np.array(normal)
    # Parameters that share a value are damped by the sum of their own diagonal entries.
    diagonal = np.diag(normal).copy()
    for k in range(int(free.max(initial=-1)) + 1):
        diagonal[k] = sum(np.trace(block[np.ix_(free == k, free == k)]) for block in blocks.products[:, :9, :9])
    damped[np.diag_indices(len(damped))] += damping * diagonal
    scale = 1 / np.sqrt(np.diag(damped))
    expected = -scale * np.linalg.solve(damped * scale[:, None] * scale, gradient * scale)
    step = damped_step(blocks.products, free, damping)
    found = np.concatenate([step.free, step.pose.ravel()])
    assert step.solvable
    assert (np.abs(found - expected) < 1e-8 * np.abs(expected) + 1e-10 * scale).all()
    promised = -(2 * gradient @ expected + expected @ normal @ expected)
    assert step.predicted == pytest.approx(promised, rel=1e-8)


@pytest.mark.parametrize("case", TIES)
def test_covariances_are_the_inverse_of_the_dense_equations(case: str) -> None:
    """Covariances of parameters and poses are blocks of the inverted dense normal matrix, times the scale squared."""
    seen, poses = scene("opencv")
    blocks = view_blocks(pack(seen, weighted=True), CAMERAS["opencv"], poses, RobustLoss())
    free = tie_parameters("opencv", TIES[case]).row
    normal, _ = dense(blocks.products, free)
    scale = 1 / np.sqrt(np.diag(normal))
    inverse = scale[:, None] * np.linalg.inv(normal * scale[:, None] * scale) * scale
    accuracy = accuracy_of(blocks.products, free, len(seen.view))
    count = int(free.max(initial=-1)) + 1
    spread = (free[:, None] == np.arange(count)).astype(float)
    expected_scale = np.sqrt(blocks.products[:, -1, -1].sum() / (2 * len(seen.view) - len(normal)))
    assert accuracy.scale == pytest.approx(expected_scale, rel=1e-12)
    expected = expected_scale**2 * spread @ inverse[:count, :count] @ spread.T
    size = np.sqrt(np.diag(expected))
    assert (np.abs(accuracy.param_covariance - expected) <= 1e-6 * size[:, None] * size).all()
    for view in range(VIEWS):
        rows = slice(count + 6 * view, count + 6 * view + 6)
        expected = expected_scale**2 * inverse[rows, rows]
        size = np.sqrt(np.diag(expected))
        assert (np.abs(accuracy.pose_covariance[view] - expected) < 1e-6 * size[:, None] * size).all()


def test_reduced_blocks_are_schur_complements() -> None:
    """A view's block without its pose is `[A a; a' s] - [B g]' C^-1 [B g]`."""
    seen, poses = scene("opencv")
    products = view_blocks(pack(seen, weighted=True), CAMERAS["opencv"], poses, RobustLoss()).products
    pose = np.arange(products.shape[1])[-7:-1]
    rest = np.setdiff1d(np.arange(products.shape[1]), pose)
    for block, reduced in zip(products, reduced_blocks(products), strict=True):
        mixed = block[np.ix_(pose, rest)]
        dense = block[np.ix_(rest, rest)] - mixed.T @ np.linalg.solve(block[np.ix_(pose, pose)], mixed)
        size = np.sqrt(np.diagonal(block)[rest])
        assert np.abs((reduced - dense) / size / size[:, None]).max() < 1e-10


def test_blocks_do_not_depend_on_how_views_are_grouped() -> None:
    """Blocks of many views at once, in several runs, are those of each view on its own."""
    rng = np.random.default_rng(2)
    poses = poses_around(30, rng)
    seen = observe(CAMERAS["luhmann"], board(13, 11, 16.0), poses, rng, noise_px=0.5)
    problem = pack(seen, weighted=False)
    together = view_blocks(problem, CAMERAS["luhmann"], poses, RobustLoss())
    assert len(seen.view) > 2000
    for view in (0, 13, 14, 15, 29):
        alone = view_blocks(select(problem, np.array([view]), 10**6), CAMERAS["luhmann"], poses[[view]], RobustLoss())
        assert np.array_equal(alone.products[0], together.products[view])
        assert np.array_equal(alone.residual_px, together.residual_px[:, seen.view == view])


def test_moving_a_pose_turns_it_about_the_camera_axes() -> None:
    """A pose's step is `exp(w) R` and `t + s`, small turns and large ones."""
    rng = np.random.default_rng(0)
    step = rng.standard_normal((6, 6)) * np.array([0, 1e-9, 1e-5, 1e-2, 1, 3])[:, None]
    poses = poses_around(6, rng)
    expected = make_pose(exp_rotation(step[:, :3]) @ poses[:, :3, :3], poses[:, :3, 3] + step[:, 3:])
    assert np.abs(move_poses(poses, step) - expected).max() < 1e-13


def whole_grid(columns: int, rows: int, views: int) -> Observations:
    """Views that show a whole grid, row by row, each point at its own column and row."""
    u, v = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float))
    grid = np.stack([u.ravel(), v.ravel()], axis=1)
    count = columns * rows
    points = KnownPoints(
        np.column_stack([grid, np.zeros(count)]), np.zeros(count, dtype=np.int64), np.array([[0, 0, 1.0, 0]])
    )
    return Observations(
        (columns, rows), tuple(f"view{n}" for n in range(views)), np.repeat(np.arange(views), count),
        np.tile(np.arange(count), views), np.tile(grid, (views, 1)), None, points,
    )  # fmt: skip


@pytest.mark.parametrize("columns", [2, 3, 7, 15, 21, 24, 25, 40, 50])
def test_a_few_points_of_a_grid_span_it(columns: int) -> None:
    """The few observations taken of a view spread over its points in both directions, whatever their order's period."""
    for views in (1, 16, 20, 32, 33, 60):
        for rows in (12, 24, 25, 40, 50):
            problem = pack(whole_grid(columns, rows, views), weighted=False)
            few = select(problem, np.arange(views), few_per_view(views))
            for view in {0, views // 2, views - 1}:
                place = few.measured_px[:, few.view_start[view] : few.view_start[view + 1]]
                whole = np.array([[columns - 1], [rows - 1]]) / np.sqrt(12)
                assert (place.std(axis=1, keepdims=True) > 0.6 * whole).all(), (columns, rows, views)
                assert np.linalg.matrix_rank(place - place.mean(axis=1, keepdims=True)) == 2


def test_observations_that_do_not_count_are_never_taken() -> None:
    """The few observations of a view are used ones, each at most once, and all of them where there are few."""
    is_used = np.random.default_rng(0).random(4410) < 0.1
    is_used[441:882] = False
    few = select(replace(pack(whole_grid(21, 21, 10), weighted=False), is_used=is_used), np.arange(10), 30)
    assert np.diff(few.view_start).tolist() == np.minimum(is_used.reshape(10, -1).sum(axis=1), 30).tolist()
    for view in range(10):
        taken = few.measured_px[:, few.view_start[view] : few.view_start[view + 1]]
        index = (taken[0] + 21 * taken[1]).astype(int)
        assert len(np.unique(index)) == len(index)
        assert is_used.reshape(10, -1)[view][index].all()


def test_the_start_does_not_depend_on_the_scale_of_covariances() -> None:
    """Whether a start will do is told in pixels: large covariances do not make a senseless first guess a good one."""
    seen, _ = scene("opencv")
    tie = tie_parameters("opencv", SolveOptions())
    assert seen.cov_px2 is not None
    cameras = []
    for scale in (1e-4, 1e8):
        problem = pack(replace(seen, cov_px2=scale * seen.cov_px2), weighted=True)
        cameras.append(coarse_camera(problem, "opencv", tie.row, tie.value, 30.0, is_robust=False))
    assert cameras[1].params == pytest.approx(cameras[0].params, rel=1e-6)


def test_linear_poses_are_turned_to_the_nearest_rotation() -> None:
    """Of a transform whose axes are not square, or left-handed, the pose has the rotation nearest to them (by SVD)."""
    rng = np.random.default_rng(4)
    motion = exp_rotation(rng.standard_normal((6, 3)))
    axes = motion + 0.2 * rng.standard_normal((6, 3, 3))
    axes[3:] *= -1
    origin = rng.standard_normal((6, 3, 1))
    views = LinearViews(np.concatenate([axes, origin], axis=2), np.tile(np.eye(4), (6, 1, 1)), np.zeros(6, dtype=bool))
    pose = poses_of(views)
    u, _, vt = np.linalg.svd(axes)
    nearest = u @ vt
    np.testing.assert_allclose(pose[:, :3, :3], nearest * np.linalg.det(nearest)[:, None, None], atol=1e-12)
    length = np.linalg.norm(axes, axis=1).mean(axis=1)
    np.testing.assert_allclose(pose[:, :3, 3], origin[:, :, 0] / length[:, None], atol=1e-12)
    views.projection[0] = np.nan
    assert np.isnan(poses_of(views)[0]).all()
