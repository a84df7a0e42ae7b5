"""Poses of a target for a known camera: first ones, and the best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import compose, invert
from calib.core.types import Observations
from calib.solver.blocks import RobustLoss, view_misfit
from calib.solver.levenberg import minimise_poses
from calib.solver.linear_pose import principal_frames
from calib.solver.outliers import forgetful
from calib.solver.problem import MANY, Problem, few_per_view, pack, select, target_covariance, target_poses
from calib.solver.start import linear_poses

Array = NDArray[np.float64]

POOR = 25.0
"""Mean square residual of a view, in units of the median view's, of which another start may find a better pose."""
SCARCE = 12
"""Points with which a first pose is unsure."""
HOPELESS = 300.0
"""A start this many times worse than what is known leads nowhere better."""
STEPS = 15
MOST_STEPS = 50


@dataclass(frozen=True, eq=False)
class FirstPoses:
    """Poses that were found."""

    cam_from_target: Array  # (V, 4, 4), nan where none was found
    found: NDArray[np.bool_]  # (V,)


@dataclass(frozen=True, eq=False)
class _Best:
    """The best poses so far and their costs; infinite: none."""

    poses: Array  # (V, 4, 4)
    cost: Array  # (V,)


def first_poses(problem: Problem, camera: Camera, *, is_robust: bool) -> FirstPoses:
    """A pose of every view, from a few of its observations."""
    few = select(problem, np.arange(problem.view_count), few_per_view(problem.view_count))
    start = linear_poses(few, camera, is_robust=is_robust)
    loss = RobustLoss()
    if is_robust:
        ok: NDArray[np.bool_] = np.asarray(np.isfinite(start).all(axis=(1, 2)))
        loss = forgetful(view_misfit(few, camera, np.where(ok[:, None, None], start, np.eye(4)), loss).residual_px)
    views = few.view_count
    best = _Best(np.tile(np.eye(4), (views, 1, 1)), np.full(views, np.inf))
    best = _improved(few, camera, best, start, np.arange(views), loss)
    unsure = _unsure(few, best)
    if len(unsure):
        flat = linear_poses(select(few, unsure, MANY), camera, is_robust=is_robust, as_planes=True)
        best = _improved(few, camera, best, flat, unsure, loss)
    best = _turned_over(few, camera, best, loss)
    found = np.isfinite(best.cost)
    return FirstPoses(np.where(found[:, None, None], best.poses, np.nan), found)


def _unsure(few: Problem, best: _Best) -> NDArray[np.int64]:
    """Views that have no pose, one that fits badly, or few points."""
    count = np.diff(few.view_start)
    square = best.cost / count
    known = square[np.isfinite(square)]
    limit = POOR * float(np.median(known)) if len(known) else 0.0
    return np.flatnonzero(~(square <= limit) | (count < SCARCE))


def _improved(
    few: Problem, camera: Camera, best: _Best, start: Array, views: NDArray[np.int64], loss: RobustLoss
) -> _Best:
    """The best poses after a descent of some views from other starts (len(views), 4, 4), nan: none."""
    ok = np.isfinite(start).all(axis=(1, 2))
    views, start = views[ok], start[ok]
    if not len(views):
        return best
    minimum = minimise_poses(select(few, views, MANY), camera, start, loss, max_iterations=STEPS, small_decrease=1e-4)
    better = minimum.blocks.cost < best.cost[views]
    poses, cost = np.array(best.poses), np.array(best.cost)
    poses[views[better]] = minimum.cam_from_target[better]
    cost[views[better]] = minimum.blocks.cost[better]
    return _Best(poses, cost)


def _turned_over(few: Problem, camera: Camera, best: _Best, loss: RobustLoss) -> _Best:
    """The best poses, those turned over that are better so."""
    known = np.flatnonzero(np.isfinite(best.cost))
    if not len(known):
        return best
    part = select(few, known, MANY)
    other = _flipped(part, best.poses[known])
    start = view_misfit(part, camera, other, loss).cost
    # Near a plane the other pose shows something else altogether; it need not be tried.
    tried = ~(start > HOPELESS * best.cost[known])
    return _improved(few, camera, best, other[tried], known[tried], loss)


def _flipped(problem: Problem, cam_from_target: Array) -> Array:
    """The poses that show the same to a camera far away: the points' plane mirrored in depth about its middle.

    In the plane's frame `R' = M R diag(1, 1, -1)`, with M the mirror across the line of sight to the middle
    (Schweighofer and Pinz 2006). For points that are not in a plane the pose is merely another start.
    """
    frame, _ = principal_frames(problem.view_start, problem.position_mm)
    pose = np.array(compose(cam_from_target, frame))
    sight = pose[:, :3, 3] / np.linalg.norm(pose[:, :3, 3], axis=1, keepdims=True)
    mirror = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    pose[:, :3, :3] = mirror @ pose[:, :3, :3] @ np.diag([1.0, 1.0, -1.0])
    return compose(pose, invert(frame))


@dataclass(frozen=True, eq=False)
class Poses:
    """Where the target stands before the camera, view by view; nan where no pose was found."""

    cam_from_target: Array  # (V, 4, 4)
    covariance: Array  # (V, 6, 6) rotation vector (rad), translation (mm), in the camera's axes
    residual_px: Array  # (M, 2) predicted - measured
    scale: (
        float  # posterior standard deviation of an observation; px, or with weights in units of the stated covariance
    )


def solve_poses(camera: Camera, observations: Observations, *, weighted: bool = True) -> Poses:
    """The pose of each view, of four points or more, with the least squared distances in the image."""
    problem = pack(observations, weighted=weighted)
    first = first_poses(problem, camera, is_robust=False)
    start = np.where(first.found[:, None, None], first.cam_from_target, np.eye(4))
    minimum = minimise_poses(problem, camera, start, RobustLoss(), max_iterations=MOST_STEPS)
    found = first.found & np.isfinite(minimum.blocks.cost)
    redundancy = 2 * int(found[observations.view].sum()) - 6 * int(found.sum())
    squares = float(minimum.blocks.products[found, -1, -1].sum())
    scale = float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan")
    normal = np.where(found[:, None, None], minimum.blocks.products[:, -7:-1, -7:-1], np.eye(6))
    lost = ~found
    poses = minimum.cam_from_target
    covariance = target_covariance(problem, poses, scale**2 * symmetric_inverse(normal).covariance)
    return Poses(
        np.where(lost[:, None, None], np.nan, target_poses(problem, poses)),
        np.where(lost[:, None, None], np.nan, covariance),
        np.where(lost[observations.view][:, None], np.nan, minimum.blocks.residual_px.T),
        scale,
    )
