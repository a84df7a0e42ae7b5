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

RUN = 2000
"""Observations at a time; their derivatives stay in the processor's cache."""
CHUNK = 128
"""Of them at a time; their equations stay in the nearest cache."""

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


@jit_sums
def _to_camera(
    view_start: NDArray[np.int64], first: int, last: int, pose: Array, position: Array, turned: Array, point: Array
) -> None:
    """R p and R p + t for the observations of some views."""
    base = view_start[first]
    for view in range(first, last):
        begin, end = view_start[view], view_start[view + 1]
        x, y, z = position[0, begin:end], position[1, begin:end], position[2, begin:end]
        for axis in range(3):
            rx, ry, rz, t = pose[view, axis, 0], pose[view, axis, 1], pose[view, axis, 2], pose[view, axis, 3]
            there, moved = turned[axis, begin - base : end - base], point[axis, begin - base : end - base]
            for n in range(end - begin):
                there[n] = rx * x[n] + ry * y[n] + rz * z[n]
            for n in range(end - begin):
                moved[n] = there[n] + t


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
def _weigh(
    begin: int,
    end: int,
    base: int,
    seen: Array,
    measured: Array,
    whitener: Array,
    is_used: NDArray[np.bool_],
    kind: int,
    knee: float,
    residual: Array,
    factor: Array,
) -> float:
    """Residuals of some observations, in pixels and weighted, and the weighted whiteners. Returns the loss.

    What does not count, or has no image, is given zeros in place of its derivatives.

    Args:
        begin: of the observations.
        end: likewise.
        base: the observation that `seen` begins with.
        seen: pixels and derivatives, of which those that do not count are overwritten.  # (2 + 6 + 2 P, N)
        measured: pixels.  # (2, M)
        whitener: see `Problem`.  # (3, M)
        is_used: see `Problem`.  # (M,)
        kind: of the loss.
        knee: likewise.
        residual: in pixels.  # (2, M)
        factor: a, b, c of the weighted whiteners, then the weighted residuals.  # (5, CHUNK)
    """
    total = 0.0
    for m in range(begin, end):
        n, k = m - begin, m - base
        du, dv = seen[0, k] - measured[0, m], seen[1, k] - measured[1, m]
        residual[0, m], residual[1, m] = du, dv
        a, b, c = whitener[0, m], whitener[1, m], whitener[2, m]
        ru, rv = a * du, b * du + c * dv
        square = ru * ru + rv * rv
        counts = is_used[m]
        if counts and kind != 0 and not square < NO_IMAGE * knee * knee:
            # The point has no image, or one that is lost: an outlier without a pull.
            total += _loss(kind, knee, NO_IMAGE * knee * knee)[0]
            counts = False
        if not counts:
            factor[:, n] = 0.0
            seen[:, k] = 0.0
            continue
        root = 1.0
        if kind == 0:
            total += square
        else:
            loss, weight = _loss(kind, knee, square)
            total += loss
            root = np.sqrt(weight)
        factor[0, n], factor[1, n], factor[2, n] = root * a, root * b, root * c
        factor[3, n], factor[4, n] = root * ru, root * rv
    return total


