"""Reconstruction error: the point nearest to all rays of a ring, against the ring: `e = X_r - X_O`, in mm.

Least squares of the distances `|d_k x (s_k - X)|`, with unit directions, in closed form:
`(sum I - d_k d_k^T) X = sum (I - d_k d_k^T) s_k`. Ruppel, Kutlu et al., Beyond Reprojection Error, equation (2).
"""

import math

import numpy as np

from calib.solver.metrics.errors import ErrorMetric, Errors, Prediction, first_reason, is_known
from designer.base.arrays import Array, Rows

NAME, SUBJECT = "reconstruction", "a point in all photos"
UNIT, AXES = "mm", ("x", "y", "z")
LEAST_SPREAD_RAD = math.radians(0.5)
"""Root mean square angle of the rays with their mean direction; two rays then make twice this angle.

Below it, an error of a ray grows more than a hundredfold along the rays.
"""
_TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def reconstruction(prediction: Prediction) -> Errors:
    """One error a point that was seen, with components x y z in the target's frame."""
    seen = prediction.calibration.observations
    is_outlier = prediction.calibration.is_outlier
    has_ray = is_known(prediction.direction)
    use = np.flatnonzero(has_ray & ~is_outlier)
    is_seen = np.bincount(seen.point, minlength=len(seen.points.face)) > 0
    points = np.flatnonzero(is_seen)
    row = (np.cumsum(is_seen) - 1)[seen.point]  # (M,) of `points`
    views = _distinct_views(row[use], seen.view[use], len(points))
    # Relative to the point, so that no digits are lost in a target far from its origin.
    start = prediction.center_mm[seen.view[use]] - prediction.position_mm[use]
    matrix, right, rays = _normal_equations(prediction.direction[use], start, row[use], len(points))
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(matrix)[:, 0], 0) / np.maximum(rays, 1))
    reason, reasons = first_reason(
        len(points),
        ("all its observations are outliers", np.bincount(row, ~is_outlier, len(points)) == 0),
        ("the camera model has no ray to it", views == 0),
        ("seen in one view only", views < 2),
        ("its rays are all but parallel", spread < LEAST_SPREAD_RAD),
    )
    vector = np.full((len(points), 3), np.nan)
    good = reason == 0
    vector[good] = np.linalg.solve(matrix[good], right[good, :, None])[:, :, 0]
    return Errors(NAME, SUBJECT, UNIT, AXES, vector, reason, reasons, point=points)


def _distinct_views(row: Rows, view: Rows, count: int) -> Rows:
    """In how many views each of `count` points is seen."""
    width = int(view.max(initial=0)) + 1
    pairs = np.unique(row * width + view)
    views: Rows = np.bincount(pairs // width, minlength=count)
    return views


def _normal_equations(direction: Array, start: Array, row: Rows, count: int) -> tuple[Array, Array, Array]:
    """Matrix (K, 3, 3), right-hand side (K, 3) and number of rays (K,) of each of `count` points."""
    rays = np.bincount(row, minlength=count).astype(np.float64)
    matrix, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for i, j in _TRIANGLE:
        outer = np.bincount(row, direction[:, i] * direction[:, j], count)
        matrix[:, i, j] = matrix[:, j, i] = (rays if i == j else 0) - outer
    along = np.einsum("mi,mi->m", direction, start)
    for i in range(3):
        right[:, i] = np.bincount(row, start[:, i] - along * direction[:, i], count)
    return matrix, right, rays


METRIC = ErrorMetric(NAME, reconstruction)
