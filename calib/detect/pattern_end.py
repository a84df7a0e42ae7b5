"""Whether the pattern ends where the target's does: rows along the sides that the target has and the photo has not.

A row may be missing because something hides it, or because what is seen is another, smaller target: only its end
tells it from one with a row more. Two things speak for an end. Covers start anywhere, so that the edge of one follows
a whole row, beside rings that are there, by a chance that shrinks with each of them; and where a ring should be, a
cover does not look like the bare white of the margin.
"""

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detect.candidates import semi_axes_px
from calib.detect.marks import zone_levels
from calib.detect.place import Places
from calib.detect.plan import TargetPlan

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]

SMALLEST_SHARE = 0.05
FARTHER = 0.85
"""Places this times as large as all but that share of the rings found are large enough to be seen: a row or two farther
away."""
COVERED = 0.3
"""Chance that a cover which hides a place hides the next of its row as well and stops before the row further in: covers
hide several together, so that the share of places hidden elsewhere says too little."""
LEAST_SPAN = 0.5
"""A row of which less is in view, over the row beside, is what the image's edge left of it: one cover hides that."""
BARE_BAND = 0.2
"""Bare white is as bright as the white around the nearest rings, within this share of their contrast ..."""
GLARE_BAND = 0.1
"""... and brighter than the brightest of them by no more than this, which noise makes: more is washed out."""
NEAREST = 4
"""So many rings tell how bright white is beside them."""
CHUNK = 256
"""Places whose distances from all rings are held at a time."""


@dataclass(frozen=True)
class FaceEnd:
    """What the sides of one face say."""

    odds: float  # logarithm of the odds against rows missing by chance, where rings beside them are there
    empty: int  # places in such rows that would be plain to see
    bare: int  # of these, those that are bare white
    is_bounded: bool  # rings were found along every side


def face_end(image: NDArray[np.generic], plan: TargetPlan, places: Places, face: int, found: Flags) -> FaceEnd:
    """Rows without a ring along the sides of a face, up to the outermost ring that was found.

    Args:
        image: grey levels.  # (H, W)
        plan: the target's.
        places: where its features must be.
        face: which face.
        found: which of the places hold what they should.  # (N,)
    """
    target = plan.target
    mine = target.ring_face[places.ring] == face
    mine_found = found[mine]
    if not mine_found.any():
        return FaceEnd(0.0, 0, 0, False)
    mine_places = places.take(mine)
    rows_in, reach = _rows_in(plan, mine_places.ring, face, mine_found)
    is_bounded = bool((reach < 0.4).all())
    missing_along = rows_in < reach[:, None] - 0.1  # (K, N)
    missing = missing_along.any(axis=0)
    if not missing.any():
        return FaceEnd(0.0, 0, 0, is_bounded)
    small = semi_axes_px(mine_places.shape)[1]
    height, width = image.shape
    least_px = FARTHER * np.quantile(small[mine_found], SMALLEST_SHARE)
    plain = (small >= least_px) & mine_places.are_whole((width, height))
    beside = plain & _beside_found(plan, mine_places.ring, face, mine_found)
    last_row = plain & (np.abs(rows_in - reach[:, None]) < 0.1)
    is_wide = (missing_along & beside).sum(axis=1) >= LEAST_SPAN * last_row.sum(axis=1)
    by_chance = max(COVERED, _share(~mine_found[beside & ~missing]))
    odds = int((missing_along[is_wide].any(axis=0) & beside).sum()) * math.log(1 / by_chance)
    empty = mine_places.take(plain & missing)
    bare = _are_bare(image, plan, empty, mine_places.take(mine_found))
    return FaceEnd(odds, len(empty.ring), int(bare.sum()), is_bounded)


def depth(outline_mm: Floats, point: Floats) -> Floats:
    """How far points lie inward of each side of an outline that runs counter-clockwise.  # (K, 2), (N, 2) -> (K, N)"""
    along = np.roll(outline_mm, -1, axis=0) - outline_mm
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.einsum("kc,knc->kn", inward, point[None] - outline_mm[:, None]))


def _rows_in(plan: TargetPlan, ring: Integers, face: int, found: Flags) -> tuple[Floats, Floats]:
    """How many pitches places lie inward of each side's first row, and the least of a found one.  # (K, N), (K,)"""
    target = plan.target
    outline = target.outline_mm[face]
    outermost = depth(outline, target.center_in_face_mm[target.ring_face == face, :2]).min(axis=1)
    pitch_mm = float(np.linalg.norm(target.lattice_mm[face], axis=1).min())
    rows_in = (depth(outline, target.center_in_face_mm[ring, :2]) - outermost[:, None]) / pitch_mm
    return rows_in, np.asarray(rows_in[:, found].min(axis=1))


def _beside_found(plan: TargetPlan, ring: Integers, face: int, found: Flags) -> Flags:
    """Places with a neighbour on the lattice that was found.  # (N,)"""
    is_found = np.zeros(plan.target.ring_count + 1, dtype=np.bool_)  # the last stands for "nothing there"
    is_found[ring[found]] = True
    near = plan.target.ring_index[ring][:, None] + plan.lattice.move[None]
    return np.asarray(is_found[plan.rows_at(face, near.reshape(-1, 2))].reshape(near.shape[:2]).any(axis=1))


def _are_bare(image: NDArray[np.generic], plan: TargetPlan, empty: Places, rings: Places) -> Flags:
    """Whether places are as white as the board beside the nearest rings, and not washed out.  # (N,)"""
    known = _levels(image, plan, rings)
    is_known = np.isfinite(known).all(axis=1)
    if not is_known.any() or not len(empty.ring):
        return np.zeros(len(empty.ring), dtype=np.bool_)
    near = known[is_known][_nearest(empty.center_px, rings.center_px[is_known])]  # (N, NEAREST, 3)
    _, ink, white = np.median(near, axis=1).T
    contrast = np.maximum(white - ink, 1e-9)
    level = _levels(image, plan, empty).T
    is_white = (np.abs(level - white) < BARE_BAND * contrast).all(axis=0)
    brightest = level.max(axis=0)
    is_washed_out = brightest > near[:, :, 2].max(axis=1) + GLARE_BAND * contrast
    return np.asarray(is_white & ~is_washed_out & (brightest < _full_scale(image)))


def _nearest(point: Floats, other: Floats) -> Integers:
    """Rows of the other points nearest to each.  # (N, 2), (M, 2) -> (N, at most NEAREST)"""
    count = min(NEAREST, len(other))
    near = [
        np.argpartition(np.hypot(*(part[:, None] - other[None]).transpose(2, 0, 1)), count - 1, axis=1)[:, :count]
        for part in (point[start : start + CHUNK] for start in range(0, len(point), CHUNK))
    ]
    return np.concatenate(near)


def _full_scale(image: NDArray[np.generic]) -> float:
    """The level at which pixels are full: all bits set, of eight or as many as are used."""
    if not np.issubdtype(image.dtype, np.integer):
        return math.inf
    return float(2 ** max(8, int(image.max()).bit_length()) - 1)


def _levels(image: NDArray[np.generic], plan: TargetPlan, places: Places) -> Floats:
    """Grey levels of centre, ink and the white around.  # (N, 3)"""
    ellipse = np.hstack([places.center_px, places.shape])
    return zone_levels(image, ellipse, ratio=plan.ratio, around=0.4 + 0.6 * plan.limit)[:, :3]


def _share(flags: Flags) -> float:
    """The share that a few draws tell (Laplace's rule of succession), neither 0 nor 1."""
    return (int(flags.sum()) + 1) / (len(flags) + 2)
