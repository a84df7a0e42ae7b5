"""What was named against the photo: how far faces stand apart, and whether the pattern ends where the target's does.

The codes of two solids may be the same where their proportions are not. The size of a solid no photo tells, the size
of its lattices against the distance of its faces does: with rings on two faces, all points

    c + k (p - c),    c the middle of the point's face,

are brought to their pixels by one projection, and the k that does it best is 1 if the target is the one of the file.

A row may be missing because something hides it, or because what is seen is another, smaller target: only its end
tells it from one with a row more. Each place of the first such row says what stands there, and the odds add up:

- Covers start anywhere, so that the edge of one follows a whole row, beside rings that are there, by a chance that
  shrinks with each of them.
- A cover does not leave bare white where the near half of the next ring should be, as the margin does, also where the
  board ends in the middle of that ring.
- Where part of a ring looks out from under a cover, the pattern goes on.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.detector.candidates import semi_axes_px
from calib.detector.lens import Lens
from calib.detector.place import Places, direct_projection, fixes_projection, nearest_rows
from calib.detector.plan import TargetPlan
from calib.detector.ring_marks import zone_levels
from designer.base.arrays import Array, Flags, Rows

AGREES = 0.02
"""Centres within this share of the pitch of one projection, in the median, need no other spacing."""
BETTER = 0.5
"""Another spacing brings the misfit below this share of that without; noise, which no spacing mends, does not."""
TRIED = tuple(np.linspace(math.log(0.7), math.log(1.4), 15).tolist())
"""Logarithms of k from which the best is found by a parabola."""
LEAST_FACES = 3
"""Of fewer, none can be left out."""
SMALLEST_SHARE = 0.05
FARTHER = 0.85
"""Places this times as large as all but that share of the rings found are large enough to be seen: a row or two farther
away."""
COVERED = 0.3
"""Chance that a cover which hides a place hides the next of its row as well and stops before the row further in: covers
hide several together, so that the share of places hidden elsewhere says too little."""
LEAST_SPAN = 0.5
"""A row of which less is in view, over the row beside, is what the image's edge left of it: one cover hides that."""
BARE_ODDS = 6.0
"""Logarithm of the odds that bare white is the margin, and no cover just as white: two such places are an end."""
PART_ODDS = 8.0
"""The same of part of a ring, that it is one; more, since nothing else makes rings."""
WHITE_BAND = 0.25
"""White is as bright as around the nearest rings, within this share of their contrast. Blur takes more of the white
between rings than of a margin, and more still of what they enclose: so much brighter than theirs it may be."""
GLARE_BAND = 0.1
"""White within this share of the contrast of full pixels may be washed out, so that rings may be there, unless it is no
brighter than white around the nearest rings, which are seen, and not full itself."""
NEAREST = 4
"""So many rings tell how bright white is beside them."""
ARC = 16
"""Directions in which a place is looked at, the first toward the row further in."""
NEAR_HALF = (-2, -1, 0, 1, 2)
"""Those within 45 degrees of it: the board may end in the middle of the place."""
RING_SEEN = 2
"""In so many directions next to each other white, ink and white follow each other where part of a ring is seen."""


def lattice_over_spacing(plan: TargetPlan, lens: Lens, ring: Rows, center_px: Array) -> float:
    """The logarithm of k; 0 where k = 1 fits, where no other does much better, or the projection is open."""
    straight = lens.straighten(center_px)
    has_ray = np.isfinite(straight).all(axis=1)
    ring, straight = ring[has_ray], straight[has_ray]
    face = plan.target.ring_face[ring]
    middle_mm = plan.target.target_from_face[face, :3, 3]
    offset_mm = plan.target.center_mm[ring] - middle_mm
    on_face = plan.target.center_in_face_mm[ring, :2]
    if not fixes_projection(on_face, face):
        return 0.0
    pitch_px = _pitch_px(plan, face, on_face, straight)

    def told_by(rows: Flags) -> tuple[float, float]:
        """The least misfit that a spacing tried has, and the logarithm of k by these points."""
        middle, offset, seen = middle_mm[rows], offset_mm[rows], straight[rows]
        misfits = [_misfit(middle + math.exp(value) * offset, seen) / pitch_px for value in (0.0, *TRIED)]
        best = _least(np.square(misfits[1:]))
        least = min(_misfit(middle + math.exp(best) * offset, seen) / pitch_px, *misfits)
        return least, best if misfits[0] >= AGREES and least < BETTER * misfits[0] else 0.0

    if _misfit(middle_mm + offset_mm, straight) < AGREES * pitch_px:
        return 0.0
    told = told_by(np.ones(len(face), dtype=np.bool_))[1]
    faces = np.unique(face)
    if told or len(faces) < LEAST_FACES:
        return told
    # The wrong target may bring a whole face under wrong names: the others agree best without it.
    without = [face != f for f in faces]
    told_without = [told_by(rows) for rows in without if fixes_projection(on_face[rows], face[rows])]
    return min(told_without, default=(0.0, 0.0))[1]


