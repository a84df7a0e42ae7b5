"""A picture of longitude and latitude: `u = fx atan2(X, Z) + cx`, `v = fy atan2(Y, sqrt(X^2 + Z^2)) + cy`, in radians.

It holds every direction, a whole sphere in a picture twice as wide as high; what players of panoramas expect.
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
        longitude, latitude = (pixel[n, 0] - cx) / fx, (pixel[n, 1] - cy) / fy
        scale = math.cos(latitude) if abs(longitude) < math.pi and abs(latitude) < 0.5 * math.pi else np.nan
        ray[n, 0], ray[n, 2] = scale * math.sin(longitude), scale * math.cos(longitude)
        ray[n, 1] = math.sin(latitude) + 0 * scale


@jit
def _fill_pixels(params: Array, point: Array, pixel: Array) -> None:
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    for n in range(len(point)):
        x, y, z = point[n, 0], point[n, 1], point[n, 2]
        across = math.hypot(x, z)
        pixel[n, 0] = fx * math.atan2(x, z) + cx if across > 0 else np.nan
        pixel[n, 1] = fy * math.atan2(y, across) + cy if across > 0 else np.nan


@jit
def _fill_linear(params: Array, point: Array, rows: Array) -> None:
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    rows[:] = 0.0
    for n in range(point.shape[1]):
        x, y, z = point[0, n], point[1, n], point[2, n]
        across = math.hypot(x, z) if x != 0 or z != 0 else np.nan
        longitude, latitude = math.atan2(x, z), math.atan2(y, across)
        square = across**2 + y * y
        rows[0, n], rows[1, n] = fx * longitude + cx + 0 * across, fy * latitude + cy
        rows[2, n], rows[4, n] = fx * z / across**2, -fx * x / across**2
        rows[5, n], rows[6, n] = -fy * y * x / (across * square), fy * across / square
        rows[7, n] = -fy * y * z / (across * square)
        rows[8, n], rows[10, n] = longitude, 1.0
        rows[13, n], rows[15, n] = latitude, 1.0


MODEL = CompiledModel(
    name="equirectangular",
    remedy="it shows every direction but the two poles",
    parameters=FOCAL_AND_CENTRE,
    fill_rays=_fill_rays,
    fill_pixels=_fill_pixels,
    fill_linear=_fill_linear,
    lens=lambda camera: (),
)
