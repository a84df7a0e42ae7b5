"""Direct fit of the ring model to the pixels: Levenberg-Marquardt in compiled code, all rings in one batch.

The vanishing line enters as a Gaussian prior on `m`: with zero information it is free, with the information of the
face's grid the fit weighs line and pixels as they deserve, and the covariance contains the line's own uncertainty.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detect.ring_model import PARAMETERS
from calib.detect.small_solve import cholesky_invert, cholesky_solve
from calib.jit import jit, jit_sums
from calib.threads import in_chunks

Floats: TypeAlias = NDArray[np.float64]

MAX_ITERATIONS = 25
MAX_PIXELS = 4096
CHUNK = 64
"""Pixels whose derivatives are multiplied together at once."""
PIXEL_BUDGET = 900
"""Larger rings are sampled: so many pixels near the edges hold the centre far better than any printer or plane does."""
DENSE_RADIUS_PX = 24.0
"""Rings up to this mean outer radius use every pixel near an edge."""


@dataclass(frozen=True, eq=False)
class RingFits:
    """N fits. A fit that failed has `ok` false and numbers without meaning."""

    params: Floats  # (N, 13) see calib.detect.ring_model
    cov_px2: Floats  # (N, 2, 2) of the centre
    cov_line: Floats  # (N, 2, 2) of m
    noise: Floats  # (N,) residual standard deviation in grey levels
    pixels: NDArray[np.int64]  # (N,) how many pixels were used
    ok: NDArray[np.bool_]  # (N,)

    @property
    def center_px(self) -> Floats:
        """Projected centres.  # (N, 2)"""
        return self.params[:, :2]

    @property
    def contrast(self) -> Floats:
        """White minus black at the centre, in grey levels.  # (N,)"""
        return self.params[:, 9] * self.params[:, 12]


@jit
def plane_distance(p: Floats, q: Floats, v0: float, v1: float, out: Floats) -> None:
    """F and its derivatives at the offset (v0, v1): out = F, |grad F|, dF/dv (2), dF/dE (3), dF/dm (2),
    F times the curvature of the level set (per px)."""
    x0 = v0 + q[0] * v0 * v0 + q[1] * v0 * v1 + q[2] * v1 * v1
    x1 = v1 + q[3] * v0 * v0 + q[4] * v0 * v1 + q[5] * v1 * v1
    y0 = p[2] * x0
    y1 = p[3] * x0 + p[4] * x1
    length = math.sqrt(y0 * y0 + y1 * y1) + 1e-12
    inv_w = 1.0 / (1.0 - p[5] * x0 - p[6] * x1)
    f = length * inv_w
    s = inv_w / length
    fx0 = (p[2] * y0 + p[3] * y1) * s + f * p[5] * inv_w
    fx1 = p[4] * y1 * s + f * p[6] * inv_w
    fv0 = fx0 * (1.0 + 2.0 * q[0] * v0 + q[1] * v1) + fx1 * (2.0 * q[3] * v0 + q[4] * v1)
    fv1 = fx0 * (q[1] * v0 + 2.0 * q[2] * v1) + fx1 * (1.0 + q[4] * v0 + 2.0 * q[5] * v1)
    out[0] = f
    out[1] = math.sqrt(fv0 * fv0 + fv1 * fv1) + 1e-12
    out[2] = fv0
    out[3] = fv1
    out[4] = y0 * x0 * s
    out[5] = y1 * x0 * s
    out[6] = y1 * x1 * s
    out[7] = f * x0 * inv_w
    out[8] = f * x1 * inv_w
    # The level set |E xi| - F (1 - m . xi) = 0 has the Hessian of |E xi| alone.
    e0 = -p[2] * fv1
    e1 = p[4] * fv0 - p[3] * fv1
    inv_g = 1.0 / out[1]
    across = (y0 * e1 - y1 * e0) * s * inv_g
    out[9] = across * across * inv_g


