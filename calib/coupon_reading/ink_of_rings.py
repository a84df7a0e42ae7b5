"""How much wider the ink of a print is than designed, from the rings of photos of it, at no known scale.

Ink that runs by b at each edge turns inner over outer radius r / R into (r - b) / (R + b) = k, so that a ring seems to
have run by (r - k R) / (1 + k) = b, whatever its distance. What tone curve, sharpening and lens do to edges is alike
for all ink: d px. Around an outline with semi-axes p, q (px) the fitted ratio takes that for d R w of bleed, with

    w = ((p^-1/2 + q^-1/2) / 2)^2,

within 1 % of the least squares of displaced outlines up to 1 : 4. Bleed is the same in mm on large rings and small
ones, optics the same in px, or in blurs. So

    (r - k R) / (1 + k) = b + (c s + e) R w,    s the ring's own blur (px),

over all rings of all photos tells b, c and e apart as well as sizes and slants of rings differ; where they are all
alike, what is not known of c and e is in the standard deviation of b.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.core.types import Detections
from calib.coupon_reading.result import LEAST_OFFSET_MM, STEP_MM, UNSEEN_BLURS
from calib.measure_target.deviations import Estimate
from designer.base.arrays import Array, Rows
from designer.base.marks import Count, Number
from designer.target import TargetGeometry

PRIOR_SIGMA = np.array([1.0, 0.5, 0.1])
"""Of b (mm: anything), of c (blurs) and e (px), before anything was seen. A power of 2.2 moves edges by nearly half a
blur (`calib.coupon_reading.edges`); that other processing moves them by .1 px is an assumption."""
LEAST_BLURS = 6.0
"""Of the stroke and the hole of a ring, where it is narrowest: with less room two edges are one, which a tone curve
shifts otherwise (of rendered photos, gamma 2.2: by a fifth of a blur at 3 blurs, by a fiftieth at 6)."""
LEAST_VIEWS, LEAST_RINGS = 5, 30
ROUNDS = 10
ODD = 3.0
"""Residuals over the usual from which on a ring counts less (Huber)."""


@dataclass(frozen=True)
class InkBleed:
    """What the rings of all photos tell of the ink."""

    bleed_mm: Estimate  # by which ink is wider at each edge than designed
    seen_mm: Number  # likewise as the usual ring looks, with what optics add
    rings: Count  # sightings that it rests on
    views: Count

    @property
    def more_offset_mm(self) -> float:
        """What to add to the ink offset of this print for the next; 0: bleed is no more than noise, or too little."""
        bleed = self.bleed_mm
        if not bleed.is_significant or abs(bleed.value) < LEAST_OFFSET_MM:
            return 0.0
        return round(-round(bleed.value / STEP_MM) * STEP_MM, 6)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Sightings of rings, N of them."""

    seen_mm: Array  # (N,) seeming bleed
    by_unknown: Array  # (N, 3) derivatives by b, c, e
    view: Rows  # (N,)
    ring: Rows  # (N,)


def ink_of_rings(seen: Sequence[Detections], target: TargetGeometry) -> InkBleed | None:
    """What photos of one camera tell; None: too few rings are large and sharp enough, or their edges are not known.

    >>> ink_of_rings([detector.detect(photo) for photo in photos], target).bleed_mm

    Args:
        seen: in each photo.
        target: as designed.
    """
    rows = _rows(seen, target)
    views = len(np.unique(rows.view))
    if views < LEAST_VIEWS or len(rows.view) < LEAST_RINGS:
        return None
    found, covariance = _fit(rows)
    unseen_mm = UNSEEN_BLURS * float(np.median(rows.by_unknown[:, 1]))
    bleed = Estimate(float(found[0]), math.hypot(math.sqrt(covariance[0, 0]), unseen_mm))
    return InkBleed(bleed, float(np.median(rows.seen_mm)), len(rows.view), views)


