"""Distances between triangulated points against known ones: what a check object says of a rig's millimetres.

All pairs of points of a frame are compared. Errors of a rig are shared by all points, and most of them cancel in a
distance, so each distance has a standard deviation of its own: by the noise of both ends, and by each of the rig's
independent errors.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.cameras.rig import Rig
from calib.core.parallel import one_thread
from calib.space.propagate import (
    PointSightings,
    Rays,
    calibration_factor,
    keep_places,
    propagate,
    whitening,
    with_noise,
)
from calib.space.triangulate import TriangulatedPoints, triangulate_points
from designer.base.arrays import Array, Rows
from designer.base.marks import Count, Gap, Length
from designer.base.words import figure

NOTICEABLE = 1.05
"""Times as much scatter as stated, that is taken into account."""
MOST_PAIRS = 40_000
BINS = 6
WITHIN_95 = 1.959964
MOST_BINS = 100


@dataclass(frozen=True)
class LengthBin:
    """Pairs of about the same distance."""

    from_mm: float
    to_mm: float
    pairs: Count
    mean_mm: Gap  # measured - known
    rms_mm: Gap
    expected_mm: Gap  # root mean square of the stated standard deviations
    within_95: Gap  # share of the pairs within 95 % limits


@dataclass(frozen=True)
class LengthCheck:
    """Measured distances of a check object against its known ones."""

    object_name: str
    points: Count
    frames: Count
    pairs: Count
    every: Count  # one pair of so many was looked at
    rms_mm: Gap  # of measured - known
    expected_mm: Gap
    expected_by_noise_mm: Gap
    ratio: Gap  # root mean square of errors over their own standard deviations; 1 where these are right
    within_95: Gap
    scale: Gap  # measured over known, less one
    scale_sigma: Gap
    bins: Annotated[tuple[LengthBin, ...], Length(0, MOST_BINS)]


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of points with their distances."""

    first: Rows  # (Q,)
    second: Rows  # (Q,)
    direction: Array  # (Q, 3) from first to second
    length_mm: Array  # (Q,) measured
    known_mm: Array  # (Q,)
    every: int


def triangulate_target(rig: Rig, seen: PointSightings, noise_px: Array | None, *, rejects: bool) -> TriangulatedPoints:
    """The points of a target: with the noise that was given, or as their centres state it, or as much more as shows."""
    if noise_px is not None:
        return triangulate_points(rig, replace(seen, cov_px2=None), noise_px, rejects=rejects)
    found = triangulate_points(rig, seen, rejects=rejects)
    if seen.cov_px2 is None or not found.scale > NOTICEABLE:
        return found
    remark = f"centres scatter {figure(found.scale, 3)} times as much as they state; the sigmas are of what they do"
    more = replace(seen, cov_px2=seen.cov_px2 * found.scale**2, remarks=(*seen.remarks, remark))
    return triangulate_points(rig, more, rejects=rejects)


