"""Residuals of the brightness model, their derivatives and the normal equations of one ring."""

from typing import TypeAlias

import numpy as np

from calib.core.jit import jit, jit_inside, jit_sums
from calib.detector.ring_model import (
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
    Distance,
    Numbers,
    bend_of,
    parameters_of,
    plane_distance,
)
from designer.base.arrays import Array

Floats: TypeAlias = Array
Equation: TypeAlias = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float, float, float, float, float
]

CHUNK = 128
"""Pixels that are worked out at once: their rows stay in the processor's nearest memory."""
RESIDUAL = PARAMETERS * CHUNK
DISTANCE = RESIDUAL + CHUNK
"""Where the residuals of a chunk stand, and what comes after them: the plane distances."""
ROOM = DISTANCE + CHUNK
"""Rows of a chunk: PARAMETERS of derivatives, residuals, distances. One array: the compiler can tell that its rows do
not overlap, and then works several pixels out at once."""
MAX_CURVATURE = 0.6
"""Of an edge, times its blur: the tips of flatter ellipses are no arcs of circles over the width of the blur."""
LEAST_ROOM = -0.8
"""A pixel's place between the centre of an edge's curvature (-1) and the edge (0); nearer to it none is right."""
MAX_BOW = 0.3
"""Distances are bettered by no more than this share."""
MOST_GROWN = 0.5
"""Of a blur, from a ring's middle to its edge."""
FAR = 6.0
"""In blurs from an edge: farther out nothing changes."""
MILLS = 0.24


@jit_inside
def _density(a: float) -> float:
    """The normal density at 0 <= a <= FAR: the exponential is the 64th power of a series."""
    y = a * a * (-1.0 / 128.0)
    e = 1.0 + y * (1.0 / 7.0) * (1.0 + y * 0.125)
    e = 1.0 + y * (1.0 / 5.0) * (1.0 + y * (1.0 / 6.0) * e)
    e = 1.0 + y * (1.0 / 3.0) * (1.0 + y * 0.25 * e)
    e = 1.0 + y * (1.0 + y * 0.5 * e)
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return 0.3989422804014327 * e


@jit_inside
def _mills(k: float) -> float:
    """Mills' ratio at a as a polynomial in k = 1 / (1 + MILLS a) (minimax on 0..FAR)."""
    mills = 1.390114509097616 - 0.3135441793179374 * k
    mills = -1.6194668776127493 + k * mills
    mills = 1.5681309295416128 + k * mills
    mills = -0.3861485101340224 + k * mills
    mills = 0.3898165051600239 + k * mills
    return k * (0.22441175990366652 + k * mills)


@jit_inside
def edges(t: float, other: float) -> tuple[float, float, float, float]:
    """1 - Phi(t) and the normal density, of two numbers, to 1e-9 and 1e-8, without a branch or a call."""
    a = -t if t < 0.0 else t
    b = -other if other < 0.0 else other
    # Far out exactly no slope: near a ring's centre distances in blurs have no limit.
    a_far, b_far = a > FAR, b > FAR
    a, b = FAR if a_far else a, FAR if b_far else b
    density_a, density_b = _density(a), _density(b)
    x, y = 1.0 + MILLS * a, 1.0 + MILLS * b
    both = 1.0 / (x * y)
    tail_a, tail_b = density_a * _mills(both * y), density_b * _mills(both * x)
    return (
        1.0 - tail_a if t < 0.0 else tail_a,
        0.0 if a_far else density_a,
        1.0 - tail_b if other < 0.0 else tail_b,
        0.0 if b_far else density_b,
    )


