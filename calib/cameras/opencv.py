"""OpenCV's camera: a pinhole with forward Brown distortion, five coefficients.

`u = fx x' + cx`, `v = fy y' + cy` with `(x', y') = D(X/Z, Y/Z)`, `D` as in `calib.cameras.brown`.
"""

import numpy as np

from calib.cameras.brown import BLOCK, distort, fold_radius, undistort_block
from calib.cameras.camera import Camera
from calib.cameras.parameters import AT_ONCE, FOCAL_AND_CENTRE, CompiledModel, LensParameter, keep_rows
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array


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


def _fold(camera: Camera) -> tuple[float]:
    """The radius beyond which the lens folds over."""
    return (fold_radius(camera.params[4:]),)


@jit
def _linearise(params: Array, fold: float, point: Array, kept: Array) -> None:
    rows = np.zeros(len(kept) * AT_ONCE)
    rows[10 * AT_ONCE : 11 * AT_ONCE] = 1.0  # u by cx
    rows[20 * AT_ONCE : 21 * AT_ONCE] = 1.0  # v by cy
    p = params[0], params[1], params[2], params[3], params[4], params[5], params[6], params[7], params[8]
    for begin in range(0, point.shape[1], AT_ONCE):
        count = min(AT_ONCE, point.shape[1] - begin)
        for axis in range(3):
            rows[axis * AT_ONCE : axis * AT_ONCE + count] = point[axis, begin : begin + count]
        _fill(p, fold * fold, count, rows)
        keep_rows(rows, begin, count, kept)


@jit_sums
def _fill(
    p: tuple[float, float, float, float, float, float, float, float, float], limit: float, count: int, rows: Array
) -> None:
    """Replace points, the first three rows, by pixels and derivatives, row by row as in `Linearised`."""
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = p
    for n in range(count):
        depth = rows[2 * AT_ONCE + n]
        inverse_depth = 1.0 / depth
        x, y = rows[n] * inverse_depth, rows[AT_ONCE + n] * inverse_depth
        s = x * x + y * y
        one = 1.0 if (depth > 0) & (s < limit) else np.nan
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))  # of the radial factor, over the radius
        xy2, sx, sy = 2 * x * y, s + 2 * x * x, s + 2 * y * y
        a, b = x * radial + p1 * xy2 + p2 * sx, y * radial + p1 * sy + p2 * xy2
        rows[n], rows[AT_ONCE + n] = one * (fx * a + cx), one * (fy * b + cy)
        dxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
        dyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
        dxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
        fu, fv = one * fx * inverse_depth, one * fy * inverse_depth
        rows[2 * AT_ONCE + n], rows[3 * AT_ONCE + n] = fu * dxx, fu * dxy
        rows[4 * AT_ONCE + n] = -fu * (dxx * x + dxy * y)
        rows[5 * AT_ONCE + n], rows[6 * AT_ONCE + n] = fv * dxy, fv * dyy
        rows[7 * AT_ONCE + n] = -fv * (dxy * x + dyy * y)
        gx, gy = fx * x * s, fy * y * s
        rows[8 * AT_ONCE + n] = a
        rows[12 * AT_ONCE + n], rows[13 * AT_ONCE + n], rows[16 * AT_ONCE + n] = gx, gx * s, gx * s * s
        rows[14 * AT_ONCE + n], rows[15 * AT_ONCE + n] = fx * xy2, fx * sx
        rows[18 * AT_ONCE + n] = b
        rows[21 * AT_ONCE + n], rows[22 * AT_ONCE + n], rows[25 * AT_ONCE + n] = gy, gy * s, gy * s * s
        rows[23 * AT_ONCE + n], rows[24 * AT_ONCE + n] = fy * sy, fy * xy2


MODEL = CompiledModel(
    name="opencv",
    remedy="fisheye, ds and eucm reach any angle off the axis",
    parameters=(*FOCAL_AND_CENTRE, *(LensParameter(name, "1") for name in ("k1", "k2", "p1", "p2", "k3"))),
    opencv_lens=("k1", "k2", "p1", "p2", "k3"),
    lens=_fold,
    fill_rays=_rays,
    fill_pixels=_project,
    fill_linear=_linearise,
)