@jit
def _sample_pixels(
    p: Floats, q: Floats, reach: float, height: int, width: int, pixels: NDArray[np.int32]
) -> int:
    """Pixels on lines across the edges of a large ring: close to the edge, where the position is; and on every
    fourth line as far as `reach`, where the levels are."""
    out = np.empty(10)
    count = 0
    edges = 2 if p[7] > 0.0 else 1
    far = int(math.ceil(reach))
    near = int(math.ceil(0.5 * reach))
    rays = int(PIXEL_BUDGET / (edges * (2 * near + 1 + 0.5 * (far - near))))
    for edge in range(edges):
        rho = 1.0 if edge == 0 else p[7]
        for ray in range(rays):
            # A fraction of a turn apart for the two edges, so that rows and columns are not sampled alike.
            angle = 2.0 * math.pi * (ray + 0.37 * edge) / rays
            y0, y1 = math.cos(angle), math.sin(angle)
            x0 = y0 / p[2]
            x1 = (y1 - p[3] * x0) / p[4]
            scale = rho / (1.0 + rho * (p[5] * x0 + p[6] * x1))
            x0 *= scale
            x1 *= scale
            plane_distance(p, q, x0, x1, out)
            nu, nv = out[2] / out[1], out[3] / out[1]
            half = far if ray % 4 == 0 else near
            for t in range(-half, half + 1):
                u = int(round(p[0] + x0 + t * nu))
                v = int(round(p[1] + x1 + t * nv))
                if 0 <= u < width and 0 <= v < height and count < MAX_PIXELS:
                    pixels[count, 0] = u
                    pixels[count, 1] = v
                    count += 1
    return count


@jit
def _choose_pixels(
    p: Floats, q: Floats, reach: float, limit: float, height: int, width: int, pixels: NDArray[np.int32]
) -> int:
    """Pixels near the ring's edges: within `reach` px of one and no farther out than F = `limit`."""
    s0 = math.sqrt(p[2] * p[2] + p[3] * p[3])
    det = p[2] * p[4]
    half_u = math.sqrt(p[3] * p[3] + p[4] * p[4]) / det
    half_v = s0 / det
    radius = 1.0 / math.sqrt(det)
    out = np.empty(10)
    count = 0
    if radius <= DENSE_RADIUS_PX:
        u_first = max(0, int(math.floor(p[0] - 1.15 * half_u - reach)))
        u_last = min(width - 1, int(math.ceil(p[0] + 1.15 * half_u + reach)))
        v_first = max(0, int(math.floor(p[1] - 1.15 * half_v - reach)))
        v_last = min(height - 1, int(math.ceil(p[1] + 1.15 * half_v + reach)))
        for v in range(v_first, v_last + 1):
            for u in range(u_first, u_last + 1):
                plane_distance(p, q, u - p[0], v - p[1], out)
                f, g = out[0], out[1]
                near = abs(f - 1.0) <= reach * g or (p[7] > 0.0 and abs(f - p[7]) <= reach * g)
                if p[7] <= 0.0 and f < 0.5:
                    near = True
                if near and 0.0 <= f <= limit and count < MAX_PIXELS:
                    pixels[count, 0] = u
                    pixels[count, 1] = v
                    count += 1
        return count
    return _sample_pixels(p, q, reach, height, width, pixels)


@jit
def _edge(t: float) -> tuple[float, float]:
    """1 - Phi(t) and the normal density; most pixels are near one edge only, and far ones cost nothing."""
    if t > 6.0:
        return 0.0, 0.0
    if t < -6.0:
        return 1.0, 0.0
    return 0.5 - 0.5 * math.erf(t * 0.7071067811865476), 0.3989422804014327 * math.exp(-0.5 * t * t)


@jit_sums
def _add_outer(rows: Floats, filled: int, total: Floats) -> None:
    """Add rows @ rows' to the lower triangle of `total`.  # (P, CHUNK), (P, P)"""
    for a in range(PARAMETERS):
        for b in range(a + 1):
            s = 0.0
            for n in range(filled):
                s += rows[a, n] * rows[b, n]
            total[a, b] += s


