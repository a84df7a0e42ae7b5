"""The camera of a sample from an expansion about the camera of all views: no solution from scratch, the same minimum.

Whatever the camera, a view's best pose follows from its own points. With the pose always at its best, the cost of a
view is a function `F_v` of the camera (variable projection; Golub and Pereyra 1973), and that of a sample the sum of
`w_v F_v` with `w_v` how often the view was drawn. So the gradient of each `F_v` and the pose that goes with it, as
polynomials of second order about the camera of all views, bring any sample next to its minimum without a look at the
observations. Coordinates y of the camera are `params = params_0 + direction y`, in which the camera of all views has
unit covariance.

There the true gradient is taken, and led to zero with the second derivatives of the expansion, again if once is not
enough. Where these are too far off, as for few views and much noise, a few Gauss-Newton steps follow.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import is_allowed
from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.core.linear_algebra import solve_square, symmetric_inverse
from calib.solver.accuracy import SINGULAR, UNSURE_FOCAL, accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration
from calib.solver.levenberg import move_poses, turn_of_centre
from calib.solver.problem import MANY, Problem, Tie, select
from calib.solver.schur import damped_step, reduced_normal
from calib.studies.gradients import CameraFit, gradients_of, reduced_gradient, step_length
from designer.base.arrays import Array, Rows

STEP = 3.0
"""Of the differences, in standard deviations: samples of a tenth of the views are about that far off."""


CLOSE = 1e-7
"""Distance from the minimum, in standard deviations of all unknowns, that is none."""
NEAR = 0.5
"""Distance, in standard deviations of all unknowns, that is near the minimum."""
SAFETY = 3.0
"""On the estimate of how far from the minimum a step ends."""
CONTRACTION = 0.3
"""A step longer than this part of the one before does not lead to the minimum at once."""
STEADY = 0.1
"""Second derivatives that leave more of a distance than this are worth new ones, which cost about three gradients."""
MOST_STEPS = 10
MARGIN = 4.0
"""Of the limits to what is degenerate, which are asked for at the pool's camera and not at the sample's."""


@dataclass(frozen=True, eq=False)
class ExpansionPoint:
    """The minimum of all views, where the expansion is taken, and how poses follow there."""

    problem: Problem
    camera: Camera
    scale: float  # of the residuals, in sigmas
    row: Rows  # (P,) of the free parameters, -1 for those that are fixed
    cam_from_target: Array  # (V, 4, 4) from the problem's origin
    direction: Array  # (P, Q)
    extra: Array  # (V, P + 6, 6) second derivatives by all unknowns and the pose, less the normal matrix
    pose_inverse: Array  # (V, 6, 6) inverse of the second derivatives by the pose
    pose_slope: Array  # (V, 6, Q)


@dataclass(frozen=True, eq=False)
class Expansion:
    """Of V views: gradient by y (Q) and pose step (6), together (Q + 6), with Q free parameters."""

    at: ExpansionPoint
    value: Array  # (V, Q + 6) at y = 0
    slope: Array  # (V, Q + 6, Q)
    bend: Array  # (V, Q + 6, Q, Q) second derivatives
    normal: Array  # (V, Q, Q) of the free parameters, poses eliminated
    before: Array  # (V, Q) its diagonal before they were


def expand(problem: Problem, calibration: Calibration, cam_from_target: Array, tie: Tie) -> Expansion | None:
    """The expansion of every view at a minimum of all; None if that is not determined, or too near to a bound.

    By central differences of the gradients. Each needs a look at the observations where the pose is right to first
    order already; what is left of it is put into the pose, and its effect into the gradient.

    Args:
        problem: what was seen.
        calibration: of all views.
        cam_from_target: poses from the problem's origin (V, 4, 4).
        tie: free, fixed and shared parameters.
    """
    camera, free = calibration.camera, int(tie.row.max(initial=-1)) + 1
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
    extra, inverse, slope = _second_by_pose(problem, camera, cam_from_target, spread @ root, products, accuracy.scale)
    at = ExpansionPoint(
        problem, camera, calibration.scale, tie.row, cam_from_target, spread @ root, extra, inverse, slope
    )
    middle = _look(at, np.zeros(free))
    axis = STEP * np.eye(free)
    ahead = np.stack([_look(at, y) for y in axis], axis=-1)  # (V, Q + 6, Q)
    behind = np.stack([_look(at, -y) for y in axis], axis=-1)
    bend = np.empty((*middle.shape, free, free))
    for i in range(free):
        bend[..., i, i] = ahead[..., i] + behind[..., i] - 2 * middle
    for i in range(free):
        for j in range(i):
            both = _look(at, axis[i] + axis[j]) + _look(at, -axis[i] - axis[j]) - 2 * middle
            bend[..., i, j] = bend[..., j, i] = 0.5 * (both - bend[..., i, i] - bend[..., j, j])
    slope = (ahead - behind) / (2 * STEP)
    if not (np.isfinite(bend).all() and np.isfinite(slope).all()):
        return None
    camera_block = products[:, : len(tie.row), : len(tie.row)]
    normal = np.stack([reduced_normal(products[view : view + 1], tie.row)[0] for view in range(len(products))])
    before = np.einsum("vpp,pq->vq", camera_block, spread)
    return Expansion(at, middle, slope, bend / STEP**2, normal, before)


def _second_by_pose(
    problem: Problem, camera: Camera, cam_from_target: Array, direction: Array, products: Array, scale: float
) -> tuple[Array, Array, Array]:
    """Second derivatives by the poses: true ones, as residuals times curvature slow down a descent without them.

    At the minimum the gradient by each pose is zero, so it does not matter how a pose is moved. Returns `extra`,
    `pose_inverse` and `pose_slope` of `ExpansionPoint`.
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
    return extra, inverse, slope


