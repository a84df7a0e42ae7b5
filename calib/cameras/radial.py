"""Lenses that are symmetric about their axis, whatever the angle: what a model says of them, and all that follows.

A point (X, Y, Z) is seen at `u = fx s X + cx`, `v = fy s Y + cy` with a scale `s` of `X^2 + Y^2`, of Z and of the
lens's parameters; light that reaches `(a, b) = ((u - cx) / fx, (v - cy) / fy)` comes from the direction (a, b, m) with
a depth `m` of `a^2 + b^2`, which is negative behind the camera. A model gives the two, and is then a `RadialModel`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.parameters import LensParameter, Linearised, to_unit
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array

FIRST = 4
"""Parameters before those of the lens: fx fy cx cy."""


@dataclass(frozen=True)
class RadialModel:
    """A model (see `calib.cameras.CameraModel`) of a scale and a depth.

    Their kernels take the lens's parameters (K,) and what `limits` makes of these, what comes in and what is to be
    filled: nan where the model shows nothing.
    """

    name: str
    remedy: str
    parameters: tuple[LensParameter, ...]
    fill_scale: Callable[..., None]  # (K,), limits, points (3, N) -> s, its derivatives by X^2 + Y^2, Z, parameters
    fill_depth: Callable[..., None]  # (K,), limits, a^2 + b^2 (N,) -> m (N,)
    limits: Callable[[Array], tuple[float, ...]]
    opencv_lens: tuple[str, ...] | None = None

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Unit directions (..., 3) at pixels (..., 2); nan where there is none."""
        pixel = np.asarray(pixel, dtype=np.float64)
        ray = np.empty((*pixel.shape[:-1], 3))
        flat = ray.reshape(-1, 3)
        np.divide(pixel - camera.params[2:FIRST], camera.params[:2], out=ray[..., :2])
        depth = np.empty(len(flat))
        lens = camera.params[FIRST:]
        self.fill_depth(lens, *self.limits(lens), (flat[:, :2] ** 2).sum(axis=1), depth)
        flat[:, 2] = depth
        flat[np.isnan(depth)] = np.nan
        to_unit(flat)
        return ray

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2) of points (..., 3); nan where there is none."""
        point = np.asarray(point, dtype=np.float64)
        scale = self._scale(camera, np.ascontiguousarray(point.reshape(-1, 3).T))[0].reshape(point.shape[:-1])
        pixel: Array = camera.params[:2] * (scale[..., None] * point[..., :2]) + camera.params[2:FIRST]
        return pixel

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        point = np.ascontiguousarray(point, dtype=np.float64)
        rows = np.zeros((8 + 2 * len(self.parameters), point.shape[1]))
        _fill(camera.params, point, self._scale(camera, point), rows)
        return Linearised(rows)

    def _scale(self, camera: Camera, point: Array) -> Array:
        lens = camera.params[FIRST:]
        scale = np.empty((3 + len(lens), point.shape[1]))
        self.fill_scale(lens, *self.limits(lens), point, scale)
        return scale


@jit_sums
def _fill(params: Array, point: Array, scale: Array, rows: Array) -> None:
    """The rows of `Linearised` from those of the scale, one simple loop each."""
    every, lens = len(params), len(params) - FIRST
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    x, y, s, by_square, by_depth = point[0], point[1], scale[0], scale[1], scale[2]
    for n in range(point.shape[1]):
        rows[0, n], rows[1, n] = fx * s[n] * x[n] + cx, fy * s[n] * y[n] + cy
    for n in range(point.shape[1]):
        rows[2, n] = fx * (s[n] + 2 * x[n] * x[n] * by_square[n])
        rows[3, n] = fx * 2 * x[n] * y[n] * by_square[n]
        rows[4, n] = fx * x[n] * by_depth[n]
    for n in range(point.shape[1]):
        rows[5, n] = fy * 2 * x[n] * y[n] * by_square[n]
        rows[6, n] = fy * (s[n] + 2 * y[n] * y[n] * by_square[n])
        rows[7, n] = fy * y[n] * by_depth[n]
    for n in range(point.shape[1]):
        rows[8, n], rows[10, n] = s[n] * x[n], 1.0
        rows[9 + every, n], rows[11 + every, n] = s[n] * y[n], 1.0
    for k in range(lens):
        by_lens, u, v = scale[3 + k], rows[8 + FIRST + k], rows[8 + every + FIRST + k]
        for n in range(point.shape[1]):
            u[n], v[n] = fx * x[n] * by_lens[n], fy * y[n] * by_lens[n]


@jit
def polynomial(coefficients: Array, square: float) -> tuple[float, float]:
    """`1 + c1 s + c2 s^2 + ...` and its derivative by s."""
    value, slope = 0.0, 0.0
    for k in range(len(coefficients) - 1, -1, -1):
        slope = slope * square + value
        value = value * square + coefficients[k]
    return 1.0 + square * value, value + square * slope
