"""Dark ellipses on white, with or without a white centre: what may be a ring or a dot."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.detector.borders import Borders, Threshold, binarise, find_borders, is_speckle, refine_seeds
from designer.base.arrays import Array, Rows

Floats: TypeAlias = Array

MIN_RADIUS_PX = 2.2
"""Smaller blobs hold no position worth having."""
MAX_ELONGATION = 12.0
MAX_CANDIDATES = 20_000
"""More ellipses than any target has rings: the largest are kept, so that noise cannot take all day."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """N dark ellipses, in pixels of the full image."""

    ellipse: Floats  # (N, 5) centre u v (for rings: the projected centre), then E of the outer border (3)
    ratio: Floats  # (N,) inner over outer radius; 0: no white centre was seen
    region: Rows  # (N,) the white region around, a number unique in the image
    misfit_px: Floats  # (N,)

    @property
    def count(self) -> int:
        """How many."""
        return len(self.ratio)

    @property
    def radius_px(self) -> Floats:
        """Geometric mean of the semi-axes.  # (N,)"""
        return 1 / np.sqrt(self.ellipse[:, 2] * self.ellipse[:, 4])

    def take(self, rows: NDArray[np.generic]) -> "Candidates":
        """Some of them."""
        return Candidates(self.ellipse[rows], self.ratio[rows], self.region[rows], self.misfit_px[rows])


def find_candidates(
    grey: NDArray[np.uint8], threshold: Threshold, factor: int, first_region: int, ratio: float
) -> Candidates:
    """Candidates in an image reduced by a factor, by one threshold, for rings with that ratio of their radii.

    White regions are numbered from `first_region` on, so that thresholds do not share numbers.
    """
    binary = binarise(grey, threshold)
    borders = find_borders(np.zeros_like(binary) if is_speckle(binary) else binary)
    outer = _dark_ellipses(borders)
    inner = _white_centres(borders, outer, ratio)
    has_centre = inner >= 0
    ellipse = borders.ellipse[outer].copy()
    seed = 0.5 * (borders.ellipse[outer, :2] + borders.ellipse[np.maximum(inner, 0), :2])
    rows = np.flatnonzero(has_centre)
    seeds = seed[rows]
    good = refine_seeds(borders.point, borders.first, outer[rows], inner[rows], borders.ellipse, seeds)
    ellipse[rows, :2] = np.where(good[:, None], seeds, ellipse[rows, :2])
    found_ratio = np.sqrt(borders.area_px2[np.maximum(inner, 0)] / borders.area_px2[outer])
    ellipse[:, :2] = (ellipse[:, :2] + 0.5) * factor - 0.5
    ellipse[:, 2:] /= factor
    return Candidates(
        ellipse=ellipse,
        ratio=np.where(has_centre, found_ratio, 0.0),
        region=borders.parent[outer] + first_region,
        misfit_px=borders.misfit_px[outer] * factor,
    )


def _dark_ellipses(borders: Borders) -> Rows:
    """Holes that are ellipses.  # (N,)"""
    large, small = semi_axes_px(borders.ellipse[:, 2:])
    fits = borders.misfit_px < 0.35 + 0.06 * small
    sized = (small > MIN_RADIUS_PX) & (large < MAX_ELONGATION * small)
    rows = np.flatnonzero(borders.is_hole & fits & sized)
    if len(rows) > MAX_CANDIDATES:
        rows = rows[np.argsort(-small[rows], kind="stable")[:MAX_CANDIDATES]]
    return rows


def _white_centres(borders: Borders, outer: Rows, ratio: float) -> Rows:
    """The white blob inside each dark ellipse that can be a ring's centre; -1: none.  # (N,)"""
    slot = np.full(len(borders.parent), -1, dtype=np.int64)
    slot[outer] = np.arange(len(outer))
    inner = np.full(len(outer), -1, dtype=np.int64)
    child = np.flatnonzero((borders.parent >= 0) & (slot[borders.parent] >= 0))
    if not len(child):
        return inner
    around = slot[borders.parent[child]]
    offset = borders.ellipse[child, :2] - borders.ellipse[outer[around], :2]
    relative = plane_offset(borders.ellipse[outer[around], 2:], offset)
    share = borders.area_px2[child] / borders.area_px2[outer[around]]
    fits = (np.linalg.norm(relative, axis=1) < 0.3) & (share > 0.2 * ratio**2) & (share < 0.5 * (1 + ratio**2))
    fits &= np.isfinite(borders.misfit_px[child])
    # The largest wins: assigned last.
    order = np.argsort(borders.area_px2[child[fits]], kind="stable")
    inner[around[fits][order]] = child[fits][order]
    return inner


