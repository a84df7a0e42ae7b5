"""The image of one ring, which every fit shares: its distance function, and the pixels that a fit uses.

With `v = u - c` the offset from the projected centre `c`, the plane distance from the ring's centre in units of the
outer radius is

    F(v) = |E xi| / (1 - m . xi),    xi = v + q(v),

`E` lower triangular with a positive diagonal, `m` the vanishing line (`m . xi = 1` holds on it) and `q` a known
quadratic form that straightens the lens locally (zero without a lens). The ring's edges are `F = 1` and `F = k`; the
signed distance of a pixel from an edge is `(F - rho) / |grad F|` to first order (Sampson), and the equations of the fit
take the second order along the gradient. For a pinhole this is the planar homology between the two conics, eight
parameters: c, E, m and k.

Brightness: white and ink each vary linearly over the ring,

    I(u) = L (1 - a T) + T h . (u - u0),    L = w + g . (u - u0),    T = Phi(d_inner / s) - Phi(d_outer / s),

with `s` the edge's blur in pixels (lens and pixel together) and Phi the normal distribution; h is zero where light only
multiplies, and takes up veiling light or a black level. A dot has no inner edge: T = 1 - Phi(d_outer / s). Edges are
curved: what is written as Phi(d / s) is the blurred disc with the edge's own radius of curvature. Out of focus s is
that of the middle, and grows over the image as `blur_growth` tells: each edge has the blur of its own place.

The fits take the derivatives of the distances at the edges, where the brightness changes: dd = dF / |grad F|.
"""

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit, jit_inside, jit_sums
from designer.base.arrays import Array, Flags

CENTER_U: Final = 0
CENTER_V: Final = 1
E00: Final = 2
E10: Final = 3
E11: Final = 4
M0: Final = 5
M1: Final = 6
RATIO: Final = 7
BLUR: Final = 8
WHITE: Final = 9
LIGHT_U: Final = 10
LIGHT_V: Final = 11
DARKNESS: Final = 12
INK_LIGHT_U: Final = 13
INK_LIGHT_V: Final = 14
PARAMETERS: Final = 15
GEOMETRY_PARAMETERS: Final = 8

Floats: TypeAlias = Array
Numbers: TypeAlias = Floats | tuple[float, ...]
"""Where a loop runs over pixels: a tuple, which stays in registers, so that several pixels are worked out at once."""
LENS_NUMBERS: Final = 8
"""Of what a lens does about a ring: six of its bend (`ring_model`'s q), and two of the gradient of the blur's
logarithm."""
Distance: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""F, |grad F|, dF/dv (2), dF/dE (3), dF/dm (2), F times the curvature of the level set (per px); half the second
derivative of F along its gradient over |grad F|^2, and the part of it that |E xi| has."""
MAX_PIXELS = 4096
DENSE_RADIUS_PX = 24.0
"""Rings up to this mean outer radius use every pixel near an edge."""
PIXEL_BUDGET = 560
"""Larger rings are sampled: so many pixels near the edges hold the centre far better than any printer or plane does."""
LEAST_LINES = 3
"""Across a quarter of an edge, however wide its blur makes them."""


@jit_inside
def plane_distance(p: Numbers, q: Numbers, v0: float, v1: float) -> Distance:
    """F and its derivatives at the offset (v0, v1)."""
    x0 = v0 + q[0] * v0 * v0 + q[1] * v0 * v1 + q[2] * v1 * v1
    x1 = v1 + q[3] * v0 * v0 + q[4] * v0 * v1 + q[5] * v1 * v1
    y0 = p[E00] * x0
    y1 = p[E10] * x0 + p[E11] * x1
    length = math.sqrt(y0 * y0 + y1 * y1) + 1e-12
    # Divisions are what costs time here: four of six are had by multiplying.
    w = 1.0 - p[M0] * x0 - p[M1] * x1
    s = 1.0 / (length * w)
    inv_w = s * length
    f = length * inv_w
    fx0 = (p[E00] * y0 + p[E10] * y1) * s + f * p[M0] * inv_w
    fx1 = p[E11] * y1 * s + f * p[M1] * inv_w
    fv0 = fx0 * (1.0 + 2.0 * q[0] * v0 + q[1] * v1) + fx1 * (2.0 * q[3] * v0 + q[4] * v1)
    fv1 = fx0 * (q[1] * v0 + 2.0 * q[2] * v1) + fx1 * (1.0 + q[4] * v0 + 2.0 * q[5] * v1)
    g = math.sqrt(fv0 * fv0 + fv1 * fv1) + 1e-12
    # The level set |E xi| - F (1 - m . xi) = 0 has the Hessian of |E xi| alone.
    e0 = -p[E00] * fv1
    e1 = p[E11] * fv0 - p[E10] * fv1
    inv_g = 1.0 / g
    across = (y0 * e1 - y1 * e0) * s * inv_g
    curvature = across * across * inv_g
    # W F = |E xi| twice along the gradient, W = 1 - m . xi.
    along = (y0 * (p[E10] * fv0 + p[E11] * fv1) - y1 * p[E00] * fv0) * s * inv_g
    stretch = 0.5 * along * along * w * w * s * inv_g * inv_g
    bow = stretch + (p[M0] * fv0 + p[M1] * fv1) * inv_w * inv_g * inv_g
    by_e00, by_e10, by_e11 = y0 * x0 * s, y1 * x0 * s, y1 * x1 * s
    return f, g, fv0, fv1, by_e00, by_e10, by_e11, f * x0 * inv_w, f * x1 * inv_w, curvature, bow, stretch


@jit
def parameters_of(p: Floats) -> Numbers:
    """Parameters as a tuple."""
    return (p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11], p[12], p[13], p[14])


@jit
def bend_of(q: Floats) -> Numbers:
    """The lens's bend and the growth of its blur as a tuple."""
    return (q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7])