@jit_inside
def blurs_from_edge(off: float, bow: float, stretch: float, per_blur: float, curvature: float) -> tuple[float, float]:
    """How far a pixel is from an edge, in blurs, and what the edge's curvature adds to that.

    A disc of radius 1 / e (in blurs), blurred, is the distribution of a Rician variable; `x + ln(1 + e x) / (2 x)`
    takes it to the normal one (Temme, Computers Math. Applic. 25, 1993), here with a Pade approximant of the logarithm.

    Args:
        off: the pixel's F less that of the edge.
        bow: half the second derivative of F along its gradient over |grad F|^2: what Sampson's distance leaves out.
        stretch: the part of it that |E xi| has.
        per_blur: blurs by F.
        curvature: e as the level set through the pixel has it.
    """
    more = off * bow
    more = MAX_BOW if more > MAX_BOW else -MAX_BOW if more < -MAX_BOW else more
    x = off * per_blur * (1.0 + more)
    # The curvature goes with 1 / |grad F|^3, and that is another one at the edge.
    e = curvature * (1.0 + 6.0 * off * stretch)
    e = 0.0 if e < 0.0 else MAX_CURVATURE if e > MAX_CURVATURE else e
    z = e * x
    z = LEAST_ROOM if z < LEAST_ROOM else z
    return x, 0.5 * e * (6.0 + z) / (6.0 + 4.0 * z)


@jit_inside
def _bounded(grown: float) -> float:
    """A blur over that of the ring's middle."""
    return 1.0 + (MOST_GROWN if grown > MOST_GROWN else -MOST_GROWN if grown < -MOST_GROWN else grown)


@jit_inside
def pixel_equation(
    value: float, du: float, dv: float, p: Numbers, grow_u: float, grow_v: float, distance: Distance
) -> Equation:
    """Derivatives of the model at one pixel by the parameters, and its residual.

    Args:
        value: the pixel's grey level.
        du: its offset from the fixed origin of the light's gradient; dv likewise.
        dv: see du.
        p: parameters (`ring_model`).
        grow_u: the gradient of the blur's logarithm over the image (per px); grow_v likewise.
        grow_v: see grow_u.
        distance: what `plane_distance` said.
    """
    f, g, fv0, fv1, f_e00, f_e10, f_e11, f_m0, f_m1, curvature, bow, stretch = distance
    is_ring = p[RATIO] > 0.0
    ratio = p[RATIO] if is_ring else 1.0
    inv_s = 1.0 / p[BLUR]
    # Each edge has the blur of its own place, not of the pixel's.
    inv_g = 1.0 / g
    grown, along = grow_u * du + grow_v * dv, (grow_u * fv0 + grow_v * fv1) * inv_g * inv_g
    wide_outer, wide_inner = _bounded(grown - (f - 1.0) * along), _bounded(grown - (f - ratio) * along)
    per_both = inv_s * inv_g / (wide_outer * wide_inner)
    per_outer, per_inner = per_both * wide_inner, per_both * wide_outer
    outer, bent_outer = blurs_from_edge(f - 1.0, bow, stretch, per_outer, curvature * p[BLUR] * wide_outer)
    inner, bent_inner = blurs_from_edge(
        f - ratio, bow, stretch, per_inner, curvature * p[BLUR] * wide_inner * (1.0 / ratio)
    )
    t_outer, t_inner = outer + bent_outer, inner + bent_inner
    inside, phi_outer, hole, phi_inner = edges(t_outer, t_inner)
    hole = hole if is_ring else 0.0
    phi_inner = phi_inner if is_ring else 0.0
    ink = inside - hole
    light = p[WHITE] + p[LIGHT_U] * du + p[LIGHT_V] * dv
    shade = 1.0 - p[DARKNESS] * ink
    ink_light = p[INK_LIGHT_U] * du + p[INK_LIGHT_V] * dv
    # The light falls on the target before the lens blurs it: blur(L s) = L blur(s) + s^2 grad L . grad blur(s).
    slope_u, slope_v = p[INK_LIGHT_U] - p[DARKNESS] * p[LIGHT_U], p[INK_LIGHT_V] - p[DARKNESS] * p[LIGHT_V]
    ink_per_f = phi_inner * per_inner - phi_outer * per_outer
    bleed = p[BLUR] * p[BLUR] * ink_per_f * (slope_u * fv0 + slope_v * fv1)
    step = ink_light - light * p[DARKNESS]
    per_f = step * ink_per_f
    by_blur = phi_outer * (t_outer - 2.0 * bent_outer) - phi_inner * (t_inner - 2.0 * bent_inner)
    return (
        -per_f * fv0, -per_f * fv1, per_f * f_e00, per_f * f_e10, per_f * f_e11, per_f * f_m0, per_f * f_m1,
        -step * phi_inner * per_inner, step * by_blur * inv_s,
        shade, shade * du, shade * dv, -light * ink, ink * du, ink * dv,
        value - light * shade - ink * ink_light - bleed,
    )  # fmt: skip


