"""The unified camera: a point is projected onto the unit sphere, and from a point xi above its middle to the image.

`u = fx X / (Z + xi d) + cx`, `v = fy Y / (Z + xi d) + cy` with the distance `d = |(X, Y, Z)|` (Mei and Rives 2007,
without their polynomial; Geyer and Daniilidis 2000).
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, LensParameter
from calib.cameras.radial import RadialModel
from calib.core.jit import jit_sums
from designer.base.arrays import Array


@jit_sums
def _fill_scale(lens: Array, least_cosine: float, point: Array, scale: Array) -> None:
    xi = lens[0]
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        d = math.sqrt(x * x + y * y + z * z)
        s = 1 / (z + xi * d) if z > least_cosine * d else np.nan
        scale[0, n], scale[1, n] = s, -s * s * xi / (2 * d)
        scale[2, n], scale[3, n] = -s * s * (1 + xi * z / d), -s * s * d


@jit_sums
def _fill_depth(lens: Array, least_cosine: float, square: Array, depth: Array) -> None:
    xi = lens[0]
    for n in range(len(square)):
        root = math.sqrt(1 + (1 - xi * xi) * square[n])  # nan outside of the image
        depth[n] = 1 - xi * (1 + square[n]) / (xi + root)


def _limits(lens: Array) -> tuple[float]:
    """The cosine of the angle off the axis up to which the distance from the centre grows."""
    xi = float(lens[0])
    return (-xi if xi <= 1 else -1 / xi,)


MODEL = RadialModel(
    name="omni",
    remedy="its one number ends there; fisheye or eucm may reach farther",
    parameters=(*FOCAL_AND_CENTRE, LensParameter("xi", "1", lower=-1.0)),
    limits=_limits,
    fill_scale=_fill_scale,
    fill_depth=_fill_depth,
)
