"""Metrics of views that a camera was not solved from: what it is worth on the next photo."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import rays
from calib.core.selection import keep_sightings, keep_views
from calib.core.types import Observations
from calib.metrics.errors import is_known
from calib.metrics.evaluation import Evaluation, errors_of, joined, truth_remarks
from calib.observe.truth import Truth
from calib.solver.calibration import Calibration
from calib.solver.pose import solve_poses
from designer.base.errors import InputError

LEAST_FOLDS = 2

Solve = Callable[[Observations], Calibration]


def evaluate_held_out(calibration: Calibration, solve: Solve, folds: int, truth: Truth | None = None) -> Evaluation:
    """Leave every `folds`-th view out in turn, solve a camera from the others, and apply all metrics to those left out.

    A view's own pose has to be found from its own points, with the camera as it is; only the camera is held out.
    Observations that the calibration left out as outliers stay out of all this.

    Args:
        calibration: of all views.
        solve: solves a camera again as it was solved.
        folds: how many parts the views fall into.
        truth: of the photos, if they were rendered.

    Raises:
        InputError: fewer views than parts, or the others do not determine a camera.
    """
    views = calibration.observations.view_count
    if not LEAST_FOLDS <= folds <= views:
        raise InputError(f"{folds} parts of {views} views; give {LEAST_FOLDS} to {views}")
    remarks = [] if truth is None else list(truth_remarks(calibration, truth))
    kept, parts = [], []
    for fold in range(folds):
        held = np.arange(views) % folds == fold
        one, found, said = _fold(calibration, held, solve)
        remarks.extend(f"part {fold + 1} of {folds}: {line}" for line in said)
        if found.any():
            kept.append(np.flatnonzero(found))
            parts.append(errors_of(one, truth))
    if not parts:
        raise InputError("no view that was held out has a pose that shows its points; nothing to evaluate")
    errors = tuple(joined(calibration, same, kept) for same in zip(*parts, strict=True))
    return Evaluation(calibration, errors, truth, folds, tuple(remarks))


def _fold(
    calibration: Calibration, held: NDArray[np.bool_], solve: Solve
) -> tuple[Calibration, NDArray[np.bool_], list[str]]:
    """The camera of the other views with the poses of those held out, which of all views have one, and remarks."""
    used = keep_sightings(calibration.observations, ~calibration.is_outlier)
    others = solve(keep_views(used, ~held))
    remarks = list(others.remarks) if others.status != "converged" else []
    shown = keep_views(used, held)
    # Where the camera has no ray, as outside of a learned map, it says nothing of the pose.
    shown = keep_sightings(shown, is_known(rays(others.camera, shown.center_px)))
    poses = solve_poses(others.camera, shown, weighted=calibration.weighted).cam_from_target
    has_pose = np.isfinite(poses.sum(axis=(1, 2)))
    found = held.copy()
    found[held] = has_pose
    if lost := int(held.sum() - found.sum()):
        remarks.append(f"{lost} views have no pose that shows their points")
    rows = found[calibration.observations.view]
    one = replace(
        others,
        observations=keep_views(calibration.observations, found),
        cam_from_target=poses[has_pose],
        residual_px=np.full((int(rows.sum()), 2), np.nan),
        is_outlier=calibration.is_outlier[rows],
        pose_covariance=np.full((int(has_pose.sum()), 6, 6), np.nan),
    )
    return one, found, remarks
