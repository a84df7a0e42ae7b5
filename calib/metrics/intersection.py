"""Intersection error: where the predicted ray meets the plane of the face, against the point: `X_pred - X_O`, in mm.

With the ray `s + t d` and the plane `n X = h`: `t = (h - n s) / (n d)`.
Ruppel, Kutlu et al., Beyond Reprojection Error, Prediction and Evaluation.
"""

import numpy as np

from calib.metrics.errors import OUTLIER, Errors, first_reason, is_known
from calib.metrics.prediction import Prediction

NAME, SUBJECT = "intersection", "a ring in a photo"
UNIT, AXES = "mm", ("x", "y", "z")
LEAST_SINE = 1e-6
"""A ray that makes a smaller angle with a plane does not meet it at a point that can be computed."""


def intersection(prediction: Prediction) -> Errors:
    """One error an observation of a point on a known plane, with components x y z in the target's frame."""
    seen = prediction.calibration.observations
    face = seen.points.face[seen.point]
    on_plane = face >= 0
    plane = np.concatenate([seen.points.plane, np.full((1, 4), np.nan)])[face]  # the last for face -1
    normal, start, direction = plane[:, :3], prediction.center_mm[seen.view], prediction.direction
    sine = np.einsum("mi,mi->m", normal, direction)
    is_parallel = np.abs(sine) < LEAST_SINE
    along = (plane[:, 3] - np.einsum("mi,mi->m", normal, start)) / np.where(is_parallel, np.nan, sine)
    is_behind = along <= 0
    along = np.where(is_behind, np.nan, along)
    vector = start + along[:, None] * direction - prediction.position_mm
    reason, reasons = first_reason(
        len(vector),
        (OUTLIER, prediction.calibration.is_outlier),
        ("on no known plane", ~on_plane),
        ("the camera model has no ray there", ~is_known(direction)),
        ("the ray is parallel to its plane", is_parallel),
        ("the plane is behind the camera", is_behind),
    )
    return Errors(
        NAME, SUBJECT, UNIT, AXES, vector, reason, reasons,
        view=seen.view, point=seen.point, sighting=np.arange(len(vector)),
    )  # fmt: skip
