"""Levenberg-Marquardt: one loop for cameras, rigs and printed targets; over a camera and its poses; over poses alone.

A step x of `(H + damping diag H) x = -g` is taken if the cost falls; the damping then follows how much of what the
step promised came true (after Nielsen 1999, bolder), else it grows.
"""

from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

import numpy as np

from calib.cameras import is_allowed
from calib.cameras.camera import Camera
from calib.core.jit import jit
from calib.core.small_solve import cholesky_factor, substitute
from calib.solver.blocks import Blocks, RobustLoss, view_blocks
from calib.solver.problem import Problem
from calib.solver.schur import Step, damped_step
from designer.base.arrays import Array, Flags, Rows

FIRST_DAMPING = 1e-4
LARGEST_DAMPING = 1e12
SMALLEST_DAMPING = 1e-14
SMALL_DECREASE = 1e-15
"""Of the cost: with 100,000 observations the unknowns are then within 1e-5 standard deviations of the minimum."""
ROUNDING = 1e-13
"""Of the cost: a step that promises less and does not deliver is lost in rounding."""
PERFECT_PX = 1e-11
"""Root mean square of residuals that are nothing but rounding."""
FIRST_GROWTH = 2.0
FULL_GAIN = 0.9


class Promising(Protocol):
    """A step, of which is known by how much the cost falls if the equations are right."""

    @property
    def predicted(self) -> float:
        """By the undamped quadratic model."""


State = TypeVar("State")
Equations = TypeVar("Equations")
StepT = TypeVar("StepT", bound=Promising)


class Solvable(Protocol[State, Equations, StepT]):
    """What the loop asks of a problem; states and equations are its own affair."""

    @property
    def perfect(self) -> float:
        """A cost that is nothing but rounding."""

    def equations(self, state: State) -> Equations:
        """The normal equations at a state."""

    def cost(self, equations: Equations) -> float:
        """Of the state; nan where it has none."""

    def step(self, state: State, equations: Equations, damping: float) -> StepT | None:
        """The damped step; None if there is none."""

    def trial(self, state: State, equations: Equations, step: StepT) -> tuple[State, Equations] | None:
        """The state after a step and the equations there; None if it is not allowed."""

    def gives_up(self, there: Equations) -> bool:
        """Told of each trial without a cost: whether to go on is in vain."""


@dataclass(frozen=True, eq=False)
class Descent(Generic[State, Equations]):
    """Where a descent ended."""

    state: State
    equations: Equations  # there
    iterations: int
    converged: bool


@dataclass(frozen=True)
class DescentSteps:
    """How a descent goes: `DescentSteps(300, damping=1e-10)`."""

    most: int  # trial steps
    small_decrease: float = SMALL_DECREASE  # ends the descent when a step promises less, as a part of the cost
    damping: float = FIRST_DAMPING  # to begin with; little where the start is near the minimum


def levenberg_marquardt(
    problem: Solvable[State, Equations, StepT], state: State, steps: DescentSteps
) -> Descent[State, Equations]:
    """Descend from a state to the nearest minimum of the cost."""
    damping = steps.damping
    equations = problem.equations(state)
    cost, growth = problem.cost(equations), FIRST_GROWTH
    if not abs(cost) < float("inf"):
        problem.gives_up(equations)
        return Descent(state, equations, 0, converged=False)
    for iteration in range(1, steps.most + 1):
        step = problem.step(state, equations, damping)
        if step is not None and step.predicted <= steps.small_decrease * cost + problem.perfect:
            return Descent(state, equations, iteration, converged=True)
        trial = None if step is None else problem.trial(state, equations, step)
        if step is not None and trial is not None:
            there = trial[1]
            trial_cost = problem.cost(there)
            if trial_cost < cost:
                gain = (cost - trial_cost) / step.predicted
                damping = max(damping * _shrinkage(gain, growth), SMALLEST_DAMPING)
                (state, equations), cost, growth = trial, trial_cost, FIRST_GROWTH
                continue
            if not abs(trial_cost) < float("inf"):
                if problem.gives_up(there):
                    return Descent(state, equations, iteration, converged=False)
            elif step.predicted <= ROUNDING * cost:
                return Descent(state, equations, iteration, converged=True)
        damping, growth = damping * growth, growth * 2
        if damping > LARGEST_DAMPING:
            return Descent(state, equations, iteration, converged=False)
    return Descent(state, equations, steps.most, converged=False)


def _shrinkage(gain: float, growth: float) -> float:
    """Factor of the damping after a step that gained this part of what it promised."""
    if gain > FULL_GAIN:
        return 1e-3 if growth == FIRST_GROWTH else 0.2  # not at once where bolder steps have just failed
    return max(1 / 3, 1 - (2 * gain - 1) ** 3)