@jit_sums
def _fill(begin: int, count: int, turned: Array, seen: Array, factor: Array, rows: Array) -> None:
    """The rows [J r] of some observations, unknown by unknown: first those of u, then those of v.

    One simple loop a row: what it reads and writes does not overlap, so that the processor takes several at once.

    Args:
        begin: of the observations among those of `seen`.
        count: of them, at most `CHUNK`.
        turned: R p.  # (3, N)
        seen: pixels and derivatives.  # (2 + 6 + 2 P, N)
        factor: see `_weigh`.  # (5, CHUNK)
        rows: the result.  # (P + 7, 2 CHUNK)
    """
    end, parameters = begin + count, (seen.shape[0] - 8) // 2
    a, b, c = factor[0], factor[1], factor[2]
    x, y, z = turned[0, begin:end], turned[1, begin:end], turned[2, begin:end]
    for unknown in range(parameters + 3):
        is_shift = unknown >= parameters
        # Pixels, then by the three coordinates of the point, u and v; then by the parameters, u and v.
        at, after = (unknown - parameters + 2, 3) if is_shift else (8 + unknown, parameters)
        by_u, by_v = seen[at, begin:end], seen[at + after, begin:end]
        row = rows[unknown + 3 if is_shift else unknown]
        u, v = row[:count], row[count:]
        for n in range(count):
            u[n] = a[n] * by_u[n]
        for n in range(count):
            v[n] = b[n] * by_u[n] + c[n] * by_v[n]
    for half in range(2):
        first, last = half * count, (half + 1) * count
        shift = rows[parameters + 3 :, first:last]
        for axis in range(3):
            turn, residual = rows[parameters + axis, first:last], rows[parameters + 6, first:last]
            after, before = shift[(axis + 1) % 3], shift[(axis + 2) % 3]
            p, q = (y, z) if axis == 0 else (z, x) if axis == 1 else (x, y)
            for n in range(count):
                turn[n] = p[n] * before[n] - q[n] * after[n]
        weighted = factor[3 + half]
        for n in range(count):
            residual[n] = weighted[n]


@jit_sums
def _add_products(rows: Array, count: int, product: Array) -> None:
    """Add `rows @ rows.T`, four by two sums at a time so that each number loaded is used often; the lower triangle."""
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
                    if i + k < size and j + m <= i + k:
                        product[i + k, j + m] += sums[k][m]


@jit
def _view_products(
    view_start: NDArray[np.int64],
    first: int,
    last: int,
    turned: Array,
    seen: Array,
    measured: Array,
    whitener: Array,
    is_used: NDArray[np.bool_],
    kind: int,
    knee: float,
    residual: Array,
    products: Array,
    cost: Array,
) -> None:
    """Blocks and costs of some views, `CHUNK` observations at a time."""
    base, size = view_start[first], products.shape[1]
    rows, factor = np.empty((size, 2 * CHUNK)), np.empty((5, CHUNK))
    for view in range(first, last):
        cost[view] = 0.0
        products[view] = 0.0
        for begin in range(view_start[view], view_start[view + 1], CHUNK):
            end = min(begin + CHUNK, view_start[view + 1])
            cost[view] += _weigh(begin, end, base, seen, measured, whitener, is_used, kind, knee, residual, factor)
            _fill(begin - base, end - begin, turned, seen, factor, rows)
            _add_products(rows, 2 * (end - begin), products[view])
        for i in range(size):
            for j in range(i):
                products[view, j, i] = products[view, i, j]


def view_blocks(problem: Problem, camera: Camera, cam_from_target: Array, loss: RobustLoss) -> Blocks:
    """The normal equations of all views at a camera and poses (V, 4, 4)."""
    views, count = problem.view_count, problem.measured_px.shape[1]
    size = len(camera.params) + 7
    blocks = Blocks(np.empty((views, size, size)), np.empty(views), np.empty((2, count)))
    knee = KNEE[loss.kind] * loss.sigma
    pose = np.ascontiguousarray(cam_from_target)
    for first, last in _runs(problem.view_start):
        width = int(problem.view_start[last] - problem.view_start[first])
        turned, point = np.empty((3, width)), np.empty((3, width))
        _to_camera(problem.view_start, first, last, pose, problem.position_mm, turned, point)
        seen = linearise(camera, point)
        _view_products(
            problem.view_start, first, last, turned, seen.rows, problem.measured_px, problem.whitener,
            problem.is_used, LOSSES[loss.kind], knee, blocks.residual_px, blocks.products, blocks.cost,
        )  # fmt: skip
    return blocks


def _runs(view_start: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Runs of whole views with about `RUN` observations."""
    views = len(view_start) - 1
    if view_start[-1] <= RUN:
        return [(0, views)]
    result, first = [], 0
    while first < views:
        last = max(int(np.searchsorted(view_start, view_start[first] + RUN, side="right")) - 1, first + 1)
        result.append((first, last))
        first = last
    return result
