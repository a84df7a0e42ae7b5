"""A picture on a cylinder whose axis stands upright: `u = fx lambda + cx`, `v = fy Y / R + cy`.

With `R = sqrt(X^2 + Z^2)` and `lambda = atan2(X, Z)`, in radians. What is upright in the world stays straight if the
camera is level, and the field may be a whole turn; straight up and down is infinitely far away.
"""

import math

import numpy as np

from calib.cameras.parameters import FOCAL_AND_CENTRE, CompiledModel
from calib.core.jit import jit
from designer.base.arrays import Array


@jit
def _fill_rays(params: Array, pixel: Array, ray: Array) -> None:
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    for n in range(len(pixel)):
        turn = (pixel[n, 0] - cx) / fx
        is_seen = abs(turn) < math.pi
        ray[n, 0], ray[n, 1] = math.sin(turn) if is_seen else np.nan, (pixel[n, 1] - cy) / fy if is_seen else np.nan
        ray[n, 2] = math.cos(turn)


@jit
def _fill_pixels(params: Array, point: Array, pixel: Array) -> None:
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    for n in range(len(point)):
        x, y, z = point[n, 0], point[n, 1], point[n, 2]
        across = math.hypot(x, z)
        pixel[n, 0] = fx * math.atan2(x, z) + cx if across > 0 else np.nan
        pixel[n, 1] = fy * y / across + cy if across > 0 else np.nan


@jit
def _fill_linear(params: Array, point: Array, rows: Array) -> None:
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    rows[:] = 0.0
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        across = math.hypot(x, z) if x != 0 or z != 0 else np.nan
        turn, slope = math.atan2(x, z), y / across
        rows[0, n], rows[1, n] = fx * turn + cx + 0 * across, fy * slope + cy
        rows[2, n], rows[4, n] = fx * z / across**2, -fx * x / across**2
        rows[5, n], rows[6, n], rows[7, n] = -fy * slope * x / across**2, fy / across, -fy * slope * z / across**2
        rows[8, n], rows[10, n] = turn, 1.0
        rows[13, n], rows[15, n] = slope, 1.0


MODEL = CompiledModel(
    name="cylinder",
    remedy="it has no place for straight up and down; an equirectangular picture has",
    parameters=FOCAL_AND_CENTRE,
    fill_rays=_fill_rays,
    fill_pixels=_fill_pixels,
    fill_linear=_fill_linear,
    lens=lambda camera: (),
)