def ink_of_cameras(of_each: Sequence[InkBleed]) -> InkBleed | None:
    """What several cameras tell together: what is not seen may be wrong in all alike, so sigmas do not average out."""
    if not of_each:
        return None
    weight = np.array([one.bleed_mm.sigma**-2 for one in of_each])
    share = weight / weight.sum()
    bleed = Estimate(
        float(share @ [one.bleed_mm.value for one in of_each]), float(share @ [one.bleed_mm.sigma for one in of_each])
    )
    return InkBleed(
        bleed, float(share @ [one.seen_mm for one in of_each]),
        sum(one.rings for one in of_each), sum(one.views for one in of_each),
    )  # fmt: skip


def _rows(seen: Sequence[Detections], target: TargetGeometry) -> _Rows:
    """The rings that are large and sharp enough."""
    view = np.repeat(np.arange(len(seen)), [len(one.ring) for one in seen])
    ring = np.concatenate([np.zeros(0, dtype=np.int64), *(one.ring for one in seen)])
    edges = np.concatenate([np.zeros((0, 5)), *(one.edges for one in seen)])
    axes, ratio, blur = edges[:, :2], edges[:, 3], edges[:, 4]
    with np.errstate(invalid="ignore"):  # nan: not known
        narrowest = np.minimum(ratio, 1 - ratio) * axes[:, 1]
        is_good = (ratio > 0) & (target.radius_inner_mm[ring] > 0) & (blur > 0) & (narrowest > LEAST_BLURS * blur)
    view, ring, axes, ratio, blur = view[is_good], ring[is_good], axes[is_good], ratio[is_good], blur[is_good]
    outer, inner = target.radius_outer_mm[ring], target.radius_inner_mm[ring]
    mm_per_px = outer * ((1 / np.sqrt(axes)).mean(axis=1)) ** 2
    by_unknown = np.column_stack([np.ones(len(ring)), blur * mm_per_px, mm_per_px])
    return _Rows((inner - ratio * outer) / (1 + ratio), by_unknown, view, ring)


def _fit(rows: _Rows) -> tuple[Array, Array]:
    """b, c, e and their covariance, to which the rings of one photo, and the sightings of one ring, err alike.

    Rings weigh as their edges do in px. The covariance is the sandwich of clusters (Liang and Zeger, Biometrika 73,
    1986), of photos and of rings, one added to the other.
    """
    prior = np.diag(PRIOR_SIGMA**-2)
    weight = rows.by_unknown[:, 2] ** -2
    found: Array = np.zeros(3)
    trust: Array = np.ones(len(weight))
    sigma_px = 0.1
    for _ in range(ROUNDS):
        weighted = rows.by_unknown * (trust * weight / sigma_px**2)[:, None]
        found = np.asarray(np.linalg.solve(weighted.T @ rows.by_unknown + prior, weighted.T @ rows.seen_mm), np.float64)
        left_px = (rows.seen_mm - rows.by_unknown @ found) * np.sqrt(weight)
        sigma_px = max(1.4826 * float(np.median(np.abs(left_px))), 1e-4)
        trust = 1 / np.maximum(1.0, np.abs(left_px) / (ODD * sigma_px))
    weighted = rows.by_unknown * (trust * weight / sigma_px**2)[:, None]
    spread = _prior_and_clusters(rows, weighted * (rows.seen_mm - rows.by_unknown @ found)[:, None], prior)
    inverse = np.linalg.inv(weighted.T @ rows.by_unknown + prior)
    return found, inverse @ spread @ inverse


def _prior_and_clusters(rows: _Rows, score: Array, prior: Array) -> Array:
    """How the scores (N, 3) of clusters scatter.  # (3, 3)"""
    spread = prior
    for cluster in (rows.view, rows.ring):
        _, row = np.unique(cluster, return_inverse=True)
        count = int(row.max()) + 1
        sums = np.column_stack([np.bincount(row, one) for one in score.T])
        spread = spread + sums.T @ sums * count / max(count - score.shape[1], 1)
    return spread
