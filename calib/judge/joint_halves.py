"""A rig solved from halves of its frames: whether its joint covariance can be believed, and whether anything moved.

Frames are halved in two ways. By turns: the frames are ordered by how the target was held, and taken first, second,
second, first, so that both halves are alike; the order they were taken in does not matter. In order: the first against
the last, which shows a camera that was pushed or a focus that crept meanwhile. If all is noise, both differ by what the
covariances of the halves say.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import skew, steps_between
from calib.core.types import RigObservations, keep_frames, keep_photos, keep_sightings, sightings_per_view
from calib.judge.halves import PER_RIGHT_ANGLE, PLACE, NoHalves, PairApart, RigHalves, RigSplit, SplitKind, by_turns
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import relative
from calib.rigs.result import RigCalibration, as_given
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import mechanism_prior
from designer.base.arrays import Flags
from designer.base.errors import InputError

HalfSolver = Callable[[Flags], RigCalibration]
"""Solves the rig of some frames (V,) as all of them were solved; InputError: they do not do."""

LEAST_FRAMES = 6
"""Three of each half."""
BY_TURNS, MANY_FRAMES = 2, 200
"""Ways of halving by turns, along the directions in which the held targets differ most; of more frames one."""


def rig_halves(found: RigCalibration, solve_half: HalfSolver) -> RigHalves | NoHalves:
    """Compare solutions of halves of the frames; halves that do not determine the rig are skipped."""
    count = len(found.rig_from_target)
    if found.status != "converged":
        return NoHalves("the frames do not determine the rig, so neither does half of them")
    if count < LEAST_FRAMES:
        return NoHalves(f"{count} frames cannot be halved; take {LEAST_FRAMES} or more")
    splits, reasons = [], []
    for kind, is_first in ways_to_halve(found):
        try:
            halves = solve_half(is_first), solve_half(~is_first)
        except InputError as error:
            reasons.append(f"half of the frames do not do: {error}")
            continue
        if any(half.status != "converged" for half in halves):
            reasons.append("half of the frames do not determine the rig")
        elif (split := _compared(kind, found, *halves)) is not None:
            splits.append(split)
    if not splits:
        return NoHalves(reasons[0] if reasons else "no pose was estimated, so none can differ")
    return RigHalves(tuple(splits))


def enlarged(found: RigCalibration, halves: RigHalves | NoHalves, *, as_target: bool = False) -> RigCalibration:
    """The rig with the noise's part of its covariances as halves of the frames show it, or as they place the target."""
    if isinstance(halves, NoHalves):
        return found
    square = (halves.target_factor if as_target else halves.factor) ** 2
    if square == 1:
        return found
    sigma = found.delay_sigma_s
    return replace(
        found, covariance=square * found.covariance, frame_covariance=square * found.frame_covariance,
        pose_covariance=tuple(square * one for one in found.pose_covariance),
        delay_sigma_s=None if sigma is None else np.sqrt(square) * sigma,
    )  # fmt: skip


def half_solver(found: RigCalibration, choices: Sequence[CameraChoice], options: RigOptions) -> HalfSolver:
    """What solves the rig of some of a solution's frames as all were solved: what all left out stays out.

    The cameras found are only where each half starts from.
    """
    seen = without_outliers(found)
    near = [replace(choice, given=camera) for choice, camera in zip(choices, found.cameras, strict=True)]

    def solve_half(rows: Flags) -> RigCalibration:
        half, carrier = keep_frames(seen, rows), options.carrier
        for name, own in zip(half.camera_names, half.sightings, strict=True):
            if not own.view_count:
                raise InputError(f"{name} sees the target in none of them")
        if carrier is not None:
            carried = carrier.rig_from_mechanism
            if len(carried) != len(rows):  # frames were left out of the solution
                carried = mechanism_prior(found)[0].carrier.rig_from_mechanism
            carrier = replace(carrier, rig_from_mechanism=carried[rows])
        has_slack = found.slack is not None
        return solve_rig(half, near, replace(options, carrier=carrier, reject_sigma=None, allows_offsets=has_slack))

    return solve_half


