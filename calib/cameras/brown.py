"""The Brown polynomial and its exact inverse, which the lens models are made of.

`D(x, y) = (x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6) + (2 p1 xy + p2 (r^2 + 2x^2), p1 (r^2 + 2y^2) + 2 p2 xy)`
in normalised coordinates (Brown 1966, in OpenCV's order and naming: k1 k2 p1 p2 k3).
"""

import math

import numpy as np

from calib.cameras.polynomial import first_change
from calib.core.jit import jit
from designer.base.arrays import Array

MAX_STEPS = 60
TOLERANCE = 5e-16
ACCEPTED_RESIDUAL = 1e-12
"""A larger residual of the inverse, relative to the radius, means that there is no inverse."""
BLOCK = 512
"""Points that are inverted together; they and what is made of them stay in the processor's nearest cache."""
LAST_STEP = 1e-10
"""A Newton step no longer than this, relative to the radius, ends within rounding of the inverse."""


@jit
def _first_zero(coefficients: Array) -> float:
    """The smallest positive square s at which the slope `1 + 3 k1 s + 5 k2 s^2 + 7 k3 s^3` ends, or infinity."""
    k1, k2, _, _, k3 = coefficients
    return first_change(np.array([1.0, 3 * k1, 5 * k2, 7 * k3]))


def fold_radius(coefficients: Array) -> float:
    """Radius up to which the radial part grows; beyond it the polynomial folds the image over.

    The smallest positive root of `d/dr (r + k1 r^3 + k2 r^5 + k3 r^7)`, or infinity.
    """
    return math.sqrt(_first_zero(coefficients))


@jit
def distort(coefficients: Array, fold: float, x: float, y: float) -> tuple[float, float]:
    """`D` of one point; nan beyond the fold."""
    square = x * x + y * y
    if not square < fold * fold:
        return np.nan, np.nan
    k1, k2, p1, p2, k3 = coefficients
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    )


@jit
def _radius_of(coefficients: Array, fold: float, distorted: float) -> float:
    """The radius that the radial part takes to `distorted`: Newton, kept in a bracket; at most the fold."""
    k1, k2, _, _, k3 = coefficients
    low, high, radius = 0.0, fold, min(distorted, fold)
    for _ in range(MAX_STEPS):
        s = radius * radius
        residual = radius * (1 + s * (k1 + s * (k2 + s * k3))) - distorted
        if residual > 0:
            high = min(high, radius)
        else:
            low = max(low, radius)
        slope = 1 + s * (3 * k1 + s * (5 * k2 + s * 7 * k3))
        step = radius - residual / slope if slope > 0 else -1.0
        if not low <= step <= high:
            step = 0.5 * (low + high) if high < np.inf else 2 * radius
        if abs(step - radius) <= 1e-3 * radius:  # the rest is left to the steps in two dimensions
            return step
        radius = step
    return radius


@jit
def undistort(coefficients: Array, fold: float, x: float, y: float) -> tuple[float, float]:
    """The point that `D` takes to (x, y), to machine precision; nan where there is none short of the fold."""
    k1, k2, p1, p2, k3 = coefficients
    if k1 == 0 and k2 == 0 and k3 == 0 and p1 == 0 and p2 == 0:
        return x, y
    distorted = math.sqrt(x * x + y * y)
    if distorted == 0 or not distorted < np.inf:
        return x - x, y - y
    scale = min(_radius_of(coefficients, fold, distorted), 0.9999 * fold) / distorted
    a, b = scale * x, scale * y
    residual = np.inf
    for _ in range(MAX_STEPS):
        s = a * a + b * b
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))  # of the radial factor, over the radius
        e = a * radial + 2 * p1 * a * b + p2 * (s + 2 * a * a) - x
        f = b * radial + p1 * (s + 2 * b * b) + 2 * p2 * a * b - y
        last, residual = residual, abs(e) + abs(f)
        if residual <= TOLERANCE * distorted or (residual < ACCEPTED_RESIDUAL * distorted and residual >= last):
            break
        daa = radial + slope * a * a + 2 * p1 * b + 6 * p2 * a
        dbb = radial + slope * b * b + 6 * p1 * b + 2 * p2 * a
        dab = slope * a * b + 2 * p1 * a + 2 * p2 * b
        determinant = daa * dbb - dab * dab
        da, db = (dbb * e - dab * f) / determinant, (daa * f - dab * e) / determinant
        # Near the fold the slope all but vanishes, and a whole step would leave what can be inverted.
        for _ in range(MAX_STEPS):
            if (a - da) ** 2 + (b - db) ** 2 < fold * fold:
                break
            da, db = 0.5 * da, 0.5 * db
        a, b = a - da, b - db
    if not residual < ACCEPTED_RESIDUAL * distorted or not a * a + b * b < fold * fold:
        return np.nan, np.nan
    return a, b