def _look(at: ExpansionPoint, y: Array) -> Array:
    """Gradients and pose steps of all views at y; nan where there is no such camera.  # (V, Q + 6)"""
    trial = replace(at.camera, params=at.camera.params + at.direction @ y)
    step = at.pose_slope @ y
    if not is_allowed(trial):
        return np.full((len(step), len(y) + 6), np.nan)
    poses = move_poses(at.cam_from_target, step, turn_of_centre(at.camera, trial))
    products = view_blocks(at.problem, trial, poses, RobustLoss()).products
    parameters = len(at.direction)
    pose = products[:, parameters:-1, parameters:-1] + at.extra[:, parameters:]
    coupling = at.direction.T @ (products[:, :parameters, parameters:-1] + at.extra[:, :parameters])
    rest = -solve_square(pose, products[:, parameters:-1, -1:])
    reduced = products[:, :parameters, -1] @ at.direction + (coupling @ rest)[..., 0]
    return np.concatenate([reduced, step + rest[..., 0]], axis=1)


@dataclass(frozen=True, eq=False)
class _GradientSum:
    """The gradient of a sample as a polynomial of y, and the steps of its poses."""

    value: Array  # (Q,)
    slope: Array  # (Q, Q)
    bend: Array  # (Q, Q, Q)

    def gradient(self, y: Array) -> Array:
        """At y.  # (Q,)"""
        gradient: Array = self.value + 0.5 * (self.slope + self.second(y)) @ y
        return gradient

    def second(self, y: Array) -> Array:
        """Second derivatives at y.  # (Q, Q)"""
        return self.slope + self.bend @ y


def find_near(expansion: Expansion, views: Rows, weight: Rows) -> CameraFit | None:
    """The minimum of a sample; None if the expansion does not lead there, or if the sample may be degenerate.

    Args:
        expansion: of all views.
        views: (D,) those drawn.
        weight: (D,) how often.
    """
    if not _is_determined(expansion, views, weight):
        return None
    at, free = expansion.at, expansion.at.direction.shape[1]
    total = _GradientSum(np.zeros(free), np.zeros((free, free)), np.zeros((free, free, free)))
    _add_gradients(
        expansion.value, expansion.slope, expansion.bend, views, weight, total.value, total.slope, total.bend
    )
    y, bending = _zero_of(total)
    step, follow = _pose_steps(expansion, views, y)
    camera = replace(at.camera, params=at.camera.params + at.direction @ y)
    if not (np.isfinite(y).all() and is_allowed(camera)):
        return None
    poses = move_poses(at.cam_from_target[views], step, turn_of_centre(at.camera, camera))
    near = CameraFit(camera, poses, np.nan, 0)
    return _led_to_zero(at, views, weight, near, total.second(y), follow, bending)


def _led_to_zero(
    at: ExpansionPoint, views: Rows, weight: Rows, near: CameraFit, second: Array, follow: Array, bending: float
) -> CameraFit | None:
    """The minimum by steps with second derivatives that stay as they are.

    Costs are not compared: this near to the minimum their differences are lost in rounding.

    Args:
        at: the minimum of all views.
        views: (D,) those drawn.
        weight: (D,) how often.
        near: where to begin.
        second: derivatives by y (Q, Q).
        follow: derivatives of the pose steps by y (D, 6, Q).
        bending: by how much the second derivatives are off, about.
    """
    camera, poses, before = near.camera, near.cam_from_target, np.inf
    for look in range(1, MOST_STEPS + 1):
        there = gradients_of(at.problem, views, camera, poses)
        reduced, rest, square = reduced_gradient(at.direction, at.pose_inverse, views, weight, there.gradient, follow)
        dy = _solved(second, -reduced)
        promised, cost = square - float(reduced @ dy), float(there.cost @ weight)
        length = step_length(promised, at.scale)
        trial = replace(camera, params=camera.params + at.direction @ dy)
        if not (np.isfinite(cost) and length <= NEAR and is_allowed(trial)):
            return None
        # Of a step's length, so much is left: as of the last one, or as the gradient is off a straight line.
        left = max(length / before, bending)
        if look > 1 and left > STEADY:
            return _descended(at, views, weight, CameraFit(camera, poses, cost, look), before, bending)
        poses = move_poses(poses, rest + follow @ dy, turn_of_centre(camera, trial))
        camera, before = trial, length
        if SAFETY * left * length <= CLOSE:
            return CameraFit(camera, poses, cost - promised, look)
    return None


