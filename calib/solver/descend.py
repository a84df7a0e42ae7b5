"""The descent from a first camera and first poses to the minimum, and what robustness asks for after it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.solver.beyond import Shown, lost_views, minimise_shown
from calib.solver.blocks import RobustLoss, view_misfit
from calib.solver.levenberg import Minimum, minimise
from calib.solver.options import Loss, SolveOptions
from calib.solver.outliers import deviations, forgetful, robust_covariance_factor, robust_sigma, whitened
from calib.solver.problem import Problem, few_per_view, select
from calib.solver.tie import Tie

Array = NDArray[np.float64]

NEAR = 1e-10
"""Damping to begin the last descent with."""
ROUNDS = 6
"""Of weighing or leaving out outliers and solving again."""


@dataclass(frozen=True, eq=False)
class Descended:
    """A minimum, what was left out for it, and how far off each observation is."""

    minimum: Minimum
    is_used: NDArray[np.bool_]  # (M,)
    is_beyond: NDArray[np.bool_]  # (M,) not used, because the model does not show them
    sigma_px: float  # robust standard deviation of a coordinate
    deviation: Array  # (M,) in robust standard deviations
    robust: tuple[float, float] | None  # if weights were lowered: sigma of a whitened coordinate, factor of covariances
    is_lost: NDArray[np.bool_]  # (V,) views with too few observations left for a pose; the minimum is then none


def descend(
    problem: Problem, camera: Camera, poses: Array, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> Descended:
    """Down to the minimum, of a part of the observations first: the last steps are then two or three.

    Args:
        problem: what was seen.
        camera: where to start.
        poses: where to start (V, 4, 4).
        tie: free, fixed and shared parameters.
        options: losses and limits.
        cov_px2: of the observations (M, 2, 2), if known.
    """
    steps = options.max_iterations
    starts = [(camera, poses), (without_lens(camera, tie), poses)]
    few = few_per_view(problem.view_count)
    if len(problem.is_used) > 2 * few * problem.view_count:
        thin = select(problem, np.arange(problem.view_count), few)
        loss = _first_loss(thin, camera, poses, options)
        near = minimise(thin, camera, poses, tie.row, loss, max_iterations=steps, small_decrease=1e-6)
        starts.insert(0, (near.camera, near.cam_from_target))
    shown = _best_of(problem, starts, tie, options)
    if is_robust(options):
        shown, is_used = _forgiving(problem, shown, tie, options, cov_px2)
    else:
        is_used = problem.is_used & ~shown.is_beyond
    found = shown.minimum
    residual = found.blocks.residual_px
    robust = None
    if options.loss != "squares":
        standard = whitened(problem.whitener, residual)
        sigma, length = robust_sigma(standard), np.hypot(*standard)[is_used]
        robust = sigma, robust_covariance_factor(length[np.isfinite(length)], RobustLoss(options.loss, sigma))
    sigma_px = robust_sigma(residual)
    return Descended(
        found, is_used, shown.is_beyond, sigma_px, deviations(residual, cov_px2, sigma_px), robust,
        lost_views(problem, is_used),
    )  # fmt: skip


def _best_of(problem: Problem, starts: Sequence[tuple[Camera, Array]], tie: Tie, options: SolveOptions) -> Shown:
    """The minimum from the first start that leads to one with all points; else the one that leaves least error."""
    found = []
    for start in starts:
        loss = _first_loss(problem, *start, options)
        shown = minimise_shown(problem, *start, tie.row, loss, max_iterations=options.max_iterations, damping=NEAR)
        if not shown.is_beyond.any():
            return shown  # else the lens, maybe fitted to a part, folds the image over where the rest lies
        found.append(shown)
    return min(found, key=lambda one: (not one.minimum.converged, one.mean_cost))


def is_robust(options: SolveOptions) -> bool:
    """Whether outliers are expected."""
    return options.loss != "squares" or options.reject_sigma is not None


def without_lens(camera: Camera, tie: Tie) -> Camera:
    """The camera with no distortion but what a person fixed."""
    params = np.where((np.arange(len(camera.params)) < 4) | (tie.row < 0), camera.params, 0.0)
    return replace(camera, params=params)


def _first_loss(problem: Problem, camera: Camera, poses: Array, options: SolveOptions) -> RobustLoss:
    """Squares, or a loss that does not follow outliers."""
    if not is_robust(options):
        return RobustLoss()
    residual = view_misfit(problem, camera, poses, RobustLoss()).residual_px
    return forgetful(whitened(problem.whitener, residual))


def _forgiving(
    problem: Problem, start: Shown, tie: Tie, options: SolveOptions, cov_px2: Array | None
) -> tuple[Shown, NDArray[np.bool_]]:
    """Weigh down or leave out what lies far off, until nothing changes; and which observations then count."""
    found, is_beyond = start.minimum, start.is_beyond
    is_used, steps, taken = problem.is_used, options.max_iterations, found.iterations
    limit = np.inf if options.reject_sigma is None else options.reject_sigma
    kinds: list[Loss] = [options.loss] * ROUNDS if options.reject_sigma is None else ["cauchy"] * 3
    for kind in kinds:
        loss = RobustLoss(kind, robust_sigma(whitened(problem.whitener, found.blocks.residual_px)))
        found = minimise(problem, found.camera, found.cam_from_target, tie.row, loss, max_iterations=steps)
        taken += found.iterations
    for _ in range(0 if options.reject_sigma is None else ROUNDS):
        residual = found.blocks.residual_px
        keeps = problem.is_used & (deviations(residual, cov_px2) <= limit)
        if lost_views(problem, keeps).any():
            return Shown(found, is_beyond), keeps
        loss = RobustLoss(options.loss, robust_sigma(whitened(problem.whitener, residual)))
        kept = replace(problem, is_used=keeps)
        shown = minimise_shown(kept, found.camera, found.cam_from_target, tie.row, loss, max_iterations=steps)
        found, is_beyond = shown.minimum, shown.is_beyond
        taken += found.iterations
        same, is_used = np.array_equal(keeps, is_used), keeps
        if same:
            break
    # Losses that forgive have no barrier: what they do not show lies as far off as can be.
    is_beyond = is_beyond | (problem.is_used & ~np.isfinite(found.blocks.residual_px).all(axis=0))
    return Shown(replace(found, iterations=taken), is_beyond), is_used & ~is_beyond