@jit
def _accumulate(
    image: NDArray[np.generic],
    pixels: NDArray[np.int32],
    count: int,
    p: Floats,
    q: Floats,
    origin: Floats,
    want_sandwich: bool,
    normal: Floats,
    gradient: Floats,
    sandwich: Floats,
    rows: Floats,
) -> float:
    """Sum of squared residuals; fills J'J, J'r and, on request, the sum of r^2 J J' (lower triangles)."""
    normal[:] = 0.0
    gradient[:] = 0.0
    sandwich[:] = 0.0
    out = np.empty(10)
    cost = 0.0
    is_ring = p[7] > 0.0
    inv_s = 1.0 / p[8]
    filled = 0
    for n in range(count):
        u, v = pixels[n, 0], pixels[n, 1]
        plane_distance(p, q, u - p[0], v - p[1], out)
        inv_g = 1.0 / out[1]
        # Blur moves a curved edge towards its centre of curvature by s^2 / 2 times the curvature.
        shift = 0.5 * out[9] * p[8]
        t_outer = (out[0] - 1.0) * inv_g * inv_s + min(shift, 0.35)
        ink, phi_outer = _edge(t_outer)
        phi_inner = 0.0
        t_inner = 0.0
        if is_ring:
            t_inner = (out[0] - p[7]) * inv_g * inv_s + min(shift / p[7], 0.35)
            beyond, phi_inner = _edge(t_inner)
            ink -= beyond
        du, dv = u - origin[0], v - origin[1]
        light = p[9] + p[10] * du + p[11] * dv
        shade = 1.0 - p[12] * ink
        ink_light = p[13] * du + p[14] * dv
        # The light falls on the target before the lens blurs it: blur(L s) = L blur(s) + s^2 grad L . grad blur(s).
        slope_u, slope_v = p[13] - p[12] * p[10], p[14] - p[12] * p[11]
        ink_per_f = (phi_inner - phi_outer) * inv_g * inv_s
        bleed = p[8] * p[8] * ink_per_f * (slope_u * out[2] + slope_v * out[3])
        residual = image[v, u] - light * shade - ink * ink_light - bleed
        step = ink_light - light * p[12]
        per_f = step * ink_per_f
        rows[0, filled] = -per_f * out[2]
        rows[1, filled] = -per_f * out[3]
        for k in range(5):
            rows[2 + k, filled] = per_f * out[4 + k]
        rows[7, filled] = -step * phi_inner * inv_g * inv_s
        rows[8, filled] = step * (phi_outer * t_outer - phi_inner * t_inner) * inv_s
        rows[9, filled] = shade
        rows[10, filled] = shade * du
        rows[11, filled] = shade * dv
        rows[12, filled] = -light * ink
        rows[13, filled] = ink * du
        rows[14, filled] = ink * dv
        rows[PARAMETERS, filled] = residual
        cost += residual * residual
        filled += 1
        if filled == CHUNK or n == count - 1:
            for a in range(PARAMETERS):
                s = 0.0
                for k in range(filled):
                    s += rows[a, k] * rows[PARAMETERS, k]
                gradient[a] += s
            _add_outer(rows, filled, normal)
            if want_sandwich:
                for a in range(PARAMETERS):
                    for k in range(filled):
                        rows[a, k] *= rows[PARAMETERS, k]
                _add_outer(rows, filled, sandwich)
            filled = 0
    return cost


@jit
def _add_prior(
    p: Floats, line: Floats, information: Floats, noise2: float, is_ring: bool, normal: Floats, gradient: Floats
) -> float:
    """Add the prior on m (in units of the noise); hold the ratio of a dot. Returns the prior's cost."""
    d0, d1 = p[5] - line[0], p[6] - line[1]
    i00, i01, i11 = information[0, 0] * noise2, information[0, 1] * noise2, information[1, 1] * noise2
    normal[5, 5] += i00
    normal[6, 5] += i01
    normal[6, 6] += i11
    gradient[5] -= i00 * d0 + i01 * d1
    gradient[6] -= i01 * d0 + i11 * d1
    if not is_ring:
        for k in range(PARAMETERS):
            normal[7, k] = 0.0
            normal[k, 7] = 0.0
        normal[7, 7] = 1.0
        gradient[7] = 0.0
    return i00 * d0 * d0 + 2.0 * i01 * d0 * d1 + i11 * d1 * d1


