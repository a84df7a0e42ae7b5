"""Whether the pattern ends where the target's does: rows along the sides that the target has and the photo has not.

A row may be missing because something hides it, or because what is seen is another, smaller target: only its end
tells it from one with a row more. Two things speak for an end. Covers start anywhere, so that a whole row hidden
beside rings that are there is a chance that shrinks with each of them; and where a ring should be, a cover does not
look like the bare white of the margin.
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
BARE_BAND = 0.2
"""Bare white is as bright as the white around the nearest rings, within this share of their contrast."""
NEAREST = 4
"""So many rings tell how bright white is beside them."""


@dataclass(frozen=True)
class FaceEnd:
    """What the sides of one face say."""

    odds: float  # logarithm of the odds against rows missing by chance, where rings beside them are there
    bare: int  # places in such rows that are bare white
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
        return FaceEnd(0.0, 0, False)
    mine_places = places.take(mine)
    missing, is_bounded = _missing_rows(plan, mine_places.ring, face, mine_found)
    if not missing.any():
        return FaceEnd(0.0, 0, is_bounded)
    small = semi_axes_px(mine_places.shape)[1]
    height, width = image.shape
    least_px = FARTHER * np.quantile(small[mine_found], SMALLEST_SHARE)
    plain = (small >= least_px) & mine_places.are_whole((width, height))
    beside = plain & _beside_found(plan, mine_places.ring, face, mine_found)
    hidden = beside & ~missing
    odds = -int((beside & missing).sum()) * math.log(_share(~mine_found[hidden]))
    bare = _are_bare(image, plan, mine_places.take(plain & missing), mine_places.take(mine_found))
    return FaceEnd(odds, int(bare.sum()), is_bounded)


def depth(outline_mm: Floats, point: Floats) -> Floats:
    """How far points lie inward of each side of an outline that runs counter-clockwise.  # (K, 2), (N, 2) -> (K, N)"""
    along = np.roll(outline_mm, -1, axis=0) - outline_mm
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.einsum("kc,knc->kn", inward, point[None] - outline_mm[:, None]))


def _missing_rows(plan: TargetPlan, ring: Integers, face: int, found: Flags) -> tuple[Flags, bool]:
    """Places between a side and the found ring nearest to it, and whether rings reach all sides.  # (N,)"""
    target = plan.target
    outline = target.outline_mm[face]
    outermost = depth(outline, target.center_in_face_mm[target.ring_face == face, :2]).min(axis=1)
    pitch_mm = float(np.linalg.norm(target.lattice_mm[face], axis=1).min())
    rows_in = (depth(outline, target.center_in_face_mm[ring, :2]) - outermost[:, None]) / pitch_mm
    reach = rows_in[:, found].min(axis=1)
    return np.asarray((rows_in < reach[:, None] - 0.1).any(axis=0)), bool((reach < 0.4).all())


def _beside_found(plan: TargetPlan, ring: Integers, face: int, found: Flags) -> Flags:
    """Places with a neighbour on the lattice that was found.  # (N,)"""
    is_found = np.zeros(plan.target.ring_count + 1, dtype=np.bool_)  # the last stands for "nothing there"
    is_found[ring[found]] = True
    near = plan.target.ring_index[ring][:, None] + plan.lattice.move[None]
    return np.asarray(is_found[plan.rows_at(face, near.reshape(-1, 2))].reshape(near.shape[:2]).any(axis=1))


def _are_bare(image: NDArray[np.generic], plan: TargetPlan, empty: Places, rings: Places) -> Flags:
    """Whether places are as white as the board beside the nearest rings, and not washed out.  # (N,)"""
    if not len(empty.ring):
        return np.zeros(0, dtype=np.bool_)
    distance = np.linalg.norm(empty.center_px[:, None] - rings.center_px[None], axis=2)
    near = np.argsort(distance, axis=1, kind="stable")[:, :NEAREST]
    used, at = np.unique(near, return_inverse=True)
    _, ink, white = np.nanmedian(_levels(image, plan, rings.take(used))[at.reshape(near.shape)], axis=1).T
    centre, ring, around = _levels(image, plan, empty).T
    level = np.stack([centre, ring, around])
    off = np.abs(level - white) / np.maximum(white - ink, 1e-9)
    return np.asarray((off < BARE_BAND).all(axis=0) & (level.max(axis=0) < float(image.max())))


def _levels(image: NDArray[np.generic], plan: TargetPlan, places: Places) -> Floats:
    """Grey levels of centre, ink and the white around.  # (N, 3)"""
    ellipse = np.hstack([places.center_px, places.shape])
    return zone_levels(image, ellipse, ratio=plan.ratio, around=0.4 + 0.6 * plan.limit)[:, :3]


def _share(flags: Flags) -> float:
    """The share that a few draws tell (Laplace's rule of succession), neither 0 nor 1."""
    return (int(flags.sum()) + 1) / (len(flags) + 2)
