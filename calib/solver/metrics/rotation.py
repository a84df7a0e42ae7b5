"""Rotation error: the angle between a view's axes and the true ones, in degrees, after the turn that all views share.

A camera's principal point and its axes can be moved together with next to no change of what it sees, and a model with
another image plane than the sensor's has other axes. Neither is an error of a view's pose; hence the best common turn
`Q` in `R = Q exp(e) R_true`, by least squares (the mean of rotations by their polar factor), is taken out.
"""

import numpy as np

from calib.core.se3 import log_rotation, nearest_rotation
from calib.solver.metrics.errors import ErrorMetric, Errors, Prediction, first_reason, is_known
from calib.solver.metrics.pose import UNKNOWN
from designer.base.arrays import Array

NAME, SUBJECT = "rotation", "a camera's axes"
UNIT, AXES = "deg", ("x", "y", "z")


def rotation(prediction: Prediction) -> Errors | None:
    """One rotation vector a view, in the true camera's axes; None if no true poses are known.

    A single view defines the common turn and has no error of its own: it is left out.
    """
    true = prediction.true_cam_from_target
    if true is None:
        return None
    has_truth = is_known(true.reshape(-1, 16))
    is_alone = has_truth.sum() < 2
    vector = np.full((len(true), 3), np.nan)
    if not is_alone:
        estimate = prediction.calibration.cam_from_target[has_truth, :3, :3]
        vector[has_truth] = np.degrees(turns_of_views(estimate, true[has_truth, :3, :3]))
    reason, reasons = first_reason(
        len(true), (UNKNOWN, ~has_truth), ("a single view has no turn to compare with", has_truth & is_alone)
    )
    return Errors(NAME, SUBJECT, UNIT, AXES, vector, reason, reasons, view=np.arange(len(true)))


def turns_of_views(estimate: Array, true: Array) -> Array:
    """Rotation vectors (V, 3) in radians from true rotations (V, 3, 3) to estimates, after the turn that all share."""
    turn = estimate @ true.transpose(0, 2, 1)
    return log_rotation(nearest_rotation(turn.sum(axis=0)).T @ turn)


METRIC = ErrorMetric(NAME, rotation, needs_truth=True)
