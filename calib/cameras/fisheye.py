"""The fisheye lens of Kannala and Brandt: the distance from the centre is a polynomial of the angle off the axis.

`r = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, `u = fx r X / rho + cx`, `v = fy r Y / rho + cy`
with `rho^2 = X^2 + Y^2` and `theta = atan2(rho, Z)` (A Generic Camera Model and Calibration Method, 2006, in the
form of OpenCV's fisheye). It is kept up to the angle where r ceases to grow.
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, LensParameter
from calib.cameras.polynomial import first_change
from calib.cameras.radial import RadialModel, polynomial
from calib.core.jit import jit
from designer.base.arrays import Array

NEAR_AXIS = 1e-8
"""Tangent of an angle at which an angle and its tangent are one in floating point."""
MOST_STEPS = 60


@jit
def _radius(lens: Array, theta: float) -> tuple[float, float]:
    """The distance and its derivative."""
    value, slope = polynomial(lens, theta * theta)
    return theta * value, value + 2 * theta * theta * slope


@jit
def _fill_scale(lens: Array, last_theta: float, last_radius: float, point: Array, scale: Array) -> None:
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        square = x * x + y * y
        rho, length2 = math.sqrt(square), square + z * z
        theta = math.atan2(rho, z)
        if not (theta < last_theta and length2 > 0):
            scale[:, n] = np.nan
            continue
        if rho <= NEAR_AXIS * z:  # r is theta here, and theta rho / z
            scale[0, n], scale[1, n], scale[2, n] = 1 / z, (lens[0] - 1 / 3) / (z * z * z), -1 / (z * z)
            scale[3:, n] = 0.0
            continue
        radius, slope = _radius(lens, theta)
        scale[0, n] = radius / rho
        scale[1, n] = (slope * z / length2 - radius / rho) / (2 * square)
        scale[2, n] = -slope / length2
        power = theta / rho
        for k in range(len(lens)):
            power *= theta * theta
            scale[3 + k, n] = power


@jit
def _fill_depth(lens: Array, last_theta: float, last_radius: float, square: Array, depth: Array) -> None:
    for n in range(len(square)):
        radius = math.sqrt(square[n])
        if not radius < last_radius:
            depth[n] = np.nan
        elif radius <= NEAR_AXIS:
            depth[n] = 1.0
        else:
            theta = _theta(lens, last_theta, radius)
            depth[n] = radius * math.cos(theta) / math.sin(theta)


@jit
def _theta(lens: Array, last: float, radius: float) -> float:
    """The angle of a distance: Newton's method, kept where the distance grows."""
    low, high, theta = 0.0, last, min(radius, 0.5 * last)
    for _ in range(MOST_STEPS):
        value, slope = _radius(lens, theta)
        if value > radius:
            high = theta
        else:
            low = theta
        step = theta - (value - radius) / slope
        if not low <= step <= high:
            step = 0.5 * (low + high)
        if abs(step - theta) <= 4e-16 * theta:
            return step
        theta = step
    return theta


def _limits(lens: Array) -> tuple[float, float]:
    """The angle up to which the distance grows, half a turn at most, and the distance there."""
    k1, k2, k3, k4 = lens.tolist()
    last = min(math.pi, math.sqrt(first_change(np.array([1.0, 3 * k1, 5 * k2, 7 * k3, 9 * k4]))))
    return last, float(_radius(lens, last)[0])


MODEL = RadialModel(
    name="fisheye",
    remedy="its polynomial bends back there; ds or eucm do not",
    parameters=(*FOCAL_AND_CENTRE, *(LensParameter(f"k{k}", "1") for k in range(1, 5))),
    limits=_limits,
    fill_scale=_fill_scale,
    fill_depth=_fill_depth,
    opencv_lens=("k1", "k2", "k3", "k4"),  # of cv2.fisheye
)
