"""Where the solution starts: a first camera and first poses, without prior knowledge."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import MODELS, rays
from calib.cameras.camera import Camera
from calib.solver.blocks import RobustLoss, view_misfit
from calib.solver.levenberg import Minimum, minimise, minimise_poses
from calib.solver.linear_pose import focal_of, linear_views, poses_of, weak_perspective_poses
from calib.solver.outliers import forgetful
from calib.solver.problem import MANY, Problem, few_per_view, select

Array = NDArray[np.float64]

FEW_VIEWS = 16
FOCALS = (0.5, 0.8, 1.3, 2.2, 4.0, 8.0)
"""First guesses of the focal length where the views do not tell, in units of the image's longer side."""
GOOD_FIT = 5e-4
"""Root mean square residual, as a part of the image's longer side, of a start that needs no other tried."""
COARSE_STEPS = 25
LEAST_POINTS = 4
"""Of a view, for a pose."""


def first_camera(model: str, image_size: tuple[int, int], focal_px: float) -> Camera:
    """A camera without distortion, its principal point in the middle of the image."""
    params = np.zeros(len(MODELS[model].parameters))
    params[:4] = focal_px, focal_px, 0.5 * (image_size[0] - 1), 0.5 * (image_size[1] - 1)
    return Camera(model, params, image_size)


def coarse_camera(
    problem: Problem, model: str, tie: NDArray[np.int64], fixed: Array, focal_px: float | None, *, is_robust: bool
) -> Camera:
    """A camera from a few observations of a few views, good enough to start all of them.

    Args:
        problem: what was seen.
        model: the camera's.
        tie: the free parameter that each parameter follows (P,); -1: fixed.
        fixed: values of the parameters that have one from the start (P,), nan of the others.
        focal_px: first guess of a person.
        is_robust: start from what most observations of a view agree on.
    """
    views = _spread_views(problem)
    few = select(problem, views, few_per_view(len(views)))
    side = max(problem.image_size)
    best: Minimum | None = None
    best_cost = np.inf
    for focal in _focals(few, focal_px, side, is_robust=is_robust):
        camera = _with_fixed(first_camera(model, problem.image_size, focal), tie, fixed)
        found = _solve_few(few, camera, tie, is_robust=is_robust)
        if found is None:
            continue
        square = (found.blocks.residual_px**2).sum(axis=0)
        cost = float(np.nanmedian(square) if is_robust else square.mean())  # in pixels, whatever the weights
        if cost < best_cost:
            best, best_cost = found, cost
        if cost < (GOOD_FIT * side) ** 2:
            break
    if best is None:
        return _with_fixed(first_camera(model, problem.image_size, focal_px or float(side)), tie, fixed)
    return best.camera


def _spread_views(problem: Problem) -> NDArray[np.int64]:
    """Views that are evenly spread over their order."""
    used = np.add.reduceat(problem.is_used.astype(np.int64), problem.view_start[:-1])
    views = np.flatnonzero(used >= LEAST_POINTS)
    if len(views) <= FEW_VIEWS:
        return views
    return views[((np.arange(FEW_VIEWS) + 0.5) * len(views) / FEW_VIEWS).astype(np.int64)]


def _focals(few: Problem, focal_px: float | None, side: int, *, is_robust: bool) -> list[float]:
    """First guesses, the most likely one first."""
    middle = 0.5 * (np.array(few.image_size) - 1)
    centred = (few.measured_px - middle[:, None]) / side
    found = focal_of(linear_views(few.view_start, few.position_mm, centred, is_robust=is_robust))
    likely = [] if focal_px is None else [focal_px]
    likely += [found * side] if 0.1 < found < 50 else []
    return [*likely, *(factor * side for factor in FOCALS)]


def _with_fixed(camera: Camera, tie: NDArray[np.int64], fixed: Array) -> Camera:
    """The camera with a person's values, and one value for parameters that are to share it."""
    params = np.where(np.isnan(fixed), camera.params, fixed)
    free = tie >= 0
    params[free] = (np.bincount(tie[free], params[free]) / np.bincount(tie[free]))[tie[free]]
    return replace(camera, params=params)


def _solve_few(few: Problem, camera: Camera, tie: NDArray[np.int64], *, is_robust: bool) -> Minimum | None:
    """Poses from linear equations, then all unknowns together, the distortion last."""
    poses = linear_poses(few, camera, is_robust=is_robust)
    ok: NDArray[np.bool_] = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    if not ok.any():
        return None
    few = select(few, np.flatnonzero(ok), MANY)
    loss = RobustLoss()
    if is_robust:
        loss = forgetful(view_misfit(few, camera, poses[ok], loss).residual_px)
    found = minimise_poses(few, camera, poses[ok], loss, max_iterations=3, small_decrease=1e-2)
    seen = np.isfinite(found.blocks.cost)
    if not seen.any():
        return None
    few = select(few, np.flatnonzero(seen), MANY)
    found = minimise(
        few, camera, found.cam_from_target[seen], tie, loss, max_iterations=COARSE_STEPS, small_decrease=1e-4
    )
    return found if np.isfinite(found.blocks.cost.sum()) else None


def linear_poses(problem: Problem, camera: Camera, *, is_robust: bool, as_planes: bool = False) -> Array:
    """Poses (V, 4, 4) by linear equations on the rays of the measured pixels; nan where there is none.

    Of a solid, a projection and weak perspective are tried: the one is exact, the other stands few points, and a plane
    with a point or two beside it.
    """
    ray = rays(camera, problem.measured_px.T)
    used = problem.is_used & np.isfinite(ray).all(axis=1)
    counts = np.add.reduceat(used.astype(np.int64), problem.view_start[:-1])
    poses = np.full((problem.view_count, 4, 4), np.nan)
    views = np.flatnonzero(counts >= LEAST_POINTS)
    if not len(views):
        return poses
    inside = used & (counts >= LEAST_POINTS)[problem.view]
    start = np.concatenate([[0], np.cumsum(counts[views])])
    position, image = problem.position_mm[:, inside], ray[inside, :2].T
    fitted = linear_views(start, position, image, as_planes=as_planes, is_robust=is_robust)
    poses[views] = poses_of(fitted)
    if not as_planes and not fitted.is_planar.all():
        other = np.full_like(poses, np.nan)
        other[views] = weak_perspective_poses(start, position, image)
        poses = _closer(problem, camera, poses, other)
    return poses


def _closer(problem: Problem, camera: Camera, poses: Array, other: Array) -> Array:
    """Of two poses of each view (V, 4, 4), nan: none, the one that shows the points nearer to where they were seen."""
    median = [_median_squares(problem, camera, one) for one in (poses, other)]
    return np.where((median[1] < median[0])[:, None, None], other, poses)


def _median_squares(problem: Problem, camera: Camera, poses: Array) -> Array:
    """Median squared distance in each view (V,); infinite without a pose."""
    known: NDArray[np.bool_] = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    shown = np.where(known[:, None, None], poses, np.eye(4))
    square = (view_misfit(problem, camera, shown, RobustLoss()).residual_px ** 2).sum(axis=0)
    square = np.where(np.isfinite(square), square, np.inf)
    order = np.lexsort((square, problem.view))
    middle = (problem.view_start[:-1] + problem.view_start[1:]) // 2
    median: Array = np.where(known, square[order][middle], np.inf)
    return median
