"""Which pixels a fit uses: those near the ring's edges, all of them or a sample."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit, jit_sums
from calib.detector.plane_distance import Numbers, bend_of, offset_on_circle, parameters_of, plane_distance
from calib.detector.ring_model import CENTER_U, CENTER_V, E00, E10, E11, RATIO

Floats: TypeAlias = NDArray[np.float64]

MAX_PIXELS = 4096
DENSE_RADIUS_PX = 24.0
"""Rings up to this mean outer radius use every pixel near an edge."""
PIXEL_BUDGET = 560
"""Larger rings are sampled: so many pixels near the edges hold the centre far better than any printer or plane does."""
LEAST_LINES = 3
"""Across a quarter of an edge, however wide its blur makes them."""


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
def _mark_near(p: Numbers, q: Numbers, reach: float, limit: float, u: int, v: int, near: NDArray[np.bool_]) -> None:
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
    """Pixels near the ring's edges: within `reach` px of one and no farther out than F = `limit`.

    Args:
        image: grey levels.  # (H, W)
        p: the ring's parameters.
        q: the lens's bend.
        reach: in px.
        limit: in outer radii.
        pixels: the result: u, v and grey level.  # (3, MAX_PIXELS)

    Returns:
        How many.
    """
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
