"""The descent to the minimum: of models that do not show every point, and what robustness asks for after it.

A model that is kept where it is one-to-one has no image of some points, and no sum of squares is defined once one of
those counts. So the points that stand in the way of the descent are left out, it goes on with the others to their
minimum, and what the camera then shows is taken back. A point that was left out twice stays out: the model cannot show
it together with the others. What comes out is a minimum of the points that count, all of them shown.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import neutral
from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.types import LEAST_POINTS
from calib.solver.accuracy import accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks, view_misfit
from calib.solver.levenberg import DescentSteps, Minimum, minimise
from calib.solver.outliers import deviations, forgetful, robust_scale, robust_sigma, whitened
from calib.solver.problem import Loss, Problem, SolveOptions, Tie, few_per_view
from designer.base.arrays import Array, Flags, Rows

MOST_ROUNDS = 60
"""Of leaving out and taking back."""
WIDER = 0.004
"""Part of the angle off the axis by which more is left out each time that leaving out was not enough."""
TWICE = 2
DIMENSIONS = 2
"""Of displacements that are not drawn to zero, for fewer that would be worse (Stein 1956)."""
NEAR = 1e-10
"""Damping to begin the last descent with."""
CLOSE = 1e-12
"""Of the cost, what the last step from a minimum to one close by may promise: 1e-4 standard deviations."""
PRIOR_ROUNDS, SAME_VARIANCE = 6, 0.01
"""Of weighing what is believed against what observations leave over, until that changes by less."""
LEAST_SCALE = 1e-9
"""Of perfect data."""
ROUNDS = 6
"""Of weighing or leaving out outliers and solving again."""


@dataclass(frozen=True, eq=False)
class ShownMinimum:
    """A minimum of the points that the model shows there."""

    minimum: Minimum
    is_beyond: Flags  # (M,) points that were to count and do not, because the model does not show them

    @property
    def mean_cost(self) -> float:
        """Of a point that counts; infinite without any."""
        count = int((~self.is_beyond).sum())
        return float(self.minimum.blocks.cost.sum()) / count if count else np.inf


def minimise_shown(
    problem: Problem, camera: Camera, cam_from_target: Array, tie: Rows, loss: RobustLoss, steps: DescentSteps
) -> ShownMinimum:
    """Descend to a minimum of the points that the model shows there; arguments as those of `minimise`."""
    is_beyond = np.zeros_like(problem.is_used)
    times = np.zeros(len(is_beyond), dtype=np.int64)  # that each was left out
    iterations, rounds, in_a_row = 0, 0, 0
    while True:
        part = replace(problem, is_used=problem.is_used & ~is_beyond)
        found = minimise(part, camera, cam_from_target, tie, loss, steps)
        camera, cam_from_target, problem = found.camera, found.cam_from_target, problem.at(found.amount)
        iterations, rounds = iterations + found.iterations, rounds + 1
        in_a_row = 0 if found.converged else in_a_row + 1
        change = _taken_back(found, is_beyond, times) if found.converged else _in_the_way(part, found, in_a_row)
        if rounds == MOST_ROUNDS or not change.any():
            break
        is_beyond = is_beyond ^ change
        times += is_beyond & change
        if lost_views(problem, problem.is_used & ~is_beyond).any():
            break
    return ShownMinimum(replace(found, iterations=iterations), is_beyond)


def _in_the_way(problem: Problem, found: Minimum, in_a_row: int) -> Flags:
    """Points to go on without: those that stood in the way, and where that was not enough, ever more next to them."""
    if found.in_the_way is None:
        return np.zeros_like(problem.is_used)
    pose = found.cam_from_target[problem.view]
    x, y, z = ((pose[:, :3, :3] @ problem.position_mm.T[:, :, None])[:, :, 0] + pose[:, :3, 3]).T
    off_axis = np.arctan2(np.hypot(x, y), z)
    limit = (1 - WIDER * (in_a_row - 1)) * off_axis[found.in_the_way].min(initial=np.inf)
    wider: Flags = problem.is_used & (found.in_the_way | (off_axis > limit))
    return wider


def _taken_back(found: Minimum, is_beyond: Flags, times: Rows) -> Flags:
    """Points that were left out, but not twice, and that the camera shows after all."""
    if not is_beyond.any():
        return is_beyond
    shown: Flags = is_beyond & np.isfinite(found.blocks.residual_px).all(axis=0) & (times < TWICE)
    return shown


def lost_views(problem: Problem, is_used: Flags) -> Flags:
    """Views of which fewer observations count than a pose needs.  # (V,)"""
    lost: Flags = np.add.reduceat(is_used.astype(np.int64), problem.view_start[:-1]) < LEAST_POINTS
    return lost


