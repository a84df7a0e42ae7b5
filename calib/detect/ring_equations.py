"""Residuals of the brightness model, their derivatives and the normal equations of one ring."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detect.plane_distance import OUTPUTS, plane_distance
from calib.detect.ring_model import (
    BLUR,
    CENTER_U,
    CENTER_V,
    DARKNESS,
    INK_LIGHT_U,
    INK_LIGHT_V,
    LIGHT_U,
    LIGHT_V,
    M0,
    M1,
    PARAMETERS,
    RATIO,
    WHITE,
)
from calib.jit import jit, jit_sums

Floats: TypeAlias = NDArray[np.float64]

CHUNK = 64
"""Pixels whose derivatives are multiplied together at once."""
MAX_CURVATURE_SHIFT = 0.35
"""In blurs: beyond this the first-order shift of a curved edge is no longer true."""


@jit
def _edge(t: float) -> tuple[float, float]:
    """1 - Phi(t) and the normal density; most pixels are near one edge only, and far ones cost nothing."""
    if t > 6.0:
        return 0.0, 0.0
    if t < -6.0:
        return 1.0, 0.0
    return 0.5 - 0.5 * math.erf(t * 0.7071067811865476), 0.3989422804014327 * math.exp(-0.5 * t * t)


@jit
def pixel_equation(value: float, du: float, dv: float, p: Floats, out: Floats, rows: Floats, k: int) -> float:
    """Residual of one pixel, and its model's derivatives into column k of `rows`.

    Args:
        value: the pixel's grey level.
        du: its offset from the fixed origin of the light's gradient; dv likewise.
        dv: see du.
        p: parameters (`ring_model`).
        out: what `plane_distance` said.
        rows: derivatives, and the residual in the last row.  # (PARAMETERS + 1, CHUNK)
        k: the column.
    """
    inv_s = 1.0 / p[BLUR]
    inv_g = 1.0 / out[1]
    # Blur moves a curved edge towards its centre of curvature by s^2 / 2 times the curvature.
    shift = 0.5 * out[9] * p[BLUR]
    bent_outer = min(shift, MAX_CURVATURE_SHIFT)
    t_outer = (out[0] - 1.0) * inv_g * inv_s + bent_outer
    ink, phi_outer = _edge(t_outer)
    phi_inner = t_inner = bent_inner = 0.0
    if p[RATIO] > 0.0:
        bent_inner = min(shift / p[RATIO], MAX_CURVATURE_SHIFT)
        t_inner = (out[0] - p[RATIO]) * inv_g * inv_s + bent_inner
        beyond, phi_inner = _edge(t_inner)
        ink -= beyond
    light = p[WHITE] + p[LIGHT_U] * du + p[LIGHT_V] * dv
    shade = 1.0 - p[DARKNESS] * ink
    ink_light = p[INK_LIGHT_U] * du + p[INK_LIGHT_V] * dv
    # The light falls on the target before the lens blurs it: blur(L s) = L blur(s) + s^2 grad L . grad blur(s).
    slope_u, slope_v = p[INK_LIGHT_U] - p[DARKNESS] * p[LIGHT_U], p[INK_LIGHT_V] - p[DARKNESS] * p[LIGHT_V]
    ink_per_f = (phi_inner - phi_outer) * inv_g * inv_s
    bleed = p[BLUR] * p[BLUR] * ink_per_f * (slope_u * out[2] + slope_v * out[3])
    residual: float = value - light * shade - ink * ink_light - bleed
    step = ink_light - light * p[DARKNESS]
    per_f = step * ink_per_f
    rows[0, k] = -per_f * out[2]
    rows[1, k] = -per_f * out[3]
    for n in range(5):
        rows[2 + n, k] = per_f * out[4 + n]
    rows[7, k] = -step * phi_inner * inv_g * inv_s
    rows[8, k] = step * (phi_outer * (t_outer - 2.0 * bent_outer) - phi_inner * (t_inner - 2.0 * bent_inner)) * inv_s
    rows[9, k] = shade
    rows[10, k] = shade * du
    rows[11, k] = shade * dv
    rows[12, k] = -light * ink
    rows[13, k] = ink * du
    rows[14, k] = ink * dv
    rows[PARAMETERS, k] = residual
    return residual


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
def accumulate(
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
    out = np.empty(OUTPUTS)
    cost = 0.0
    filled = 0
    for n in range(count):
        u, v = pixels[n, 0], pixels[n, 1]
        plane_distance(p, q, u - p[CENTER_U], v - p[CENTER_V], out)
        residual = pixel_equation(float(image[v, u]), u - origin[0], v - origin[1], p, out, rows, filled)
        cost += residual * residual
        filled += 1
        if filled == CHUNK or n == count - 1:
            for a in range(PARAMETERS):
                for k in range(filled):
                    gradient[a] += rows[a, k] * rows[PARAMETERS, k]
            _add_outer(rows, filled, normal)
            if want_sandwich:
                for a in range(PARAMETERS):
                    for k in range(filled):
                        rows[a, k] *= rows[PARAMETERS, k]
                _add_outer(rows, filled, sandwich)
            filled = 0
    return cost


@jit
def add_prior(
    p: Floats, line: Floats, information: Floats, noise2: float, is_ring: bool, normal: Floats, gradient: Floats
) -> float:
    """Add the prior on m (in units of the noise); hold the ratio of a dot. Returns the prior's cost."""
    d0, d1 = p[M0] - line[0], p[M1] - line[1]
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
    cost: float = i00 * d0 * d0 + 2.0 * i01 * d0 * d1 + i11 * d1 * d1
    return cost
