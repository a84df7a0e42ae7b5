"""Borders of a binary image and their hierarchy (Suzuki and Abe 1985), as flat arrays for compiled code."""

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.jit import jit

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_POINTS = 6
"""Shorter borders are noise: no ellipse can be told from them."""


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
def _ellipses(
    point: NDArray[np.int32],
    first: Integers,
    is_hole: NDArray[np.bool_],
    ellipse: Floats,
    misfit: Floats,
) -> None:
    """Moments of each border's polygon by Green's theorem, as an ellipse; and how well the border fits it."""
    for b in range(len(first) - 1):
        start, stop = first[b], first[b + 1]
        misfit[b] = np.inf
        ellipse[b, 2] = ellipse[b, 4] = 1.0
        if stop - start < MIN_POINTS:
            continue
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
        if abs(area) < 4.0:
            continue
        mu /= 6.0 * area
        mv /= 6.0 * area
        suu = uu / (12.0 * area) - mu * mu
        svv = vv / (12.0 * area) - mv * mv
        suv = uv / (24.0 * area) - mu * mv
        # Borders run through white pixels, half a pixel outside a dark blob and inside a white one.
        half_sum, half_diff = 0.5 * (suu + svv), 0.5 * (suu - svv)
        spread = np.sqrt(half_diff * half_diff + suv * suv)
        large, small = half_sum + spread, half_sum - spread
        if small <= 0.05:
            continue
        grow = -0.5 if is_hole[b] else 0.5
        large_new = 0.25 * (2.0 * np.sqrt(large) + grow) ** 2
        small_new = 0.25 * max(2.0 * np.sqrt(small) + grow, 0.5) ** 2
        angle = 0.5 * np.arctan2(suv, half_diff)
        cos, sin = np.cos(angle), np.sin(angle)
        m00 = 0.25 * (cos * cos / large_new + sin * sin / small_new)
        m11 = 0.25 * (sin * sin / large_new + cos * cos / small_new)
        m01 = 0.25 * cos * sin * (1.0 / large_new - 1.0 / small_new)
        ellipse[b, 0] = base_u + mu
        ellipse[b, 1] = base_v + mv
        ellipse[b, 4] = np.sqrt(m11)
        ellipse[b, 3] = m01 / ellipse[b, 4]
        ellipse[b, 2] = np.sqrt(max(m00 - ellipse[b, 3] ** 2, 1e-12))
        total = 0.0
        for n in range(start, stop):
            du, dv = point[n, 0] - ellipse[b, 0], point[n, 1] - ellipse[b, 1]
            y0 = ellipse[b, 2] * du
            y1 = ellipse[b, 3] * du + ellipse[b, 4] * dv
            f = np.sqrt(y0 * y0 + y1 * y1) + 1e-9
            gu = (ellipse[b, 2] * y0 + ellipse[b, 3] * y1) / f
            gv = ellipse[b, 4] * y1 / f
            off = (f - 1.0) / np.sqrt(gu * gu + gv * gv) + grow
            total += off * off
        misfit[b] = np.sqrt(total / (stop - start))


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
    return depth % 2 == 1
