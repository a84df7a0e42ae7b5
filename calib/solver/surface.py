"""A surface over the image of a solved camera: hundreds of control points, from the same sightings.

The base, a model of few parameters, is solved first, from nothing; then all are solved together, Gauss-Newton on
`sum loss(r) + d' Q d` with the precision Q of the control points d that makes the photos likeliest
(`calib.solver.surface_equations`). What the base's parameters and a turn of the camera do as well is theirs: the
surface has no part in those directions. Where nothing was seen the prior carries on, and the covariance, that of the
parameters given the photos, grows to its amplitude. It supposes that the control points can be the lens: what is too
rough for them is no part of it, and outweighs it where photos of little noise tell the rest that well.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import is_allowed
from calib.cameras.camera import Camera
from calib.cameras.surface import SurfaceModel
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread_with_scipy
from calib.solver.accuracy import Accuracy, UndeterminedError
from calib.solver.blocks import Blocks, Misfit, RobustLoss, view_misfit
from calib.solver.costs import IMAGE
from calib.solver.descend import ROUNDS, Descended, descended_at, is_robust, lost_views
from calib.solver.levenberg import FIRST_DAMPING, Minimum, move_poses, turn_of_centre
from calib.solver.outliers import deviations, robust_scale, robust_sigma, whitened
from calib.solver.problem import Loss, Problem, SolveOptions, Tie
from calib.solver.surface_equations import (
    POSE,
    Smoothness,
    SurfaceEquations,
    SurfaceProblem,
    eliminated,
    free_motions,
    likeliest,
    precision,
    roughness,
    surface_equations,
)
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError

LEAST_VIEWS = 3
"""Of two, poses take up what the surface would be told by."""
LEARN_IN_ROUNDS = 2
"""The smoothness is that of the base's residuals first, then of the surface's own."""
MOST_STEPS = 30
SMALL_DECREASE = 1e-10
"""Of the cost: with 100,000 observations the unknowns are then within a few thousandths of standard deviations."""
LARGEST_DAMPING = 1e6


@dataclass(frozen=True, eq=False)
class _State:
    """Where the descent is."""

    camera: Camera
    cam_from_target: Array  # (V, 4, 4)
    amount: Array  # (S,)
    smoothness: Smoothness | None = None
    iterations: int = 0
    converged: bool = False


@dataclass(frozen=True, eq=False)
class _Bending:
    """What stays the same during the descent."""

    problem: Problem
    model: SurfaceModel
    spread: Array  # (B, F) of the base's free parameters; control points are all free
    parts: Array  # see `roughness`

    @property
    def extra(self) -> int:
        """Amounts of displacements of the points; the first of `spread`."""
        return len(self.problem.amount)

    @property
    def free(self) -> int:
        """Free parameters of the base."""
        return int(self.spread.shape[1])

    def normal_of_free(self, matrix: Array) -> Array:
        """A symmetric matrix of all parameters (P, P) by the free ones (Q, Q)."""
        base, free = self.spread.shape
        part = np.empty((len(matrix) - base + free,) * 2)
        part[:free, :free] = self.spread.T @ matrix[:base, :base] @ self.spread
        part[:free, free:] = self.spread.T @ matrix[:base, base:]
        part[free:, :free] = part[:free, free:].T
        part[free:, free:] = matrix[base:, base:]
        return part

    def gradient_of_free(self, vector: Array) -> Array:
        """The same of a gradient."""
        return np.concatenate([self.spread.T @ vector[: len(self.spread)], vector[len(self.spread) :]])

    def of_all(self, free: Array) -> Array:
        """A step of the free parameters (Q, ...) as one of all (P, ...)."""
        return np.concatenate([self.spread @ free[: self.free], free[self.free :]])

    def loss(self, kind: Loss, residual_px: Array) -> RobustLoss:
        """A loss with its knee where these residuals bend."""
        return RobustLoss(kind, robust_sigma(whitened(self.problem.whitener, residual_px)))

    def misfit_of(self, state: _State, loss: RobustLoss) -> Misfit:
        """Of all sightings."""
        return view_misfit(self.at(state), state.camera, state.cam_from_target, loss)

    def at(self, state: _State) -> Problem:
        """The problem with the points where they are."""
        return self.problem.at(state.amount)

    def off(self, state: _State) -> Array:
        """All unknowns but poses, from what is believed of them; control points from zero."""
        value = np.concatenate([state.amount, state.camera.params])
        if self.problem.prior is not None:
            value[: len(self.spread)] -= self.problem.prior.mean
        return value

    def belief(self, size: int) -> Array:
        """The problem's prior precision of all unknowns but poses, without that of control points."""
        belief, first, prior = np.zeros((size, size)), len(self.spread), self.problem.prior
        if prior is not None:
            belief[:first, :first] = prior.variance * prior.precision
        return belief


