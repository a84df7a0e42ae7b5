"""Starting values of all unknowns of a rig: by the cameras' own poses, and by the carrier's where there is one.

Photos of one camera that are counted from another frame on than those of the others: a list that lacks its first.

Two cameras that are held together see the target from poses that differ alike in all frames. If they do not, but would
with one camera's frames counted some further, the photos are paired wrongly, and no adjustment can make up for it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import invert
from calib.core.types import RigObservations, keep_frames
from calib.rigs.carrier import start_turntable, turned_by
from calib.rigs.descend import rig_equations
from calib.rigs.hand_eye import HandEyeStart, start_hand_eye
from calib.rigs.motion import motion_of
from calib.rigs.problem import Mechanism, RigOptions, RigProblem, RigState, frame_times, pack_rig
from calib.rigs.start import Alone, frame_candidates, joined, relative_poses, synchronised
from calib.rigs.variance_components import LEAST_SCALE, LEAST_SIGMA
from calib.solver.problem import few_per_view, select
from designer.base.arrays import Flags
from designer.base.errors import InputError
from designer.base.words import figure, printable

FARTHEST = 5
"""Frames by which photos are tried to be shifted."""
LEAST_FRAMES = 6
"""That two cameras share, from which is told whether they fit."""
MOST_FRAMES = 40
"""That are compared."""
FITS = 0.05
"""Scatter of the pose between two cameras, radians and parts of the distance, up to which nothing is tried."""
BETTER = 0.2
"""Of the scatter as the frames are, up to which frames that are shifted fit."""


def require_same_frames(observations: RigObservations, alone: Sequence[Alone]) -> None:
    """Refuse photos of which the frames would fit if those of some cameras were shifted.

    Raises:
        InputError: the message names the cameras, and how far.
    """
    late = [(number, by) for number, by in enumerate(_offsets(observations, alone)) if by]
    if not late:
        return
    frames = observations.frame_names
    number, by = late[0]
    first = next(frame for frame in observations.frame[number].tolist() if 0 <= frame + by < len(frames))
    told = ", ".join(
        f"camera {printable(observations.camera_names[row])}: its frames fit if shifted by {shift}"
        for row, shift in late
    )
    raise InputError(
        f"{told}: what it shows in {printable(frames[first])} the others show in {printable(frames[first + by])}; "
        "name or list the photos of one moment alike"
        + ", or estimate the time offsets of the cameras"
        * (observations.time_s is not None)
    )


def _offsets(observations: RigObservations, alone: Sequence[Alone]) -> list[int]:
    """By how much each camera's frames are to be counted further to fit those of most cameras; 0 where none fit."""
    count = len(alone)
    shift: dict[tuple[int, int], int] = {}
    for first in range(count):
        for second in range(first + 1, count):
            by = _shift(observations, alone, first, second)
            if by is not None:
                shift[first, second], shift[second, first] = by, -by
    if not any(shift.values()):
        return [0] * count
    begin = max(range(count), key=lambda one: sum(pair[0] == one and not by for pair, by in shift.items()))
    offset, open_ends = {begin: 0}, [begin]
    while open_ends:
        known = open_ends.pop()
        for (one, other), by in shift.items():
            if one == known and other not in offset:
                offset[other] = offset[known] + by
                open_ends.append(other)
    return [offset.get(number, 0) for number in range(count)]


def _shift(observations: RigObservations, alone: Sequence[Alone], first: int, second: int) -> int | None:
    """By how much the second camera's frames are to be counted further to fit the first's; None: not to be told."""
    as_they_are = _scatter(observations, alone, first, second, 0)
    if not np.isfinite(as_they_are) or as_they_are <= FITS:
        return 0 if np.isfinite(as_they_are) else None
    tried = [by for by in range(-FARTHEST, FARTHEST + 1) if by]
    scatter = [_scatter(observations, alone, first, second, by) for by in tried]
    best = int(np.argmin(scatter))
    return tried[best] if scatter[best] <= BETTER * as_they_are else None


def _scatter(observations: RigObservations, alone: Sequence[Alone], first: int, second: int, by: int) -> float:
    """Of the pose between two cameras, the second's frames counted further; infinite where they share few."""
    _, at_first, at_second = np.intersect1d(
        observations.frame[first], observations.frame[second] + by, return_indices=True
    )
    one, other = alone[first].cam_from_target[at_first], alone[second].cam_from_target[at_second]
    rows = np.flatnonzero(np.isfinite(one[:, 0, 0]) & np.isfinite(other[:, 0, 0]))
    if len(rows) < LEAST_FRAMES:
        return np.inf
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_FRAMES)).astype(int)]
    apart = relative_poses(one[rows], other[rows])[1]
    return float(np.median(apart, axis=1).min())


FIRST_SIGMA = (2e-3, 1.0)
"""Of a carrier's errors, rad and mm, to begin with."""


@dataclass(frozen=True, eq=False)
class RigStart:
    """Where the descent begins."""

    observations: RigObservations  # of the frames in which a camera has a pose
    alone: Sequence[Alone]
    options: RigOptions
    problem: RigProblem
    state: RigState
    remarks: tuple[str, ...]  # on frames that were left out
    undetermined: tuple[str, ...] = ()  # what a carrier's motions do not tell


