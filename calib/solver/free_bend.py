"""A flat target whose bend is an unknown, together with the camera and the poses.

A camera is solved with the target as it is taken to be; there the normal equations of the bend, the camera and the
poses together ask for a step of the bend, and so on (Gauss-Newton, of which each step of the bend is followed to the
minimum of all others). The covariances are those of all unknowns together.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.surface import surface_model
from calib.core.types import Observations
from calib.solver.accuracy import Accuracy, UndeterminedError, accuracy_of
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration, PlaneBend, plane_bend
from calib.solver.costs import IMAGE
from calib.solver.outliers import robust_scale, robust_sigma, whitened
from calib.solver.problem import SolveOptions, origin_poses, pack, target_covariance, tie_parameters
from calib.solver.schur import damped_step
from calib.solver.surface import step_of_points
from designer.base.arrays import Array
from designer.base.errors import InputError

ROUNDS, SETTLED = 8, 0.01
"""Of bending, until it changes by less than this part of its standard deviations."""
ROUNDING = 1e-9
"""Of half a side."""
TOO_FAR = 0.1
"""Heights, and standard deviations of these, of half a side, that are no board's."""
MODES = 2
Solve = Callable[[Observations], Calibration]


def solve_bent(observations: Observations, solve: Solve, options: SolveOptions) -> Calibration:
    """Solve the camera, the poses and the bend of a flat target; the points of what comes out are bent.

    Raises:
        InputError: the target is not flat, the photos do not tell its bend, or options that do not go together.
    """
    if options.minimise != IMAGE:
        raise InputError(f"--free-bend: goes with distances in the image only; leave --minimise {options.minimise} out")
    bend, begin, iterations = plane_bend(observations.points), time.perf_counter(), 0
    for _ in range(ROUNDS):
        found = solve(bend.bent(observations))
        iterations += found.iterations
        if found.status == "degenerate":
            return found
        step, half = _step(found, bend, options), np.array(bend.half_mm)
        height = np.array(bend.height_mm) + step.height_mm
        if not (np.maximum(np.abs(height), step.sigma_mm) < TOO_FAR * half).all():
            raise _untold()
        if (np.abs(step.height_mm) <= SETTLED * step.sigma_mm + ROUNDING * half).all():
            told = _told(found, bend, step)
            return replace(told, iterations=iterations, seconds=time.perf_counter() - begin)
        first, second = height.tolist()
        bend = replace(bend, height_mm=(first, second))
    raise _untold()


def _untold() -> UndeterminedError:
    return UndeterminedError(
        "--free-bend: the photos do not tell how the target is bent; take photos that show it large and tilted, "
        "or leave it out"
    )


@dataclass(frozen=True, eq=False)
class _BendStep:
    """A step of the bend, and how sure all is there."""

    height_mm: Array  # (2,)
    sigma_mm: Array  # (2,)
    accuracy: Accuracy  # of the bend's two, the camera's parameters, and the poses


def _step(found: Calibration, bend: PlaneBend, options: SolveOptions) -> _BendStep:
    """What the normal equations of all unknowns at a solution ask for.

    Raises:
        UndeterminedError: they have no solution.
    """
    seen = found.observations
    problem = replace(pack(seen, weighted=found.weighted), is_used=~found.is_outlier)
    poses = origin_poses(problem, found.cam_from_target)
    loss, robust = RobustLoss(), None
    if options.loss != "squares":
        standard = whitened(problem.whitener, np.ascontiguousarray(found.residual_px.T))
        loss = RobustLoss(options.loss, robust_sigma(standard))
        robust = robust_scale(standard, problem.is_used, loss)
    modes = np.ascontiguousarray(bend.modes_mm(seen.points.position_mm)[:, seen.point].transpose(0, 2, 1))
    tie = tie_parameters(found.camera.model, options)
    if surface_model(found.camera.model) is None:
        blocks = view_blocks(problem, found.camera, poses, loss, modes_mm=modes)
        row = np.concatenate([np.arange(MODES), np.where(tie.row >= 0, tie.row + MODES, -1)])
        damped = damped_step(blocks.products, row, 0.0)
        height = damped.free[:MODES] if damped.solvable else np.full(MODES, np.nan)
        accuracy = accuracy_of(blocks.products, row, int(problem.is_used.sum()), robust)
    else:
        height, accuracy = step_of_points(problem, found.camera, poses, tie, loss, modes, robust)
    sigma = np.sqrt(np.diagonal(accuracy.param_covariance)[:MODES])
    if not (np.isfinite(height).all() and np.isfinite(sigma).all()):
        raise _untold()
    moved = target_covariance(problem, poses, accuracy.pose_covariance)
    return _BendStep(height, sigma, replace(accuracy, pose_covariance=moved))


def _told(found: Calibration, bend: PlaneBend, step: _BendStep) -> Calibration:
    """The calibration with its bend, and with the covariances of all unknowns together."""
    covariance = step.accuracy.param_covariance
    first, both, second = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    told = replace(bend, covariance_mm2=(float(first), float(both), float(second)))
    (a, b), (sigma_a, sigma_b) = told.height_mm, told.sigma_mm
    x, y, z = told.axes[2].tolist()
    remark = (
        f"the target is bent: its middle stands {a:.3g} ± {sigma_a:.2g} mm out against the ends of its first side and "
        f"{b:.3g} ± {sigma_b:.2g} mm against those of its second, along its normal ({x:g}, {y:g}, {z:g}); its points "
        "were moved so"
    )
    return replace(
        found, scale=step.accuracy.scale, param_covariance=covariance[MODES:, MODES:],
        pose_covariance=step.accuracy.pose_covariance, target_bend=told, remarks=(remark, *found.remarks),
    )  # fmt: skip