@one_thread
def check_lengths(found: TriangulatedPoints, known_mm: Array, object_name: str) -> LengthCheck | None:
    """Compare distances with known ones; None where no frame has two points.

    Args:
        found: the triangulated points.
        known_mm: where the points (K, 3) of `sightings.point_names` lie on the check object.
        object_name: what it is called.
    """
    places = np.flatnonzero(found.is_placed)
    pairs = _pairs(found, known_mm, places)
    if pairs is None:
        return None
    noise, by_calibration = _spread(found, places)
    ends = np.einsum("qi,qij,qj->q", pairs.direction, noise[pairs.first] + noise[pairs.second], pairs.direction)
    shared = np.zeros(len(ends))
    if by_calibration is not None:
        moved = by_calibration[pairs.second] - by_calibration[pairs.first]
        shared = (np.einsum("qi,qir->qr", pairs.direction, moved) ** 2).sum(axis=1)
    error, variance = pairs.length_mm - pairs.known_mm, ends + shared
    off = np.abs(error) / np.sqrt(variance)
    scale, scale_sigma = _scale(pairs, noise, by_calibration)
    return LengthCheck(
        object_name, len(places), len(np.unique(found.sightings.frame[places])), len(error), pairs.every, _rms(error),
        float(np.sqrt(variance.mean())), float(np.sqrt(ends.mean())), _rms(off), float((off < WITHIN_95).mean()),
        scale, scale_sigma, _bins(pairs.known_mm, error, variance),
    )  # fmt: skip


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _pairs(found: TriangulatedPoints, known_mm: Array, places: Rows) -> _Pairs | None:
    """Pairs within each frame, as rows of `places`; evenly some of very many."""
    frame, points = found.sightings.frame[places], found.sightings.point[places]
    groups = [np.flatnonzero(frame == one) for one in np.unique(frame)]
    total = sum(len(group) * (len(group) - 1) // 2 for group in groups)
    if not total:
        return None
    every = -(-total // MOST_PAIRS)
    upper = [np.triu_indices(len(group), 1) for group in groups]
    first = np.concatenate([group[i] for group, (i, _) in zip(groups, upper, strict=True)])[::every]
    second = np.concatenate([group[j] for group, (_, j) in zip(groups, upper, strict=True)])[::every]
    across = found.position_mm[places[second]] - found.position_mm[places[first]]
    length = np.linalg.norm(across, axis=1)
    known = np.linalg.norm(known_mm[points[second]] - known_mm[points[first]], axis=1)
    return _Pairs(first, second, across / length[:, None], length, known, every)


def _spread(found: TriangulatedPoints, places: Rows) -> tuple[Array, Array | None]:
    """Noise (N, 3, 3) of some points, and how each of the rig's independent errors moves them (N, 3, R)."""
    keep = np.zeros(found.sightings.count, dtype=bool)
    keep[places] = True
    seen = keep_places(found.sightings, keep)
    cov = with_noise(seen, found.noise_px)
    used = found.is_used[keep[found.sightings.place]]
    rays = Rays(seen.count, seen.camera[used], seen.place[used], whitening(cov[used]))
    spread = propagate(found.rig, calibration_factor(found.rig), found.position_mm[places], rays)
    return spread.noise_mm2, spread.by_calibration


def _scale(pairs: _Pairs, noise: Array, by_calibration: Array | None) -> tuple[float, float]:
    """The factor that fits measured to known distances best, less one, and its standard deviation."""
    weight = pairs.known_mm / (pairs.known_mm**2).sum()
    scale = float((weight * (pairs.length_mm - pairs.known_mm)).sum())
    pull = np.zeros((len(noise), 3))
    np.add.at(pull, pairs.second, weight[:, None] * pairs.direction)
    np.add.at(pull, pairs.first, -weight[:, None] * pairs.direction)
    variance = float(np.einsum("ni,nij,nj->", pull, noise, pull))
    if by_calibration is not None:
        variance += float((np.einsum("ni,nir->r", pull, by_calibration) ** 2).sum())
    return scale, float(np.sqrt(variance))


def _bins(known_mm: Array, error_mm: Array, variance_mm2: Array) -> tuple[LengthBin, ...]:
    """By length, as many pairs in each."""
    edges = np.unique(np.quantile(known_mm, np.linspace(0, 1, BINS + 1)))
    if len(edges) < 2:
        edges = np.array([known_mm.min(), known_mm.max()])
    place = np.clip(np.searchsorted(edges, known_mm, side="right") - 1, 0, len(edges) - 2)
    bins = []
    for row in range(len(edges) - 1):
        error, variance = error_mm[place == row], variance_mm2[place == row]
        if len(error):
            within = float((np.abs(error) < WITHIN_95 * np.sqrt(variance)).mean())
            bins.append(LengthBin(
                float(edges[row]), float(edges[row + 1]), len(error), float(error.mean()), _rms(error),
                float(np.sqrt(variance.mean())), within,
            ))  # fmt: skip
    return tuple(bins)
