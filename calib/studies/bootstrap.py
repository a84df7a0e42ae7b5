"""Bootstrap samples of a camera: the views that they are drawn from, and how each is solved and evaluated."""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import fitted_models
from calib.core.parallel import one_thread
from calib.core.se3 import make_pose
from calib.core.types import Observations, keep_sightings
from calib.renderer.truth import Truth
from calib.solver.accuracy import NO_FIT
from calib.solver.calibrate import calibrate
from calib.solver.calibration import Calibration
from calib.solver.descend import is_robust
from calib.solver.metrics.errors import centers_mm, predict, summarise
from calib.solver.metrics.evaluation import truth_remarks
from calib.solver.metrics.intersection import intersection
from calib.solver.metrics.pose import pose
from calib.solver.metrics.reconstruction import reconstruction
from calib.solver.metrics.reprojection import reprojection
from calib.solver.problem import Problem, SolveOptions, Tie, origin_poses, pack, tie_parameters
from calib.studies.near import Expansion, expand, find_near
from calib.studies.sample_metrics import Sample, sample_errors
from calib.studies.samples import SampleErrors, SampleResult, draw_counts, failed_sample
from calib.studies.workers import SamplePool
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError


@dataclass(frozen=True, eq=False)
class Pool(SamplePool):
    """V views, the camera of all of them, and what is known about it."""

    observations: Observations  # of the views that have a pose
    camera_model: str
    options: SolveOptions
    calibration: Calibration  # of all views
    problem: Problem
    tie: Tie
    cam_from_target: Array  # (V, 4, 4) from the problem's origin
    true_center_mm: Array | None  # (V, 3) where the cameras were, if known; nan for views of which it is not
    remarks: tuple[str, ...]  # on the solution of all views, and on the truth
    expansion: Expansion | None  # None: every sample is to be solved from scratch

    @property
    def model(self) -> str:
        """Of the camera."""
        return self.camera_model

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

    @one_thread
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers, each a function of seed, case and number alone."""
        return [run_sample(self, draw_counts(seed, case, n, size, self.view_count), n) for n in numbers]


def make_pool(observations: Observations, model: str, options: SolveOptions, truth: Truth | None) -> Pool:
    """Solve the camera of all views, and expand it.

    Views that the solution leaves out are not in the pool; the calibration's remarks name them. Samples are solved
    from scratch, which is slow, if the model is not its parameters alone or if outliers are weighed anew in each.

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
        center = centers_mm(truth.poses_of(kept.view_names))
    problem = pack(kept, weighted=options.weighted)
    poses = origin_poses(problem, calibration.cam_from_target)
    tie = tie_parameters(model, options)
    expansion = None
    is_few = model in fitted_models()  # of hundreds of parameters there is no expansion
    if is_few and not is_robust(options) and calibration.status == "converged":
        expansion = expand(problem, calibration, poses, tie)
    return Pool(kept, model, options, calibration, problem, tie, poses, center, remarks, expansion)


def require_enough(pool: Pool, size: int) -> None:
    """Refuse samples that cannot determine the camera, whichever views are drawn.

    A view of n points has 2n - 6 equations beyond those that its own pose takes.
    """
    unknown = len(set(pool.tie.row[pool.tie.row >= 0].tolist()))
    spare = np.sort(2 * np.bincount(pool.observations.view, minlength=pool.view_count) - 6)[::-1].cumsum()
    if size < pool.view_count and spare[size - 1] < unknown:
        least = int(np.argmax(spare >= unknown)) + 1
        raise InputError(
            f"size {size}: so few views give at most {spare[size - 1]} equations for {unknown} parameters of "
            f"the camera; draw {least} or more"
        )


def run_sample(pool: Pool, counts: Rows, number: int) -> SampleResult:
    """The camera and the errors of a sample; whatever becomes of it, there is a result."""
    views = np.flatnonzero(counts)
    weight = counts[views]
    found = None if pool.expansion is None else find_near(pool.expansion, views, weight)
    if found is None:
        return solve_from_scratch(pool, counts, number)
    is_plain = not pool.calibration.weighted
    errors = sample_errors(
        Sample(pool.observations, pool.problem, views, weight, found.camera, found.cam_from_target),
        pool.true_center_mm,
        found.cost if is_plain else None,
    )
    # Half of all residuals are at most sqrt(2) times their root mean square.
    if not math.sqrt(2) * errors.reprojection_px < NO_FIT * max(pool.observations.image_size):
        return solve_from_scratch(pool, counts, number)
    params = tuple(found.camera.params.tolist())
    return SampleResult(number, "converged", len(views), params, found.looks, errors=errors)


def solve_from_scratch(pool: Pool, counts: Rows, number: int) -> SampleResult:
    """A sample as anyone would solve it: each view as often as it was drawn, from the first guess, and all metrics."""
    drawn = np.repeat(np.arange(len(counts)), counts)
    distinct = int((counts > 0).sum())
    try:
        found = calibrate(expanded(pool.observations, drawn), pool.model, pool.options)
    except (InputError, np.linalg.LinAlgError) as error:
        return failed_sample(number, distinct, pool.value_count, str(error))
    true = None
    if pool.true_center_mm is not None:  # axes of true poses mean nothing, and no metric here asks
        row = {name: view for view, name in enumerate(pool.observations.view_names)}
        true = make_pose(np.eye(3), -pool.true_center_mm[[row[name] for name in found.observations.view_names]])
    prediction = predict(found, true)
    says = found.status != "converged" or found.observations.view_count < len(drawn)
    metrics = (metric(prediction) for metric in (reprojection, intersection, reconstruction, pose))
    return SampleResult(
        number, found.status, distinct, tuple(found.camera.params.tolist()), found.iterations,
        "; ".join(found.remarks) if says else "",
        SampleErrors(*(math.nan if one is None else summarise(one).rmse for one in metrics)),
    )  # fmt: skip


def expanded(observations: Observations, drawn: Rows) -> Observations:
    """The observations of views (N,), one that is named twice as two views that look alike."""
    start = np.searchsorted(observations.view, np.arange(observations.view_count + 1))
    length = np.diff(start)[drawn]
    place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
    rows = np.repeat(start[drawn], length) + place
    names = tuple(observations.view_names[view] for view in drawn.tolist())
    return replace(keep_sightings(observations, rows), view_names=names, view=np.repeat(np.arange(len(drawn)), length))
