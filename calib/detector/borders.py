"""Black and white from grey, the borders in it, and the centres of the circles that borders may be.

A line through a point near the centre meets the outer border at parameters a < d and the inner one at b < c. With
s1 = a + d, p1 = a d, s2 = b + c, p2 = b c, the image of the chord's midpoint is the root of
`(s2 - s1) t^2 + 2 (p1 - p2) t + (s1 p2 - s2 p1) = 0` nearest (b + c) / 2. Moving there and turning the line by a right
angle in the plane of the circles brings the point to the projected centre.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.detector.ring_model import upright
from designer.base.arrays import Array, Flags, Rows

COARSE_PIXELS = 8_000_000
"""Candidates are looked for in images reduced to about this size; centres are always measured in the full image."""
Floats: TypeAlias = Array
Integers: TypeAlias = Rows

MIN_POINTS = 6
MIN_AREA_PX2 = 4.0
MIN_VARIANCE_PX2 = 0.05
"""Shorter, smaller and thinner borders are noise: no ellipse can be told from them."""
STEPS = 12
"""Lines; two make a step."""


def reduction(shape: tuple[int, int]) -> int:
    """The whole factor, a power of two, that brings an image down to COARSE_PIXELS.  # (H, W)"""
    factor = 1
    while shape[0] * shape[1] > COARSE_PIXELS * factor * factor:
        factor *= 2
    return factor


def reduced(pixels: NDArray[np.generic], factor: int) -> NDArray[np.uint8]:
    """Mean of factor x factor pixels, as 8 bit stretched over the brightness that occurs.  # (H, W) -> (H/f, W/f)

    A light blur keeps noise from becoming speckle where a threshold falls on an even brightness: following the borders
    of a few hundred thousand specks takes seconds.
    """
    height, width = pixels.shape[0] // factor, pixels.shape[1] // factor
    small = pixels
    if factor > 1:
        cropped = np.ascontiguousarray(pixels[: height * factor, : width * factor])
        small = cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA)
    small = np.asarray(cv2.GaussianBlur(small.astype(small.dtype.type, copy=False), (3, 3), SPECKLE_BLUR_PX))
    if small.dtype == np.uint8:
        return np.ascontiguousarray(small, dtype=np.uint8)
    low, high = float(small.min()), float(small.max())
    return np.asarray((small.astype(np.float64) - low) * (255.0 / max(high - low, 1e-9)), dtype=np.uint8)


SPECKLE_BLUR_PX = 0.8


MAX_CHANGES = 1_000_000


"""Ten thousand rings of twelve pixels' radius make as many."""


@dataclass(frozen=True)
class Threshold:
    """One way to binarise: a window of 0 is Otsu's threshold, else the local mean less an offset."""

    window: int
    offset: float = 0.0


def thresholds(grey: NDArray[np.uint8]) -> Iterator[Threshold]:
    """The ways to try, in order: Otsu first, then local means over a large and a small window.

    The offset keeps even areas white: noise may not turn them into speckle.
    """
    yield Threshold(0)
    side = min(grey.shape)
    offset = max(6.0, 4 * noise_level(grey))
    yield Threshold(_odd(side / 6), offset)
    yield Threshold(_odd(side / 18), offset)


def is_speckle(binary: NDArray[np.uint8]) -> bool:
    """Whether a binary image changes so often along its rows that following its borders would take minutes."""
    return cv2.norm(binary[:, 1:], binary[:, :-1], cv2.NORM_L1) > 255.0 * MAX_CHANGES


def noise_level(grey: NDArray[np.uint8]) -> float:
    """Standard deviation of the noise, from the median of second differences (insensitive to edges)."""
    second = np.concatenate([_second_differences(grey), _second_differences(grey.T)])
    # |2a - b - c| of Gaussian noise has the median 0.6745 sqrt(6) sigma.
    return float(np.median(second)) / (0.6745 * 6**0.5) if second.size else 0.0


