"""First poses of all views for a first camera, the better of both where a plane leaves two."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.se3 import compose, invert
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.levenberg import minimise_poses
from calib.solver.linear_pose import linear_views
from calib.solver.problem import MANY, Problem, few_per_view, select
from calib.solver.start import linear_poses
from calib.types import Camera

Array = NDArray[np.float64]

HOPELESS = 300.0
STEPS = 12


@dataclass(frozen=True, eq=False)
class FirstPoses:
    """Poses that were found."""

    cam_from_target: Array  # (V, 4, 4), nan where none was found
    found: NDArray[np.bool_]  # (V,)


def first_poses(problem: Problem, camera: Camera, loss: RobustLoss) -> FirstPoses:
    """A pose of every view, from a few of its observations."""
    few = select(problem, np.arange(problem.view_count), few_per_view(problem.view_count))
    poses = linear_poses(few, camera)
    found: NDArray[np.bool_] = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    if found.any():
        views = np.flatnonzero(found)
        inside = select(few, views, MANY)
        best, cost = _refined(inside, camera, poses[views], loss)
        poses[views], cost = _better_of_two(inside, camera, best, cost, loss)
        found[views] = np.isfinite(cost)
    return FirstPoses(np.where(found[:, None, None], poses, np.nan), found)


def _refined(few: Problem, camera: Camera, poses: Array, loss: RobustLoss) -> tuple[Array, Array]:
    """Poses at their minima, and their costs, infinite where there is none."""
    minimum = minimise_poses(few, camera, poses, loss, max_iterations=STEPS, small_decrease=1e-4)
    cost = minimum.blocks.cost
    return minimum.cam_from_target, np.where(np.isfinite(cost), cost, np.inf)


def _better_of_two(few: Problem, camera: Camera, poses: Array, cost: Array, loss: RobustLoss) -> tuple[Array, Array]:
    """Poses and costs with those views turned over that are better so."""
    other = _flipped(few, poses)
    start = view_blocks(few, camera, other, loss).cost
    # Near a plane the other pose shows something else altogether; it need not be tried.
    views = np.flatnonzero(~(start > HOPELESS * cost))
    if not len(views):
        return poses, cost
    other, other_cost = _refined(select(few, views, MANY), camera, other[views], loss)
    better = other_cost < cost[views]
    poses, cost = np.array(poses), np.array(cost)
    poses[views[better]], cost[views[better]] = other[better], other_cost[better]
    return poses, cost


def _flipped(problem: Problem, cam_from_target: Array) -> Array:
    """The poses that show the same to a camera far away: the points' plane mirrored in depth about its middle.

    In the plane's frame `R' = M R diag(1, 1, -1)`, with M the mirror across the line of sight to the middle
    (Schweighofer and Pinz 2006). For points that are not in a plane the pose is merely another start.
    """
    frame = linear_views(problem.view_start, problem.position_mm, problem.measured_px).target_from_plane
    pose = compose(cam_from_target, frame)
    sight = pose[:, :3, 3] / np.linalg.norm(pose[:, :3, 3], axis=1, keepdims=True)
    mirror = np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]
    pose = np.array(pose)
    pose[:, :3, :3] = mirror @ pose[:, :3, :3] @ np.diag([1.0, 1.0, -1.0])
    return compose(pose, invert(frame))
