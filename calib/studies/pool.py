"""The views that bootstrap samples are drawn from, and what all samples share."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.types import Observations
from calib.metrics.evaluation import truth_remarks
from calib.metrics.prediction import centers_mm
from calib.observe.truth import Truth, true_poses
from calib.pipeline.solving import calibrate
from calib.solver.calibration import Calibration
from calib.solver.descend import is_robust
from calib.solver.options import SolveOptions, Tie, tie_parameters
from calib.solver.problem import Problem, pack
from calib.studies.expansion import Expansion, expand
from calib.studies.sample import SampleResult
from designer.base.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pool:
    """V views, the camera of all of them, and what is known about it."""

    observations: Observations  # of the views that have a pose
    model: str
    options: SolveOptions
    calibration: Calibration  # of all views
    problem: Problem
    tie: Tie
    cam_from_target: Array  # (V, 4, 4) from the problem's origin
    true_center_mm: Array | None  # (V, 3) where the cameras were, if known; nan for views of which it is not
    remarks: tuple[str, ...]  # on the solution of all views, and on the truth
    expansion: Expansion | None  # None: every sample is to be solved from scratch

    @property
    def view_count(self) -> int:
        """V."""
        return self.observations.view_count

    @property
    def value_count(self) -> int:
        """P, of the camera's parameters."""
        return len(self.calibration.camera.params)

    @property
    def covariance(self) -> Array:
        """(P, P) of the camera's parameters in the solution of all views."""
        return self.calibration.param_covariance

    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """Bootstrap samples."""
        from calib.studies.bootstrap import run_chunk  # which needs this module

        return run_chunk(self, case, size, seed, numbers)


def make_pool(observations: Observations, model: str, options: SolveOptions, truth: Truth | None) -> Pool:
    """Solve the camera of all views, and expand it.

    Views that the solution leaves out are not in the pool; the calibration's remarks name them. Samples are solved
    from scratch, which is slow, if the model is not its parameters alone or if outliers are weighed anew in each.

    Args:
        observations: what was seen.
        model: a camera model's name.
        options: weights, losses, fixed and shared parameters.
        truth: of the photos, if they were rendered.

    Raises:
        InputError: all views together do not determine the camera, or the truth is of other photos.
    """
    calibration = calibrate(observations, model, options)
    if calibration.status == "degenerate":
        raise InputError(
            f"all {observations.view_count} views together do not determine the camera: {calibration.remarks[0]}; "
            "there is nothing to draw from: take more photos, from more sides, or a model with fewer parameters"
        )
    kept = calibration.observations
    center: Array | None = None
    remarks = calibration.remarks
    if truth is not None:
        remarks += truth_remarks(calibration, truth)
        center = centers_mm(true_poses(truth, kept.view_names))
    problem = pack(kept, weighted=options.weighted)
    poses = np.array(calibration.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    tie = tie_parameters(model, options)
    expansion = None
    if calibration.camera.learned is None and not is_robust(options) and calibration.status == "converged":
        expansion = expand(problem, calibration.camera, poses, tie)
    return Pool(kept, model, options, calibration, problem, tie, poses, center, remarks, expansion)


def require_enough(pool: Pool, size: int) -> None:
    """Refuse samples that cannot determine the camera, whichever views are drawn.

    A view of n points has 2n - 6 equations beyond those that its own pose takes.

    Args:
        pool: what is drawn from.
        size: views of a sample.

    Raises:
        InputError: fewer equations than parameters.
    """
    unknown = len(set(pool.tie.row[pool.tie.row >= 0].tolist()))
    spare = np.sort(2 * np.bincount(pool.observations.view, minlength=pool.view_count) - 6)[::-1].cumsum()
    if size < pool.view_count and spare[size - 1] < unknown:
        least = int(np.argmax(spare >= unknown)) + 1
        raise InputError(
            f"size {size}: so few views give at most {spare[size - 1]} equations for {unknown} parameters of "
            f"the camera; draw {least} or more"
        )
