"""The double sphere camera: two unit spheres whose middles are xi apart, then a pinhole set off by alpha / (1 - alpha).

With `d1 = |(X, Y, Z)|`, `z1 = xi d1 + Z` and `d2 = |(X, Y, z1)|` it is `u = fx X / (alpha d2 + (1 - alpha) z1) + cx`,
v likewise (Usenko, Demmel and Cremers, The Double Sphere Camera Model, 2018).
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, LensParameter
from calib.cameras.radial import RadialModel
from calib.core.jit import jit_sums
from designer.base.arrays import Array


@jit_sums
def _fill_scale(lens: Array, least_cosine: float, point: Array, scale: Array) -> None:
    xi, alpha = lens[0], lens[1]
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        square = x * x + y * y
        d1 = math.sqrt(square + z * z)
        z1 = xi * d1 + z
        d2 = math.sqrt(square + z1 * z1)
        s = 1 / (alpha * d2 + (1 - alpha) * z1) if z > least_cosine * d1 else np.nan
        change = -s * s
        by_z1 = alpha * z1 / d2 + 1 - alpha
        scale[0, n], scale[1, n] = s, change * (alpha / (2 * d2) + by_z1 * xi / (2 * d1))
        scale[2, n], scale[3, n] = change * by_z1 * (xi * z / d1 + 1), change * by_z1 * d1
        scale[4, n] = change * (d2 - z1)


@jit_sums
def _fill_depth(lens: Array, least_cosine: float, square: Array, depth: Array) -> None:
    xi, alpha = lens[0], lens[1]
    for n in range(len(square)):
        root = math.sqrt(1 - (2 * alpha - 1) * square[n])  # nan outside of the image
        second = (1 - alpha * alpha * square[n]) / (alpha * root + 1 - alpha)  # z1 of the direction (a, b, z1)
        length = second * second + square[n]
        factor = (second * xi + math.sqrt(second * second + (1 - xi * xi) * square[n])) / length
        depth[n] = second - xi / factor


def _limits(lens: Array) -> tuple[float]:
    """The cosine of the angle off the axis at which the image ends."""
    xi, alpha = lens.tolist()
    first = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    return (-(first + xi) / math.sqrt(2 * first * xi + xi * xi + 1),)


MODEL = RadialModel(
    name="ds",
    remedy="its two numbers end there; fisheye may reach farther",
    parameters=(
        *FOCAL_AND_CENTRE,
        LensParameter("xi", "1", lower=-1.0, upper=1.0),
        LensParameter("alpha", "1", lower=-1.0, upper=1.0),
    ),
    limits=_limits,
    fill_scale=_fill_scale,
    fill_depth=_fill_depth,
)
