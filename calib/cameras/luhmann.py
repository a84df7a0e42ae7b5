"""The photogrammetric camera: a pinhole whose distortion is a function of the *measured* point (backward Brown).

With the measured point in normalised coordinates, y up as in the literature, `x = (u - cx) / fx`,
`y = -(v - cy) / fy`, the undistorted point is `(x, y) - delta` (Luhmann, Close-Range Photogrammetry):
`delta = (k1 r^2 + k2 r^4 + k3 r^6) (x, y) + (p1 (r^2 + 2x^2) + 2 p2 xy, p2 (r^2 + 2y^2) + 2 p1 xy)`.

With y down, as everywhere else in this program, this is `D` of `calib.cameras.brown` with the coefficients
-k1, -k2, p2, -p1, -k3.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.brown import distort, fold_radius, undistort
from calib.jit import jit

Array = NDArray[np.float64]


def _coefficients(params: Array) -> Array:
    """The parameters k1 k2 k3 p1 p2 as coefficients of `D`."""
    k1, k2, k3, p1, p2 = params[4:].tolist()
    return np.array([-k1, -k2, p2, -p1, -k3])


@jit
def _rays(params: Array, coefficients: Array, fold: float, pixel: Array, ray: Array) -> None:
    for n in range(len(pixel)):
        x, y = (pixel[n, 0] - params[2]) / params[0], (pixel[n, 1] - params[3]) / params[1]
        x, y = distort(coefficients, fold, x, y)
        ray[n, 0], ray[n, 1], ray[n, 2] = x, y, 1.0 + 0.0 * x


@jit
def _project(params: Array, coefficients: Array, fold: float, point: Array, pixel: Array) -> None:
    for n in range(len(point)):
        if point[n, 2] > 0:
            x, y = undistort(coefficients, fold, point[n, 0] / point[n, 2], point[n, 1] / point[n, 2])
            pixel[n, 0], pixel[n, 1] = params[0] * x + params[2], params[1] * y + params[3]
        else:
            pixel[n, 0], pixel[n, 1] = np.nan, np.nan


@dataclass(frozen=True)
class Luhmann:
    """Backward Brown distortion of a pinhole."""

    name: str = "luhmann"
    parameter_names: tuple[str, ...] = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "p1", "p2")

    def rays(self, params: Array, pixel: Array) -> Array:
        """Directions (..., 3) with z = 1, in closed form; nan where the lens folds over."""
        coefficients = _coefficients(params)
        flat = np.ascontiguousarray(pixel, dtype=np.float64).reshape(-1, 2)
        ray = np.empty((len(flat), 3))
        _rays(params, coefficients, fold_radius(coefficients), flat, ray)
        return ray.reshape(*np.shape(pixel)[:-1], 3)

    def project(self, params: Array, point: Array) -> Array:
        """Pixels (..., 2), by exact inversion; nan behind the camera and outside the lens's image."""
        coefficients = _coefficients(params)
        flat = np.ascontiguousarray(point, dtype=np.float64).reshape(-1, 3)
        pixel = np.empty((len(flat), 2))
        _project(params, coefficients, fold_radius(coefficients), flat, pixel)
        return pixel.reshape(*np.shape(point)[:-1], 2)
