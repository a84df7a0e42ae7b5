"""The photogrammetric camera: a pinhole whose distortion is a function of the *measured* point (backward Brown).

With the measured point in normalised coordinates, y up as in the literature, `x = (u - cx) / fx`,
`y = -(v - cy) / fy`, the undistorted point is `(x, y) - delta` (Luhmann, Close-Range Photogrammetry):
`delta = (k1 r^2 + k2 r^4 + k3 r^6) (x, y) + (p1 (r^2 + 2x^2) + 2 p2 xy, p2 (r^2 + 2y^2) + 2 p1 xy)`.

With y down, as everywhere else in this program, this is `D` of `calib.cameras.brown` with the coefficients
-k1, -k2, p2, -p1, -k3.
"""

import numpy as np

from calib.cameras.brown import BLOCK, distort, fold_radius, undistort_block
from calib.cameras.camera import Camera
from calib.cameras.parameters import AT_ONCE, FOCAL_AND_CENTRE, CompiledModel, LensParameter, keep_rows
from calib.core.jit import jit, jit_sums
from designer.base.arrays import Array


def _lens(camera: Camera) -> tuple[Array, float]:
    """The parameters k1 k2 k3 p1 p2 as coefficients of `D`, and the radius beyond which that folds over."""
    k1, k2, k3, p1, p2 = camera.params[4:].tolist()
    coefficients = np.array([-k1, -k2, p2, -p1, -k3])
    return coefficients, fold_radius(coefficients)


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
def _linearise(params: Array, coefficients: Array, fold: float, point: Array, kept: Array) -> None:
    rows, place = np.zeros(len(kept) * AT_ONCE), np.empty((2, AT_ONCE))
    rows[10 * AT_ONCE : 11 * AT_ONCE] = 1.0  # u by cx
    rows[20 * AT_ONCE : 21 * AT_ONCE] = 1.0  # v by cy
    p = params[0], params[1], params[2], params[3]
    c = coefficients[0], coefficients[1], coefficients[2], coefficients[3], coefficients[4]
    for begin in range(0, point.shape[1], AT_ONCE):
        count = min(AT_ONCE, point.shape[1] - begin)
        for n in range(count):
            inverse_depth = 1.0 / point[2, begin + n] if point[2, begin + n] > 0 else np.nan
            x, y = point[0, begin + n] * inverse_depth, point[1, begin + n] * inverse_depth
            place[0, n], place[1, n] = x, y
            rows[2 * AT_ONCE + n], rows[3 * AT_ONCE + n], rows[4 * AT_ONCE + n] = x, y, inverse_depth
        undistort_block(coefficients, fold, place[0, :count], place[1, :count])
        rows[:count], rows[AT_ONCE : AT_ONCE + count] = place[0, :count], place[1, :count]
        _fill(p, c, count, rows)
        keep_rows(rows, begin, count, kept)


@jit_sums
def _fill(
    p: tuple[float, float, float, float], c: tuple[float, float, float, float, float], count: int, rows: Array
) -> None:
    """Replace what is in the first five rows by pixels and derivatives, row by row as in `Linearised`.

    There are (a, b) = D^-1(x, y), x, y and the inverse depth. The derivative by (x, y) is D'^-1, and that by a
    coefficient c is -D'^-1 dD/dc.
    """
    fx, fy, cx, cy = p
    k1, k2, p1, p2, k3 = c
    for n in range(count):
        a, b = rows[n], rows[AT_ONCE + n]
        x, y, inverse_depth = rows[2 * AT_ONCE + n], rows[3 * AT_ONCE + n], rows[4 * AT_ONCE + n]
        rows[n], rows[AT_ONCE + n] = fx * a + cx, fy * b + cy
        s = a * a + b * b
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))
        dxx = radial + slope * a * a + 2 * p1 * b + 6 * p2 * a
        dyy = radial + slope * b * b + 6 * p1 * b + 2 * p2 * a
        dxy = slope * a * b + 2 * p1 * a + 2 * p2 * b
        inverse = 1.0 / (dxx * dyy - dxy * dxy)
        uu, uv, vu, vv = fx * inverse * dyy, -fx * inverse * dxy, -fy * inverse * dxy, fy * inverse * dxx
        rows[2 * AT_ONCE + n], rows[3 * AT_ONCE + n] = uu * inverse_depth, uv * inverse_depth
        rows[4 * AT_ONCE + n] = -(uu * x + uv * y) * inverse_depth
        rows[5 * AT_ONCE + n], rows[6 * AT_ONCE + n] = vu * inverse_depth, vv * inverse_depth
        rows[7 * AT_ONCE + n] = -(vu * x + vv * y) * inverse_depth
        # k1, k2, k3, p1, p2 are -k1, -k2, -k3, -p2 and p1 of the coefficients.
        u, v = (uu * a + uv * b) * s, (vu * a + vv * b) * s
        ab2, sa, sb = 2 * a * b, s + 2 * a * a, s + 2 * b * b
        rows[8 * AT_ONCE + n] = a
        rows[12 * AT_ONCE + n], rows[13 * AT_ONCE + n], rows[14 * AT_ONCE + n] = u, u * s, u * s * s
        rows[15 * AT_ONCE + n], rows[16 * AT_ONCE + n] = uu * sa + uv * ab2, -(uu * ab2 + uv * sb)
        rows[18 * AT_ONCE + n] = b
        rows[21 * AT_ONCE + n], rows[22 * AT_ONCE + n], rows[23 * AT_ONCE + n] = v, v * s, v * s * s
        rows[24 * AT_ONCE + n], rows[25 * AT_ONCE + n] = vu * sa + vv * ab2, -(vu * ab2 + vv * sb)


MODEL = CompiledModel(
    name="luhmann",
    remedy="fisheye, ds and eucm reach any angle; virtual needs no lens formula",
    parameters=(*FOCAL_AND_CENTRE, *(LensParameter(name, "1") for name in ("k1", "k2", "k3", "p1", "p2"))),
    lens=_lens,
    fill_rays=_rays,
    fill_pixels=_project,
    fill_linear=_linearise,
)