def _least(cost: Array) -> float:
    """Where a parabola through the least of the costs tried and its neighbours is least."""
    best = int(np.clip(np.argmin(cost), 1, len(TRIED) - 2))
    before, at, after = cost[best - 1 : best + 2]
    curvature = before - 2 * at + after
    shift = 0.5 * (before - after) / curvature if curvature > 0 else 0.0
    return float(TRIED[best] + np.clip(shift, -1, 1) * (TRIED[1] - TRIED[0]))


def _pitch_px(plan: TargetPlan, face: Rows, on_face: Array, straight: Array) -> float:
    """The usual distance of neighbours in the straight image, as far as the faces' spread tells it."""
    pitch_mm = float(np.linalg.norm(plan.target.lattice_mm[0], axis=1).min())
    spread = [
        np.linalg.norm(np.std(straight[face == f], axis=0)) / np.linalg.norm(np.std(on_face[face == f], axis=0))
        for f in np.unique(face)
        if (face == f).sum() > 2
    ]
    return pitch_mm * float(np.median(spread)) if spread else math.inf


def _misfit(point_mm: Array, straight: Array) -> float:
    """Median distance in px of pixels from the one projection that fits points best."""
    projection = direct_projection(point_mm, straight)
    mapped = point_mm @ projection[:, :3].T + projection[:, 3]
    return float(np.median(np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - straight, axis=1)))


@dataclass(frozen=True)
class FaceEnd:
    """What the sides of one face say."""

    odds: float  # logarithm of the odds that the pattern ends before the target does, and is not hidden
    is_bounded: bool  # rings were found along every side


def face_end(image: NDArray[np.generic], plan: TargetPlan, places: Places, face: int, found: Flags) -> FaceEnd:
    """Rows without a ring along the sides of a face, up to the outermost ring that was found."""
    target = plan.target
    mine = target.ring_face[places.ring] == face
    mine_found = found[mine]
    if not mine_found.any():
        return FaceEnd(0.0, False)
    mine_places = places.take(mine)
    rows_in, reach = _rows_in(plan, mine_places.ring, face, mine_found)
    is_bounded = bool((reach < 0.4).all())
    missing_along = rows_in < reach[:, None] - 0.1  # (K, N)
    missing = missing_along.any(axis=0)
    if not missing.any():
        return FaceEnd(0.0, is_bounded)
    small = semi_axes_px(mine_places.shape)[1]
    height, width = image.shape
    least_px = FARTHER * np.quantile(small[mine_found], SMALLEST_SHARE)
    plain = (small >= least_px) & mine_places.are_whole((width, height))
    at_end = np.abs(rows_in - reach[:, None]) < 0.1  # (K, N)
    first = plain & (missing_along & (rows_in > reach[:, None] - 1.1)).any(axis=0)
    further_in_px = mine_places.center_px[at_end.any(axis=0) & ~missing]
    empty, rings = (mine_places.take(np.flatnonzero(rows)) for rows in (first, mine_found))
    is_bare, is_part = _sight(image, plan, empty, further_in_px, rings)
    is_without = ~np.isin(mine_places.ring, empty.ring[is_part])
    beside = plain & _beside_found(plan, mine_places.ring, face, mine_found)
    is_wide = (missing_along & beside).sum(axis=1) >= LEAST_SPAN * (plain & at_end).sum(axis=1)
    by_chance = max(COVERED, _share(~mine_found[beside & ~missing]))
    along = missing_along[is_wide].any(axis=0) & beside & is_without
    odds = int(along.sum()) * math.log(1 / by_chance) + BARE_ODDS * int(is_bare.sum()) - PART_ODDS * int(is_part.sum())
    return FaceEnd(odds, is_bounded)


def depth(outline_mm: Array, point: Array) -> Array:
    """How far points lie inward of each side of an outline that runs counter-clockwise.  # (K, 2), (N, 2) -> (K, N)"""
    along = np.roll(outline_mm, -1, axis=0) - outline_mm
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(np.einsum("kc,knc->kn", inward, point[None] - outline_mm[:, None]))


def _rows_in(plan: TargetPlan, ring: Rows, face: int, found: Flags) -> tuple[Array, Array]:
    """How many pitches places lie inward of each side's first row, and the least of a found one.  # (K, N), (K,)"""
    target = plan.target
    outline = target.outline_mm[face]
    outermost = depth(outline, target.center_in_face_mm[target.ring_face == face, :2]).min(axis=1)
    pitch_mm = float(np.linalg.norm(target.lattice_mm[face], axis=1).min())
    rows_in = (depth(outline, target.center_in_face_mm[ring, :2]) - outermost[:, None]) / pitch_mm
    return rows_in, np.asarray(rows_in[:, found].min(axis=1))