@jit
def upright(e00: float, e10: float, e11: float) -> float:
    """The turn Q of the polar decomposition E = Q S, S symmetric, of a lower triangular E: an angle in the plane."""
    return math.atan2(e10, e00 + e11)


@jit
def offset_on_circle(p: Floats, rho: float, angle: float) -> tuple[float, float]:
    """The straightened offset xi of the point at plane distance rho in a direction of the plane.

    Angles are counted so that the map from the plane is symmetric (`upright`): turning the image by a right angle then
    turns all directions by a right angle, whatever the triangular E does.
    """
    angle += upright(p[E00], p[E10], p[E11])
    x0 = math.cos(angle) / p[E00]
    x1 = (math.sin(angle) - p[E10] * x0) / p[E11]
    scale = rho / (1.0 + rho * (p[M0] * x0 + p[M1] * x1))
    return scale * x0, scale * x1


@jit
def _take(image: NDArray[np.generic], u: int, v: int, pixels: Floats, count: int) -> int:
    """One more pixel, if there is room for it; returns how many there are."""
    if count == MAX_PIXELS:
        return count
    pixels[0, count] = u
    pixels[1, count] = v
    pixels[2, count] = image[v, u]
    return count + 1


@jit
def _sample_pixels(image: NDArray[np.generic], p: Floats, q: Floats, reach: float, pixels: Floats) -> int:
    """Pixels on lines across the edges of a large ring; returns how many.

    Most lines stay close to the edge, where the position is; every fourth runs as far as `reach`, where the levels are.
    """
    height, width = image.shape
    count = 0
    edges = 2 if p[RATIO] > 0.0 else 1
    far = math.ceil(reach)
    near = math.ceil(0.5 * reach)
    # Four quarters alike, so that an image turned by a right angle is sampled at the same points.
    quarter = max(int(PIXEL_BUDGET / (edges * (2 * near + 1 + 0.5 * (far - near)))) // 4, LEAST_LINES)
    rays = 4 * quarter
    for edge in range(edges):
        rho = 1.0 if edge == 0 else p[RATIO]
        for ray in range(rays):
            # A fraction of a turn apart for the two edges, so that rows and columns are not sampled alike.
            angle = 2.0 * math.pi * (ray + 0.37 * edge) / rays
            x0, x1 = offset_on_circle(p, rho, angle)
            distance = plane_distance(p, q, x0, x1)
            nu, nv = distance[2] / distance[1], distance[3] / distance[1]
            half = far if ray % quarter % 4 == 0 else near
            for t in range(-half, half + 1):
                u = round(p[CENTER_U] + x0 + t * nu)
                v = round(p[CENTER_V] + x1 + t * nv)
                if 0 <= u < width and 0 <= v < height:
                    count = _take(image, u, v, pixels, count)
    return count


@jit_sums
def _mark_near(p: Numbers, q: Numbers, reach: float, limit: float, u: int, v: int, near: Flags) -> None:
    """Whether pixels from (u, v) on to the right are near the ring's edges, into `near`."""
    has_hole = p[RATIO] > 0.0
    for k in range(len(near)):
        distance = plane_distance(p, q, u + k - p[CENTER_U], v - p[CENTER_V])
        f, room = distance[0], reach * distance[1]
        at_outer = abs(f - 1.0) <= room
        at_inner = abs(f - p[RATIO]) <= room if has_hole else f < 0.5
        near[k] = (at_outer | at_inner) & (f >= 0.0) & (f <= limit)


@jit
def choose_pixels(image: NDArray[np.generic], p: Floats, q: Floats, reach: float, limit: float, pixels: Floats) -> int:
    """Pixels u, v, grey level within `reach` px of the ring's edges and no farther out than F = `limit`; how many."""
    height, width = image.shape
    s0 = math.sqrt(p[E00] * p[E00] + p[E10] * p[E10])
    det = p[E00] * p[E11]
    half_u = math.sqrt(p[E10] * p[E10] + p[E11] * p[E11]) / det
    half_v = s0 / det
    radius = 1.0 / math.sqrt(det)
    if radius > DENSE_RADIUS_PX:
        return _sample_pixels(image, p, q, reach, pixels)
    u_first = max(0, math.floor(p[CENTER_U] - 1.15 * half_u - reach))
    u_last = min(width - 1, math.ceil(p[CENTER_U] + 1.15 * half_u + reach))
    v_first = max(0, math.floor(p[CENTER_V] - 1.15 * half_v - reach))
    v_last = min(height - 1, math.ceil(p[CENTER_V] + 1.15 * half_v + reach))
    if u_last < u_first:
        return 0
    near = np.empty(u_last - u_first + 1, dtype=np.bool_)
    shape, bend = parameters_of(p), bend_of(q)
    count = 0
    for v in range(v_first, v_last + 1):
        _mark_near(shape, bend, reach, limit, u_first, v, near)
        for k in range(len(near)):
            if near[k]:
                count = _take(image, u_first + k, v, pixels, count)
    return count
