"""The camera of a sample from what the pool knows: no solution from scratch, the same minimum.

The expansion of the sample's views gives a camera and poses next to the minimum. There the true gradient is taken, and
led to zero with the second derivatives of the expansion, again if once is not enough. Where these are too far off, as
for few views and much noise, a few Gauss-Newton steps follow.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.solver.accuracy import SINGULAR, UNSURE_FOCAL
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.levenberg import is_allowed, move_poses, turn_of_centre
from calib.solver.problem import MANY, select
from calib.solver.schur import damped_step
from calib.studies.expansion import Expansion
from calib.studies.gradients import gradients_of
from calib.studies.pool import Pool

Array = NDArray[np.float64]
Count = NDArray[np.int64]

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
class NearMinimum:
    """The minimum of a sample of D distinct views."""

    camera: Camera
    cam_from_target: Array  # (D, 4, 4) from the problem's origin
    cost: float  # sum of squared whitened residuals, views as often as drawn
    looks: int  # how often the observations were looked at


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


def find_near(pool: Pool, views: Count, weight: Count) -> NearMinimum | None:
    """The minimum of a sample; None if the pool does not lead there, or if the sample may be degenerate.

    Args:
        pool: the views, expanded.
        views: (D,) those drawn.
        weight: (D,) how often.
    """
    expansion = pool.expansion
    if expansion is None or not _is_determined(pool, expansion, views, weight):
        return None
    total = _weighted(expansion, views, weight)
    y, bending = _zero_of(total)
    step, follow = _pose_steps(expansion, views, y)
    start = pool.calibration.camera
    camera = replace(start, params=start.params + expansion.direction @ y)
    if not (np.isfinite(y).all() and is_allowed(camera)):
        return None
    poses = move_poses(pool.cam_from_target[views], step, turn_of_centre(start, camera))
    return _led_to_zero(
        pool, expansion, views, weight, NearMinimum(camera, poses, np.nan, 0), total.second(y), follow, bending
    )


def _led_to_zero(
    pool: Pool,
    expansion: Expansion,
    views: Count,
    weight: Count,
    near: NearMinimum,
    second: Array,
    follow: Array,
    bending: float,
) -> NearMinimum | None:
    """The minimum by steps with second derivatives that stay as they are.

    Costs are not compared: this near to the minimum their differences are lost in rounding.

    Args:
        pool: the views.
        expansion: of them.
        views: (D,) those drawn.
        weight: (D,) how often.
        near: where to begin.
        second: derivatives by y (Q, Q).
        follow: derivatives of the pose steps by y (D, 6, Q).
        bending: by how much the second derivatives are off, about.
    """
    camera, poses, before = near.camera, near.cam_from_target, np.inf
    for look in range(1, MOST_STEPS + 1):
        there = gradients_of(pool.problem, views, camera, poses)
        reduced, rest, square = _reduced(
            expansion.direction, expansion.pose_inverse, views, weight, there.gradient, follow
        )
        dy = _solved(second, -reduced)
        promised, cost = square - float(reduced @ dy), float(there.cost @ weight)
        length = _length(promised, pool.calibration.scale)
        trial = replace(camera, params=camera.params + expansion.direction @ dy)
        if not (np.isfinite(cost) and length <= NEAR and is_allowed(trial)):
            return None
        # Of a step's length, so much is left: as of the last one, or as the gradient is off a straight line.
        left = max(length / before, bending)
        if look > 1 and left > STEADY:
            return _descended(pool, views, weight, NearMinimum(camera, poses, cost, look), before, bending)
        poses = move_poses(poses, rest + follow @ dy, turn_of_centre(camera, trial))
        camera, before = trial, length
        if SAFETY * left * length <= CLOSE:
            return NearMinimum(camera, poses, cost - promised, look)
    return None


def _descended(
    pool: Pool, views: Count, weight: Count, near: NearMinimum, before: float, bending: float
) -> NearMinimum | None:
    """The minimum by Gauss-Newton steps after a step of so many standard deviations; None if they do not shrink."""
    camera, poses = near.camera, near.cam_from_target
    problem = select(pool.problem, views, MANY)
    heavy = np.repeat(np.sqrt(weight), np.diff(problem.view_start))
    problem = replace(problem, whitener=problem.whitener * heavy)
    for look in range(near.looks + 1, MOST_STEPS + 1):
        blocks = view_blocks(problem, camera, poses, RobustLoss())
        step = damped_step(blocks.products, pool.tie.row, 0.0)
        length = _length(step.predicted, pool.calibration.scale)
        if not (step.solvable and length <= CONTRACTION * before):
            return None
        trial = replace(camera, params=camera.params + np.where(pool.tie.row >= 0, step.free[pool.tie.row], 0.0))
        if not is_allowed(trial):
            return None
        poses = move_poses(poses, step.pose, turn_of_centre(camera, trial))
        camera = trial
        # Each step shortens the distance by about the same factor; the first comes after a step of another kind.
        if length * max(length / before, bending) <= CLOSE:
            return NearMinimum(camera, poses, float(blocks.cost.sum()) - step.predicted, look)
        before = length
    return None


def _length(decrease: float, scale: float) -> float:
    """A step in standard deviations, from the decrease of the cost that it promises; nan uphill."""
    return float(np.sqrt(decrease)) / scale if decrease >= 0 else float("nan")


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


def _is_determined(pool: Pool, expansion: Expansion, views: Count, weight: Count) -> bool:
    """Whether the sample is well clear of what `calib.solver.accuracy` calls degenerate."""
    free = expansion.normal.shape[1]
    points = np.diff(pool.problem.view_start)[views]
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
    camera = pool.calibration.camera
    follows = pool.tie.row[:2]
    sigma = pool.calibration.scale * np.sqrt(np.diagonal(inverse)[follows[follows >= 0]])
    return bool((MARGIN * sigma < UNSURE_FOCAL * camera.params[:2][follows >= 0]).all())


def _weighted(expansion: Expansion, views: Count, weight: Count) -> _GradientSum:
    free = expansion.direction.shape[1]
    total = _GradientSum(np.zeros(free), np.zeros((free, free)), np.zeros((free, free, free)))
    _add_gradients(
        expansion.value, expansion.slope, expansion.bend, views, weight, total.value, total.slope, total.bend
    )
    return total


def _pose_steps(expansion: Expansion, views: Count, y: Array) -> tuple[Array, Array]:
    """The steps of the poses at y (D, 6) and their derivatives by y (D, 6, Q)."""
    step, follow = np.empty((len(views), 6)), np.empty((len(views), 6, len(y)))
    _steps_at(expansion.value, expansion.slope, expansion.bend, views, y, step, follow)
    return step, follow


@jit
def _add_normals(normals: Array, befores: Array, views: Count, weight: Count, normal: Array, before: Array) -> None:
    for place in range(len(views)):
        view, w = views[place], weight[place]
        for i in range(len(before)):
            before[i] += w * befores[view, i]
            for j in range(len(before)):
                normal[i, j] += w * normals[view, i, j]


@jit
def _add_gradients(
    values: Array, slopes: Array, bends: Array, views: Count, weight: Count, value: Array, slope: Array, bend: Array
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
def _steps_at(values: Array, slopes: Array, bends: Array, views: Count, y: Array, step: Array, follow: Array) -> None:
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


@jit
def _reduced(
    direction: Array, pose_inverse: Array, views: Count, weight: Count, gradient: Array, follow: Array
) -> tuple[Array, Array, float]:
    """The sample's gradient by y with the poses at their best (Q,), what these lack (D, 6), and what that promises."""
    parameters, free = direction.shape
    reduced, rest, square = np.zeros(free), np.zeros((len(views), 6)), 0.0
    for place in range(len(views)):
        w, inverse = weight[place], pose_inverse[views[place]]
        for i in range(6):
            for j in range(6):
                rest[place, i] -= inverse[i, j] * gradient[place, parameters + j]
            square -= w * rest[place, i] * gradient[place, parameters + i]
        for q in range(free):
            total = 0.0
            for p in range(parameters):
                total += direction[p, q] * gradient[place, p]
            for i in range(6):
                total += follow[place, i, q] * gradient[place, parameters + i]
            reduced[q] += w * total
    return reduced, rest, square
