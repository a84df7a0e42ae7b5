"""The projected centre of two concentric circles from their borders, after Jiang and Quan (2005).

A line through a point near the centre meets the outer border at parameters a < d and the inner one at b < c. With
s1 = a + d, p1 = a d, s2 = b + c, p2 = b c, the image of the chord's midpoint is the root of
`(s2 - s1) t^2 + 2 (p1 - p2) t + (s1 p2 - s2 p1) = 0` nearest (b + c) / 2. Moving there and turning the line by a right
angle in the plane of the circles brings the point to the projected centre.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.detector.plane_distance import upright

Floats: TypeAlias = NDArray[np.float64]

STEPS = 12
"""Lines; two make a step."""


@jit
def _crossings(
    point: NDArray[np.int32], start: int, stop: int, cu: float, cv: float, du: float, dv: float, ends: Floats
) -> bool:
    """Smallest and largest line parameter at which a closed border crosses the line c + t d."""
    low, high = np.inf, -np.inf
    pu, pv = point[stop - 1, 0] - cu, point[stop - 1, 1] - cv
    side = du * pv - dv * pu
    along = du * pu + dv * pv
    for n in range(start, stop):
        qu, qv = point[n, 0] - cu, point[n, 1] - cv
        side_next = du * qv - dv * qu
        along_next = du * qu + dv * qv
        if (side <= 0.0) != (side_next <= 0.0):
            t = along + (along_next - along) * side / (side - side_next)
            low = min(low, t)
            high = max(high, t)
        side, along = side_next, along_next
    ends[0], ends[1] = low, high
    return low < 0.0 < high


@jit
def midpoint_on_line(a: float, b: float, c: float, d: float) -> float:
    """The image of the chord's midpoint on a line that meets the circles at a < b < c < d; nan if there is none."""
    s1, p1, s2, p2 = a + d, a * d, b + c, b * c
    qa, qb, qc = s2 - s1, 2.0 * (p1 - p2), s1 * p2 - s2 * p1
    guess = 0.5 * (b + c)
    if abs(qa) < 1e-9 * abs(qb):
        return -qc / qb if qb != 0.0 else np.nan
    disc = qb * qb - 4.0 * qa * qc
    if disc < 0.0:
        return np.nan
    w = -0.5 * (qb + math.copysign(math.sqrt(disc), qb))
    t1 = w / qa
    t2 = qc / w if w != 0.0 else t1
    return t1 if abs(t1 - guess) < abs(t2 - guess) else t2


@jit
def refine_seeds(
    point: NDArray[np.int32],
    first: NDArray[np.int64],
    outer: NDArray[np.int64],
    inner: NDArray[np.int64],
    ellipse: Floats,
    seed: Floats,
) -> NDArray[np.bool_]:
    """Move each seed (N, 2) to the projected centre of its two borders; false where the lines miss them.

    The mean of the last half of the steps is taken, because borders run in whole pixels. A step goes along two lines at
    a right angle in the plane, both from one place, so that it does not matter which of them comes first.
    """
    ok = np.zeros(len(outer), dtype=np.bool_)
    big, small = np.empty(2), np.empty(2)
    for n in range(len(outer)):
        o, i = outer[n], inner[n]
        cu, cv = seed[n, 0], seed[n, 1]
        mean_u = mean_v = 0.0
        taken = 0
        e = ellipse[o]
        for line in range(STEPS):
            if line % 2 == 0:
                from_u, from_v = cu, cv
            # A different pair of lines each step.
            angle = 0.5 * math.pi * line + math.pi / STEPS * (line // 2) + upright(e[2], e[3], e[4])
            y0, y1 = math.cos(angle), math.sin(angle)
            du = y0 / e[2]
            dv = (y1 - e[3] * du) / e[4]
            norm = math.sqrt(du * du + dv * dv)
            du /= norm
            dv /= norm
            if not _crossings(point, first[o], first[o + 1], from_u, from_v, du, dv, big):
                break
            if not _crossings(point, first[i], first[i + 1], from_u, from_v, du, dv, small):
                break
            # Half a pixel from the white pixels' centres to the edge.
            t = midpoint_on_line(big[0] + 0.5, small[0] - 0.5, small[1] + 0.5, big[1] - 0.5)
            if not (small[0] < t < small[1]):
                break
            cu += t * du
            cv += t * dv
            if line >= STEPS // 2 and line % 2 == 1:
                mean_u += cu
                mean_v += cv
                taken += 1
        if taken == STEPS // 4:
            seed[n, 0] = mean_u / taken
            seed[n, 1] = mean_v / taken
            ok[n] = True
    return ok
