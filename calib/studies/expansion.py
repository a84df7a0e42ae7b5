"""A view's cost as a function of the camera alone, expanded about the camera of all views.

Whatever the camera, a view's best pose follows from its own points. With the pose always at its best, the cost of a
view is a function `F_v` of the camera (variable projection; Golub and Pereyra 1973), and that of a sample the sum of
`w_v F_v` with `w_v` how often the view was drawn. So the gradient of each `F_v` and the pose that goes with it, as
polynomials of second order about the camera of all views, bring any sample next to its minimum without a look at the
observations. Coordinates y of the camera are `params = params_0 + direction y`, in which the camera of all views has
unit covariance.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.linear_algebra import solve_square, symmetric_inverse
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.levenberg import is_allowed, move_poses, turn_of_centre
from calib.solver.options import Tie
from calib.solver.problem import Problem
from calib.solver.schur import reduced_normal
from calib.studies.gradients import gradients_of

Array = NDArray[np.float64]

STEP = 3.0
"""Of the differences, in standard deviations: samples of a tenth of the views are about that far off."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """Of V views: gradient by y (Q) and pose step (6), together (Q + 6), with Q free parameters."""

    direction: Array  # (P, Q)
    value: Array  # (V, Q + 6) at y = 0
    slope: Array  # (V, Q + 6, Q)
    bend: Array  # (V, Q + 6, Q, Q) second derivatives
    pose_inverse: Array  # (V, 6, 6) inverse of the second derivatives by the pose
    normal: Array  # (V, Q, Q) of the free parameters, poses eliminated
    before: Array  # (V, Q) its diagonal before they were


def expand(problem: Problem, camera: Camera, cam_from_target: Array, tie: Tie) -> Expansion | None:
    """The expansion of every view at a minimum of all; None if that is not determined, or too near to a bound.

    By central differences of the gradients. Each needs a look at the observations where the pose is right to first
    order already; what is left of it is put into the pose, and its effect into the gradient.

    Args:
        problem: what was seen.
        camera: of all views.
        cam_from_target: poses from the problem's origin (V, 4, 4).
        tie: free, fixed and shared parameters.
    """
    free = int(tie.row.max(initial=-1)) + 1
    products = view_blocks(problem, camera, cam_from_target, RobustLoss()).products
    accuracy = accuracy_of(products, tie.row, int(problem.is_used.sum()))
    if free == 0 or not np.isfinite(accuracy.param_covariance).all():
        return None
    spread: Array = (tie.row[:, None] == np.arange(free)).astype(np.float64)  # (P, Q)
    leader = np.argmax(spread, axis=0)
    try:
        root = np.linalg.cholesky(accuracy.param_covariance[np.ix_(leader, leader)])
    except np.linalg.LinAlgError:
        return None
    start = _start(problem, camera, cam_from_target, spread @ root, products, accuracy.scale)
    middle = _look(start, np.zeros(free))
    axis = STEP * np.eye(free)
    ahead = np.stack([_look(start, y) for y in axis], axis=-1)  # (V, Q + 6, Q)
    behind = np.stack([_look(start, -y) for y in axis], axis=-1)
    bend = np.empty((*middle.shape, free, free))
    for i in range(free):
        bend[..., i, i] = ahead[..., i] + behind[..., i] - 2 * middle
    for i in range(free):
        for j in range(i):
            both = _look(start, axis[i] + axis[j]) + _look(start, -axis[i] - axis[j]) - 2 * middle
            bend[..., i, j] = bend[..., j, i] = 0.5 * (both - bend[..., i, i] - bend[..., j, j])
    slope = (ahead - behind) / (2 * STEP)
    if not (np.isfinite(bend).all() and np.isfinite(slope).all()):
        return None
    camera_block = products[:, : len(tie.row), : len(tie.row)]
    return Expansion(
        start.direction, middle, slope, bend / STEP**2, start.pose_inverse,
        np.stack([reduced_normal(products[view : view + 1], tie.row)[0] for view in range(len(products))]),
        np.einsum("vpp,pq->vq", camera_block, spread),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Start:
    """Where the differences are taken, and how poses follow there."""

    problem: Problem
    camera: Camera
    cam_from_target: Array  # (V, 4, 4)
    direction: Array  # (P, Q)
    extra: Array  # (V, P + 6, 6) second derivatives by all unknowns and the pose, less the normal matrix
    pose_inverse: Array  # (V, 6, 6) inverse of the second derivatives by the pose
    pose_slope: Array  # (V, 6, Q)


def _start(
    problem: Problem, camera: Camera, cam_from_target: Array, direction: Array, products: Array, scale: float
) -> _Start:
    """Second derivatives by the poses: true ones, as residuals times curvature slow down a descent without them.

    At the minimum the gradient by each pose is zero, so it does not matter how a pose is moved.
    """
    views, parameters = np.arange(problem.view_count), len(direction)
    sigma = scale / np.sqrt(np.einsum("vkk->vk", products[:, -7:-1, -7:-1]))  # (V, 6)
    columns = []
    for k in range(6):
        step = np.zeros((len(views), 6))
        step[:, k] = sigma[:, k]
        ends = [gradients_of(problem, views, camera, move_poses(cam_from_target, sign * step)) for sign in (1, -1)]
        columns.append((ends[0].gradient - ends[1].gradient) / (2 * sigma[:, k : k + 1]))
    second = np.stack(columns, axis=-1)  # (V, P + 6, 6)
    pose = second[:, parameters:]
    inverse = symmetric_inverse(0.5 * (pose + pose.transpose(0, 2, 1))).inverse
    slope = -inverse @ second[:, :parameters].transpose(0, 2, 1) @ direction
    extra = second - products[:, :-1, -7:-1]
    return _Start(problem, camera, cam_from_target, direction, extra, inverse, slope)


def _look(start: _Start, y: Array) -> Array:
    """Gradients and pose steps of all views at y; nan where there is no such camera.  # (V, Q + 6)"""
    trial = replace(start.camera, params=start.camera.params + start.direction @ y)
    step = start.pose_slope @ y
    if not is_allowed(trial):
        return np.full((len(step), len(y) + 6), np.nan)
    poses = move_poses(start.cam_from_target, step, turn_of_centre(start.camera, trial))
    products = view_blocks(start.problem, trial, poses, RobustLoss()).products
    parameters = len(start.direction)
    pose = products[:, parameters:-1, parameters:-1] + start.extra[:, parameters:]
    coupling = start.direction.T @ (products[:, :parameters, parameters:-1] + start.extra[:, :parameters])
    rest = -solve_square(pose, products[:, parameters:-1, -1:])
    reduced = products[:, :parameters, -1] @ start.direction + (coupling @ rest)[..., 0]
    return np.concatenate([reduced, step + rest[..., 0]], axis=1)
