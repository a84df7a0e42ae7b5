"""The solution: from observations, without prior knowledge, to a calibration."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.covariance import accuracy_of
from calib.solver.degeneracy import why_degenerate
from calib.solver.levenberg import Minimum, minimise
from calib.solver.options import Loss, SolveOptions
from calib.solver.outliers import deviations, robust_sigma, whitened
from calib.solver.poses import first_poses
from calib.solver.problem import Problem, few_per_view, pack, select
from calib.solver.start import coarse_camera
from calib.solver.tie import Tie, tie_parameters
from calib.types import Calibration, Camera, Observations, Status
from designer.errors import InputError

Array = NDArray[np.float64]

FAR_OFF = 6.0
NEAR = 1e-10
"""Damping to begin the last descent with."""
ROUNDS = 6
"""Of weighing or leaving out outliers and solving again."""


@dataclass(frozen=True, eq=False)
class _Robust:
    """A minimum, what was left out for it, and how far off each observation is."""

    minimum: Minimum
    is_used: NDArray[np.bool_]
    sigma: float  # of a whitened coordinate
    deviation: Array  # (M,) in robust standard deviations


def solve(observations: Observations, model: str, options: SolveOptions | None = None) -> Calibration:
    """Solve a camera and the poses of all views.

    Levenberg-Marquardt on the distances in the image, from linear equations (homographies of planar views, direct
    linear transforms of others) as the start. The result does not depend on the order of the views but for rounding.

    Args:
        observations: what was seen; every view has four points or more that are not on a line.
        model: a camera model that is its parameters alone.
        options: weights, losses, fixed and shared parameters.

    Raises:
        InputError: fewer equations than unknowns, no view whose pose can be found, or options that do not fit.
    """
    begin = time.perf_counter()
    options = options or SolveOptions()
    tie = tie_parameters(model, options)
    problem = pack(observations, weighted=options.weighted)
    _require_equations(problem, tie)
    camera = coarse_camera(problem, model, tie.row, tie.value, options.focal_px, RobustLoss())
    first = first_poses(problem, camera, RobustLoss())
    if not first.found.any():
        raise InputError("no view has a pose that shows its points; check that points and pixels belong together")
    remarks = _left_out(observations, first.found)
    if remarks:
        observations = keep_views(observations, first.found)
        problem = pack(observations, weighted=options.weighted)
        _require_equations(problem, tie)
    robust = _descend(problem, camera, first.cam_from_target[first.found], tie, options, observations.cov_px2)
    return _calibration(observations, robust, tie, options, remarks, time.perf_counter() - begin)


def _descend(
    problem: Problem, camera: Camera, poses: Array, tie: Tie, options: SolveOptions, cov: Array | None
) -> _Robust:
    """Down to the minimum, of a part of the observations first: the last steps are then two or three."""
    steps = options.max_iterations
    is_robust = options.loss != "squares" or options.reject_sigma is not None
    starts = [(camera, poses), (_without_lens(camera, tie), poses)]
    few = few_per_view(problem.view_count)
    if len(problem.is_used) > 2 * few * problem.view_count:
        thin = select(problem, np.arange(problem.view_count), few)
        loss = _forgetful(thin, camera, poses) if is_robust else RobustLoss()
        near = minimise(thin, camera, poses, tie.row, loss, max_iterations=steps, small_decrease=1e-6)
        starts.insert(0, (near.camera, near.cam_from_target))
    for start in starts:
        loss = _forgetful(problem, *start) if is_robust else RobustLoss()
        found = minimise(problem, *start, tie.row, loss, max_iterations=steps, damping=NEAR)
        if np.isfinite(found.blocks.cost).all():
            break  # else the lens, fitted to a part, folds the image over where the rest lies
    is_used = problem.is_used
    if is_robust:
        found, is_used = _robust(problem, found, tie, options, cov)
    residual = found.blocks.residual_px
    return _Robust(found, is_used, robust_sigma(whitened(problem.whitener, residual)), deviations(residual, cov))


def _without_lens(camera: Camera, tie: Tie) -> Camera:
    """The camera with no distortion but what a person fixed."""
    params = np.where((np.arange(len(camera.params)) < 4) | (tie.row < 0), camera.params, 0.0)
    return replace(camera, params=params)


def _forgetful(problem: Problem, camera: Camera, poses: Array) -> RobustLoss:
    """A loss that outliers do not draw: squares alone would follow them before they can be told."""
    residual = view_blocks(problem, camera, poses, RobustLoss()).residual_px
    return RobustLoss("cauchy", robust_sigma(whitened(problem.whitener, residual)))


def _robust(
    problem: Problem, found: Minimum, tie: Tie, options: SolveOptions, cov: Array | None
) -> tuple[Minimum, NDArray[np.bool_]]:
    """Weigh down or leave out what lies far off, until nothing changes."""
    is_used, steps, taken = problem.is_used, options.max_iterations, found.iterations
    limit = np.inf if options.reject_sigma is None else options.reject_sigma
    kinds: list[Loss] = [options.loss] * ROUNDS if options.reject_sigma is None else ["cauchy"] * 3
    for kind in kinds:
        loss = RobustLoss(kind, robust_sigma(whitened(problem.whitener, found.blocks.residual_px)))
        found = minimise(problem, found.camera, found.cam_from_target, tie.row, loss, max_iterations=steps)
        taken += found.iterations
    for _ in range(0 if options.reject_sigma is None else ROUNDS):
        residual = found.blocks.residual_px
        keeps = problem.is_used & (deviations(residual, cov) <= limit)
        loss = RobustLoss(options.loss, robust_sigma(whitened(problem.whitener, residual)))
        kept = replace(problem, is_used=keeps)
        found = minimise(kept, found.camera, found.cam_from_target, tie.row, loss, max_iterations=steps)
        taken += found.iterations
        same, is_used = np.array_equal(keeps, is_used), keeps
        if same:
            break
    return replace(found, iterations=taken), is_used


def _calibration(
    observations: Observations, robust: _Robust, tie: Tie, options: SolveOptions, remarks: list[str], seconds: float
) -> Calibration:
    found = robust.minimum
    robust_scale = None if options.loss == "squares" else robust.sigma
    accuracy = accuracy_of(found.blocks.products, tie.row, int(robust.is_used.sum()), robust_scale)
    reason = why_degenerate(observations, found, accuracy, tie)
    status: Status = "degenerate" if reason else "converged" if found.converged else "stopped"
    if reason:
        remarks = [reason, *remarks]
    elif not found.converged:
        remarks = [f"stopped after {found.iterations} steps, short of the minimum; allow more", *remarks]
    left_out = int((~robust.is_used).sum())
    if options.reject_sigma is None and options.loss == "squares":
        remarks = [*remarks, *_far_off(observations, robust)]
    if left_out:
        views = len(np.unique(observations.view[~robust.is_used]))
        limit = f"beyond {options.reject_sigma:g} robust standard deviations"
        remarks = [*remarks, f"{left_out} of {len(robust.is_used)} observations in {views} views left out: {limit}"]
    return Calibration(
        found.camera, observations, found.cam_from_target, found.blocks.residual_px.T, ~robust.is_used,
        accuracy.scale, accuracy.param_covariance, accuracy.pose_covariance, tie.fixed,
        options.weighted and observations.cov_px2 is not None, status, tuple(remarks), found.iterations, seconds,
    )  # fmt: skip


def _far_off(observations: Observations, robust: _Robust) -> list[str]:
    """A word on observations that noise does not explain, if they were neither left out nor weighed down."""
    far = np.flatnonzero(robust.deviation > FAR_OFF)
    if not len(far):
        return []
    worst = int(far[np.argmax(robust.deviation[far])])
    off = float(np.hypot(*robust.minimum.blocks.residual_px[:, worst]))
    return [
        f"{len(far)} of {len(robust.deviation)} observations are off by more than {FAR_OFF:g} robust standard "
        f"deviations, the worst by {off:.3g} px in {observations.view_names[observations.view[worst]]}; look at them, "
        "or reject them"
    ]


def _require_equations(problem: Problem, tie: Tie) -> None:
    """Refuse fewer equations than unknowns."""
    unknowns = int(tie.row.max(initial=-1)) + 1 + 6 * problem.view_count
    equations = 2 * int(problem.is_used.sum())
    if equations < unknowns or problem.view_count == 0:
        raise InputError(
            f"{equations // 2} observations in {problem.view_count} views: too few rings for {unknowns} unknowns; "
            f"take more photos, or fix parameters"
        )


def _left_out(observations: Observations, found: NDArray[np.bool_]) -> list[str]:
    """What to say of views without a pose."""
    return [
        f"{observations.view_names[view]}: left out: no pose shows its points where they were seen"
        for view in np.flatnonzero(~found).tolist()
    ]


def keep_views(observations: Observations, keep: NDArray[np.bool_]) -> Observations:
    """The observations of some views.  # (V,) of bool"""
    if keep.all():
        return observations
    rows = keep[observations.view]
    return replace(
        observations,
        view_names=tuple(name for name, kept in zip(observations.view_names, keep.tolist(), strict=True) if kept),
        view=(np.cumsum(keep) - 1)[observations.view[rows]],
        point=observations.point[rows],
        center_px=observations.center_px[rows],
        cov_px2=None if observations.cov_px2 is None else observations.cov_px2[rows],
    )
