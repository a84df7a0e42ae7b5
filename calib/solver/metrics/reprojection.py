"""Reprojection error: `e = u_predicted - u_detected`, in pixels of the measured image.

Ruppel, Kutlu et al., Beyond Reprojection Error, Prediction and Evaluation.
"""

import numpy as np

from calib.solver.metrics.errors import OUTLIER, ErrorMetric, Errors, Prediction, first_reason, is_known

NAME, SUBJECT = "reprojection", "a point in a photo"
UNIT, AXES = "px", ("u", "v")


def reprojection(prediction: Prediction) -> Errors:
    """One error an observation, with components u v."""
    seen = prediction.calibration.observations
    vector = prediction.predicted_px - seen.center_px
    reason, reasons = first_reason(
        len(vector),
        (OUTLIER, prediction.calibration.is_outlier),
        ("the camera model has no pixel there", ~is_known(vector)),
    )
    return Errors(
        NAME, SUBJECT, UNIT, AXES, vector, reason, reasons,
        view=seen.view, point=seen.point, sighting=np.arange(len(vector)),
    )  # fmt: skip


METRIC = ErrorMetric(NAME, reprojection)