SHORT = 1e-4
"""Of the residuals, what a step moves the picture by: the normal matrix is then as it was, covariances to a millionth
(of five views to five), and only the gradient is renewed, in half the time. The last step is nearly always one."""
PATIENCE = 16
"""Steps refused because the model does not show all points there, all told, until the descent is given up.

Not in a row: along the fold small steps succeed between refused ones, and a descent into it creeps on. Counted in a
row, 35 of 36 such descents with wide lenses (half angles of 55 to 100 degrees) went on to their last step, the 100th,
where this ends them at about the 22nd; none converged, and the minima without the points in the way were the same.
"""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the descent ended."""

    camera: Camera
    cam_from_target: Array  # (V, 4, 4)
    blocks: Blocks  # there, see `SHORT`
    iterations: int
    converged: bool
    in_the_way: Flags | None = None  # (M,) points that the model would have ceased to show, had it gone on
    amount: Array = field(default_factory=lambda: np.zeros(0))  # (S,) of the problem's displacements


def minimise(
    problem: Problem, camera: Camera, cam_from_target: Array, tie: Rows, loss: RobustLoss, steps: DescentSteps
) -> Minimum:
    """Descend to the nearest minimum of the summed losses.

    Args:
        problem: what was seen, and amounts of displacements to start from.
        camera: where to start; fixed parameters keep its values.
        cam_from_target: where to start (V, 4, 4).
        tie: the free parameter that each parameter follows (P,); -1: fixed.
        loss: of the whitened residuals.
        steps: of the descent.
    """
    one = _OneCamera(problem, tie, loss)
    found = levenberg_marquardt(one, _CameraState(camera, cam_from_target, problem), steps)
    state, in_the_way = found.state, None if found.converged else one.in_the_way
    return Minimum(
        state.camera, state.cam_from_target, found.equations, found.iterations, found.converged, in_the_way,
        state.problem.amount,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _CameraState:
    """A camera, its poses (V, 4, 4), and what it sees with the points where they are."""

    camera: Camera
    cam_from_target: Array
    problem: Problem


class _OneCamera:
    """One camera and its views, for `levenberg_marquardt`.

    The steps to where a model no longer shows all points are counted, and the fewest that one would lose are kept.
    """

    def __init__(self, problem: Problem, tie: Rows, loss: RobustLoss) -> None:
        self.is_used, self.row, self.tie, self.loss = problem.is_used, problem.rows(tie), tie, loss
        self.perfect = PERFECT_PX**2 * max(int(problem.is_used.sum()), 1)
        self.refused = 0
        self.in_the_way: Flags | None = None

    def equations(self, state: _CameraState) -> Blocks:
        return view_blocks(state.problem, state.camera, state.cam_from_target, self.loss)

    def cost(self, equations: Blocks) -> float:
        return equations.total

    def step(self, state: _CameraState, equations: Blocks, damping: float) -> Step | None:
        step = damped_step(equations.every, self.row, damping)
        return step if step.solvable else None

    def trial(self, state: _CameraState, equations: Blocks, step: Step) -> tuple[_CameraState, Blocks] | None:
        """As `Solvable`; after a short step the normal matrix is as it was, see `SHORT`."""
        amount = state.problem.amount
        camera = moved_camera(state.camera, self.tie, step.free[len(amount) :])
        if not is_allowed(camera):
            return None
        pose_step = step.pose[: len(state.cam_from_target)]  # without the prior's
        poses = move_poses(state.cam_from_target, pose_step, turn_of_centre(state.camera, camera))
        moved = state.problem.at(amount + step.free[: len(amount)])
        near = equations.products if step.predicted <= SHORT**2 * self.cost(equations) else None
        return _CameraState(camera, poses, moved), view_blocks(moved, camera, poses, self.loss, near=near)

    def gives_up(self, there: Blocks) -> bool:
        """As `Solvable`, see `PATIENCE`."""
        hidden = self.is_used & ~np.isfinite(there.residual_px).all(axis=0)
        self.refused += 1
        if self.in_the_way is None or hidden.sum() <= self.in_the_way.sum():
            self.in_the_way = hidden
        return self.refused > PATIENCE


def turn_of_centre(camera: Camera, trial: Camera) -> Array:
    """The rotation vector of the camera that undoes, in the middle of the image, a shift of the principal point."""
    du, dv = trial.params[2:4] - camera.params[2:4]
    fx, fy = trial.params[:2]
    return np.array([dv / fy, -du / fx, 0.0])


def minimise_poses(
    problem: Problem,
    camera: Camera,
    cam_from_target: Array,
    loss: RobustLoss,
    *,
    max_iterations: int,
    small_decrease: float = SMALL_DECREASE,
) -> Minimum:
    """Descend in each view's pose on its own, the camera known; arguments as those of `minimise`."""
    poses = np.array(cam_from_target)
    blocks = view_blocks(problem, camera, poses, loss, of_poses=True)
    views, perfect = problem.view_count, PERFECT_PX**2 * np.diff(problem.view_start)
    damping, open_views = np.full(views, FIRST_DAMPING), np.ones(views, dtype=bool)
    iterations = 0
    while open_views.any() and iterations < max_iterations:
        iterations += 1
        step, promised = np.empty((views, 6)), np.empty(views)
        _pose_steps(blocks.products, damping, step, promised)
        trial = np.where(open_views[:, None, None], move_poses(poses, step), poses)
        there = view_blocks(problem, camera, trial, loss, of_poses=True)
        better = open_views & (there.cost < blocks.cost)
        small = promised <= small_decrease * blocks.cost + perfect
        is_every = better.all()
        poses = trial if is_every else np.where(better[:, None, None], trial, poses)
        blocks = there if is_every else _chosen(problem, blocks, there, better)
        damping = np.where(better, damping * 0.05, damping * 8).clip(1e-15, 1e15)
        open_views &= ~small & (damping < LARGEST_DAMPING)
    return Minimum(camera, poses, blocks, iterations, converged=not open_views.any())


