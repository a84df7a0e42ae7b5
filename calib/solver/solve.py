"""The solution: from observations, without prior knowledge, to a calibration."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.solver.blocks import RobustLoss
from calib.solver.covariance import accuracy_of
from calib.solver.degeneracy import why_degenerate
from calib.solver.levenberg import Minimum, minimise
from calib.solver.options import SolveOptions
from calib.solver.poses import first_poses
from calib.solver.problem import Problem, few_per_view, pack, select
from calib.solver.start import coarse_camera
from calib.solver.tie import Tie, tie_parameters
from calib.types import Calibration, Camera, Observations, Status
from designer.errors import InputError

Array = NDArray[np.float64]

MEDIAN_LENGTH = 1.1774100225154747
"""Median length of a normal vector in the plane, sqrt(2 ln 2), in standard deviations of a coordinate."""
FAR_OFF = 6.0
NEAR = 1e-10
"""Damping to begin the last descent with."""
ROUNDS = 6
"""Of weighing or leaving out outliers and solving again."""


@dataclass(frozen=True, eq=False)
class _Robust:
    """A minimum, what was left out for it, and the standard deviation that outliers are judged by."""

    minimum: Minimum
    is_used: NDArray[np.bool_]
    sigma: float  # from the median residual, whitened


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
    robust = _descend(problem, camera, first.cam_from_target[first.found], tie, options)
    return _calibration(observations, robust, tie, options, remarks, time.perf_counter() - begin)


def _descend(problem: Problem, camera: Camera, poses: Array, tie: Tie, options: SolveOptions) -> _Robust:
    """Down to the minimum, of a part of the observations first: the last steps are then two or three."""
    steps = options.max_iterations
    few = few_per_view(problem.view_count)
    if len(problem.is_used) > 2 * few * problem.view_count:
        thin = select(problem, np.arange(problem.view_count), few)
        found = minimise(thin, camera, poses, tie.row, RobustLoss(), max_iterations=steps, small_decrease=1e-6)
        camera, poses = found.camera, found.cam_from_target
    found = minimise(problem, camera, poses, tie.row, RobustLoss(), max_iterations=steps, damping=NEAR)
    if options.loss == "squares" and options.reject_sigma is None:
        return _Robust(found, problem.is_used, _sigma(problem, found))
    return _robust(problem, found, tie, options)


def _robust(problem: Problem, found: Minimum, tie: Tie, options: SolveOptions) -> _Robust:
    """Weigh down or leave out what lies far off, until nothing changes."""
    is_used = problem.is_used
    # Squares alone are drawn by outliers; a loss that forgets them finds the others first.
    for _ in range(0 if options.reject_sigma is None else 3):
        found = minimise(
            problem, found.camera, found.cam_from_target, tie.row, RobustLoss("cauchy", _sigma(problem, found)),
            max_iterations=options.max_iterations,
        )  # fmt: skip
    for _ in range(ROUNDS):
        sigma = _sigma(problem, found)
        length = np.hypot(*_whitened(problem, found.blocks.residual_px))
        limit = np.inf if options.reject_sigma is None else options.reject_sigma * sigma
        keeps = problem.is_used & (length <= limit)
        again = replace(problem, is_used=keeps)
        found = minimise(
            again, found.camera, found.cam_from_target, tie.row, RobustLoss(options.loss, sigma),
            max_iterations=options.max_iterations,
        )  # fmt: skip
        same, is_used = np.array_equal(keeps, is_used), keeps
        if same and options.loss == "squares":
            break
    return _Robust(found, is_used, _sigma(problem, found))


def _sigma(problem: Problem, found: Minimum) -> float:
    """Standard deviation of a whitened coordinate, from the median length: outliers do not move it."""
    length = np.hypot(*_whitened(problem, found.blocks.residual_px))
    return max(float(np.nanmedian(length)) / MEDIAN_LENGTH, 1e-9)


def _whitened(problem: Problem, residual_px: Array) -> Array:
    """Residuals (2, M) in standard deviations."""
    a, b, c = problem.whitener
    return np.stack([a * residual_px[0], b * residual_px[0] + c * residual_px[1]])


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
    if options.reject_sigma is None:
        remarks = [*remarks, *_far_off(observations, robust, options)]
    if left_out:
        views = len(np.unique(observations.view[~robust.is_used]))
        limit = f"beyond {options.reject_sigma:g} robust standard deviations"
        remarks = [*remarks, f"{left_out} of {len(robust.is_used)} observations in {views} views left out: {limit}"]
    return Calibration(
        found.camera, observations, found.cam_from_target, found.blocks.residual_px.T, ~robust.is_used,
        accuracy.scale, accuracy.param_covariance, accuracy.pose_covariance, tie.fixed,
        options.weighted and observations.cov_px2 is not None, status, tuple(remarks), found.iterations, seconds,
    )  # fmt: skip


def _far_off(observations: Observations, robust: _Robust, options: SolveOptions) -> list[str]:
    """A word on observations that noise does not explain, if they were neither left out nor weighed down."""
    if options.loss != "squares":
        return []
    problem = pack(observations, weighted=options.weighted)
    length = np.hypot(*_whitened(problem, robust.minimum.blocks.residual_px))
    far = np.flatnonzero(length > FAR_OFF * robust.sigma)
    if not len(far):
        return []
    worst = int(far[np.argmax(length[far])])
    off = float(np.hypot(*robust.minimum.blocks.residual_px[:, worst]))
    return [
        f"{len(far)} of {len(length)} observations are off by more than {FAR_OFF:g} robust standard deviations, the "
        f"worst by {off:.3g} px in {observations.view_names[observations.view[worst]]}; reject them or look at them"
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
