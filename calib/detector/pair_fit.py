"""Two ellipses under one planar homology, fitted to sub-pixel edge points: the start of the direct fit.

Eight parameters (c, E, m and the ratio of the radii; see `ring_model`), Levenberg-Marquardt, all rings in one batch.
Edge points are where the brightness crosses the middle between its two sides, on lines across the edge.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit, jit_sums
from calib.core.parallel import in_chunks
from calib.core.small_solve import cholesky_solve
from calib.detector.ring_equations import CHUNK, add_products
from calib.detector.ring_model import (
    BLUR,
    CENTER_U,
    CENTER_V,
    DARKNESS,
    E00,
    E11,
    GEOMETRY_PARAMETERS,
    LENS_NUMBERS,
    PARAMETERS,
    RATIO,
    WHITE,
    Numbers,
    bend_of,
    offset_on_circle,
    parameters_of,
    plane_distance,
)
from designer.base.arrays import Array

Floats: TypeAlias = Array

RAYS = 40
MAX_STEPS = 33
ITERATIONS = 40
ENOUGH = 1e-4
"""A share of the cost: what is found here is a start."""
RESIDUAL = GEOMETRY_PARAMETERS * CHUNK
ROOM = RESIDUAL + 4 * CHUNK
"""As in `ring_equations`: rows of derivatives, then residuals, in whole fours; a ring's points are one chunk."""
ROBUST_PX = 0.4
"""Edge points farther off than this count less (Huber)."""


@jit
def _bilinear(image: NDArray[np.generic], u: float, v: float) -> float:
    """Brightness between pixels; the caller keeps one pixel inside the image."""
    iu, iv = int(u), int(v)
    fu, fv = u - iu, v - iv
    top = image[iv, iu] * (1.0 - fu) + image[iv, iu + 1] * fu
    bottom = image[iv + 1, iu] * (1.0 - fu) + image[iv + 1, iu + 1] * fu
    value: float = top * (1.0 - fv) + bottom * fv
    return value