@jit
def undistort_block(coefficients: Array, fold: float, x: Array, y: Array) -> None:
    """`undistort` of many points (N,) in place, several at once.

    Three Newton steps without a branch, so that the processor takes several points together. Where they do not arrive,
    or not where `D` is known to be one-to-one, the point is left to `undistort`. What comes out for a point does not
    depend on its neighbours.
    """
    k1, k2, p1, p2, k3 = coefficients
    c1, c2, c3, c4 = _inverse_series(k1, k2, k3)
    sure = sure_square(coefficients)
    result_x, result_y, arrived = np.empty(len(x)), np.empty(len(x)), np.empty(len(x), np.bool_)
    for n in range(len(x)):
        u, v = x[n], y[n]
        s = u * u + v * v
        scale = 1 + s * (c1 + s * (c2 + s * (c3 + s * c4)))
        a = scale * u - 2 * p1 * u * v - p2 * (s + 2 * u * u)
        b = scale * v - p1 * (s + 2 * v * v) - 2 * p2 * u * v
        da, db = _newton_step(k1, k2, p1, p2, k3, u, v, a, b)
        a, b = a - da, b - db
        da, db = _newton_step(k1, k2, p1, p2, k3, u, v, a, b)
        a, b = a - da, b - db
        da, db = _newton_step(k1, k2, p1, p2, k3, u, v, a, b)
        a, b = a - da, b - db
        result_x[n], result_y[n] = a, b
        arrived[n] = (da * da + db * db <= LAST_STEP * LAST_STEP * s) & (a * a + b * b < sure)
    for n in range(len(x)):
        if arrived[n]:
            x[n], y[n] = result_x[n], result_y[n]
        else:
            x[n], y[n] = undistort(coefficients, fold, x[n], y[n])


@jit
def _newton_step(
    k1: float, k2: float, p1: float, p2: float, k3: float, x: float, y: float, a: float, b: float
) -> tuple[float, float]:
    """What is to be taken from (a, b) so that `D` comes to (x, y)."""
    s = a * a + b * b
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))
    e = a * radial + 2 * p1 * a * b + p2 * (s + 2 * a * a) - x
    f = b * radial + p1 * (s + 2 * b * b) + 2 * p2 * a * b - y
    daa = radial + slope * a * a + 2 * p1 * b + 6 * p2 * a
    dbb = radial + slope * b * b + 6 * p1 * b + 2 * p2 * a
    dab = slope * a * b + 2 * p1 * a + 2 * p2 * b
    inverse = 1.0 / (daa * dbb - dab * dab)
    return (dbb * e - dab * f) * inverse, (daa * f - dab * e) * inverse


@jit
def _inverse_series(k1: float, k2: float, k3: float) -> tuple[float, float, float, float]:
    """The inverse of the radial part as a polynomial of the same form, cut off (Drap and Lefevre 2016)."""
    return (
        -k1,
        3 * k1 * k1 - k2,
        -12 * k1 * k1 * k1 + 8 * k1 * k2 - k3,
        55 * k1 * k1 * k1 * k1 - 55 * k1 * k1 * k2 + 5 * k2 * k2 + 10 * k1 * k3,
    )


@jit
def sure_square(coefficients: Array) -> float:
    """The square of a radius within which `D` is one-to-one.

    Its Jacobian is symmetric. Of the radial part, the eigenvalues are the slope and the mean of the slope up to there:
    at least 1/4 where the slope is. Of the tangential part, none is larger than `6 |p| r`: at most 1/8. So the sum is
    positive definite in a disc, where `D` is the gradient of a convex function.
    """
    k1, k2, p1, p2, k3 = coefficients
    least = 0.25
    tangential = 6 * math.sqrt(p1 * p1 + p2 * p2)
    radius = 0.5 * least / tangential if tangential > 0 else np.inf
    zero = _first_zero(np.array([k1, k2, 0.0, 0.0, k3]) / (1 - least))
    return min(zero, radius * radius)
