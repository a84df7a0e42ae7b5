"""Borders of a binary image and their hierarchy (Suzuki and Abe 1985), as flat arrays for compiled code."""

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_POINTS = 6
MIN_AREA_PX2 = 4.0
MIN_VARIANCE_PX2 = 0.05
"""Shorter, smaller and thinner borders are noise: no ellipse can be told from them."""


@dataclass(frozen=True, eq=False)
class Borders:
    """B borders. A hole is the border of a dark blob inside a white region; other borders surround white regions."""

    point: NDArray[np.int32]  # (P, 2) u v, border after border
    first: Integers  # (B + 1,) where a border's points begin
    parent: Integers  # (B,) the border around, -1: none
    is_hole: NDArray[np.bool_]  # (B,)
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
def _ellipses(
    point: NDArray[np.int32], first: Integers, is_hole: NDArray[np.bool_], ellipse: Floats, misfit: Floats
) -> None:
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
def _hole_flags(parent: Integers) -> NDArray[np.bool_]:
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
    is_hole: NDArray[np.bool_] = depth % 2 == 1
    return is_hole
