"""A lens as a smooth surface: a pinhole whose image is displaced by a cubic B-spline, to be simulated, not solved.

`u = p + sum_rc B_r(p_v) B_c(p_u) d_rc` with the pinhole's pixel `p = (fx X/Z + cx, fy Y/Z + cy)` and displacements
`d_rc` in px at `ROWS` x `COLUMNS` control points of uniform cubic B-splines (de Boor, A Practical Guide to Splines,
1978), whose domain is the image and a margin around it. With control points of any pattern it bends as no Brown
polynomial does: what a lens of many elements leaves over when its polynomial is taken away.
"""

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.parameters import FOCAL_AND_CENTRE, CompiledModel, Parameter
from calib.core.jit import jit

Array = NDArray[np.float64]

COLUMNS, ROWS = 8, 6
DEGREE = 3
MARGIN = 0.1
"""Of a side of the image, on both ends: the domain of the splines beyond it."""
FIRST = len(FOCAL_AND_CENTRE)
MAX_STEPS = 60
TOLERANCE_PX = 1e-11
ACCEPTED_PX = 1e-6
"""A larger residual of the inverse means that there is none."""


@jit
def _basis(place: float, count: int, weight: Array, slope: Array) -> int:
    """The first of the four control points of `count` that count at a place, their weights and the slopes of these.

    -1 outside of the domain [0, count - 3].
    """
    spans = count - DEGREE
    if not 0 <= place <= spans:
        return -1
    first = min(int(place), spans - 1)
    t = place - first
    s = 1 - t
    weight[0], weight[1] = s * s * s / 6, (3 * t * t * t - 6 * t * t + 4) / 6
    weight[2], weight[3] = (3 * s * s * s - 6 * s * s + 4) / 6, t * t * t / 6
    slope[0], slope[1] = -0.5 * s * s, 1.5 * t * t - 2 * t
    slope[2], slope[3] = 2 * s - 1.5 * s * s, 0.5 * t * t
    return first


@jit
def _displaced(params: Array, scale: Array, a: float, b: float, work: Array, out: Array) -> tuple[int, int]:
    """Where the pinhole's pixel (a, b) is seen, and the derivatives: `out` = u, v, u by a, u by b, v by a, v by b.

    `work` (4, 4) holds afterwards weights and slopes of columns and of rows. (-1, -1), and nan, outside of the domain.
    """
    column = _basis((a - scale[0, 0]) * scale[0, 1], COLUMNS, work[0], work[1])
    row = _basis((b - scale[1, 0]) * scale[1, 1], ROWS, work[2], work[3])
    if column < 0 or row < 0:
        out[:] = np.nan
        return -1, -1
    out[0], out[1], out[2], out[3], out[4], out[5] = a, b, 1.0, 0.0, 0.0, 1.0
    for j in range(4):
        for i in range(4):
            k = FIRST + (row + j) * COLUMNS + column + i
            du, dv = params[k], params[k + ROWS * COLUMNS]
            both = work[0, i] * work[2, j]
            by_a, by_b = work[1, i] * work[2, j] * scale[0, 1], work[0, i] * work[3, j] * scale[1, 1]
            out[0] += both * du
            out[1] += both * dv
            out[2] += by_a * du
            out[3] += by_b * du
            out[4] += by_a * dv
            out[5] += by_b * dv
    return column, row


@jit
def _project(params: Array, scale: Array, point: Array, pixel: Array) -> None:
    work, out = np.empty((4, 4)), np.empty(6)
    for n in range(len(point)):
        pixel[n, 0], pixel[n, 1] = np.nan, np.nan
        if point[n, 2] > 0:
            a, b = point[n, 0] / point[n, 2], point[n, 1] / point[n, 2]
            _displaced(params, scale, params[0] * a + params[2], params[1] * b + params[3], work, out)
            pixel[n, 0], pixel[n, 1] = out[0], out[1]


@jit
def _rays(params: Array, scale: Array, pixel: Array, ray: Array) -> None:
    """Newton's method from the pixel itself."""
    work, out = np.empty((4, 4)), np.empty(6)
    for n in range(len(pixel)):
        a, b, left = pixel[n, 0], pixel[n, 1], np.inf
        for _ in range(MAX_STEPS):
            _displaced(params, scale, a, b, work, out)
            e, f = out[0] - pixel[n, 0], out[1] - pixel[n, 1]
            last, left = left, abs(e) + abs(f)
            if not left > TOLERANCE_PX or (last <= left < ACCEPTED_PX):
                break
            determinant = out[2] * out[5] - out[3] * out[4]
            a -= (out[5] * e - out[3] * f) / determinant
            b -= (out[2] * f - out[4] * e) / determinant
        one = 1.0 if left < ACCEPTED_PX else np.nan
        ray[n, 0], ray[n, 1], ray[n, 2] = one * (a - params[2]) / params[0], one * (b - params[3]) / params[1], one


@jit
def _linearise(params: Array, scale: Array, point: Array, rows: Array) -> None:
    pixel, by_point, by_params = rows[:2], rows[2:8].reshape(2, 3, -1), rows[8:].reshape(2, len(params), -1)
    work, out = np.empty((4, 4)), np.empty(6)
    fx, fy, cx, cy = params[:FIRST]
    for n in range(point.shape[1]):
        inverse_depth = 1.0 / point[2, n] if point[2, n] > 0 else np.nan
        x, y = point[0, n] * inverse_depth, point[1, n] * inverse_depth
        column, row = _displaced(params, scale, fx * x + cx, fy * y + cy, work, out)
        for axis in range(2):
            along_x, along_y = out[2 + 2 * axis], out[3 + 2 * axis]
            pixel[axis, n] = out[axis]
            gx, gy = along_x * fx * inverse_depth, along_y * fy * inverse_depth
            by_point[axis, 0, n], by_point[axis, 1, n], by_point[axis, 2, n] = gx, gy, -(gx * x + gy * y)
            by_params[axis, :, n] = 0.0
            by_params[axis, 0, n], by_params[axis, 1, n] = along_x * x, along_y * y
            by_params[axis, 2, n], by_params[axis, 3, n] = along_x, along_y
            if column >= 0:
                for j in range(4):
                    for i in range(4):
                        k = FIRST + axis * ROWS * COLUMNS + (row + j) * COLUMNS + column + i
                        by_params[axis, k, n] = work[0, i] * work[2, j]


def _scale(camera: Camera) -> tuple[Array]:
    """First pixel of the domain and spans per pixel, across and down.  # (2, 2)"""
    rows = []
    for side, count in zip(camera.image_size, (COLUMNS, ROWS), strict=True):
        rows.append((-0.5 - MARGIN * side, (count - DEGREE) / (side * (1 + 2 * MARGIN))))
    return (np.array(rows),)


MODEL = CompiledModel(
    name="spline",
    remedy="show the target there too",
    parameters=(
        *FOCAL_AND_CENTRE,
        *(
            Parameter(f"d{axis}_row{row}_column{column}_px", "px")
            for axis in "uv"
            for row in range(ROWS)
            for column in range(COLUMNS)
        ),
    ),
    lens=_scale,
    fill_rays=_rays,
    fill_pixels=_project,
    fill_linear=_linearise,
)
