"""From what the cameras of a rig saw to where they stand, and how sure that is: one adjustment of all sightings."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import parameter_names
from calib.core.parallel import one_thread_with_scipy
from calib.core.se3 import invert
from calib.core.types import RigObservations, keep_frames
from calib.rigs.accuracy import Found, RigAccuracy, accuracy_of_rig
from calib.rigs.carrier import carrier_errors
from calib.rigs.descend import descend_rig
from calib.rigs.hand_eye import HandEyeStart, start_hand_eye
from calib.rigs.in_space import RigInSpace, rig_in_space, space_remark, with_step
from calib.rigs.motion import motion_of
from calib.rigs.options import CameraChoice, RigOptions
from calib.rigs.problem import RigProblem, RigState, frame_times, pack_rig, without_params
from calib.rigs.result import CarrierFit, RigCalibration
from calib.rigs.shifted import require_same_frames
from calib.rigs.start import Alone, frame_candidates, joined, solve_alone, synchronised
from calib.rigs.turntable import start_turntable, turned_by
from calib.rigs.worth import DISAGREES, LEAST_SCALE, LEAST_SIGMA, disagreement, residuals, scales_left, settled
from calib.solver.blocks import KNEE
from calib.solver.calibration import Status
from calib.solver.costs import IMAGE
from calib.solver.in_space import require_planes
from calib.solver.problem import Problem, few_per_view, select, target_covariance, target_poses
from designer.base.errors import InputError

Array = NDArray[np.float64]

SURELY, LEAST_OFF = 4.0, 2e-3
"""Standard deviations, and parts, from which on a target's size is said to be off."""
FIRST_SIGMA = (2e-3, 1.0)
"""Of a carrier's errors, rad and mm, to begin with."""
MOTION_ROUNDS = 3
"""Of telling the target's motion by frames that are solved with it."""


@one_thread_with_scipy
def solve_rig(
    observations: RigObservations,
    choices: Sequence[CameraChoice],
    options: RigOptions | None = None,
    alone: Sequence[Alone] | None = None,
) -> RigCalibration:
    """`solve_rig(observations, [CameraChoice("opencv")] * 4).cam_from_rig`.

    Each camera is solved alone, frames that two saw join them, and Levenberg-Marquardt over all parameters, places and
    frames, these eliminated block by block, gives the most likely rig. What an observation of each camera is worth is
    estimated with it. The result does not depend on the order of frames or cameras but for rounding.

    Args:
        observations: what was seen; each view has a sighting.
        choices: how each camera is to be solved (C,).
        options: weights, losses, what carries the target.
        alone: of each camera, where `cameras_alone` has told it already.

    Raises:
        InputError: a camera cannot be solved, or not in space, no frames join some cameras to the others, frames of
            one would have to be shifted to fit, or options that do not fit.
    """
    begin = time.perf_counter()
    options = options or RigOptions()
    alone = alone or cameras_alone(observations, choices, options)
    delay_s = np.zeros(len(alone))
    if options.estimates_delays:
        alone, delay_s = synchronised(observations, alone)
    else:
        require_same_frames(observations, alone)
    reference = options.reference if options.carrier is None else _busiest(observations, alone)
    cam_from_rig = joined(observations, alone, reference)
    observations, alone, options, remarks = _placed(observations, alone, options)
    started = _start(observations, alone, options, cam_from_rig, delay_s, reference)
    image, problem = _down(started, observations, alone, options)
    is_image = options.minimise == IMAGE or not image.converged
    there = None if is_image else rig_in_space(problem, image, observations, alone, options)
    return _calibration(image, problem, there, observations, alone, options, remarks, started.undetermined, begin)


def cameras_alone(
    observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions
) -> tuple[Alone, ...]:
    """Each camera by itself; arguments as those of `solve_rig`."""
    _check(observations, choices, options)
    return tuple(
        solve_alone(seen, name, choice, options)
        for seen, name, choice in zip(observations.sightings, observations.camera_names, choices, strict=True)
    )


def _check(observations: RigObservations, choices: Sequence[CameraChoice], options: RigOptions) -> None:
    """Refuse what does not fit together."""
    for seen in observations.sightings:
        require_planes(options.minimise, seen.points, seen.point)
    if len(choices) != observations.camera_count:
        raise ValueError("a choice for each camera is needed")
    if not 0 <= options.reference < observations.camera_count:
        raise InputError(f"reference {options.reference}: the rig has cameras 0 to {observations.camera_count - 1}")
    carrier = options.carrier
    if carrier is not None and len(carrier.rig_from_carrier) != observations.frame_count:
        raise ValueError("a pose of the carrier for each frame is needed")
    if options.estimates_delays and observations.time_s is None:
        raise InputError("time offsets need time stamps; give each photo's, or leave the offsets out")


