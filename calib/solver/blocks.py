"""The normal equations of every view: residuals and derivatives of its observations, and their products.

A view's unknowns are the P parameters of the camera and the six of its pose: `p_cam' = exp(w) R p + t + s` with the
rotation vector w (rad) and the shift s (mm). With J the derivatives of the whitened residuals r, a view's block is
`[J r]' [J r]`, (P + 7, P + 7): normal matrix, gradient and squared sum in one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise
from calib.jit import jit, jit_sums
from calib.solver.options import Loss
from calib.solver.problem import Problem
from calib.types import Camera

Array = NDArray[np.float64]

CHUNK = 2000
"""Observations at a time; their derivatives stay in the processor's cache."""

NO_IMAGE = 1e8
"""Squared length, in knees, that robust losses give to points that the camera does not show."""

LOSSES: dict[Loss, int] = {"squares": 0, "huber": 1, "cauchy": 2}
KNEE: dict[Loss, float] = {"squares": np.inf, "huber": 1.345, "cauchy": 2.385}
"""Where the losses bend, in standard deviations: 95 % efficient on normal noise (Holland and Welsch 1977)."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """The normal equations of V views, and the residuals they were made of."""

    products: Array  # (V, P + 7, P + 7) symmetric
    cost: Array  # (V,) sum of the losses of the whitened residuals; nan if an observation that counts has no image
    residual_px: Array  # (2, M) predicted - measured


@dataclass(frozen=True)
class RobustLoss:
    """A loss of the whitened residual's length: squares up to the knee, then flatter."""

    kind: Loss = "squares"
    sigma: float = 1.0  # standard deviation of a whitened residual, which the knee is a multiple of


@jit
def _to_camera(
    view_start: NDArray[np.int64], first: int, last: int, pose: Array, position: Array, turned: Array, point: Array
) -> None:
    """R p and R p + t for the observations of some views."""
    base = view_start[first]
    for view in range(first, last):
        r = pose[view]
        for m in range(view_start[view], view_start[view + 1]):
            x, y, z = position[0, m], position[1, m], position[2, m]
            for axis in range(3):
                value = r[axis, 0] * x + r[axis, 1] * y + r[axis, 2] * z
                turned[axis, m - base] = value
                point[axis, m - base] = value + r[axis, 3]


@jit
def _loss(kind: int, knee: float, square: float) -> tuple[float, float]:
    """Loss and weight of a squared residual; the weight is the loss's derivative by the square."""
    if kind == 0 or square <= 0:
        return square, 1.0
    if kind == 1:
        if square <= knee * knee:
            return square, 1.0
        length = np.sqrt(square)
        return 2 * knee * length - knee * knee, knee / length
    ratio = square / (knee * knee)
    return knee * knee * np.log1p(ratio), 1 / (1 + ratio)


@jit
def _fill(
    begin: int,
    end: int,
    base: int,
    turned: Array,
    pixel: Array,
    by_point: Array,
    by_params: Array,
    measured: Array,
    whitener: Array,
    is_used: NDArray[np.bool_],
    kind: int,
    knee: float,
    residual: Array,
    rows: Array,
) -> float:
    """The rows [J r] of a view, unknown by unknown: first those of u, then those of v. Returns the loss."""
    count, parameters = end - begin, by_params.shape[1]
    last = parameters + 6
    total = 0.0
    for n in range(count):
        m, k = begin + n, begin + n - base
        du, dv = pixel[0, k] - measured[0, m], pixel[1, k] - measured[1, m]
        residual[0, m], residual[1, m] = du, dv
        if not is_used[m]:
            for c in range(last + 1):
                rows[c, n] = 0.0
                rows[c, count + n] = 0.0
            continue
        a, b, c2 = whitener[0, m], whitener[1, m], whitener[2, m]
        ru, rv = a * du, b * du + c2 * dv
        square = ru * ru + rv * rv
        if kind != 0 and not square < NO_IMAGE * knee * knee:
            square = NO_IMAGE * knee * knee  # the point has no image, or one that is lost: an outlier without a pull
            for c in range(last + 1):
                rows[c, n] = 0.0
                rows[c, count + n] = 0.0
            total += _loss(kind, knee, square)[0]
            continue
        loss, weight = _loss(kind, knee, square)
        total += loss
        root = np.sqrt(weight)
        a, b, c2 = root * a, root * b, root * c2
        rows[last, n], rows[last, count + n] = root * ru, root * rv
        for c in range(parameters):
            du, dv = by_params[0, c, k], by_params[1, c, k]
            rows[c, n], rows[c, count + n] = a * du, b * du + c2 * dv
        ux, uy, uz = a * by_point[0, 0, k], a * by_point[0, 1, k], a * by_point[0, 2, k]
        vx = b * by_point[0, 0, k] + c2 * by_point[1, 0, k]
        vy = b * by_point[0, 1, k] + c2 * by_point[1, 1, k]
        vz = b * by_point[0, 2, k] + c2 * by_point[1, 2, k]
        x, y, z = turned[0, k], turned[1, k], turned[2, k]
        p = parameters
        rows[p, n], rows[p + 1, n], rows[p + 2, n] = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux
        rows[p + 3, n], rows[p + 4, n], rows[p + 5, n] = ux, uy, uz
        k = count + n
        rows[p, k], rows[p + 1, k], rows[p + 2, k] = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
        rows[p + 3, k], rows[p + 4, k], rows[p + 5, k] = vx, vy, vz
    return total