@jit
def _is_sane(p: Floats, start: Floats) -> bool:
    """Whether parameters still describe a ring near its start."""
    if not (p[2] > 0.0 and p[4] > 0.0 and p[8] > 0.15 and p[8] < 12.0 and p[9] > 0.0):
        return False
    if start[7] > 0.0 and not 0.05 < p[7] < 0.95:
        return False
    area, area_start = p[2] * p[4], start[2] * start[4]
    if not 0.4 * area_start < area < 2.5 * area_start:
        return False
    du, dv = p[0] - start[0], p[1] - start[1]
    y0 = start[2] * du
    y1 = start[3] * du + start[4] * dv
    # The vanishing line must stay away from the ring: |m| in units of its size.
    w0 = p[5] / p[2] - p[6] * p[3] / (p[2] * p[4])
    w1 = p[6] / p[4]
    return y0 * y0 + y1 * y1 < 0.6 and w0 * w0 + w1 * w1 < 0.25


@jit
def _fit_one(
    image: NDArray[np.generic],
    start: Floats,
    q: Floats,
    line: Floats,
    information: Floats,
    limit: float,
    params: Floats,
    center_cov: Floats,
    line_cov: Floats,
    noise_out: Floats,
    work: Floats,
    rows: Floats,
    pixels: NDArray[np.int32],
) -> int:
    """Fit one ring; returns the number of pixels used, or 0 if it failed."""
    height, width = image.shape
    normal, damped, sandwich, inverse = work[0], work[1], work[2], work[3]
    gradient, step, trial = work[4, 0], work[4, 1], work[4, 2]
    origin = start[:2].copy()
    is_ring = start[7] > 0.0
    params[:] = start
    count = _choose_pixels(start, q, 3.0 * start[8] + 1.0, limit, height, width, pixels)
    if count < 2 * PARAMETERS:
        return 0
    freedom = count - PARAMETERS
    cost = _accumulate(image, pixels, count, params, q, origin, False, normal, gradient, sandwich, rows)
    noise2 = max(cost / freedom, 1e-6)
    prior = _add_prior(params, line, information, noise2, is_ring, normal, gradient)
    damping = 1e-4
    for _ in range(MAX_ITERATIONS):
        damped[:] = normal
        for k in range(PARAMETERS):
            damped[k, k] += damping * normal[k, k] + 1e-30
        if not cholesky_solve(damped, gradient, step):
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e8:
                return 0
            continue
        trial[:] = params + step
        moved = math.sqrt(step[0] * step[0] + step[1] * step[1])
        if not _is_sane(trial, start):
            damping *= 10.0
            if damping > 1e8:
                return 0
            continue
        trial_cost = _accumulate(image, pixels, count, trial, q, origin, False, damped, step, sandwich, rows)
        trial_prior = _add_prior(trial, line, information, noise2, is_ring, damped, step)
        if trial_cost + trial_prior <= cost + prior:
            gain = (cost + prior - trial_cost - trial_prior) / (cost + prior + 1e-30)
            params[:] = trial
            normal[:] = damped
            gradient[:] = step
            cost, prior = trial_cost, trial_prior
            damping = max(damping * 0.1, 1e-9)
            if moved < 1e-3 and gain < 1e-3:
                break
        else:
            damping = max(damping * 10.0, 1e-6)
            if damping > 1e8 or moved < 1e-6:
                break
    noise2 = max(cost / freedom, 1e-6)
    _accumulate(image, pixels, count, params, q, origin, True, normal, gradient, sandwich, rows)
    _add_prior(params, line, information, noise2, is_ring, normal, gradient)
    if not cholesky_invert(normal, damped, inverse):
        return 0
    # Sandwich: right also where noise grows with brightness. The prior scatters with its own covariance.
    scale = count / freedom
    for a in range(PARAMETERS):
        for b in range(a + 1):
            sandwich[a, b] *= scale
    sandwich[5, 5] += information[0, 0] * noise2 * noise2
    sandwich[6, 5] += information[0, 1] * noise2 * noise2
    sandwich[6, 6] += information[1, 1] * noise2 * noise2
    for a in range(PARAMETERS):
        for b in range(a):
            sandwich[b, a] = sandwich[a, b]
    if not is_ring:
        sandwich[7, :] = 0.0
        sandwich[:, 7] = 0.0
    for a in range(2):
        for b in range(2):
            total = 0.0
            total_line = 0.0
            for i in range(PARAMETERS):
                for j in range(PARAMETERS):
                    total += inverse[a, i] * sandwich[i, j] * inverse[j, b]
                    total_line += inverse[5 + a, i] * sandwich[i, j] * inverse[j, 5 + b]
            center_cov[a, b] = total
            line_cov[a, b] = total_line
    noise_out[0] = math.sqrt(noise2)
    return count


