"""How large an error in space is: one number of a covariance, and three of many."""

from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array
from designer.base.marks import Gap

MOST = 95
"""Per cent of the points that are better than what is told of most."""


@dataclass(frozen=True)
class PointErrors:
    """Root mean square lengths of errors in space, of many points; nan where they are not known."""

    median_mm: Gap
    most_mm: Gap  # 95 % of the points are better
    worst_mm: Gap


NOT_KNOWN = PointErrors(float("nan"), float("nan"), float("nan"))


def rms_error_mm(covariance_mm2: Array) -> Array:
    """The root mean square of the length of an error (N,) with a covariance (N, 3, 3)."""
    sigma: Array = np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2))
    return sigma


def errors_of(length_mm: Array) -> PointErrors:
    """Three numbers of many (N,); nan of those that are not known, and of none."""
    known = length_mm[np.isfinite(length_mm)]
    if not len(known):
        return NOT_KNOWN
    return PointErrors(*(float(value) for value in (*np.percentile(known, [50, MOST]), known.max())))


def rms_errors(covariance_mm2: Array | None) -> PointErrors:
    """Three numbers of the errors of many points with covariances (N, 3, 3); nan if these are not known."""
    return NOT_KNOWN if covariance_mm2 is None else errors_of(rms_error_mm(covariance_mm2))