def _busiest(observations: RigObservations, alone: Sequence[Alone]) -> int:
    """The camera that has most poses of its own."""
    return int(np.argmax([int(np.isfinite(one.cam_from_target[:, 0, 0]).sum()) for one in alone]))


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
    kept = [
        replace(one, cam_from_target=one.cam_from_target[has_pose[frames]])
        for frames, one in zip(observations.frame, alone, strict=True)
    ]
    carrier = options.carrier
    if carrier is not None:
        options = replace(options, carrier=replace(carrier, rig_from_carrier=carrier.rig_from_carrier[has_pose]))
    remarks = tuple(f"frame {name}: left out: no camera's sightings show where the target was" for name in lost)
    return keep_frames(observations, has_pose), kept, options, remarks


@dataclass(frozen=True, eq=False)
class _RigStart:
    problem: RigProblem
    state: RigState
    undetermined: tuple[str, ...] = ()  # what a carrier's motions do not tell


def _start(
    observations: RigObservations,
    alone: Sequence[Alone],
    options: RigOptions,
    cam_from_rig: Array,
    delay_s: Array,
    reference: int,
) -> _RigStart:
    """All unknowns by the cameras' own poses, and by the carrier's where there is one."""
    scale = np.array([max(one.scale, LEAST_SCALE) if np.isfinite(one.scale) else 1.0 for one in alone])
    carrier = options.carrier
    problem = pack_rig(
        observations, [one.tie.row for one in alone],
        [carrier is None and number == reference for number in range(len(alone))], weighted=options.weighted,
        loss=options.loss, scale=scale, with_delays=options.estimates_delays, carrier=carrier,
    )  # fmt: skip
    thin = _thin(problem)
    origin = problem.seen[0].problem.origin_mm
    frames, _ = frame_candidates(thin, observations, alone, cam_from_rig, origin)
    cameras = tuple(one.camera for one in alone)
    state = RigState(cameras, cam_from_rig, frames, delay_s, np.eye(4))
    if options.estimates_delays:
        problem = replace(problem, motion=motion_of(frames, frame_times(observations)))
    if carrier is None:
        return _RigStart(problem, state)
    start = start_hand_eye(frames, carrier.rig_from_carrier) if not carrier.is_turntable else None
    if start is None:
        turn = carrier.rig_from_carrier
        table = start_turntable(frames, None if carrier.has_free_angles else np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
        start, carrier = table.start, replace(carrier, rig_from_carrier=turned_by(table.angle_rad))
        problem = replace(problem, prior=problem.prior and replace(problem.prior, carrier=carrier))
    return _RigStart(_with_noise(problem, start), _carried(state, start), start.undetermined)


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


def _thin(problem: RigProblem) -> RigProblem:
    """The problem with a few sightings of each view."""
    seen = tuple(
        replace(one, problem=select(one.problem, np.arange(one.problem.view_count), few_per_view(problem.frame_count)))
        for one in problem.seen
    )
    return replace(problem, seen=seen)


def _down(
    start: _RigStart, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> tuple[Found, RigProblem]:
    """Down to the minimum at which the observations are worth what their residuals say."""
    steps, problem, state = options.max_iterations, start.problem, start.state
    thin = _thin(problem)
    for places in (without_params(thin), thin):
        rough = replace(places, scale=np.maximum(problem.scale, scales_left(places, state)))
        state = descend_rig(rough, state, max_iterations=steps, loss="cauchy", small_decrease=1e-4).state
        if options.estimates_delays:
            problem = replace(problem, motion=motion_of(state.rig_from_target, frame_times(observations)))
            thin = _thin(problem)
    found = descend_rig(problem, state, max_iterations=steps, loss="cauchy", small_decrease=1e-6)
    for _ in range(MOTION_ROUNDS if options.estimates_delays else 0):  # by poses of which all sightings tell
        problem = replace(problem, motion=motion_of(found.state.rig_from_target, frame_times(observations)))
        found = descend_rig(problem, found.state, max_iterations=steps, loss="cauchy", small_decrease=1e-6)
    return settled(problem, found, observations, alone, options)


def _calibration(
    image: Found, problem: RigProblem, there: RigInSpace | None, observations: RigObservations,
    alone: Sequence[Alone], options: RigOptions, remarks: tuple[str, ...], undetermined: tuple[str, ...], begin: float,
) -> RigCalibration:  # fmt: skip
    """The result, of the minimum in the image or of that in space if there is one."""
    found, scale = (image, problem.scale) if there is None else (there.found, there.scale)
    state, packed = found.state, _sized(problem, found.state)
    accuracy = accuracy_of_rig(problem, image, _labels(problem, observations, state), KNEE[options.loss])
    if there is not None:
        remarks = (space_remark(options.minimise, problem, image.state, state, accuracy), *remarks)
        accuracy = with_step(accuracy, image.state, state)
    frames = target_poses(packed, state.rig_from_target)
    carrier = None
    if problem.prior is not None:
        carrier = replace(_carrier_fit(found, problem, accuracy), undetermined=undetermined)
        remarks = (*remarks, *undetermined, *_size_remark(carrier))
    remarks = (*remarks, *_why_disagreeing(disagreement(problem, state, alone), observations, alone, options))
    status: Status = "degenerate" if accuracy.weakest else "converged" if found.converged else "stopped"
    if accuracy.weakest:
        remarks = (accuracy.weakest, *remarks)
    elif not found.converged:
        remarks = (f"stopped after {found.iterations} steps, short of the minimum; allow more", *remarks)
    reference = options.reference if problem.prior is None else -1
    return RigCalibration(
        observations, state.cameras, state.cam_from_rig, frames,
        tuple(np.ascontiguousarray(one.T) for one in residuals(problem, state)),
        tuple(~one.problem.is_used for one in problem.seen), scale, accuracy.covariance,
        target_covariance(packed, state.rig_from_target, accuracy.frame_covariance), reference,
        observations.camera_names[reference] if problem.prior is None else _frame_name(options),
        tuple(bool((one.tie.row >= 0).any()) for one in alone),
        options.weighted and all(one.cov_px2 is not None for one in observations.sightings), status, remarks,
        found.iterations, time.perf_counter() - begin,
        state.delay_s if options.estimates_delays else None,
        accuracy.delay_sigma_s if options.estimates_delays else None, carrier,
        problem.slack[0].size if problem.slack else None, np.array([one.scale for one in alone]),
    )  # fmt: skip


def _why_disagreeing(
    ratio: Array, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> list[str]:
    """A word on cameras whose photos fit a camera alone, but not the rig."""
    far = np.flatnonzero(ratio > DISAGREES).tolist()
    if not far or options.carrier is not None:
        return []
    unit = " in px" if not options.weighted or observations.sightings[0].cov_px2 is None else " in stated deviations"
    told = ", ".join(
        f"{observations.camera_names[number]} {alone[number].scale:.2g} alone, "
        f"{ratio[number] * alone[number].scale:.2g} in the rig"
        for number in far
    )
    cause = "a camera that was moved, or a target that is not as its file says"
    if options.estimates_delays:
        cause = "a target that moves faster than its frames tell, " + cause
    else:
        cause = "photos of a moving target that were not taken at once (estimate the time offsets), " + cause
    slack = (
        "; each photo counts as little as that shows, and what is stated has it in it" if options.allows_slack else ""
    )
    return [f"photos that fit each camera alone do not fit together (residuals{unit}: {told}): {cause}{slack}"]


def _sized(problem: RigProblem, state: RigState) -> Problem:
    """The first camera's sightings with the points' middle where it is on a target of the solved size."""
    packed = problem.seen[0].problem
    return replace(packed, origin_mm=state.size * packed.origin_mm)


def _size_remark(carrier: CarrierFit) -> list[str]:
    """A word on a target that is not as large as its file says, by the robot's ways."""
    off, sigma = carrier.size - 1, carrier.size_sigma
    if not abs(off) > max(SURELY * sigma, LEAST_OFF):
        return []
    return [
        f"by the robot's ways the target is {100 * abs(off):.2f} +- {100 * sigma:.2f} % "
        f"{'smaller' if off < 0 else 'larger'} than its file says, or the robot's lengths are as much off: measure one"
    ]


def _labels(problem: RigProblem, observations: RigObservations, state: RigState) -> list[str]:
    """What the shared unknowns are called.  # (G,)"""
    label = [""] * (problem.shared_count + 1)  # what is fixed takes the last
    for one, camera, name in zip(problem.seen, state.cameras, observations.camera_names, strict=True):
        for place, parameter in zip(one.params.tolist(), parameter_names(camera.model), strict=False):
            label[place] = f"{parameter} of {name}"
        for axis, place in enumerate(one.pose.tolist()):
            label[place] = f"{'the direction' if axis < 3 else 'the place'} of {name}"
        label[one.delay[0]] = f"the time offset of {name}"
    for place in () if problem.prior is None else problem.prior.column.tolist():
        label[place] = "where the target sits"
    label[problem.size_column] = "the size of the target"
    return label[:-1]


def _frame_name(options: RigOptions) -> str:
    """Whose frame the rig's is, with a carrier."""
    carrier = options.carrier
    if carrier is None or carrier.is_camera_in_hand:
        return "flange"
    return "table" if carrier.is_turntable else "base"


def _carrier_fit(found: Found, problem: RigProblem, accuracy: RigAccuracy) -> CarrierFit:
    """What the photos show of the carrier."""
    prior, state = problem.prior, found.state
    if prior is None or accuracy.carrier_covariance is None:
        raise ValueError("a rig without a carrier")
    packed = _sized(problem, state)
    target = state.carrier_from_target[None]
    error = carrier_errors(prior, state.rig_from_target, state.carrier_from_target)
    angle = None
    if prior.carrier.is_turntable:
        turn = prior.carrier.rig_from_carrier
        angle = np.arctan2(turn[:, 1, 0], turn[:, 0, 0]) + (error[:, 2] if prior.carrier.has_free_angles else 0.0)
    return CarrierFit(
        prior.carrier.kind, target_poses(packed, target)[0],
        target_covariance(packed, target, accuracy.carrier_covariance[None])[0],
        float(prior.sigma[0]), float(prior.sigma[1]), error, angle, size=state.size, size_sigma=accuracy.size_sigma,
    )  # fmt: skip
