"""Pose error: `|C - C_true|`, how far the camera's centre is from where it was, in mm in the target's frame.

The centre `C = -R^T t` is where all rays of a view meet, so it means the same for every camera model, also for those
whose image plane is another than the sensor's.
Ruppel, Kutlu et al., Beyond Reprojection Error, Prediction and Evaluation.
"""

import numpy as np

from calib.solver.metrics.errors import ErrorMetric, Errors, Prediction, centers_mm, first_reason, is_known

NAME, SUBJECT = "pose", "a camera's centre"
UNIT, AXES = "mm", ("x", "y", "z")
UNKNOWN = "its true pose is not known"


def pose(prediction: Prediction) -> Errors | None:
    """One error a view, with components x y z in the target's frame; None if no true poses are known."""
    if prediction.true_cam_from_target is None:
        return None
    vector = prediction.center_mm - centers_mm(prediction.true_cam_from_target)
    reason, reasons = first_reason(len(vector), (UNKNOWN, ~is_known(vector)))
    return Errors(NAME, SUBJECT, UNIT, AXES, vector, reason, reasons, view=np.arange(len(vector)))


METRIC = ErrorMetric(NAME, pose, needs_truth=True)
