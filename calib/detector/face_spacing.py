"""How far a solid's faces stand apart for the pitch of their rings, as the photo shows it.

The codes of two solids may be the same where their proportions are not. The size of a solid no photo tells, the size
of its lattices against the distance of its faces does: with rings on two faces, all points

    c + k (p - c),    c the middle of the point's face,

are brought to their pixels by one projection, and the k that does it best is 1 if the target is the one of the file.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detector.lens import Lens
from calib.detector.place import direct_projection, fixes_projection
from calib.detector.plan import TargetPlan

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]

AGREES = 0.02
"""Centres within this share of the pitch of one projection, in the median, need no other spacing."""
BETTER = 0.5
"""Another spacing brings the misfit below this share of that without; noise, which no spacing mends, does not."""
TRIED = tuple(np.linspace(math.log(0.7), math.log(1.4), 15).tolist())
"""Logarithms of k from which the best is found by a parabola."""
LEAST_FACES = 3
"""Of fewer, none can be left out."""


def lattice_over_spacing(plan: TargetPlan, lens: Lens, ring: Integers, center_px: Floats) -> float:
    """The logarithm of k; 0 where k = 1 fits, where no other does much better, or the projection is open.

    Args:
        plan: the target's.
        lens: straightens the image.
        ring: rows of the target.  # (N,)
        center_px: where they were measured.  # (N, 2)
    """
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


def _least(cost: Floats) -> float:
    """Where a parabola through the least of the costs tried and its neighbours is least."""
    best = int(np.clip(np.argmin(cost), 1, len(TRIED) - 2))
    before, at, after = cost[best - 1 : best + 2]
    curvature = before - 2 * at + after
    shift = 0.5 * (before - after) / curvature if curvature > 0 else 0.0
    return float(TRIED[best] + np.clip(shift, -1, 1) * (TRIED[1] - TRIED[0]))


def _pitch_px(plan: TargetPlan, face: Integers, on_face: Floats, straight: Floats) -> float:
    """The usual distance of neighbours in the straight image, as far as the faces' spread tells it."""
    pitch_mm = float(np.linalg.norm(plan.target.lattice_mm[0], axis=1).min())
    spread = [
        np.linalg.norm(np.std(straight[face == f], axis=0)) / np.linalg.norm(np.std(on_face[face == f], axis=0))
        for f in np.unique(face)
        if (face == f).sum() > 2
    ]
    return pitch_mm * float(np.median(spread)) if spread else math.inf


def _misfit(point_mm: Floats, straight: Floats) -> float:
    """Median distance in px of pixels from the one projection that fits points best."""
    projection = direct_projection(point_mm, straight)
    mapped = point_mm @ projection[:, :3].T + projection[:, 3]
    return float(np.median(np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - straight, axis=1)))