@jit_sums
def _products(rows: Array, count: int, product: Array) -> None:
    """`rows @ rows.T`, four by two sums at a time so that each number loaded is used often."""
    size = rows.shape[0]
    for i in range(0, size, 2):
        second = min(i + 1, size - 1)
        a, b = rows[i], rows[second]
        for j in range(0, i + 2, 4):
            c, d = rows[min(j, size - 1)], rows[min(j + 1, size - 1)]
            e, f = rows[min(j + 2, size - 1)], rows[min(j + 3, size - 1)]
            ac, ad, ae, af, bc, bd, be, bf = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for n in range(count):
                ac += a[n] * c[n]
                ad += a[n] * d[n]
                ae += a[n] * e[n]
                af += a[n] * f[n]
                bc += b[n] * c[n]
                bd += b[n] * d[n]
                be += b[n] * e[n]
                bf += b[n] * f[n]
            sums = (ac, ad, ae, af), (bc, bd, be, bf)
            for k in range(2):
                for m in range(4):
                    if i + k < size and j + m < size:
                        product[i + k, j + m] = sums[k][m]
                        product[j + m, i + k] = sums[k][m]


@jit
def _view_products(
    view_start: NDArray[np.int64],
    first: int,
    last: int,
    turned: Array,
    pixel: Array,
    by_point: Array,
    by_params: Array,
    measured: Array,
    whitener: Array,
    is_used: NDArray[np.bool_],
    kind: int,
    knee: float,
    residual: Array,
    products: Array,
    cost: Array,
) -> None:
    longest = 0
    for view in range(first, last):
        longest = max(longest, view_start[view + 1] - view_start[view])
    rows = np.empty((by_params.shape[1] + 7, 2 * longest))
    for view in range(first, last):
        begin, end = view_start[view], view_start[view + 1]
        cost[view] = _fill(
            begin,
            end,
            view_start[first],
            turned,
            pixel,
            by_point,
            by_params,
            measured,
            whitener,
            is_used,
            kind,
            knee,
            residual,
            rows,
        )
        _products(rows, 2 * (end - begin), products[view])


def view_blocks(problem: Problem, camera: Camera, cam_from_target: Array, loss: RobustLoss) -> Blocks:
    """The normal equations of all views at a camera and poses (V, 4, 4)."""
    views, count = problem.view_count, problem.measured_px.shape[1]
    size = len(camera.params) + 7
    blocks = Blocks(np.empty((views, size, size)), np.empty(views), np.empty((2, count)))
    knee = KNEE[loss.kind] * loss.sigma
    pose = np.ascontiguousarray(cam_from_target)
    for first, last in _chunks(problem.view_start):
        width = int(problem.view_start[last] - problem.view_start[first])
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(problem.view_start, first, last, pose, problem.position_mm, turned, point)
        seen = linearise(camera, point)
        _view_products(
            problem.view_start, first, last, turned, seen.pixel, seen.by_point, seen.by_params, problem.measured_px,
            problem.whitener, problem.is_used, LOSSES[loss.kind], knee, blocks.residual_px, blocks.products,
            blocks.cost,
        )  # fmt: skip
    return blocks


def _chunks(view_start: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Runs of whole views with about `CHUNK` observations."""
    views = len(view_start) - 1
    result, first = [], 0
    while first < views:
        last = max(int(np.searchsorted(view_start, view_start[first] + CHUNK, side="right")) - 1, first + 1)
        result.append((first, last))
        first = last
    return result