def _descended(
    at: ExpansionPoint, views: Rows, weight: Rows, near: CameraFit, before: float, bending: float
) -> CameraFit | None:
    """The minimum by Gauss-Newton steps after a step of so many standard deviations; None if they do not shrink."""
    camera, poses = near.camera, near.cam_from_target
    problem = select(at.problem, views, MANY)
    heavy = np.repeat(np.sqrt(weight), np.diff(problem.view_start))
    problem = replace(problem, whitener=problem.whitener * heavy)
    for look in range(near.looks + 1, MOST_STEPS + 1):
        blocks = view_blocks(problem, camera, poses, RobustLoss())
        step = damped_step(blocks.products, at.row, 0.0)
        length = step_length(step.predicted, at.scale)
        if not (step.solvable and length <= CONTRACTION * before):
            return None
        trial = replace(camera, params=camera.params + np.where(at.row >= 0, step.free[at.row], 0.0))
        if not is_allowed(trial):
            return None
        poses = move_poses(poses, step.pose, turn_of_centre(camera, trial))
        camera = trial
        # Each step shortens the distance by about the same factor; the first comes after a step of another kind.
        if length * max(length / before, bending) <= CLOSE:
            return CameraFit(camera, poses, float(blocks.cost.sum()) - step.predicted, look)
        before = length
    return None


def _solved(matrix: Array, right: Array) -> Array:
    """`matrix^-1 right`; nan if there is none."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.full(len(right), np.nan)


def _zero_of(total: _GradientSum) -> tuple[Array, float]:
    """Where the polynomial is zero, near y = 0 (nan if it is not found at once), and how much it bends until there."""
    y = first = _solved(total.slope, -total.value)
    before = np.inf
    for _ in range(MOST_STEPS):
        dy = _solved(total.second(y), -total.gradient(y))
        length = float(np.abs(dy).max())
        if not length < before:
            break
        y, before = y + dy, length
        if length <= CLOSE:
            return y, float(np.linalg.norm(y - first) / max(float(np.linalg.norm(y)), CLOSE))
    return np.full(len(y), np.nan), np.nan


def _is_determined(expansion: Expansion, views: Rows, weight: Rows) -> bool:
    """Whether the sample is well clear of what `calib.solver.accuracy` calls degenerate."""
    at, free = expansion.at, expansion.normal.shape[1]
    points = np.diff(at.problem.view_start)[views]
    if 2 * int(weight @ points) - free - 6 * int(weight.sum()) <= 0:
        return False
    normal, before = np.zeros((free, free)), np.zeros(free)
    _add_normals(expansion.normal, expansion.before, views, weight, normal, before)
    diagonal = np.diagonal(normal)
    if not (diagonal > 0).all():
        return False
    root = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(normal / (root[:, None] * root))
    if not values[0] * min(float((diagonal / before).min()), 1.0) > MARGIN * SINGULAR:
        return False
    inverse = (vectors / values) @ vectors.T / (root[:, None] * root)
    follows = at.row[:2]
    sigma = at.scale * np.sqrt(np.diagonal(inverse)[follows[follows >= 0]])
    return bool((MARGIN * sigma < UNSURE_FOCAL * at.camera.params[:2][follows >= 0]).all())


def _pose_steps(expansion: Expansion, views: Rows, y: Array) -> tuple[Array, Array]:
    """The steps of the poses at y (D, 6) and their derivatives by y (D, 6, Q)."""
    step, follow = np.empty((len(views), 6)), np.empty((len(views), 6, len(y)))
    _steps_at(expansion.value, expansion.slope, expansion.bend, views, y, step, follow)
    return step, follow


@jit
def _add_normals(normals: Array, befores: Array, views: Rows, weight: Rows, normal: Array, before: Array) -> None:
    for place in range(len(views)):
        view, w = views[place], weight[place]
        for i in range(len(before)):
            before[i] += w * befores[view, i]
            for j in range(len(before)):
                normal[i, j] += w * normals[view, i, j]


@jit
def _add_gradients(
    values: Array, slopes: Array, bends: Array, views: Rows, weight: Rows, value: Array, slope: Array, bend: Array
) -> None:
    """The first Q rows of the expansion, summed; in one order on every machine, as a library's product is not."""
    free = len(value)
    for place in range(len(views)):
        view, w = views[place], weight[place]
        for i in range(free):
            value[i] += w * values[view, i]
            for j in range(free):
                slope[i, j] += w * slopes[view, i, j]
                for k in range(free):
                    bend[i, j, k] += w * bends[view, i, j, k]


@jit
def _steps_at(values: Array, slopes: Array, bends: Array, views: Rows, y: Array, step: Array, follow: Array) -> None:
    free = len(y)
    for place in range(len(views)):
        view = views[place]
        for i in range(6):
            step[place, i] = values[view, free + i]
            for j in range(free):
                slope = slopes[view, free + i, j]
                derivative = slope
                for k in range(free):
                    derivative += bends[view, free + i, j, k] * y[k]
                follow[place, i, j] = derivative
                step[place, i] += 0.5 * (slope + derivative) * y[j]