def start_rig(observations: RigObservations, alone: Sequence[Alone], options: RigOptions) -> RigStart:
    """All unknowns of a rig as its cameras tell them one by one.

    Raises:
        InputError: no frames join some cameras to the others, or those of one would have to be shifted to fit.
    """
    delay_s = np.zeros(len(alone))
    if options.estimates_delays:
        alone, delay_s = synchronised(observations, alone)
    else:
        require_same_frames(observations, alone)
    reference = options.reference
    if options.carrier is not None:  # the camera that has most poses of its own
        reference = int(np.argmax([int(np.isfinite(one.cam_from_target[:, 0, 0]).sum()) for one in alone]))
    cam_from_rig = joined(observations, alone, reference)
    observations, alone, options, remarks = _placed(observations, alone, options)
    scale = np.array([max(one.scale, LEAST_SCALE) if np.isfinite(one.scale) else 1.0 for one in alone])
    carrier = options.carrier
    is_reference = [carrier is None and number == reference for number in range(len(alone))]
    problem = pack_rig(observations, [one.tie.row for one in alone], is_reference, scale, options)
    problem = replace(problem, known=tuple(one.priors for one in alone))
    frames, _ = frame_candidates(thinned(problem), observations, alone, cam_from_rig, problem.seen[0].problem.origin_mm)
    state = RigState(
        tuple(one.camera for one in alone),
        cam_from_rig,
        frames,
        delay_s,
        np.eye(4),
        amount=problem.seen[0].problem.amount,
    )
    if options.estimates_delays:
        problem = replace(problem, motion=motion_of(frames, frame_times(observations)))
    begin = RigStart(observations, alone, options, problem, state, remarks)
    return begin if carrier is None else _of_mechanism(begin, carrier)


def _of_mechanism(begin: RigStart, carrier: Mechanism) -> RigStart:
    """The start with where the carrier holds the rig or the target, and how it errs; without frames that it belies."""
    problem, frames = begin.problem, begin.state.rig_from_target
    start = None
    if not carrier.is_turntable:
        own = symmetric_inverse(rig_equations(replace(problem, prior=None), begin.state, problem.loss).normal.pose)
        variance = np.einsum("vkiki->vk", own.covariance.reshape(-1, 2, 3, 2, 3))
        start = start_hand_eye(frames, carrier.rig_from_mechanism, np.sqrt(variance))
    if start is None:
        turn = carrier.rig_from_mechanism
        table = start_turntable(frames, None if carrier.has_free_angles else np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
        start, carrier = table.start, replace(carrier, rig_from_mechanism=turned_by(table.angle_rad))
        problem = replace(problem, prior=problem.prior and replace(problem.prior, carrier=carrier))
    elif start.is_far_off.any():
        observations, alone, options = _without(begin.observations, begin.alone, begin.options, ~start.is_far_off)
        said = (*begin.remarks, *_far_off_remarks(begin.observations.frame_names, start))
        return replace(start_rig(observations, alone, options), remarks=said)
    return replace(
        begin, problem=_with_noise(problem, start), state=_carried(begin.state, start), undetermined=start.undetermined
    )


def _placed(
    observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> tuple[RigObservations, Sequence[Alone], RigOptions, tuple[str, ...]]:
    """Without the frames in which no camera has a pose."""
    has_pose = np.zeros(observations.frame_count, dtype=bool)
    for frames, one in zip(observations.frame, alone, strict=True):
        has_pose[frames[np.isfinite(one.cam_from_target[:, 0, 0])]] = True
    if has_pose.all():
        return observations, alone, options, ()
    lost = [name for name, ok in zip(observations.frame_names, has_pose.tolist(), strict=True) if not ok]
    remarks = tuple(f"frame {name}: left out: no camera's sightings show where the target was" for name in lost)
    return *_without(observations, alone, options, has_pose), remarks


def _without(
    observations: RigObservations, alone: Sequence[Alone], options: RigOptions, keep: Flags
) -> tuple[RigObservations, Sequence[Alone], RigOptions]:
    """Some of the frames."""
    kept = [
        replace(one, cam_from_target=one.cam_from_target[keep[frames]])
        for frames, one in zip(observations.frame, alone, strict=True)
    ]
    carrier = options.carrier
    if carrier is not None:
        options = replace(options, carrier=replace(carrier, rig_from_mechanism=carrier.rig_from_mechanism[keep]))
    return keep_frames(observations, keep), kept, options


def _far_off_remarks(names: Sequence[str], start: HandEyeStart) -> list[str]:
    """Which frames the carrier's pose does not fit, and by how much."""
    turn, shift = np.rad2deg(np.linalg.norm(start.error[:, :3], axis=1)), np.linalg.norm(start.error[:, 3:], axis=1)
    return [
        f"{printable(names[row])}: left out: its robot pose is {figure(turn[row], 2)} deg and "
        f"{figure(shift[row], 2)} mm off what the others tell"
        for row in np.flatnonzero(start.is_far_off).tolist()
    ]


def _carried(state: RigState, start: HandEyeStart) -> RigState:
    """The state in the carrier's frame."""
    back = invert(start.cam_from_rig)
    return replace(
        state, cam_from_rig=state.cam_from_rig @ start.cam_from_rig, rig_from_target=back @ state.rig_from_target,
        carrier_from_target=start.carrier_from_target,
    )  # fmt: skip


def _with_noise(problem: RigProblem, start: HandEyeStart) -> RigProblem:
    """The carrier's noise as it is given, or as the first guess leaves it."""
    prior = problem.prior
    if prior is None:
        return problem
    guess = np.maximum([start.rotation_rms_rad / np.sqrt(3), start.shift_rms_mm / np.sqrt(3)], LEAST_SIGMA)
    guess = np.where(np.isfinite(guess), guess, FIRST_SIGMA)
    return replace(problem, prior=replace(prior, sigma=np.where(np.isfinite(prior.sigma), prior.sigma, guess)))


def thinned(problem: RigProblem) -> RigProblem:
    """The problem with a few sightings of each view."""
    seen = tuple(
        replace(one, problem=select(one.problem, np.arange(one.problem.view_count), few_per_view(problem.frame_count)))
        for one in problem.seen
    )
    return replace(problem, seen=seen)
