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

from calib.cameras.brown import BLOCK, distort, fold_radius, undistort_block
from calib.cameras.parameters import FOCAL_AND_CENTRE, Linearised, Parameter
from calib.jit import jit
from calib.types import Camera

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
    x, y = np.empty(BLOCK), np.empty(BLOCK)
    for begin in range(0, len(point), BLOCK):
        count = min(BLOCK, len(point) - begin)
        for n in range(count):
            depth = point[begin + n, 2] if point[begin + n, 2] > 0 else np.nan
            x[n], y[n] = point[begin + n, 0] / depth, point[begin + n, 1] / depth
        undistort_block(coefficients, fold, x[:count], y[:count])
        for n in range(count):
            pixel[begin + n, 0], pixel[begin + n, 1] = params[0] * x[n] + params[2], params[1] * y[n] + params[3]


@jit
def _linearise(
    params: Array, coefficients: Array, fold: float, point: Array, pixel: Array, by_point: Array, by_params: Array
) -> None:
    """With (a, b) = D^-1(x, y), the derivative by (x, y) is D'^-1, and that by a coefficient c is -D'^-1 dD/dc."""
    fx, fy, cx, cy = params[0], params[1], params[2], params[3]
    k1, k2, p1, p2, k3 = coefficients
    undistorted_x, undistorted_y = np.empty(BLOCK), np.empty(BLOCK)
    for begin in range(0, point.shape[1], BLOCK):
        end = min(begin + BLOCK, point.shape[1])
        for n in range(begin, end):
            inverse_depth = 1.0 / point[2, n] if point[2, n] > 0 else np.nan
            undistorted_x[n - begin], undistorted_y[n - begin] = (
                point[0, n] * inverse_depth,
                point[1, n] * inverse_depth,
            )
        undistort_block(coefficients, fold, undistorted_x[: end - begin], undistorted_y[: end - begin])
        for n in range(begin, end):
            a, b = undistorted_x[n - begin], undistorted_y[n - begin]
            inverse_depth = 1.0 / point[2, n]
            x, y = point[0, n] * inverse_depth, point[1, n] * inverse_depth
            pixel[0, n], pixel[1, n] = fx * a + cx, fy * b + cy
            s = a * a + b * b
            radial = 1 + s * (k1 + s * (k2 + s * k3))
            slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))
            dxx = radial + slope * a * a + 2 * p1 * b + 6 * p2 * a
            dyy = radial + slope * b * b + 6 * p1 * b + 2 * p2 * a
            dxy = slope * a * b + 2 * p1 * a + 2 * p2 * b
            inverse = 1.0 / (dxx * dyy - dxy * dxy)
            uu, uv, vu, vv = fx * inverse * dyy, -fx * inverse * dxy, -fy * inverse * dxy, fy * inverse * dxx
            ud, vd = uu * inverse_depth, vv * inverse_depth
            by_point[0, 0, n], by_point[0, 1, n] = ud, uv * inverse_depth
            by_point[1, 0, n], by_point[1, 1, n] = vu * inverse_depth, vd
            by_point[0, 2, n] = -(uu * x + uv * y) * inverse_depth
            by_point[1, 2, n] = -(vu * x + vv * y) * inverse_depth
            by_params[0, 0, n], by_params[0, 1, n], by_params[0, 2, n], by_params[0, 3, n] = a, 0.0, 1.0, 0.0
            by_params[1, 0, n], by_params[1, 1, n], by_params[1, 2, n], by_params[1, 3, n] = 0.0, b, 0.0, 1.0
            # k1, k2, k3, p1, p2 are -k1, -k2, -k3, -p2 and p1 of the coefficients.
            u, v = (uu * a + uv * b) * s, (vu * a + vv * b) * s
            by_params[0, 4, n], by_params[0, 5, n], by_params[0, 6, n] = u, u * s, u * s * s
            by_params[1, 4, n], by_params[1, 5, n], by_params[1, 6, n] = v, v * s, v * s * s
            ab2, sa, sb = 2 * a * b, s + 2 * a * a, s + 2 * b * b
            by_params[0, 7, n], by_params[0, 8, n] = uu * sa + uv * ab2, -(uu * ab2 + uv * sb)
            by_params[1, 7, n], by_params[1, 8, n] = vu * sa + vv * ab2, -(vu * ab2 + vv * sb)


@dataclass(frozen=True)
class Luhmann:
    """Backward Brown distortion of a pinhole."""

    name: str = "luhmann"
    remedy: str = "virtual needs no lens formula"
    parameters: tuple[Parameter, ...] = (
        *FOCAL_AND_CENTRE,
        *(Parameter(name, "1") for name in ("k1", "k2", "k3", "p1", "p2")),
    )

    def rays(self, camera: Camera, pixel: Array) -> Array:
        """Directions (..., 3) with z = 1, in closed form; nan where the lens folds over."""
        coefficients = _coefficients(camera.params)
        flat = np.ascontiguousarray(pixel, dtype=np.float64).reshape(-1, 2)
        ray = np.empty((len(flat), 3))
        _rays(camera.params, coefficients, fold_radius(coefficients), flat, ray)
        return ray.reshape(*np.shape(pixel)[:-1], 3)

    def project(self, camera: Camera, point: Array) -> Array:
        """Pixels (..., 2), by exact inversion; nan behind the camera and outside the lens's image."""
        coefficients = _coefficients(camera.params)
        flat = np.ascontiguousarray(point, dtype=np.float64).reshape(-1, 3)
        pixel = np.empty((len(flat), 2))
        _project(camera.params, coefficients, fold_radius(coefficients), flat, pixel)
        return pixel.reshape(*np.shape(point)[:-1], 2)

    def linearise(self, camera: Camera, point: Array) -> Linearised:
        """Pixels of points (3, N) with their derivatives."""
        coefficients = _coefficients(camera.params)
        count = point.shape[1]
        result = Linearised(np.empty((2, count)), np.empty((2, 3, count)), np.empty((2, 9, count)))
        fold = fold_radius(coefficients)
        _linearise(camera.params, coefficients, fold, point, result.pixel, result.by_point, result.by_params)
        return result
