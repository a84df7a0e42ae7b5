"""Two ellipses under one planar homology, fitted to sub-pixel edge points: the start of the direct fit.

Eight parameters (c, E, m and the ratio of the radii; see `ring_model`), Levenberg-Marquardt, all rings in one batch.
Edge points are where the brightness crosses the middle between its two sides, on lines across the edge.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detect.plane_distance import offset_on_circle, plane_distance
from calib.detect.ring_model import (
    BLUR,
    CENTER_U,
    CENTER_V,
    DARKNESS,
    E00,
    E11,
    GEOMETRY_PARAMETERS,
    PARAMETERS,
    RATIO,
    WHITE,
)
from calib.jit import jit
from calib.small_solve import cholesky_solve
from calib.threads import in_chunks

Floats: TypeAlias = NDArray[np.float64]

RAYS = 40
MAX_STEPS = 33
ITERATIONS = 40
ENOUGH = 1e-4
"""A share of the cost: what is found here is a start."""
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
def _edge_points(
    image: NDArray[np.generic], p: Floats, q: Floats, edge_uv: Floats, edge_rho: Floats, levels: Floats
) -> int:
    """Sub-pixel edge points of a ring; `levels` gets each point's dark side, bright side and steepest step."""
    height, width = image.shape
    profile = np.empty(MAX_STEPS)
    count = 0
    edges = 2 if p[RATIO] > 0.0 else 1
    for edge in range(edges):
        rho = 1.0 if edge == 0 else p[RATIO]
        sign = 1.0 if edge == 0 else -1.0
        for ray in range(RAYS):
            angle = 2.0 * math.pi * (ray + 0.5 * edge) / RAYS
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
            edge_uv[count, 0] = mid_u + place * nu
            edge_uv[count, 1] = mid_v + place * nv
            edge_rho[count] = rho if edge == 0 else -1.0
            levels[count, 0], levels[count, 1], levels[count, 2] = dark, bright, 2.0 * steepest
            count += 1
    return count


@jit
def _keep_strong(count: int, edge_uv: Floats, edge_rho: Floats, levels: Floats) -> int:
    """Drop points whose contrast is below half of the median: glare, neighbours, shadows."""
    if count < 2 * GEOMETRY_PARAMETERS:
        return 0
    typical = np.median(levels[:count, 1] - levels[:count, 0])
    kept = 0
    for n in range(count):
        if levels[n, 1] - levels[n, 0] > 0.5 * typical:
            edge_uv[kept] = edge_uv[n]
            edge_rho[kept] = edge_rho[n]
            levels[kept] = levels[n]
            kept += 1
    return kept


@jit
def _pair_cost(
    p: Floats, q: Floats, count: int, edge_uv: Floats, edge_rho: Floats, normal: Floats, gradient: Floats
) -> float:
    """Huber cost of the signed distances; fills the weighted normal equations."""
    normal[:] = 0.0
    gradient[:] = 0.0
    row = np.empty(GEOMETRY_PARAMETERS)
    cost = 0.0
    for n in range(count):
        out = plane_distance(p, q, edge_uv[n, 0] - p[CENTER_U], edge_uv[n, 1] - p[CENTER_V])
        is_outer = edge_rho[n] > 0.0
        inv_g = 1.0 / out[1]
        d = (out[0] - (1.0 if is_outer else p[RATIO])) * inv_g
        weight = 1.0 if abs(d) <= ROBUST_PX else ROBUST_PX / abs(d)
        cost += d * d if weight == 1.0 else ROBUST_PX * (2.0 * abs(d) - ROBUST_PX)
        row[0] = -out[2] * inv_g
        row[1] = -out[3] * inv_g
        row[2] = out[4] * inv_g
        row[3] = out[5] * inv_g
        row[4] = out[6] * inv_g
        row[5] = out[7] * inv_g
        row[6] = out[8] * inv_g
        row[7] = 0.0 if is_outer else -inv_g
        for a in range(GEOMETRY_PARAMETERS):
            gradient[a] -= weight * row[a] * d
            for b in range(a + 1):
                normal[a, b] += weight * row[a] * row[b]
    return cost


@jit
def _fit_pair(image: NDArray[np.generic], p: Floats, q: Floats) -> float:
    """Improve p in place; returns the root-mean-square distance of the edge points in px, or -1."""
    edge_uv, edge_rho = np.empty((2 * RAYS, 2)), np.empty(2 * RAYS)
    levels = np.empty((2 * RAYS, 3))
    normal, trial_normal = np.empty((8, 8)), np.empty((8, 8))
    gradient, step, trial_gradient = np.empty(8), np.empty(8), np.empty(8)
    trial = p.copy()
    rms = -1.0
    for _round in range(2):
        count = _edge_points(image, p, q, edge_uv, edge_rho, levels)
        count = _keep_strong(count, edge_uv, edge_rho, levels)
        if count < 2 * GEOMETRY_PARAMETERS:
            return -1.0
        cost = _pair_cost(p, q, count, edge_uv, edge_rho, normal, gradient)
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
            trial_cost = _pair_cost(trial, q, count, edge_uv, edge_rho, trial_normal, trial_gradient)
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
    straight = np.zeros(6)
    for n in range(first, last):
        rms[n] = _fit_pair(image, params[n], straight)


def fit_pairs(image: NDArray[np.generic], start: Floats) -> tuple[Floats, Floats]:
    """Fit pairs of ellipses to the edges of rings.

    Args:
        image: grey levels.  # (H, W)
        start: c, E, m and the ratio to start from.  # (N, 8)

    Returns:
        Full parameters, blur and levels included, to start the direct fit from (N, 15), and the
        root-mean-square distance of the edge points in px, -1 where there was no fit (N,).
    """
    params = np.zeros((len(start), PARAMETERS))
    params[:, :GEOMETRY_PARAMETERS] = start
    rms = np.full(len(start), -1.0)
    in_chunks(lambda first, last: _fit_pair_range(image, params, rms, first, last), len(start))
    return params, rms