def move_poses(cam_from_target: Array, step: Array, turn: Array | None = None) -> Array:
    """Poses (V, 4, 4) turned by the rotation vectors and shifted by the last three of steps (V, 6).

    Args:
        cam_from_target: where from.
        step: whereto, to first order.
        turn: rotation vector (3,) of the camera that is part of every step. It is made as such, translations turned
            too, which a step along the valley of principal point and direction has to be if it is not to leave it.
    """
    moved = np.array(cam_from_target)
    _move_poses(moved, np.ascontiguousarray(step), np.zeros(3) if turn is None else turn)
    return moved


@jit
def _move_poses(pose: Array, step: Array, turn: Array) -> None:
    """What is not of the turn moves the target, then the turn the camera."""
    rest = np.empty(3)
    for view in range(len(pose)):
        t = pose[view, :, 3]
        x, y, z = turn[1] * t[2] - turn[2] * t[1], turn[2] * t[0] - turn[0] * t[2], turn[0] * t[1] - turn[1] * t[0]
        for i in range(3):
            rest[i] = step[view, i] - turn[i]
        _rotate(pose[view], rest, 3)
        t[0] += step[view, 3] - x
        t[1] += step[view, 4] - y
        t[2] += step[view, 5] - z
        _rotate(pose[view], turn, 4)


@jit
def _rotate(pose: Array, vector: Array, columns: int) -> None:
    """Turn the first columns by a rotation vector: Rodrigues' formula, see `calib.core.se3.exp_rotation`."""
    x, y, z = vector
    square = x * x + y * y + z * z
    if square == 0:
        return
    angle = np.sqrt(square)
    if angle < 1e-4:
        first, second = 1 - square / 6, 0.5 - square / 24
    else:
        first, second = np.sin(angle) / angle, 2 * (np.sin(0.5 * angle) / angle) ** 2
    for column in range(columns):
        a, b, c = pose[0, column], pose[1, column], pose[2, column]
        p, q, r = y * c - z * b, z * a - x * c, x * b - y * a  # the vector's cross product with the column
        pose[0, column] = a + first * p + second * (y * r - z * q)
        pose[1, column] = b + first * q + second * (z * p - x * r)
        pose[2, column] = c + first * r + second * (x * q - y * p)


def moved_camera(camera: Camera, tie: Rows, free: Array) -> Camera:
    """The camera after a step of its free parameters."""
    if not len(free):
        return camera
    return replace(camera, params=camera.params + np.where(tie >= 0, free[tie], 0.0))


@jit
def _pose_steps(products: Array, damping: Array, step: Array, promised: Array) -> None:
    """Damped steps (V, 6) of the poses and the decrease of each view's cost by the undamped quadratic model (V,).

    Both are zero where a pose is not determined.
    """
    first = products.shape[1] - 7
    normal, root = np.empty((6, 6)), np.empty(6)
    for view in range(len(products)):
        h, x = products[view, first:, first:], step[view]
        promised[view] = 0.0
        for i in range(6):
            root[i] = np.sqrt(h[i, i])
        for i in range(6):
            x[i] = -h[i, 6] / root[i]
            for j in range(6):
                normal[i, j] = h[i, j] / (root[i] * root[j])
            normal[i, i] = 1 + damping[view] + 1e-14
        if not cholesky_factor(normal):
            x[:] = 0.0
            continue
        substitute(normal, x)
        for i in range(6):
            x[i] /= root[i]
        for i in range(6):
            row = 2 * h[i, 6]
            for j in range(6):
                row += h[i, j] * x[j]
            promised[view] -= x[i] * row


def _chosen(problem: Problem, old: Blocks, new: Blocks, better: Flags) -> Blocks:
    """The new blocks of the views that got better, and the old ones of the others."""
    per_point = np.repeat(better, np.diff(problem.view_start))
    return Blocks(
        np.where(better, new.cost, old.cost),
        np.where(per_point, new.residual_px, old.residual_px),
        np.where(better[:, None, None], new.products, old.products),
    )