def plane_offset(shape: Floats, offset_px: Floats) -> Floats:
    """E times an offset: in units of the outer radius.  # (N, 3), (N, 2) -> (N, 2)"""
    return np.stack(
        [shape[:, 0] * offset_px[:, 0], shape[:, 1] * offset_px[:, 0] + shape[:, 2] * offset_px[:, 1]], axis=1
    )


def semi_axes_px(shape: Floats) -> tuple[Floats, Floats]:
    """Larger and smaller semi-axis of ellipses |E v| = 1.  # (N, 3) -> (N,), (N,)"""
    a, b, c = shape[:, 0] ** 2 + shape[:, 1] ** 2, shape[:, 1] * shape[:, 2], shape[:, 2] ** 2
    middle, spread = 0.5 * (a + c), np.hypot(0.5 * (a - c), b)
    return 1 / np.sqrt(np.maximum(middle - spread, 1e-12)), 1 / np.sqrt(middle + spread)


def merged(first: Candidates, second: Candidates) -> Candidates:
    """Both, without those of the second that the first has already; a ring replaces a blob at its place."""
    if not first.count or not second.count:
        return first if first.count else second
    twin, _ = nearest_candidates(first, second.ellipse[:, :2], second.ellipse[:, 2:], reach=0.5, size_ratio=2.7)
    new = twin < 0
    better = ~new & (first.ratio[np.maximum(twin, 0)] == 0) & (second.ratio > 0)
    keep = np.ones(first.count, dtype=bool)
    keep[twin[better]] = False
    rows = np.flatnonzero(new | better)
    kept = np.flatnonzero(keep)
    return Candidates(
        np.concatenate([first.ellipse[kept], second.ellipse[rows]]),
        np.concatenate([first.ratio[kept], second.ratio[rows]]),
        np.concatenate([first.region[kept], second.region[rows]]),
        np.concatenate([first.misfit_px[kept], second.misfit_px[rows]]),
    )


@jit
def _nearest(
    at: Floats,
    order: Rows,
    ellipse: Floats,
    place: Floats,
    shape: Floats,
    reach: float,
    size_ratio: float,
    distance: Floats,
) -> Rows:
    """See `nearest_candidates`; `at` are the candidates' u in ascending `order`."""
    nearest = np.full(len(place), -1, dtype=np.int64)
    for n in range(len(place)):
        e = shape[n]
        half = reach * math.sqrt(e[1] * e[1] + e[2] * e[2]) / (e[0] * e[2])
        distance[n] = reach
        for k in range(np.searchsorted(at, place[n, 0] - half), len(at)):
            if at[k] > place[n, 0] + half:
                break
            c = ellipse[order[k]]
            du, dv = c[0] - place[n, 0], c[1] - place[n, 1]
            off = math.hypot(e[0] * du, e[1] * du + e[2] * dv)
            if off < distance[n] and 1.0 / size_ratio < c[2] * c[4] / (e[0] * e[2]) < size_ratio:
                distance[n] = off
                nearest[n] = order[k]
    return nearest


def nearest_candidates(
    candidates: Candidates, place: Floats, shape: Floats, *, reach: float, size_ratio: float
) -> tuple[Rows, Floats]:
    """The candidate nearest to each place (N, 2) in the plane around it, where a circle looks like E (N, 3).

    Rows, -1 where there is none within reach and of like area (N,), and distances in radii (N,).
    """
    order = np.argsort(candidates.ellipse[:, 0], kind="stable")
    distance = np.zeros(len(place))
    at = np.ascontiguousarray(candidates.ellipse[order, 0])
    place, shape = np.ascontiguousarray(place), np.ascontiguousarray(shape)
    return _nearest(at, order, candidates.ellipse, place, shape, reach, size_ratio, distance), distance
