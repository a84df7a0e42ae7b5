"""Intersection error: where the predicted ray meets the plane of the point, against the point, in mm.

With the ray `s + t d` and the plane `n (X - X_O) = 0`: `t = n (X_O - s) / (n d)`.
Ruppel, Kutlu et al., Beyond Reprojection Error, Prediction and Evaluation.

The plane goes through the point itself and is parallel to its face. A ring that was measured stands off its face's mean
plane by h, and that plane would be met h tan(slant) beside the ring even by the true ray. The normal is the face's:
where a bow turns it by b, the error changes by b tan(slant) of itself, a hundredth if a face is bent by a hundredth of
its half width. So only the place of the plane matters, and that is right for each point.
"""

import numpy as np

from calib.solver.metrics.errors import OUTLIER, ErrorMetric, Errors, Prediction, first_reason, is_known

NAME, SUBJECT = "intersection", "a point in a photo"
UNIT, AXES = "mm", ("x", "y", "z")
LEAST_SINE = 1e-6
"""A ray that makes a smaller angle with a plane does not meet it at a point that can be computed."""


def intersection(prediction: Prediction) -> Errors:
    """One error an observation of a point on a known plane, with components x y z in the target's frame."""
    seen = prediction.calibration.observations
    face = seen.points.face[seen.point]
    on_plane = face >= 0
    normal = np.concatenate([seen.points.plane[:, :3], np.full((1, 3), np.nan)])[face]  # the last for face -1
    # From the point, so that no digits are lost far from the origin.
    start, direction = prediction.center_mm[seen.view] - prediction.position_mm, prediction.direction
    sine = np.einsum("mi,mi->m", normal, direction)
    is_parallel = np.abs(sine) < LEAST_SINE
    along = -np.einsum("mi,mi->m", normal, start) / np.where(is_parallel, np.nan, sine)
    is_behind = along <= 0
    along = np.where(is_behind, np.nan, along)
    vector = start + along[:, None] * direction
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


METRIC = ErrorMetric(NAME, intersection)