def ways_to_halve(found: RigCalibration) -> tuple[tuple[SplitKind, Flags], ...]:
    """Which frames (V,) belong to the first half, in each way."""
    count = len(found.rig_from_target)
    place, rotation = found.rig_from_target[:, :3, 3], found.rig_from_target[:, :3, :3]
    away = max(float(np.median(np.linalg.norm(place[None] - found.rig.center_mm[:, None], axis=2))), 1e-9)
    feature = np.concatenate([place / away, PER_RIGHT_ANGLE * rotation[:, :, :2].reshape(count, 6)], axis=1)
    ways: list[tuple[SplitKind, Flags]] = []
    ways += [("by turns", one) for one in by_turns(feature, BY_TURNS if count <= MANY_FRAMES else 1)]
    return (*ways, ("in order", np.arange(count) < count // 2))


def without_outliers(found: RigCalibration) -> RigObservations:
    """The sightings that count, of points as they are given: what all frames left out, halves leave out too."""
    seen = as_given(found)
    each = zip(seen.sightings, found.is_outlier, strict=True)
    counted = replace(seen, sightings=tuple(keep_sightings(own, ~outlier) for own, outlier in each))
    return keep_photos(counted, [sightings_per_view(own) > 0 for own in counted.sightings])


def _compared(kind: SplitKind, whole: RigCalibration, first: RigCalibration, second: RigCalibration) -> RigSplit | None:
    """The difference of all cameras' poses in the standard deviations of both, and what they leave over."""
    rig, other = (replace(half.rig, covariance=half.covariance) for half in (first, second))
    rows = np.concatenate([np.arange(one.start, one.stop) for one in map(rig.pose_rows, range(len(rig.names)))])
    noise = (first.covariance + second.covariance)[np.ix_(rows, rows)]
    step = steps_between(first.cam_from_rig, second.cam_from_rig).reshape(-1)
    sure = symmetric_inverse(noise)
    if not sure.rank > 0 or not np.isfinite(noise).all():
        return None
    ratio, by_noise = math.sqrt(max(float(step @ sure.inverse @ step), 0.0) / int(sure.rank)), None
    if whole.photo_covariance is not None:  # of half as many frames twice as much, and of the difference of two halves
        stated = symmetric_inverse(noise + 4 * whole.photo_covariance[np.ix_(rows, rows)]).inverse
        by_noise, ratio = ratio, math.sqrt(max(float(step @ stated @ step), 0.0) / int(sure.rank))
    pairs = []
    for a, b in combinations(range(len(rig.names)), 2):
        one, two = relative(rig, a, b), relative(other, a, b)
        sigma = math.hypot(one.baseline_sigma_mm, two.baseline_sigma_mm)
        pairs.append(PairApart((rig.names[a], rig.names[b]), two.baseline_mm - one.baseline_mm, sigma))
    left = math.sqrt((_squares(first) + _squares(second)) / _squares(whole))
    return RigSplit(kind, ratio, int(sure.rank), left, tuple(pairs), _target_apart(first, second), by_noise)


def _target_apart(first: RigCalibration, second: RigCalibration) -> float | None:
    """How far apart halves place the middle of a carried target on its carrier, in the standard deviations of both."""
    places, total = [], np.zeros((PLACE, PLACE))
    for half in (first, second):
        if half.carrier is None:
            return None
        pose = half.carrier.carrier_from_target
        lever = half.carrier.size * pose[:3, :3] @ half.observations.points.middle_mm
        moves = np.concatenate([-skew(lever), np.eye(PLACE)], axis=1)
        places.append(pose[:3, 3] + lever)
        total += moves @ half.carrier.covariance @ moves.T
    sure = symmetric_inverse(total)
    apart = places[1] - places[0]
    return math.sqrt(max(float(apart @ sure.inverse @ apart), 0.0) / int(sure.rank)) if sure.rank > 0 else None


def _squares(found: RigCalibration) -> float:
    """What all sightings leave over, redundancy regarded: the squares of as many draws of each camera's noise."""
    return sum(float(scale) ** 2 * int((~out).sum()) for scale, out in zip(found.scale, found.is_outlier, strict=True))
