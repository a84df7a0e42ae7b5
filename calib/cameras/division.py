"""The division model: light at a distorted point (a, b) comes from the direction (a, b, 1 + k1 r^2 + k2 r^4 + k3 r^6).

With `r^2 = a^2 + b^2`, `u = fx a + cx`, `v = fy b + cy` (Fitzgibbon 2001; with more coefficients Larsson et al. 2019).
Where the third coordinate is not above zero, it comes from the side or from behind. It is kept up to the radius where
the angle off the axis ceases to grow.
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, LensParameter
from calib.cameras.polynomial import first_change
from calib.cameras.radial import RadialModel, polynomial
from calib.core.jit import jit
from designer.base.arrays import Array

MOST_STEPS = 100


@jit
def _fill_scale(lens: Array, last_radius: float, least_cosine: float, point: Array, scale: Array) -> None:
    """With the depth m of r^2 and r = s rho, s solves `m(s^2 rho^2) - Z s = 0`."""
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        square = x * x + y * y
        length = math.sqrt(square + z * z)
        if not (z > least_cosine * length):
            scale[:, n] = np.nan
            continue
        rho = math.sqrt(square)
        s = _radius(lens, last_radius, rho / length, z / length) / rho if rho > 0 else 1 / z
        _, slope = polynomial(lens, s * s * square)
        by_s = 2 * s * square * slope - z
        scale[0, n], scale[1, n], scale[2, n] = s, -s * s * slope / by_s, s / by_s
        power = 1.0
        for k in range(len(lens)):
            power *= s * s * square
            scale[3 + k, n] = -power / by_s


@jit
def _radius(lens: Array, last: float, sine: float, cosine: float) -> float:
    """Where `sine m(r^2) = cosine r`: Newton's method within a bracket."""
    low, high, radius = 0.0, last, 0.5 * sine
    for _ in range(MOST_STEPS):
        value, slope = polynomial(lens, radius * radius)
        off = cosine * radius - sine * value
        if off > 0:
            high = radius
        else:
            low = radius
        step = radius - off / (cosine - sine * 2 * radius * slope)
        if not low <= step <= high:
            step = 0.5 * (low + high) if high < np.inf else 2 * radius
        if abs(step - radius) <= 4e-16 * radius:
            return step
        radius = step
    return radius


@jit
def _fill_depth(lens: Array, last_radius: float, least_cosine: float, square: Array, depth: Array) -> None:
    for n in range(len(square)):
        depth[n] = polynomial(lens, square[n])[0] if square[n] < last_radius * last_radius else np.nan


def _limits(lens: Array) -> tuple[float, float]:
    """The radius up to which the angle grows, and the cosine of the angle there."""
    k1, k2, k3 = lens.tolist()
    # The angle's tangent is r / m, which grows with r where m - 2 r^2 m' is above zero.
    last = math.sqrt(first_change(np.array([1.0, -k1, -3 * k2, -5 * k3])))
    if last == math.inf:
        highest = next((k for k in (k3, k2, k1) if k), 0.0)
        return last, (0.0 if highest == 0 else math.copysign(1.0, highest))
    depth = polynomial(lens, last * last)[0]
    return last, depth / math.hypot(depth, last)


MODEL = RadialModel(
    name="division",
    remedy="its polynomial bends back there; fisheye or eucm may reach farther",
    parameters=(*FOCAL_AND_CENTRE, *(LensParameter(f"k{k}", "1") for k in range(1, 4))),
    limits=_limits,
    fill_scale=_fill_scale,
    fill_depth=_fill_depth,
)
