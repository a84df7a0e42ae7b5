"""OpenCV's camera: a pinhole with forward Brown distortion, five coefficients.

`u = fx x' + cx`, `v = fy y' + cy` with `(x', y') = D(X/Z, Y/Z)`, `D` as in `calib.cameras.brown`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.brown import BLOCK, distort, fold_radius, undistort_block
from calib.cameras.parameters import FOCAL_AND_CENTRE, Linearised, Parameter
from calib.jit import jit
from calib.types import Camera

Array = NDArray[np.float64]


@jit
def _rays(params: Array, fold: float, pixel: Array, ray: Array) -> None:
    x, y = np.empty(BLOCK), np.empty(BLOCK)
    for begin in range(0, len(pixel), BLOCK):
        count = min(BLOCK, len(pixel) - begin)
        for n in range(count):
            x[n], y[n] = (pixel[begin + n, 0] - params[2]) / params[0], (pixel[begin + n, 1] - params[3]) / params[1]
        undistort_block(params[4:], fold, x[:count], y[:count])
        for n in range(count):
            ray[begin + n, 0], ray[begin + n, 1], ray[begin + n, 2] = x[n], y[n], 1.0 + 0.0 * x[n]


@jit
def _project(params: Array, fold: float, point: Array, pixel: Array) -> None:
    coefficients = params[4:]
    for n in range(len(point)):
        if point[n, 2] > 0:
            x, y = distort(coefficients, fold, point[n, 0] / point[n, 2], point[n, 1] / point[n, 2])
            pixel[n, 0], pixel[n, 1] = params[0] * x + params[2], params[1] * y + params[3]
        else:
            pixel[n, 0], pixel[n, 1] = np.nan, np.nan


@jit
def _linearise(params: Array, fold: float, point: Array, pixel: Array, by_point: Array, by_params: Array) -> None:
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = params
    for n in range(point.shape[1]):
        inverse_depth = 1.0 / point[2, n]
        x, y = point[0, n] * inverse_depth, point[1, n] * inverse_depth
        s = x * x + y * y
        sees = point[2, n] > 0 and s < fold * fold
        one = 1.0 if sees else np.nan
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))  # of the radial factor, over the radius
        xy2, sx, sy = 2 * x * y, s + 2 * x * x, s + 2 * y * y
        a, b = x * radial + p1 * xy2 + p2 * sx, y * radial + p1 * sy + p2 * xy2
        pixel[0, n], pixel[1, n] = one * (fx * a + cx), one * (fy * b + cy)
        dxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        dyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        dxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        fu, fv = one * fx * inverse_depth, one * fy * inverse_depth
        by_point[0, 0, n], by_point[0, 1, n], by_point[0, 2, n] = fu * dxx, fu * dxy, -fu * (dxx * x + dxy * y)
        by_point[1, 0, n], by_point[1, 1, n], by_point[1, 2, n] = fv * dxy, fv * dyy, -fv * (dxy * x + dyy * y)
        by_params[0, 0, n], by_params[0, 1, n], by_params[0, 2, n], by_params[0, 3, n] = a, 0.0, 1.0, 0.0
        by_params[1, 0, n], by_params[1, 1, n], by_params[1, 2, n], by_params[1, 3, n] = 0.0, b, 0.0, 1.0
        gx, gy = fx * x * s, fy * y * s
        by_params[0, 4, n], by_params[0, 5, n], by_params[0, 8, n] = gx, gx * s, gx * s * s
        by_params[1, 4, n], by_params[1, 5, n], by_params[1, 8, n] = gy, gy * s, gy * s * s
        by_params[0, 6, n], by_params[0, 7, n] = fx * xy2, fx * sx
        by_params[1, 6, n], by_params[1, 7, n] = fy * sy, fy * xy2


@dataclass(frozen=True)
class OpenCv:
    """Forward Brown distortion of a pinhole."""

    name: str = "opencv"
    remedy: str = "luhmann and virtual reach farther off the axis"
    parameters: tuple[Parameter, ...] = (
        *FOCAL_AND_CENTRE,
        *(Parameter(name, "1") for name in ("k1", "k2", "p1", "p2", "k3")),
    )

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Directions (..., 3) with z = 1, by exact inversion; nan where no light arrives from."""
        flat = np.ascontiguousarray(pixel, dtype=np.float64).reshape(-1, 2)
        ray = np.empty((len(flat), 3))
        _rays(camera.params, fold_radius(camera.params[4:]), flat, ray)
        return ray.reshape(*np.shape(pixel)[:-1], 3)

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2); nan behind the camera and where the lens folds over."""
        flat = np.ascontiguousarray(point, dtype=np.float64).reshape(-1, 3)
        pixel = np.empty((len(flat), 2))
        _project(camera.params, fold_radius(camera.params[4:]), flat, pixel)
        return pixel.reshape(*np.shape(point)[:-1], 2)

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        count = point.shape[1]
        result = Linearised(np.empty((2, count)), np.empty((2, 3, count)), np.empty((2, 9, count)))
        fold = fold_radius(camera.params[4:])
        _linearise(camera.params, fold, point, result.pixel, result.by_point, result.by_params)
        return result
