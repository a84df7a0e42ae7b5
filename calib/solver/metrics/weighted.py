"""Weighted error: the reprojection error in standard deviations that the sighting states, `L^-1 e` with `L L' = cov`.

Where weights stand for accuracies whose unit nobody knows, it is in pixels of a sighting of weight 1. Stated rightly,
each component scatters by one.
"""

from dataclasses import replace

import numpy as np

from calib.solver.metrics.errors import ErrorMetric, Errors, Prediction
from calib.solver.metrics.reprojection import reprojection
from calib.solver.problem import whiteners

NAME, UNIT = "weighted", "sigma"


def weighted(prediction: Prediction) -> Errors | None:
    """One error an observation, with components u v; None where accuracies are not stated, or were not to count."""
    covariance = prediction.calibration.observations.cov_px2
    if covariance is None or not prediction.calibration.weighted:
        return None
    plain = reprojection(prediction)
    a, b, c = whiteners(covariance)
    u, v = plain.vector.T
    return replace(plain, metric=NAME, unit=UNIT, vector=np.column_stack([a * u, b * u + c * v]))


METRIC = ErrorMetric(NAME, weighted)