@jit_sums
def fill_rows(pixels: Floats, first: int, filled: int, p: Numbers, q: Numbers, origin: Floats, rows: Floats) -> None:
    """The equations of `filled` pixels from the first on, into the columns of `rows`.

    Args:
        pixels: u, v and grey level.  # (3, >= first + filled)
        first: of the pixels.
        filled: how many, at most CHUNK.
        p: parameters, a tuple.
        q: the lens's bend, a tuple.
        origin: of the light's gradients.
        rows: the result; each row takes CHUNK numbers.  # (ROOM,)
    """
    u0, v0 = origin[0], origin[1]
    for k in range(filled):
        rows[k] = pixels[0, first + k]
        rows[CHUNK + k] = pixels[1, first + k]
        rows[RESIDUAL + k] = pixels[2, first + k]
    for k in range(filled):
        u, v = rows[k], rows[CHUNK + k]
        distance = plane_distance(p, q, u - p[CENTER_U], v - p[CENTER_V])
        one = pixel_equation(rows[RESIDUAL + k], u - u0, v - v0, p, q[6], q[7], distance)
        rows[k] = one[0]
        rows[CHUNK + k] = one[1]
        rows[2 * CHUNK + k] = one[2]
        rows[3 * CHUNK + k] = one[3]
        rows[4 * CHUNK + k] = one[4]
        rows[5 * CHUNK + k] = one[5]
        rows[6 * CHUNK + k] = one[6]
        rows[7 * CHUNK + k] = one[7]
        rows[8 * CHUNK + k] = one[8]
        rows[9 * CHUNK + k] = one[9]
        rows[10 * CHUNK + k] = one[10]
        rows[11 * CHUNK + k] = one[11]
        rows[12 * CHUNK + k] = one[12]
        rows[13 * CHUNK + k] = one[13]
        rows[14 * CHUNK + k] = one[14]
        rows[RESIDUAL + k] = one[15]
        rows[DISTANCE + k] = distance[0]


@jit_sums
def add_products(rows: Floats, parameters: int, filled: int, total: Floats) -> None:
    """Add products of all rows of derivatives and residuals to the lower triangle: J'J, J'r and r'r.

    Args:
        rows: those of derivatives, then that of the residuals; each takes CHUNK numbers.
        parameters: how many rows of derivatives.
        filled: how many numbers each row has.
        total: the result, its rows full to whole fours.  # (parameters + 1, 4 K)
    """
    for a in range(parameters + 1):
        for b in range(0, a + 1, 4):
            # Four at once: a number that is fetched serves four times.
            s0 = s1 = s2 = s3 = 0.0
            for n in range(filled):
                x = rows[a * CHUNK + n]
                s0 += x * rows[b * CHUNK + n]
                s1 += x * rows[(b + 1) * CHUNK + n]
                s2 += x * rows[(b + 2) * CHUNK + n]
                s3 += x * rows[(b + 3) * CHUNK + n]
            total[a, b] += s0
            total[a, b + 1] += s1
            total[a, b + 2] += s2
            total[a, b + 3] += s3


@jit
def accumulate(
    pixels: Floats, count: int, p: Floats, q: Floats, origin: Floats, normal: Floats, gradient: Floats, rows: Floats
) -> float:
    """Sum of squared residuals of the first `count` pixels (3, N); fills J'J (its lower triangle) and J'r."""
    total = np.zeros((PARAMETERS + 1, PARAMETERS + 1))
    parameters, bend = parameters_of(p), bend_of(q)
    for first in range(0, count, CHUNK):
        filled = min(CHUNK, count - first)
        fill_rows(pixels, first, filled, parameters, bend, origin, rows)
        add_products(rows, PARAMETERS, filled, total)
    normal[:] = total[:PARAMETERS, :PARAMETERS]
    gradient[:] = total[PARAMETERS, :PARAMETERS]
    cost: float = total[PARAMETERS, PARAMETERS]
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
