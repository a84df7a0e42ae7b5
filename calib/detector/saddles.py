"""Checkered lattices in a photo: saddles of its brightness, joined along the edges that lead from one to the next.

At a corner of squares the Hessian of the smoothed brightness has a negative determinant, and on a circle around it the
brightness crosses that of the middle four times: on the edges. A neighbour lies on one of these edges, which is its
own, too, with the colours beside it as the first corner has them. Everything is local, so lenses may bend the lattice
as they like.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Flags, Rows

SMOOTH_PX = 1.5
AROUND_PX, SAMPLES = 4.5, 48
"""The circle on which a corner's edges and the colours of its squares are looked for."""
MOST_BENT_RAD = 0.5
"""Of an edge, at the corner."""
MOST_UNLIKE = 3.0
"""Contrasts of neighbours."""
MOST = 1500
"""Saddles, by their strength."""
LEAST_STRENGTH = 0.004
"""Of the strongest ones'."""
LEAST_CONTRAST = 8.0
"""Grey levels between the squares."""
OFF_RAD = 0.3
"""How far a neighbour may lie from the direction of an edge."""
FARTHEST = 0.35
"""Of the image's larger side: no square is longer."""
CANDIDATES = 4
"""So many of the nearest along an edge are looked at."""
LEAST_EDGE = 0.35
"""Of the contrast of the corners, beside the edge between them."""
SMALLEST = 4


@dataclass(frozen=True, eq=False)
class Saddles:
    """N saddles, each with four directions along its edges, in the order of their angles."""

    center_px: Array  # (N, 2)
    way_rad: Array  # (N, 4) ascending within a turn
    is_dark: Flags  # (N,) the quadrant after the first direction
    contrast: Array  # (N,)


@dataclass(frozen=True, eq=False)
class CornerLattice:
    """N corners that hang together."""

    index: Rows  # (N, 2) column and row from (0, 0) on, in axes of its own, seen as columns to the right, rows down
    center_px: Array  # (N, 2)

    @property
    def size(self) -> tuple[int, int]:
        """Columns, rows."""
        columns, rows = (self.index.max(axis=0) + 1).tolist()
        return columns, rows


def find_saddles(grey: NDArray[np.uint8]) -> Saddles:
    """Of an image.  # (H, W)"""
    soft = _softened(grey, SMOOTH_PX)
    kernel = np.array([1.0, -2.0, 1.0]), np.array([-0.5, 0.0, 0.5]), np.ones(1)
    uu, vv = cv2.sepFilter2D(soft, -1, kernel[0], kernel[2]), cv2.sepFilter2D(soft, -1, kernel[2], kernel[0])
    uv = cv2.sepFilter2D(soft, -1, kernel[1], kernel[1])
    strength = uv * uv - uu * vv
    # Of equal neighbours, as corners of drawn boards have them, one is the peak.
    strength *= (1 + 3e-7 * np.arange(grey.shape[1]) + 1e-6 * np.arange(grey.shape[0])[:, None]).astype(np.float32)
    is_peak = (strength == cv2.dilate(strength, np.ones((5, 5), np.uint8))) & (strength > 0)
    edge = int(AROUND_PX) + 1
    is_peak[:edge], is_peak[-edge:], is_peak[:, :edge], is_peak[:, -edge:] = False, False, False, False
    v, u = np.nonzero(is_peak)
    order = np.argsort(-strength[v, u], kind="stable")
    usual = strength[v[order[:100]], u[order[:100]]].mean() if len(order) else 0.0
    order = order[strength[v[order], u[order]] > LEAST_STRENGTH * usual][: 4 * MOST]
    v, u = v[order], u[order]
    a, b, c = (each[v, u].astype(np.float64) for each in (uu, uv, vv))
    # To the saddle's own place within the pixel.
    gu, gv = (
        cv2.sepFilter2D(soft, -1, kernel[1], kernel[2])[v, u],
        cv2.sepFilter2D(soft, -1, kernel[2], kernel[1])[v, u],
    )
    det = np.minimum(a * c - b * b, -1e-12)
    shift = np.stack([(b * gv - c * gu) / det, (b * gu - a * gv) / det], axis=1)
    center = np.asarray(np.column_stack([u, v]) + np.clip(shift, -1.0, 1.0), dtype=np.float64)
    # Around it the brightness crosses that of the middle four times, where the edges are.
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    around = center[:, None] + AROUND_PX * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    level = levels_at(soft, around) - levels_at(soft, center)[:, None]
    after = np.roll(level, -1, axis=1)
    crosses = (level > 0) != (after > 0)
    (four,) = np.nonzero(crosses.sum(axis=1) == 4)
    center, level, after, crosses = center[four], level[four], after[four], crosses[four]
    sample = np.nonzero(crosses)[1].reshape(-1, 4)
    here, there = np.take_along_axis(level, sample, axis=1), np.take_along_axis(after, sample, axis=1)
    way = (2 * np.pi / SAMPLES) * (sample + here / (here - there))
    is_dark = there[:, 0] <= 0
    contrast = np.percentile(level, 85, axis=1) - np.percentile(level, 15, axis=1)
    bent = np.abs(way[:, 2:] - way[:, :2] - np.pi).max(axis=1, initial=0.0)
    good = np.flatnonzero((contrast > LEAST_CONTRAST) & (bent < MOST_BENT_RAD))[:MOST]
    return Saddles(center[good], way[good], is_dark[good], contrast[good])


def _softened(grey: NDArray[np.uint8], sigma_px: float) -> NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), sigma_px), dtype=np.float32)