@jit
def _edge_points(image: NDArray[np.generic], p: Floats, q: Floats, edge: Floats, levels: Floats) -> int:
    """Sub-pixel edge points of a ring: u, v and 1 on the outer edge, 0 on the inner one.

    `levels` gets each point's dark side, bright side and steepest step.
    """
    height, width = image.shape
    profile = np.empty(MAX_STEPS)
    count = 0
    for inner in range(2 if p[RATIO] > 0.0 else 1):
        rho = 1.0 if inner == 0 else p[RATIO]
        sign = 1.0 if inner == 0 else -1.0
        for ray in range(RAYS):
            angle = 2.0 * math.pi * (ray + 0.5 * inner) / RAYS
            x0, x1 = offset_on_circle(p, rho, angle)
            out = plane_distance(p, q, x0, x1)
            # As far as the middle of the ink, or of the white centre: the least room there is.
            room = (1.0 - p[RATIO]) / out[1] if p[RATIO] > 0.0 else 1.0 / out[1]
            reach = min(max(0.5 * room, 1.5), 5.0)
            half = min(int(reach / 0.5 + 0.5), (MAX_STEPS - 1) // 2)
            nu, nv = sign * out[2] / out[1], sign * out[3] / out[1]
            mid_u, mid_v = p[CENTER_U] + x0, p[CENTER_V] + x1
            far = 0.5 * half + 1.0
            # Asked so that what is not a number is left out too.
            if not (far <= mid_u <= width - 1 - far and far <= mid_v <= height - 1 - far):
                continue
            for k in range(2 * half + 1):
                t = 0.5 * (k - half)
                profile[k] = _bilinear(image, mid_u + t * nu, mid_v + t * nv)
            dark = min(profile[0], profile[1])
            bright = max(profile[2 * half], profile[2 * half - 1])
            middle = 0.5 * (dark + bright)
            best, place, steepest = np.inf, 0.0, 0.0
            for k in range(2 * half):
                rise = profile[k + 1] - profile[k]
                steepest = max(steepest, rise)
                if profile[k] < middle <= profile[k + 1]:
                    t = 0.5 * (k - half + (middle - profile[k]) / rise)
                    if abs(t) < best:
                        best, place = abs(t), t
            if best == np.inf:
                continue
            edge[0, count] = mid_u + place * nu
            edge[1, count] = mid_v + place * nv
            edge[2, count] = 1.0 - inner
            levels[count, 0], levels[count, 1], levels[count, 2] = dark, bright, 2.0 * steepest
            count += 1
    return count


@jit
def _keep_strong(count: int, edge: Floats, levels: Floats) -> int:
    """Drop points whose contrast is below half of the median: glare, neighbours, shadows."""
    if count < 2 * GEOMETRY_PARAMETERS:
        return 0
    typical = np.median(levels[:count, 1] - levels[:count, 0])
    kept = 0
    for n in range(count):
        if levels[n, 1] - levels[n, 0] > 0.5 * typical:
            edge[:, kept] = edge[:, n]
            levels[kept] = levels[n]
            kept += 1
    return kept


@jit_sums
def _fill_rows(edge: Floats, count: int, p: Numbers, q: Numbers, rows: Floats) -> float:
    """Huber cost of the signed distances; derivatives and residuals, weighted, into `rows`.  # (ROOM,)"""
    for k in range(count):
        rows[k] = edge[0, k]
        rows[CHUNK + k] = edge[1, k]
        rows[RESIDUAL + k] = edge[2, k]
    cost = 0.0
    for k in range(count):
        distance = plane_distance(p, q, rows[k] - p[CENTER_U], rows[CHUNK + k] - p[CENTER_V])
        is_outer = rows[RESIDUAL + k] > 0.5
        inv_g = 1.0 / distance[1]
        d = (distance[0] - (1.0 if is_outer else p[RATIO])) * inv_g
        size = abs(d)
        is_near = size <= ROBUST_PX
        cost += d * d if is_near else ROBUST_PX * (2.0 * size - ROBUST_PX)
        root = 1.0 if is_near else math.sqrt(ROBUST_PX / size)
        by = root * inv_g
        rows[k] = -by * distance[2]
        rows[CHUNK + k] = -by * distance[3]
        rows[2 * CHUNK + k] = by * distance[4]
        rows[3 * CHUNK + k] = by * distance[5]
        rows[4 * CHUNK + k] = by * distance[6]
        rows[5 * CHUNK + k] = by * distance[7]
        rows[6 * CHUNK + k] = by * distance[8]
        rows[7 * CHUNK + k] = 0.0 if is_outer else -by
        rows[RESIDUAL + k] = -root * d
    return cost


@jit
def _pair_cost(edge: Floats, count: int, p: Floats, q: Floats, normal: Floats, gradient: Floats, rows: Floats) -> float:
    """Huber cost of the signed distances; fills the weighted normal equations."""
    cost = _fill_rows(edge, count, parameters_of(p), bend_of(q), rows)
    total = np.zeros((GEOMETRY_PARAMETERS + 1, GEOMETRY_PARAMETERS + 4))
    add_products(rows, GEOMETRY_PARAMETERS, count, total)
    normal[:] = total[:GEOMETRY_PARAMETERS, :GEOMETRY_PARAMETERS]
    gradient[:] = total[GEOMETRY_PARAMETERS, :GEOMETRY_PARAMETERS]
    return cost


@jit
def _fit_pair(image: NDArray[np.generic], p: Floats, q: Floats) -> float:
    """Improve p in place; returns the root-mean-square distance of the edge points in px, or -1."""
    edge, levels, rows = np.empty((3, 2 * RAYS)), np.empty((2 * RAYS, 3)), np.empty(ROOM)
    normal, trial_normal = np.empty((8, 8)), np.empty((8, 8))
    gradient, step, trial_gradient = np.empty(8), np.empty(8), np.empty(8)
    trial = p.copy()
    rms = -1.0
    for _round in range(2):
        count = _edge_points(image, p, q, edge, levels)
        count = _keep_strong(count, edge, levels)
        if count < 2 * GEOMETRY_PARAMETERS:
            return -1.0
        cost = _pair_cost(edge, count, p, q, normal, gradient, rows)
        damping = 1e-3
        for _ in range(ITERATIONS):
            trial_normal[:] = normal
            for k in range(GEOMETRY_PARAMETERS):
                trial_normal[k, k] += damping * normal[k, k] + 1e-12
            if not cholesky_solve(trial_normal, gradient, step):
                return -1.0
            trial[:8] = p[:8] + step
            if not (trial[E00] > 0.0 and trial[E11] > 0.0 and 0.05 < trial[RATIO] < 0.95):
                damping *= 10.0
                continue
            trial_cost = _pair_cost(edge, count, trial, q, trial_normal, trial_gradient, rows)
            if trial_cost < cost:
                done = cost - trial_cost < ENOUGH * cost
                p[:8] = trial[:8]
                normal[:] = trial_normal
                gradient[:] = trial_gradient
                cost = trial_cost
                damping = max(0.1 * damping, 1e-9)
                if done:
                    break
            else:
                damping *= 10.0
                if damping > 1e6:
                    break
        rms = math.sqrt(cost / count)
        if rms > 3.0:
            return -1.0
        if rms < 0.3:
            # The edges were well inside the profiles: looking again from here would find the same points.
            break
    bright = np.median(levels[:count, 1])
    contrast = np.median(levels[:count, 1] - levels[:count, 0])
    slope = np.median(levels[:count, 2])
    # A Gaussian edge rises by contrast / (sqrt(2 pi) s) per pixel where it is steepest.
    p[BLUR] = min(max(0.3989422804 * contrast / max(slope, 1e-9), 0.4), 5.0)
    p[WHITE] = bright
    p[10:] = 0.0
    p[DARKNESS] = min(contrast / max(bright, 1e-9), 0.999)
    return rms


@jit
def _fit_pair_range(image: NDArray[np.generic], params: Floats, rms: Floats, first: int, last: int) -> None:
    """Fit rings first..last-1."""
    straight = np.zeros(LENS_NUMBERS)
    for n in range(first, last):
        rms[n] = _fit_pair(image, params[n], straight)


def fit_pairs(image: NDArray[np.generic], start: Floats) -> tuple[Floats, Floats]:
    """Fit pairs of ellipses to the edges of rings, from c, E, m and ratio (N, 8).

    Returns:
        Full parameters, blur and levels included, to start the direct fit from (N, 15), and the
        root-mean-square distance of the edge points in px, -1 where there was no fit (N,).
    """
    params = np.zeros((len(start), PARAMETERS))
    params[:, :GEOMETRY_PARAMETERS] = start
    rms = np.full(len(start), -1.0)
    in_chunks(lambda first, last: _fit_pair_range(image, params, rms, first, last), len(start))
    return params, rms