def require_image(model: SurfaceModel, options: SolveOptions) -> None:
    """Refuse what is not minimised with a surface.

    Raises:
        InputError: so it is.
    """
    if options.minimise != IMAGE:
        raise InputError(
            f"minimise {options.minimise}: with the {model.name} model distances in the image are minimised; leave it "
            f"out, or solve another model, such as {model.base.name}"
        )


def require_points(problem: Problem, model: SurfaceModel) -> None:
    """Refuse fewer sightings than control points, or too few photos.

    Raises:
        UndeterminedError: so it is.
    """
    count, least = int(problem.is_used.sum()), model.control_rows * model.control_columns
    if count < least or problem.view_count < LEAST_VIEWS:
        views = f"{problem.view_count} view{'s' * (problem.view_count != 1)}"
        raise UndeterminedError(
            f"{count} observations in {views}: too few for the surface of the {model.name} model, which takes {least} "
            f"in {LEAST_VIEWS} views or more; take more photos, or solve {model.base.name}"
        )


def without_rejection(options: SolveOptions) -> SolveOptions:
    """For the base: what it does not follow may be no outlier, and is weighed down only."""
    if options.reject_sigma is None:
        return options
    return replace(options, reject_sigma=None, loss="cauchy")


@one_thread_with_scipy
def bend(
    problem: Problem, base: Descended, model: SurfaceModel, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> tuple[Descended, Accuracy]:
    """Solve all together, from a minimum of the base: the minimum of both, and how sure it is; see `descend`."""
    minimum, straight = base.minimum, np.zeros(2 * model.control_rows * model.control_columns)
    camera = Camera(model.name, np.concatenate([minimum.camera.params, straight]), problem.image_size)
    state = _State(camera, minimum.cam_from_target, minimum.amount, iterations=minimum.iterations)
    row = problem.rows(tie.row)
    spread: Array = (row[:, None] == np.arange(int(row.max(initial=-1)) + 1)).astype(np.float64)
    parts = roughness(
        model.scale(problem.image_size),
        (model.control_rows, model.control_columns),
        0.5 * float(np.hypot(*problem.image_size)),
    )
    task = _Bending(problem, model, spread, parts)
    is_beyond = problem.is_used & ~np.isfinite(task.misfit_of(state, RobustLoss()).residual_px).all(axis=0)
    task = replace(task, problem=replace(problem, is_used=problem.is_used & ~is_beyond))
    return _forgiving(task, state, is_beyond, options, cov_px2)


def _forgiving(
    task: _Bending, state: _State, is_beyond: Flags, options: SolveOptions, cov_px2: Array | None
) -> tuple[Descended, Accuracy]:
    """Descend, and weigh down or leave out what lies far off, until nothing changes."""
    limit, is_used, loss = options.reject_sigma, task.problem.is_used, RobustLoss()
    first: Loss = options.loss if limit is None else "cauchy"
    kinds: list[Loss] = [first] * LEARN_IN_ROUNDS
    kinds += [options.loss] * (ROUNDS if is_robust(options) else 0)
    for count, kind in enumerate(kinds):
        residual, before = task.misfit_of(state, RobustLoss()).residual_px, is_used
        if limit is not None and count >= LEARN_IN_ROUNDS:
            is_used = task.problem.is_used & (deviations(residual, cov_px2) <= limit)
            if lost_views(task.problem, is_used).any():
                break
            if count > LEARN_IN_ROUNDS and np.array_equal(before, is_used):
                break
        loss = task.loss(kind, residual)
        part = replace(task, problem=replace(task.problem, is_used=is_used))
        state = _descended(part, state, loss, learns=count <= LEARN_IN_ROUNDS)
    return _bent(
        replace(task, problem=replace(task.problem, is_used=is_used)), state, loss, is_beyond, options, cov_px2
    )


def _weights(task: _Bending, state: _State, loss: RobustLoss) -> Array:
    """By which the squares of the residuals count (M,): the loss' derivative."""
    if loss.kind == "squares":
        return np.ones(len(task.problem.is_used))
    return loss.weights(np.hypot(*whitened(task.problem.whitener, task.misfit_of(state, loss).residual_px)))


def _equations(task: _Bending, state: _State, loss: RobustLoss) -> SurfaceEquations:
    weight = _weights(task, state, loss)
    return surface_equations(task.at(state), task.model, state.camera, state.cam_from_target, weight)


def _descended(task: _Bending, state: _State, loss: RobustLoss, *, learns: bool) -> _State:
    """Find how smooth the surface is, if it is to be learned, and go down from there."""
    equations = _equations(task, state, loss)
    surface = _surface_problem(task, state, equations)
    smoothness = state.smoothness
    if learns or smoothness is None:
        smoothness = likeliest(surface, smoothness)
    return _lowest(task, replace(state, smoothness=smoothness), loss, _prior(task, surface, smoothness))


def _surface_problem(task: _Bending, state: _State, equations: SurfaceEquations) -> SurfaceProblem:
    """The problem of the control points alone, counted from zero."""
    free, control = task.free, state.camera.params[task.model.first_control :]
    found = eliminated(equations)
    belief, off = task.belief(len(found.normal)), task.off(state)
    normal, gradient = task.normal_of_free(found.normal + belief), task.gradient_of_free(found.gradient + belief @ off)
    inverse, across = symmetric_inverse(normal[:free, :free]).inverse, normal[:free, free:]
    pull = inverse @ gradient[:free]
    inner = normal[free:, free:] - across.T @ inverse @ across
    slope = gradient[free:] - across.T @ pull
    at_zero = slope - inner @ control
    square = (
        found.square + float(off @ belief @ off) - float(gradient[:free] @ pull) - float((slope + at_zero) @ control)
    )
    freedom = 2 * int(task.problem.is_used.sum()) - POSE * task.problem.view_count - free
    of_base = task.spread[task.extra :, task.extra :]
    pinned = free_motions(equations, state.cam_from_target, of_base, task.extra)
    return SurfaceProblem(inner, at_zero, square, freedom, pinned, task.parts)


def _prior(task: _Bending, surface: SurfaceProblem, smoothness: Smoothness) -> Array:
    """The precision of all unknowns but poses: that of the control points, and the problem's."""
    first = len(task.spread)
    prior = task.belief(first + 2 * len(task.parts[0]))
    prior[first:, first:] = surface.prior(precision(task.parts, smoothness))
    return prior


def _lowest(task: _Bending, state: _State, loss: RobustLoss, prior: Array) -> _State:
    """Levenberg-Marquardt: the sum of the losses, and the control points by their prior."""
    from scipy.linalg.lapack import dpotrf, dpotrs

    def cost_of(there: _State) -> float:
        off = task.off(there)
        return float(task.misfit_of(there, loss).cost.sum() + off @ prior @ off)

    cost, damping = cost_of(state), 0.0
    equations = _equations(task, state, loss)
    for _ in range(MOST_STEPS):
        found = eliminated(equations, damping)
        normal = task.normal_of_free(found.normal + prior)
        gradient = task.gradient_of_free(found.gradient + prior @ task.off(state))
        normal[np.diag_indices(len(normal))] *= 1 + damping
        free = -dpotrs(dpotrf(normal.T, lower=1, overwrite_a=1)[0], gradient, lower=1)[0]
        step = task.of_all(free)
        amount = state.amount + step[: task.extra]
        trial = replace(state.camera, params=state.camera.params + step[task.extra :])
        poses = move_poses(state.cam_from_target, found.pose_step(step), turn_of_centre(state.camera, trial))
        there = replace(state, camera=trial, cam_from_target=poses, amount=amount, iterations=state.iterations + 1)
        trial_cost = cost_of(there) if is_allowed(trial) else np.inf
        promised = -float(gradient @ free)
        state = replace(state, iterations=there.iterations, converged=promised <= SMALL_DECREASE * cost)
        if trial_cost < cost:
            state, cost, damping = replace(there, converged=state.converged), trial_cost, 0.1 * damping
            equations = _equations(task, state, loss)
        elif not state.converged:
            damping = max(10 * damping, FIRST_DAMPING)
        if state.converged or damping > LARGEST_DAMPING:
            break
    return state


def _inverse(normal: Array) -> Array:
    """Of a positive definite matrix; nan if it is none."""
    from scipy.linalg.lapack import dpotrf, dpotri

    factor, failed = dpotrf(normal, lower=1)
    inverse = np.tril(dpotri(factor, lower=1, overwrite_c=1)[0])
    return np.full_like(normal, np.nan) if failed else inverse + np.tril(inverse, -1).T


def _bent(
    task: _Bending, state: _State, loss: RobustLoss, is_beyond: Flags, options: SolveOptions, cov_px2: Array | None
) -> tuple[Descended, Accuracy]:
    """What came of it."""
    problem, misfit = task.problem, task.misfit_of(state, loss)
    residual, equations = misfit.residual_px, _equations(task, state, loss)
    robust = None
    if options.loss != "squares":
        robust = robust_scale(whitened(problem.whitener, residual), problem.is_used, loss)
    accuracy = _accuracy(task, state, equations, robust)
    minimum = Minimum(
        state.camera, state.cam_from_target, Blocks(misfit.cost, residual, equations.pose), state.iterations,
        state.converged, amount=state.amount,
    )  # fmt: skip
    return descended_at(problem, minimum, problem.is_used, is_beyond, robust, cov_px2), accuracy


def _accuracy(
    task: _Bending, state: _State, equations: SurfaceEquations, robust: tuple[float, float] | None
) -> Accuracy:
    """Covariances of all parameters and of the poses, given the photos and the prior.

    With S the normal matrix without the poses, it is `(S + Q)^-1` times the noise's variance, which is the sum of
    squares over the observations less the poses and what the photos told of the parameters, `tr (S + Q)^-1 S`.
    """
    if state.smoothness is None:
        raise ValueError("the smoothness is not known yet")
    surface, found = _surface_problem(task, state, equations), eliminated(equations)
    prior, used = _prior(task, surface, state.smoothness), int(task.problem.is_used.sum())
    of_free = _inverse(task.normal_of_free(found.normal + prior))
    inverse = task.of_all(task.of_all(of_free).T)
    redundancy = 2 * used - POSE * task.problem.view_count - float((inverse * found.normal).sum())
    scale = float(np.sqrt(equations.square / redundancy)) if redundancy > 0 else float("nan")
    factor = scale**2
    if robust is not None and redundancy > 0:
        scale, factor = robust[0], robust[1] * 2 * used / redundancy
    poses = found.pose_inverse + found.turn @ inverse @ found.turn.transpose(0, 2, 1)
    return Accuracy(scale, factor * inverse, factor * poses, np.zeros(len(inverse)), 1.0)
