"""The extended unified camera: the unified one with an ellipsoid in place of the sphere.

`u = fx X / (alpha d + (1 - alpha) Z) + cx`, v likewise, with `d^2 = beta (X^2 + Y^2) + Z^2` (Khomutenko, Garcia and
Martinet 2016; limits as in Usenko, Demmel and Cremers 2018).
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, LensParameter
from calib.cameras.radial import RadialModel
from calib.core.jit import jit_sums
from designer.base.arrays import Array


@jit_sums
def _fill_scale(lens: Array, least: float, point: Array, scale: Array) -> None:
    alpha, beta = lens[0], lens[1]
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        square = x * x + y * y
        d = math.sqrt(beta * square + z * z)
        s = 1 / (alpha * d + (1 - alpha) * z) if z > least * d else np.nan
        change = -s * s
        scale[0, n], scale[1, n] = s, change * alpha * beta / (2 * d)
        scale[2, n], scale[3, n] = change * (alpha * z / d + 1 - alpha), change * (d - z)
        scale[4, n] = change * alpha * square / (2 * d)


@jit_sums
def _fill_depth(lens: Array, least: float, square: Array, depth: Array) -> None:
    alpha, beta = lens[0], lens[1]
    for n in range(len(square)):
        root = math.sqrt(1 - (2 * alpha - 1) * beta * square[n])  # nan outside of the image
        depth[n] = (1 - beta * alpha * alpha * square[n]) / (alpha * root + 1 - alpha)


def _limits(lens: Array) -> tuple[float]:
    """Where the image ends, as `Z / d`."""
    alpha = float(lens[0])
    return (-alpha / (1 - alpha) if alpha <= 0.5 else -(1 - alpha) / alpha,)


MODEL = RadialModel(
    name="eucm",
    remedy="its two numbers end there; fisheye may reach farther",
    parameters=(
        *FOCAL_AND_CENTRE,
        LensParameter("alpha", "1", lower=-1.0, upper=1.0),
        LensParameter("beta", "1", lower=0.0, neutral=1.0),
    ),
    limits=_limits,
    fill_scale=_fill_scale,
    fill_depth=_fill_depth,
)