def levels_at(image: NDArray[np.uint8] | NDArray[np.float32], at: Array) -> Array:
    """Brightness at places, between pixels by the four around.  # (..., 2) -> (...)"""
    flat = at.reshape(-1, 2).astype(np.float32)
    if not len(flat):
        return np.zeros(at.shape[:-1])
    found = [
        cv2.remap(image, part[None, :, 0], part[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0]
        for part in np.array_split(flat, len(flat) // 30_000 + 1)
    ]
    return np.concatenate(found).astype(np.float64).reshape(at.shape[:-1])


def _neighbours(grey: NDArray[np.uint8], saddles: Saddles) -> tuple[Rows, Rows]:
    """The neighbour in each direction of each saddle, and its direction that leads back; -1: none.  # (N, 4) twice"""
    place, ways, count = saddles.center_px, saddles.way_rad, len(saddles.center_px)

    def turn(a: Array, b: Array) -> Array:
        return np.asarray(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi))

    # Pairs that lie along an edge of either, nearly, by single precision: angles of all would take most of the time.
    flat = (place - place.mean(axis=0)).astype(np.float32)
    length = np.hypot(*(flat - flat[:, None]).transpose(2, 0, 1))
    most = FARTHEST * max(grey.shape)
    is_along = np.zeros((count, count), dtype=np.bool_)
    for way in ways.T.astype(np.float32):
        ahead = np.stack([np.cos(way), np.sin(way)], axis=1)
        is_along |= ahead @ flat.T - (ahead * flat).sum(axis=1)[:, None] > np.float32(np.cos(OFF_RAD + 1e-3)) * length
    row, other = np.nonzero(is_along & is_along.T & (length > AROUND_PX) & (length < 1.01 * most))
    step = place[other] - place[row]
    length, angle = np.linalg.norm(step, axis=1), np.arctan2(step[:, 1], step[:, 0])[:, None]
    # The direction of each neighbour that leads back here, and whether colours agree there.
    off = turn(ways[other], angle + np.pi)
    slot = off.argmin(axis=1)
    color = saddles.is_dark[:, None] ^ (np.arange(4) % 2 == 1)
    fits = (turn(angle, ways[row]) < OFF_RAD) & (off.min(axis=1, initial=np.inf) < OFF_RAD)[:, None]
    fits &= color[other, (slot - 1) % 4, None] == color[row]
    fits &= ((length >= 1.2 * AROUND_PX) & (length <= most))[:, None]
    fits &= (np.abs(np.log(saddles.contrast[row] / saddles.contrast[other])) < np.log(MOST_UNLIKE))[:, None]
    pair, way = np.nonzero(fits)
    # The nearest ones along each edge.
    edge = 4 * row[pair] + way
    order = np.lexsort((length[pair], edge))
    is_near = np.arange(len(order)) - np.searchsorted(edge[order], edge[order]) < CANDIDATES
    pair, way, edge = (each[order[is_near]] for each in (pair, way, edge))
    row, other, slot = row[pair], other[pair], slot[pair]
    step, length = step[pair], length[pair]
    # Beside the edge between both, at three places, the colours are those of the squares.
    soft = _softened(grey, SMOOTH_PX / 2)
    side = np.stack([-step[:, 1], step[:, 0]], axis=1) / length[:, None]
    side *= np.clip(0.2 * length[:, None], 1.5, AROUND_PX)
    at = place[row, None] + step[:, None] * np.array([0.3, 0.5, 0.7])[:, None]
    across = levels_at(soft, at + side[:, None]) - levels_at(soft, at - side[:, None])
    across *= np.where(color[row, way], -1.0, 1.0)[:, None]
    # A saddle that is none may lie between: the nearest good one is taken.
    good = across.min(axis=1) > LEAST_EDGE * np.minimum(saddles.contrast[row], saddles.contrast[other])
    taken, first = np.unique(edge[good], return_index=True)
    next_of, back_of = np.full((2, 4 * count), -1, dtype=np.int64)
    next_of[taken], back_of[taken] = other[good][first], slot[good][first]
    next_of, back_of = next_of.reshape(count, 4), back_of.reshape(count, 4)
    has = next_of >= 0
    mutual = has & (next_of[next_of, back_of] == np.arange(count)[:, None])
    return np.where(mutual, next_of, -1), back_of


def find_lattices(grey: NDArray[np.uint8]) -> list[CornerLattice]:
    """All checkered lattices of an image, the largest first.  # (H, W)"""
    saddles = find_saddles(grey)
    count = len(saddles.center_px)
    if count < SMALLEST:
        return []
    next_of, back_of = _neighbours(grey, saddles)
    step = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    is_taken, found = np.zeros(count, dtype=np.bool_), []
    for seed in range(count):
        if is_taken[seed]:
            continue
        # The lattice direction k of a corner is its own direction k + turn.
        place, turn, queue = {seed: (0, 0)}, {seed: 0}, [seed]
        at = {(0, 0): seed}
        is_taken[seed] = True
        while queue:
            one = queue.pop(0)
            for k in range(4):
                way = (k + turn[one]) % 4
                other = int(next_of[one, way])
                if other < 0 or is_taken[other]:
                    continue
                where = (place[one][0] + int(step[k, 0]), place[one][1] + int(step[k, 1]))
                if where in at:
                    continue
                at[where], place[other], is_taken[other] = other, where, True
                turn[other] = (int(back_of[one, way]) - k - 2) % 4
                queue.append(other)
        if len(place) >= SMALLEST:
            index = np.array(list(place.values()))
            found.append(CornerLattice(index - index.min(axis=0), saddles.center_px[list(place)]))
    return sorted(found, key=lambda one: -len(one.index))
