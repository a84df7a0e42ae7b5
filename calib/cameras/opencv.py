"""OpenCV's camera: a pinhole with forward Brown distortion, five coefficients.

`u = fx x' + cx`, `v = fy y' + cy` with `(x', y') = D(X/Z, Y/Z)`, `D` as in `calib.cameras.brown`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.brown import distort, fold_radius, undistort
from calib.jit import jit

Array = NDArray[np.float64]


@jit
def _rays(params: Array, fold: float, pixel: Array, ray: Array) -> None:
    coefficients = params[4:]
    for n in range(len(pixel)):
        x, y = (pixel[n, 0] - params[2]) / params[0], (pixel[n, 1] - params[3]) / params[1]
        x, y = undistort(coefficients, fold, x, y)
        ray[n, 0], ray[n, 1], ray[n, 2] = x, y, 1.0 + 0.0 * x


@jit
def _project(params: Array, fold: float, point: Array, pixel: Array) -> None:
    coefficients = params[4:]
    for n in range(len(point)):
        if point[n, 2] > 0:
            x, y = distort(coefficients, fold, point[n, 0] / point[n, 2], point[n, 1] / point[n, 2])
            pixel[n, 0], pixel[n, 1] = params[0] * x + params[2], params[1] * y + params[3]
        else:
            pixel[n, 0], pixel[n, 1] = np.nan, np.nan


@dataclass(frozen=True)
class OpenCv:
    """Forward Brown distortion of a pinhole."""

    name: str = "opencv"
    parameter_names: tuple[str, ...] = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")

    def rays(self, params: Array, pixel: Array) -> Array:
        """Directions (..., 3) with z = 1, by exact inversion; nan where no light arrives from."""
        flat = np.ascontiguousarray(pixel, dtype=np.float64).reshape(-1, 2)
        ray = np.empty((len(flat), 3))
        _rays(params, fold_radius(params[4:]), flat, ray)
        return ray.reshape(*np.shape(pixel)[:-1], 3)

    def project(self, params: Array, point: Array) -> Array:
        """Pixels (..., 2); nan behind the camera and where the lens folds over."""
        flat = np.ascontiguousarray(point, dtype=np.float64).reshape(-1, 3)
        pixel = np.empty((len(flat), 2))
        _project(params, fold_radius(params[4:]), flat, pixel)
        return pixel.reshape(*np.shape(point)[:-1], 2)
