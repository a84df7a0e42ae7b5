"""Points that a board's markers lead to: where homographies around them have them, looked at closely."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.detector.place import nearest_rows
from calib.detector.saddles import levels_at
from designer.base.arrays import Array, Flags, Rows

ANCHORS = 12
"""Points from whose homography a corner is predicted."""
WINDOW_PX, LEAST_WINDOW_PX = (2.5, 12.0), 2.0
TICKS, SOFT_PX = np.array([-1, -0.6, -0.3, -0.1, 0.1, 0.3, 0.6, 1]), 1.5
LIKENESS, LIKENESS_OF_ONE = 0.75, 0.82
"""Least correlation with the ideal corner: of two dark sectors, and of one, which a cover makes more easily."""
LESS_LIKE, CONTRAST = 0.1, 0.5
"""Than the corners around, and the least share of their contrast."""
OFF_PX, OFF, USUAL_OFF = 1.0, 0.02, 4.0
"""How far a corner may lie from where its neighbours say: in px, as a share of the step, and of the usual distance."""


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """The markers of a face, and the P points that are to be named."""

    dictionary: str
    border_bits: int
    first: int  # number of the first marker
    quad_mm: Array  # (K, 4, 2) their corners on the face, in the order of `Markers.corner_px`
    step_mm: float  # of the square lattice on which the markers stand
    point_mm: Array  # (P, 2)
    sector: (
        Array  # (P, 4) -1 dark, 1 light, of the quadrants around a point: x and y +, + then -, + then -, - then +, -
    )
    clear_mm: float  # so far around the points there is nothing but these quadrants
    unlike: str = "no corner between them can be told: too small, blurred, or as light as its ground"

    @property
    def holds(self) -> str:
        """Such as `markers 0-16`."""
        return f"markers {self.first}-{self.first + len(self.quad_mm) - 1}"


def named_points(
    pixels: NDArray[np.uint8], layout: MarkerLayout, known_mm: Array, known_px: Array
) -> tuple[Rows, Array]:
    """The points of a layout that known ones lead to, one after the other, and that look as they must.

    Returns:
        Rows of the points, ascending (N,), and where they are to about half a pixel (N, 2).
    """
    count = len(layout.point_mm)
    point_px, likeness, strength = np.zeros((count, 2)), np.zeros(count), np.zeros(count)
    tried = np.zeros(count, dtype=np.int64)
    is_found = np.zeros(count, dtype=np.bool_)
    while True:
        left = np.flatnonzero(~is_found & (tried < 2))
        if len(left):
            nearest = nearest_rows(layout.point_mm[left], known_mm)[:, 0]
            away = np.linalg.norm(known_mm[nearest] - layout.point_mm[left], axis=1)
            left = left[away < 1.5 * layout.step_mm]
        if not len(left):
            break
        tried[left] += 1
        at, alike, contrast = _looked_at(pixels, layout, left, known_mm, known_px)
        good = alike > np.where(layout.sector[left].sum(axis=1) == 0, LIKENESS, LIKENESS_OF_ONE)
        if not good.any():
            break
        rows = left[good]
        point_px[rows], likeness[rows], strength[rows], is_found[rows] = at[good], alike[good], contrast[good], True
        known_mm, known_px = np.concatenate([known_mm, layout.point_mm[rows]]), np.concatenate([known_px, at[good]])
    rows = np.flatnonzero(is_found)
    if not len(rows):
        return rows, point_px[rows]
    near = rows[nearest_rows(layout.point_mm[rows], layout.point_mm[rows], ANCHORS)]
    rows = rows[
        (likeness[rows] > np.median(likeness[near], axis=1) - LESS_LIKE)
        & (strength[rows] > CONTRAST * np.median(strength[near], axis=1))
    ]
    rows = rows[_fits_neighbours(layout.point_mm[rows], point_px[rows], layout.step_mm)]
    return rows, point_px[rows]


def _looked_at(
    pixels: NDArray[np.uint8], layout: MarkerLayout, rows: Rows, known_mm: Array, known_px: Array
) -> tuple[Array, Array, Array]:
    """Where points are, as known ones around them predict and their pixels correct; likeness and contrast of each."""
    at, likeness, contrast = np.zeros((len(rows), 2)), np.full(len(rows), -1.0), np.zeros(len(rows))
    place, near = layout.point_mm[rows], nearest_rows(layout.point_mm[rows], known_mm, ANCHORS)
    maps = np.full((len(rows), 3, 3), np.nan)
    for n, nearest in enumerate(near):
        if homography.is_determined(known_mm[nearest]):
            maps[n] = homography.direct(known_mm[nearest], known_px[nearest])
    middle = homography.apply(maps, place)
    scale = np.full(len(rows), np.nan)
    with np.errstate(invalid="ignore"):
        edge = [homography.apply(maps, place + layout.clear_mm * np.array(way)) - middle for way in ((1, 0), (0, 1))]
        scale = np.sqrt(np.abs(edge[0][:, 0] * edge[1][:, 1] - edge[0][:, 1] * edge[1][:, 0])) / layout.clear_mm
        reach = np.clip(0.08 * layout.step_mm * scale, 1.5, 12.0)
        # What is looked at has to lie in the image wherever the point may be.
        room = np.minimum(middle, np.array(pixels.shape[::-1]) - 1 - middle).min(axis=1) - reach - 1
        window = np.clip(layout.clear_mm * scale, *WINDOW_PX)
        window = np.minimum(np.minimum(window, room), 0.45 * layout.step_mm * scale) / scale
    x, y = (axis.ravel() for axis in np.meshgrid(TICKS, TICKS))
    usable = np.flatnonzero(np.isfinite(scale) & (window * scale > LEAST_WINDOW_PX))
    for start in range(0, len(usable), 256):
        part = usable[start : start + 256]
        sample_mm = place[part][:, None] + window[part, None, None] * np.stack([x, y], axis=1)
        sample = np.stack([homography.apply(maps[part], sample_mm[:, k]) for k in range(len(x))], axis=1)
        # Edges are as soft as a pixel makes them: with hard ones any place in the middle of the samples would do.
        right, up = (0.5 + 0.5 * np.clip(axis * (window * scale)[part, None] / SOFT_PX, -1, 1) for axis in (x, y))
        weight = np.stack([right * up, (1 - right) * up, (1 - right) * (1 - up), right * (1 - up)], axis=2)
        ideal = np.einsum("nsq,nq->ns", weight, layout.sector[rows[part]])
        ideal = ideal - ideal.mean(axis=1, keepdims=True)
        ideal /= np.linalg.norm(ideal, axis=1, keepdims=True)
        shift = np.zeros((len(part), 2))
        for ways, share in ((7, 1.0), (5, 0.3), (5, 0.1)):
            tick = np.linspace(-share, share, ways)
            way = np.stack([axis.ravel() for axis in np.meshgrid(tick, tick)], axis=1)
            trial = shift[:, None] + reach[part, None, None] * way
            level = _levels(pixels, sample[:, None] + trial[:, :, None])
            level -= level.mean(axis=2, keepdims=True)
            size = np.linalg.norm(level, axis=2)
            alike = np.einsum("nts,ns->nt", level, ideal) / np.maximum(size, 1e-6)
            best = np.argmax(np.nan_to_num(alike, nan=-1.0), axis=1)
            one = np.arange(len(part))
            shift = trial[one, best]
        at[part] = middle[part] + shift
        likeness[part] = np.nan_to_num(alike[one, best], nan=-1.0)
        contrast[part] = np.nan_to_num(size[one, best]) / len(x) ** 0.5
    likeness[contrast < 2.0] = -1.0
    return at, likeness, contrast


def _levels(pixels: NDArray[np.uint8], at: Array) -> Array:
    """Grey levels at places, nan outside.  # (N, T, S, 2) -> (N, T, S)"""
    inside = ((at >= 0) & (at <= np.array(pixels.shape[::-1]) - 1)).all(axis=-1)
    return np.where(inside, levels_at(pixels, at), np.nan)


def _fits_neighbours(place: Array, pixel: Array, step_mm: float) -> Flags:
    """Without points that lie off where those around them say, the farthest first.  # (N,)"""
    keep = np.ones(len(place), dtype=np.bool_)
    while keep.sum() > 5:
        rows = np.flatnonzero(keep)
        off, allowed = np.zeros(len(rows)), np.ones(len(rows))
        for n, nearest in enumerate(nearest_rows(place[rows], place[rows], ANCHORS)):
            others = rows[nearest[nearest != n]]
            if not homography.is_determined(place[others]):
                continue
            there = homography.direct(place[others], pixel[others])
            at, beside = homography.apply(there, place[rows[n]] + step_mm * np.array([[0, 0], [0.7, 0.7]]))
            off[n] = np.linalg.norm(at - pixel[rows[n]])
            allowed[n] = max(OFF_PX, OFF * float(np.linalg.norm(beside - at)))
        worst = np.argmax(off / np.maximum(allowed, USUAL_OFF * np.median(off)))
        if off[worst] <= max(allowed[worst], USUAL_OFF * np.median(off)):
            break
        keep[rows[worst]] = False
    return keep
