"""Which pixels a fit uses: those near the ring's edges, all of them or a sample."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detect.plane_distance import OUTPUTS, offset_on_circle, plane_distance
from calib.detect.ring_model import CENTER_U, CENTER_V, E00, E10, E11, RATIO
from calib.jit import jit

Floats: TypeAlias = NDArray[np.float64]

MAX_PIXELS = 4096
DENSE_RADIUS_PX = 24.0
"""Rings up to this mean outer radius use every pixel near an edge."""
PIXEL_BUDGET = 560
"""Larger rings are sampled: so many pixels near the edges hold the centre far better than any printer or plane does."""
LEAST_LINES = 3
"""Across a quarter of an edge, however wide its blur makes them."""


@jit
def _sample_pixels(p: Floats, q: Floats, reach: float, height: int, width: int, pixels: NDArray[np.int32]) -> int:
    """Pixels on lines across the edges of a large ring; returns how many.

    Most lines stay close to the edge, where the position is; every fourth runs as far as `reach`, where the levels are.
    """
    out = np.empty(OUTPUTS)
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
            plane_distance(p, q, x0, x1, out)
            nu, nv = out[2] / out[1], out[3] / out[1]
            half = far if ray % quarter % 4 == 0 else near
            for t in range(-half, half + 1):
                u = round(p[CENTER_U] + x0 + t * nu)
                v = round(p[CENTER_V] + x1 + t * nv)
                if 0 <= u < width and 0 <= v < height and count < MAX_PIXELS:
                    pixels[count, 0] = u
                    pixels[count, 1] = v
                    count += 1
    return count


@jit
def choose_pixels(
    p: Floats, q: Floats, reach: float, limit: float, height: int, width: int, pixels: NDArray[np.int32]
) -> int:
    """Pixels near the ring's edges: within `reach` px of one and no farther out than F = `limit`."""
    s0 = math.sqrt(p[E00] * p[E00] + p[E10] * p[E10])
    det = p[E00] * p[E11]
    half_u = math.sqrt(p[E10] * p[E10] + p[E11] * p[E11]) / det
    half_v = s0 / det
    radius = 1.0 / math.sqrt(det)
    out = np.empty(OUTPUTS)
    count = 0
    if radius <= DENSE_RADIUS_PX:
        u_first = max(0, math.floor(p[CENTER_U] - 1.15 * half_u - reach))
        u_last = min(width - 1, math.ceil(p[CENTER_U] + 1.15 * half_u + reach))
        v_first = max(0, math.floor(p[CENTER_V] - 1.15 * half_v - reach))
        v_last = min(height - 1, math.ceil(p[CENTER_V] + 1.15 * half_v + reach))
        for v in range(v_first, v_last + 1):
            for u in range(u_first, u_last + 1):
                plane_distance(p, q, u - p[CENTER_U], v - p[CENTER_V], out)
                f, g = out[0], out[1]
                near = abs(f - 1.0) <= reach * g or (p[RATIO] > 0.0 and abs(f - p[RATIO]) <= reach * g)
                if p[RATIO] <= 0.0 and f < 0.5:
                    near = True
                if near and 0.0 <= f <= limit and count < MAX_PIXELS:
                    pixels[count, 0] = u
                    pixels[count, 1] = v
                    count += 1
        return count
    return _sample_pixels(p, q, reach, height, width, pixels)