@jit
def _fit_range(
    image: NDArray[np.generic],
    start: Floats,
    q: Floats,
    line: Floats,
    information: Floats,
    limit: float,
    first: int,
    last: int,
    params: Floats,
    center_cov: Floats,
    line_cov: Floats,
    noise: Floats,
    used: NDArray[np.int64],
) -> None:
    """Fit rings first..last-1."""
    work = np.empty((5, PARAMETERS, PARAMETERS))
    rows = np.empty((PARAMETERS + 1, CHUNK))
    pixels = np.empty((MAX_PIXELS, 2), dtype=np.int32)
    for n in range(first, last):
        used[n] = _fit_one(
            image, start[n], q[n], line[n], information[n], limit,
            params[n], center_cov[n], line_cov[n], noise[n : n + 1], work, rows, pixels,
        )  # fmt: skip


def fit_rings(
    image: NDArray[np.generic],
    start: Floats,
    *,
    limit: float,
    line: Floats | None = None,
    line_information: Floats | None = None,
    bend: Floats | None = None,
) -> RingFits:
    """Fit the ring model to the pixels of an image.

    Args:
        image: grey levels, uint8, uint16 or float32.  # (H, W)
        start: parameters to start from; a ratio of 0 makes a dot.  # (N, 13)
        limit: how far out, in outer radii, pixels may be used before something else than white comes.
        line: mean of the prior on m.  # (N, 2), default 0
        line_information: inverse covariance of that prior; zero leaves m free.  # (N, 2, 2), default zero
        bend: the lens's local quadratic form: xi_u in v_u^2, v_u v_v, v_v^2, then xi_v.  # (N, 6), default zero

    Returns:
        The fits, in the order of `start`. Dots need a prior: m is not to be had from one ellipse.
    """
    count = len(start)
    line = np.zeros((count, 2)) if line is None else np.ascontiguousarray(line)
    information = np.zeros((count, 2, 2)) if line_information is None else np.ascontiguousarray(line_information)
    bend = np.zeros((count, 6)) if bend is None else np.ascontiguousarray(bend)
    start = np.ascontiguousarray(start, dtype=np.float64)
    params, noise = np.array(start), np.zeros(count)
    center_cov, line_cov = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    used = np.zeros(count, dtype=np.int64)

    def run(first: int, last: int) -> None:
        _fit_range(
            image, start, bend, line, information, limit, first, last, params, center_cov, line_cov, noise, used
        )  # fmt: skip

    in_chunks(run, count)
    ok = (used > 0) & np.isfinite(params).all(axis=1) & np.isfinite(center_cov).all(axis=(1, 2))
    ok &= (center_cov[:, 0, 0] > 0) & (center_cov[:, 1, 1] > 0)
    return RingFits(params, center_cov, line_cov, noise, used, ok)