@dataclass(frozen=True, eq=False)
class Descended:
    """A minimum, what was left out for it, and how far off each observation is."""

    minimum: Minimum
    is_used: Flags  # (M,)
    is_beyond: Flags  # (M,) not used, because the model does not show them
    sigma_px: float  # robust standard deviation of a coordinate
    deviation: Array  # (M,) in robust standard deviations
    robust: tuple[float, float] | None  # if weights were lowered: sigma of a whitened coordinate, factor of covariances
    is_lost: Flags  # (V,) views with too few observations left for a pose; the minimum is then none


def descend(
    problem: Problem, camera: Camera, poses: Array, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> Descended:
    """Down to the minimum, of a part of the observations first: the last steps are then two or three."""
    steps = options.max_iterations
    starts = [(camera, poses), (without_lens(camera, tie), poses)]
    if len(problem.is_used) > 2 * few_per_view(problem.view_count) * problem.view_count:
        thin = problem.few
        loss = _first_loss(thin, camera, poses, options)
        near = minimise(thin, camera, poses, tie.row, loss, DescentSteps(steps, small_decrease=1e-6))
        starts.insert(0, (near.camera, near.cam_from_target))
    return _described(problem, _best_of(problem, starts, tie, options), tie, options, cov_px2)


def descend_displaced(
    problem: Problem, start: Descended, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> Descended:
    """From a minimum with the points where they were to that with displacements and a prior, by what is left over."""
    found, taken = start, start.minimum.iterations
    for _ in range(PRIOR_ROUNDS):
        problem = with_variance(problem.at(found.minimum.amount), found, tie, options)
        before, (camera, poses) = problem.prior, (found.minimum.camera, found.minimum.cam_from_target)
        loss = _first_loss(problem, camera, poses, options)
        steps = options.max_iterations
        shown = minimise_shown(problem, camera, poses, tie.row, loss, DescentSteps(steps, damping=NEAR))
        found = _described(problem, shown, tie, options, cov_px2)
        taken += found.minimum.iterations
        after = with_variance(problem, found, tie, options).prior
        if before is None or after is None or abs(after.variance / before.variance - 1) < SAME_VARIANCE:
            break
    return replace(found, minimum=replace(found.minimum, iterations=taken))


def shrunk(problem: Problem, found: Descended, tie: Tie, options: SolveOptions, cov_px2: Array | None) -> Descended:
    """The minimum with displacements drawn to zero as far as they are chance (James and Stein's, its positive part).

    With amounts h of covariance C they are `1 - (S - 2) / h'C^-1 h` of what they were: so a target that is as its file
    says costs next to nothing, and for no other one is this worse on average. What is stated stays that of free ones.
    """
    amount, minimum = found.minimum.amount, found.minimum
    count, used = len(amount), int(found.is_used.sum())
    blocks = minimum.blocks
    sure = accuracy_of(blocks.products, problem.rows(tie.row), used, found.robust, blocks.prior)
    square = float(amount @ symmetric_inverse(sure.param_covariance[:count, :count]).inverse @ amount)
    if count <= DIMENSIONS or not (minimum.converged and 0 < square < np.inf):
        return found
    problem = with_variance(problem.at(max(1 - (count - DIMENSIONS) / square, 0.0) * amount), found, tie, options)
    problem = replace(problem, is_used=found.is_used)
    loss = RobustLoss()
    if options.loss != "squares":
        loss = RobustLoss(options.loss, robust_sigma(whitened(problem.whitener, minimum.blocks.residual_px)))
    steps = DescentSteps(options.max_iterations, damping=NEAR)
    there = minimise(problem.without_amounts, minimum.camera, minimum.cam_from_target, tie.row, loss, steps)
    blocks = view_blocks(problem, there.camera, there.cam_from_target, loss)
    there = replace(there, blocks=blocks, amount=problem.amount, iterations=minimum.iterations + there.iterations)
    return descended_at(problem, there, found.is_used, found.is_beyond, found.robust, cov_px2)


def with_variance(problem: Problem, found: Descended, tie: Tie, options: SolveOptions) -> Problem:
    """The problem with its prior weighed against what observations leave over at a minimum."""
    if problem.prior is None:
        return problem
    minimum = found.minimum
    scale = robust_sigma(whitened(problem.whitener, minimum.blocks.residual_px))
    if not is_robust(options):
        row = problem.rows(tie.row) if len(minimum.amount) else tie.row
        exact = accuracy_of(minimum.blocks.products, row, int(found.is_used.sum()), prior=minimum.blocks.prior).scale
        scale = exact if np.isfinite(exact) else scale
    return replace(problem, prior=replace(problem.prior, variance=max(scale, LEAST_SCALE) ** 2))


def _described(
    problem: Problem, shown: ShownMinimum, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> Descended:
    """A minimum with what robustness asks for after it."""
    if is_robust(options):
        shown, is_used = _forgiving(problem, shown, tie, options, cov_px2)
    else:
        is_used = problem.is_used & ~shown.is_beyond
    found, robust = shown.minimum, None
    if options.loss != "squares":
        standard = whitened(problem.whitener, found.blocks.residual_px)
        robust = robust_scale(standard, is_used, RobustLoss(options.loss, robust_sigma(standard)))
    return descended_at(problem, found, is_used, shown.is_beyond, robust, cov_px2)


def descended_at(
    problem: Problem, minimum: Minimum, is_used: Flags, is_beyond: Flags, robust: tuple[float, float] | None,
    cov_px2: Array | None,
) -> Descended:  # fmt: skip
    """A minimum, with how far off each observation is there."""
    residual = minimum.blocks.residual_px
    sigma_px = robust_sigma(residual)
    deviation = deviations(residual, cov_px2, sigma_px)
    return Descended(minimum, is_used, is_beyond, sigma_px, deviation, robust, lost_views(problem, is_used))


def descend_again(problem: Problem, found: Descended, tie: Tie, options: SolveOptions) -> Descended:
    """From a minimum to that of the same observations with other weights, close by."""
    minimum = found.minimum
    kept = replace(with_variance(problem.at(minimum.amount), found, tie, options), is_used=found.is_used)
    steps = DescentSteps(options.max_iterations, small_decrease=CLOSE, damping=NEAR)
    there = minimise(kept, minimum.camera, minimum.cam_from_target, tie.row, RobustLoss(), steps)
    return replace(found, minimum=replace(there, iterations=minimum.iterations + there.iterations))


def _best_of(problem: Problem, starts: Sequence[tuple[Camera, Array]], tie: Tie, options: SolveOptions) -> ShownMinimum:
    """The minimum from the first start that leads to one with all points; else the one that leaves least error."""
    found = []
    for start in starts:
        loss = _first_loss(problem, *start, options)
        shown = minimise_shown(problem, *start, tie.row, loss, DescentSteps(options.max_iterations, damping=NEAR))
        if not shown.is_beyond.any():
            return shown  # else the lens, maybe fitted to a part, folds the image over where the rest lies
        found.append(shown)
    return min(found, key=lambda one: (not one.minimum.converged, one.mean_cost))


def is_robust(options: SolveOptions) -> bool:
    """Whether outliers are expected."""
    return options.loss != "squares" or options.reject_sigma is not None


def without_lens(camera: Camera, tie: Tie) -> Camera:
    """The camera with no distortion but what a person fixed."""
    linear = np.arange(len(camera.params)) < 4
    params = np.where(linear | (tie.row < 0), camera.params, neutral(camera.model))
    return replace(camera, params=params)


def _first_loss(problem: Problem, camera: Camera, poses: Array, options: SolveOptions) -> RobustLoss:
    """Squares, or a loss that does not follow outliers."""
    if not is_robust(options):
        return RobustLoss()
    residual = view_misfit(problem, camera, poses, RobustLoss()).residual_px
    return forgetful(whitened(problem.whitener, residual))


def _forgiving(
    problem: Problem, start: ShownMinimum, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> tuple[ShownMinimum, Flags]:
    """Weigh down or leave out what lies far off, until nothing changes; and which observations then count."""
    found, is_beyond = start.minimum, start.is_beyond
    is_used, steps, taken = problem.is_used, options.max_iterations, found.iterations
    limit = np.inf if options.reject_sigma is None else options.reject_sigma
    kinds: list[Loss] = [options.loss] * ROUNDS if options.reject_sigma is None else ["cauchy"] * 3
    for kind in kinds:
        loss = RobustLoss(kind, robust_sigma(whitened(problem.whitener, found.blocks.residual_px)))
        found = minimise(
            problem.at(found.amount), found.camera, found.cam_from_target, tie.row, loss, DescentSteps(steps)
        )
        taken += found.iterations
    for _ in range(0 if options.reject_sigma is None else ROUNDS):
        residual = found.blocks.residual_px
        keeps = problem.is_used & (deviations(residual, cov_px2) <= limit)
        if lost_views(problem, keeps).any():
            return ShownMinimum(found, is_beyond), keeps
        loss = RobustLoss(options.loss, robust_sigma(whitened(problem.whitener, residual)))
        kept = replace(problem.at(found.amount), is_used=keeps)
        shown = minimise_shown(kept, found.camera, found.cam_from_target, tie.row, loss, DescentSteps(steps))
        found, is_beyond = shown.minimum, shown.is_beyond
        taken += found.iterations
        same, is_used = np.array_equal(keeps, is_used), keeps
        if same:
            break
    # Losses that forgive have no barrier: what they do not show lies as far off as can be.
    is_beyond = is_beyond | (problem.is_used & ~np.isfinite(found.blocks.residual_px).all(axis=0))
    return ShownMinimum(replace(found, iterations=taken), is_beyond), is_used & ~is_beyond