def _beside_found(plan: TargetPlan, ring: Rows, face: int, found: Flags) -> Flags:
    """Places with a neighbour on the lattice that was found.  # (N,)"""
    is_found = np.zeros(plan.target.ring_count + 1, dtype=np.bool_)  # the last stands for "nothing there"
    is_found[ring[found]] = True
    near = plan.target.ring_index[ring][:, None] + plan.lattice.move[None]
    return np.asarray(is_found[plan.rows_at(face, near.reshape(-1, 2))].reshape(near.shape[:2]).any(axis=1))


def _sight(
    image: NDArray[np.generic], plan: TargetPlan, places: Places, last_row_px: Array, rings: Places
) -> tuple[Flags, Flags]:
    """Whether the near half of places is bare white, and whether part of a ring is seen there.  # (N,), (N,)"""
    white_around = 0.4 + 0.6 * plan.limit
    known = zone_levels(image, np.hstack([rings.center_px, rings.shape]), ratio=plan.ratio, around=white_around)[:, :3]
    is_known = np.isfinite(known).all(axis=1)
    if not (is_known.any() and len(places.ring) and len(last_row_px)):
        return np.zeros(len(places.ring), dtype=np.bool_), np.zeros(len(places.ring), dtype=np.bool_)
    near = known[is_known][nearest_rows(places.center_px, rings.center_px[is_known], NEAREST)]  # (N, NEAREST, 3)
    enclosed, ink, white = np.median(near, axis=1).T[:, :, None]
    contrast = np.maximum(white - ink, 1e-9)
    further_in_px = last_row_px[nearest_rows(places.center_px, last_row_px)[:, 0]]
    radii = (0.45 * plan.ratio, 0.5 * (1 + plan.ratio), 0.25 * plan.ratio + 0.75, white_around)
    hole, middle, outer, around = (_arc_levels(image, places, further_in_px, rho) for rho in radii)
    half = np.stack([np.median(level[:, NEAR_HALF], axis=1) for level in (middle, around)])  # (2, N)
    brighter = half - white[:, 0]
    band = WHITE_BAND * contrast[:, 0]
    is_white = (brighter > -band) & (brighter < band + np.maximum(white - enclosed, 0)[:, 0])
    full = _full_scale(image)
    not_washed_out = np.maximum(full - GLARE_BAND * contrast[:, 0], near[:, :, 2].max(axis=1))
    is_full = half > np.minimum(not_washed_out, full - 1)
    is_ink = np.minimum(middle, outer) < 0.5 * (ink + white)
    is_ring = is_ink & (np.abs(np.stack([hole, around]) - white) < WHITE_BAND * contrast).all(axis=0)
    in_a_row = np.all([np.roll(is_ring, step, axis=1) for step in range(RING_SEEN)], axis=0)
    is_part = in_a_row.any(axis=1)
    return np.asarray(is_white.all(axis=0) & ~is_full.any(axis=0) & ~is_part), np.asarray(is_part)


def _arc_levels(image: NDArray[np.generic], places: Places, toward_px: Array, rho: float) -> Array:
    """Grey levels around places, so many outer radii from their centres, from the directions of points on.  # (N, ARC)

    A place's shape takes steps in px to radii, so that the circle of radius rho in the plane is what E takes to it.
    """
    e00, e10, e11 = places.shape.T
    across, down = (toward_px - places.center_px).T
    turn = 2 * math.pi / ARC * np.arange(ARC)
    angle = np.arctan2(e10 * across + e11 * down, e00 * across)[:, None] + turn
    du = rho * np.cos(angle) / e00[:, None]
    dv = (rho * np.sin(angle) - e10[:, None] * du) / e11[:, None]
    height, width = image.shape
    u = np.clip(np.rint(places.center_px[:, :1] + du).astype(np.int64), 0, width - 1)
    v = np.clip(np.rint(places.center_px[:, 1:] + dv).astype(np.int64), 0, height - 1)
    return np.asarray(image[v, u], dtype=np.float64)


def _full_scale(image: NDArray[np.generic]) -> float:
    """The level at which pixels are full: all bits set, of eight or as many as are used."""
    if not np.issubdtype(image.dtype, np.integer):
        return math.inf
    return float(2 ** max(8, int(image.max()).bit_length()) - 1)


def _share(flags: Flags) -> float:
    """The share that a few draws tell (Laplace's rule of succession), neither 0 nor 1."""
    return (int(flags.sum()) + 1) / (len(flags) + 2)