def _second_differences(grey: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Along every seventh row, of those that the image turned upside down would give as well."""
    sample = grey[4 * (len(grey) - 1) % 7 :: 7].astype(np.int16)
    return np.asarray(np.abs(2 * sample[:, 1:-1] - sample[:, :-2] - sample[:, 2:]).ravel(), dtype=np.int16)


def _odd(size: float) -> int:
    return max(11, 2 * int(size / 2) + 1)


def binarise(grey: NDArray[np.uint8], threshold: Threshold) -> NDArray[np.uint8]:
    """255 where bright.  # (H, W)"""
    if threshold.window == 0:
        return np.asarray(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)[1], dtype=np.uint8)
    local = cv2.boxFilter(grey, -1, (threshold.window, threshold.window), borderType=cv2.BORDER_REPLICATE)
    raised = cv2.add(grey, np.full(1, threshold.offset))
    return np.asarray(cv2.compare(raised, local, cv2.CMP_GT), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Borders:
    """B borders. A hole is the border of a dark blob inside a white region; other borders surround white regions."""

    point: NDArray[np.int32]  # (P, 2) u v, border after border
    first: Integers  # (B + 1,) where a border's points begin
    parent: Integers  # (B,) the border around, -1: none
    is_hole: Flags  # (B,)
    ellipse: Floats  # (B, 5) centre u v, then E (3): the ellipse with the region's area and second moments
    misfit_px: Floats  # (B,) root-mean-square distance of the border's points from that ellipse; inf: no ellipse

    @property
    def area_px2(self) -> Floats:
        """Area of each ellipse.  # (B,)"""
        return np.pi / np.maximum(self.ellipse[:, 2] * self.ellipse[:, 4], 1e-12)


@jit
def _moments(point: NDArray[np.int32], start: int, stop: int, moment: Floats) -> bool:
    """Centroid and second central moments of a closed polygon by Green's theorem; false if it has no area."""
    base_u, base_v = point[start, 0], point[start, 1]
    area = mu = mv = uu = uv = vv = 0.0
    for n in range(start, stop):
        after = n + 1 if n + 1 < stop else start
        u0, v0 = float(point[n, 0] - base_u), float(point[n, 1] - base_v)
        u1, v1 = float(point[after, 0] - base_u), float(point[after, 1] - base_v)
        cross = u0 * v1 - u1 * v0
        area += cross
        mu += (u0 + u1) * cross
        mv += (v0 + v1) * cross
        uu += (u0 * u0 + u0 * u1 + u1 * u1) * cross
        vv += (v0 * v0 + v0 * v1 + v1 * v1) * cross
        uv += (2.0 * u0 * v0 + u0 * v1 + u1 * v0 + 2.0 * u1 * v1) * cross
    area *= 0.5
    if abs(area) < MIN_AREA_PX2:
        return False
    mu /= 6.0 * area
    mv /= 6.0 * area
    moment[0], moment[1] = base_u + mu, base_v + mv
    moment[2] = uu / (12.0 * area) - mu * mu
    moment[3] = uv / (24.0 * area) - mu * mv
    moment[4] = vv / (12.0 * area) - mv * mv
    return True


@jit
def _shape_of(suu: float, suv: float, svv: float, grow: float, shape: Floats) -> bool:
    """E of the ellipse with the given second moments, its semi-axes longer by `grow`; false if it is too thin."""
    half_sum, half_diff = 0.5 * (suu + svv), 0.5 * (suu - svv)
    spread = np.sqrt(half_diff * half_diff + suv * suv)
    large, small = half_sum + spread, half_sum - spread
    if small <= MIN_VARIANCE_PX2:
        return False
    # A solid ellipse's variance along an axis is a quarter of the semi-axis squared.
    large = (2.0 * np.sqrt(large) + grow) ** 2
    small = max(2.0 * np.sqrt(small) + grow, 0.5) ** 2
    angle = 0.5 * np.arctan2(suv, half_diff)
    cos, sin = np.cos(angle), np.sin(angle)
    m00 = cos * cos / large + sin * sin / small
    m11 = sin * sin / large + cos * cos / small
    m01 = cos * sin * (1.0 / large - 1.0 / small)
    shape[2] = np.sqrt(m11)
    shape[1] = m01 / shape[2]
    shape[0] = np.sqrt(max(m00 - shape[1] ** 2, 1e-12))
    return True


@jit
def _misfit(point: NDArray[np.int32], start: int, stop: int, e: Floats, grow: float) -> float:
    """Root-mean-square distance of a border from an ellipse, both moved by half a pixel as in `_ellipses`."""
    total = 0.0
    for n in range(start, stop):
        du, dv = point[n, 0] - e[0], point[n, 1] - e[1]
        y0 = e[2] * du
        y1 = e[3] * du + e[4] * dv
        f = np.sqrt(y0 * y0 + y1 * y1) + 1e-9
        gu = (e[2] * y0 + e[3] * y1) / f
        gv = e[4] * y1 / f
        off = (f - 1.0) / np.sqrt(gu * gu + gv * gv) + grow
        total += off * off
    return float(np.sqrt(total / (stop - start)))


@jit
def _ellipses(point: NDArray[np.int32], first: Integers, is_hole: Flags, ellipse: Floats, misfit: Floats) -> None:
    """Each border's ellipse, and how well the border fits it."""
    moment = np.empty(5)
    for b in range(len(first) - 1):
        start, stop = first[b], first[b + 1]
        misfit[b] = np.inf
        ellipse[b, 2] = ellipse[b, 4] = 1.0
        # Borders run through white pixels, half a pixel outside a dark blob and inside a white one.
        grow = -0.5 if is_hole[b] else 0.5
        if stop - start < MIN_POINTS or not _moments(point, start, stop, moment):
            continue
        ellipse[b, 0], ellipse[b, 1] = moment[0], moment[1]
        if _shape_of(moment[2], moment[3], moment[4], grow, ellipse[b, 2:]):
            misfit[b] = _misfit(point, start, stop, ellipse[b], grow)


def find_borders(binary: NDArray[np.uint8]) -> Borders:
    """The borders of a binary image (white: not zero).  # (H, W)"""
    contours, hierarchy = cv2.findContours(binary, cv2.RETR_TREE, cv2.CHAIN_APPROX_NONE)
    count = len(contours)
    if count == 0:
        empty = np.zeros(0)
        return Borders(
            np.zeros((0, 2), np.int32),
            np.zeros(1, np.int64),
            empty.astype(np.int64),
            empty.astype(np.bool_),
            np.zeros((0, 5)),
            empty,
        )
    first = np.zeros(count + 1, dtype=np.int64)
    np.cumsum([len(contour) for contour in contours], out=first[1:])
    point = np.concatenate(contours).reshape(-1, 2).astype(np.int32)
    parent = hierarchy[0, :, 3].astype(np.int64)
    ellipse, misfit = np.zeros((count, 5)), np.zeros(count)
    is_hole = _hole_flags(parent)
    _ellipses(point, first, is_hole, ellipse, misfit)
    return Borders(point, first, parent, is_hole, ellipse, misfit)


@jit
def _hole_flags(parent: Integers) -> Flags:
    """Whether a border lies at odd depth. A parent always comes before or after; walk up to the top."""
    count = len(parent)
    depth = np.full(count, -1, dtype=np.int64)
    for start in range(count):
        steps = 0
        at = start
        while at >= 0 and depth[at] < 0:
            at = parent[at]
            steps += 1
        value = (depth[at] if at >= 0 else -1) + steps
        at = start
        while at >= 0 and depth[at] < 0:
            depth[at] = value
            value -= 1
            at = parent[at]
    is_hole: Flags = depth % 2 == 1
    return is_hole


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
    point: NDArray[np.int32], first: Rows, outer: Rows, inner: Rows, ellipse: Floats, seed: Floats
) -> Flags:
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
