"""How far off an observation is, in standard deviations that outliers do not move."""

import math

import numpy as np
from numpy.typing import NDArray

from calib.solver.blocks import KNEE, RobustLoss
from calib.solver.problem import whiteners

Array = NDArray[np.float64]

MEDIAN_LENGTH = 1.1774100225154747
"""Median length of a normal vector in the plane, sqrt(2 ln 2), in standard deviations of a coordinate."""
LEAST_SIGMA = 1e-9
"""Perfect data have no outliers."""


def whitened(whitener: Array, residual_px: Array) -> Array:
    """Residuals (2, M) in units of their standard deviations, by whiteners (3, M)."""
    a, b, c = whitener
    return np.stack([a * residual_px[0], b * residual_px[0] + c * residual_px[1]])


def robust_sigma(residual: Array) -> float:
    """Standard deviation of a coordinate of residuals (2, M), from their median length."""
    return _sigma_of(_squares(residual))


def _squares(residual: Array) -> Array:
    """Squared lengths of residuals (2, M)."""
    square: Array = residual[0] * residual[0] + residual[1] * residual[1]
    return square


def _sigma_of(square: Array) -> float:
    """Standard deviation of a coordinate, from the median of squared lengths."""
    known = np.isfinite(square)
    finite = square if known.all() else square[known]
    return max(math.sqrt(np.median(finite)) / MEDIAN_LENGTH, LEAST_SIGMA) if len(finite) else math.inf


def forgetful(residual: Array) -> RobustLoss:
    """A loss that outliers among such residuals (2, M) do not draw: squares would follow them before they are told."""
    return RobustLoss("cauchy", robust_sigma(residual))


def robust_covariance_factor(length: Array, loss: RobustLoss) -> float:
    """What the inverse of the weighted normal matrix is to be multiplied with for a covariance.

    With weights w(r) of residuals' lengths r, an M-estimator has the covariance `(J'J)^-1 E[w^2 r^2] / 2 / E[w + r w' /
    2]^2` (Huber 1981, section 7.6, in two dimensions), and the normal matrix is about `E[w] J'J`.
    """
    knee = KNEE[loss.kind] * loss.sigma
    if loss.kind == "huber":
        weight = np.where(length <= knee, 1.0, knee / np.maximum(length, 1e-300))
        slope = np.where(length <= knee, 1.0, 0.5 * weight)
    else:
        weight = 1 / (1 + (length / knee) ** 2)
        slope = weight**2
    return float(weight.mean() * 0.5 * (weight**2 * length**2).mean() / slope.mean() ** 2)


def deviations(residual_px: Array, cov_px2: Array | None, sigma_px: float | None = None) -> Array:
    """Lengths (M,) of residuals (2, M) in robust standard deviations, `sigma_px` if that is known already.

    With covariances, the shorter of the lengths in pixels and in stated standard deviations: a ring that is seen all
    but edge-on may be off by more pixels than others, and where the model's errors outgrow the noise, one that is
    seen well may be off by many of its small standard deviations. Neither is an outlier.
    """
    length: Array = np.sqrt(_squares(residual_px)) / (robust_sigma(residual_px) if sigma_px is None else sigma_px)
    if cov_px2 is None:
        return length
    standard = whitened(whiteners(cov_px2), residual_px)
    shorter: Array = np.minimum(length, deviations(standard, None))
    return shorter
