"""From starting values to the most likely rig, and how sure that is: one adjustment of all sightings.

To the rig that minimises distances in space it goes from that in the image, as `calib.solver.in_space` for one camera.
"""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras import parameter_names
from calib.core.se3 import invert, steps_between
from calib.core.types import RigObservations
from calib.rigs.accuracy import Found, RigAccuracy, accuracy_of_rig
from calib.rigs.carrier import mechanism_errors
from calib.rigs.descend import descend_rig, rig_equations
from calib.rigs.motion import motion_of
from calib.rigs.problem import FREE_SIZE, RigOptions, RigProblem, RigState, frame_times, seen_poses, without_params
from calib.rigs.result import MechanismFit, RigCalibration
from calib.rigs.rig_start import RigStart, start_rig, thinned
from calib.rigs.start import Alone
from calib.rigs.variance_components import DISAGREES, camera_scales, disagreement, residuals, scales_left, settled
from calib.solver.accuracy import UNSURE_FOCAL, UndeterminedError
from calib.solver.blocks import KNEE
from calib.solver.calibration import Status, plane_bend
from calib.solver.costs import COSTS, IMAGE
from calib.solver.in_space import camera_change, in_space
from calib.solver.levenberg import DescentSteps
from calib.solver.priors import contradictions
from calib.solver.problem import Problem, target_covariance, target_poses
from designer.base.arrays import Array
from designer.base.words import printable


def rig_in_space(
    problem: RigProblem, image: Found, observations: RigObservations, alone: Sequence[Alone], options: RigOptions
) -> tuple[Found, Array]:
    """From the minimum in the image to that in space, without what the first left out.

    What distances of each camera, a carrier and single photos are worth is judged anew: noise is in mm there. What
    comes of it is told in the image: its equations there, and the standard deviation of an observation (C,).

    Raises:
        UndeterminedError: what is least in space is nowhere near.
    """
    seen = tuple(
        replace(one, problem=in_space(one.problem, options.minimise, observations.points, own.point))
        for one, own in zip(problem.seen, observations.sightings, strict=True)
    )
    spaced = replace(problem, seen=seen)
    spaced = replace(spaced, scale=scales_left(spaced, image.state))
    found = descend_rig(spaced, image.state, DescentSteps(options.max_iterations))
    as_it_is = replace(options, reject_sigma=None, allows_offsets=bool(problem.slack))
    found, _ = settled(spaced, found, observations, alone, as_it_is)
    _require_near(image.state, found.state, observations.camera_names, options.minimise)
    told = replace(
        found,
        equations=rig_equations(problem, found.state, problem.loss),
        iterations=image.iterations + found.iterations,
    )
    return told, camera_scales(problem, told, options.loss)


def _require_near(before: RigState, after: RigState, names: Sequence[str], minimise: str) -> None:
    """Refuse focal lengths that run away: where photos hardly tell them, many distances are shorter for wild ones."""
    for name, old, new in zip(names, before.cameras, after.cameras, strict=True):
        (was, _), (now, _) = old.params[:2], new.params[:2]
        if not abs(now - was) <= UNSURE_FOCAL * was:
            raise UndeterminedError(
                f"--minimise {minimise}: takes the focal length of {name} from {was:.0f} px in the image to {now:.4g} "
                "px, so the photos do not tell it; take more photos, keep the lens of an earlier run, or minimise image"
            )


def with_step(accuracy: RigAccuracy, problem: RigProblem, before: RigState, after: RigState) -> RigAccuracy:
    """The accuracy in the image, with the step from there to another estimate in it (`V + D D'`)."""
    params = [new.params - old.params for old, new in zip(before.cameras, after.cameras, strict=True)]
    places = steps_between(before.cam_from_rig, after.cam_from_rig)
    step = np.concatenate([part for pair in zip(params, places, strict=True) for part in pair])
    frames = steps_between(before.rig_from_target, after.rig_from_target)
    rigid = replace(problem, motion=None, slack=())
    views = [steps_between(*(seen_poses(rigid, of, k)[1] for of in (before, after))) for k in range(len(problem.seen))]
    carried = steps_between(before.carrier_from_target, after.carrier_from_target)
    carrier, moved = accuracy.mechanism_covariance, after.amount - before.amount
    return replace(
        accuracy,
        covariance=accuracy.covariance + np.outer(step, step),
        frame_covariance=accuracy.frame_covariance + frames[:, :, None] * frames[:, None, :],
        pose_covariance=tuple(
            one + by[:, :, None] * by[:, None, :] for one, by in zip(accuracy.pose_covariance, views, strict=True)
        ),
        delay_sigma_s=np.hypot(accuracy.delay_sigma_s, after.delay_s - before.delay_s),
        mechanism_covariance=None if carrier is None else carrier + np.outer(carried, carried),
        amount_covariance=accuracy.amount_covariance + np.outer(moved, moved),
    )


def space_remark(minimise: str, problem: RigProblem, before: RigState, after: RigState, accuracy: RigAccuracy) -> str:
    """By how much the rig is another one than that of the image, whose accuracy is given."""
    changes, row = [], 0
    for one, old, new in zip(problem.seen, before.cameras, after.cameras, strict=True):
        own = slice(row, row + len(old.params))
        row = own.stop + len(one.pose)
        pixel = one.problem.measured_px.T[one.problem.is_used]
        changes.append(camera_change(old, new.params - old.params, accuracy.covariance[own, own], pixel))
    off_px, sigma_px = max(changes)
    said = f"minimised: {COSTS[minimise].title}"
    if off_px > 0:
        said += (
            f"; where points were seen, 95 % are within {off_px:.2g} px of the camera that the distances in the image "
            f"give, itself sure to {sigma_px:.2g} px there"
        )
    turn_rad = np.linalg.norm(steps_between(before.cam_from_rig, after.cam_from_rig)[:, :3], axis=1).max()
    way = invert(after.cam_from_rig)[:, :3, 3] - invert(before.cam_from_rig)[:, :3, 3]
    way_mm = np.linalg.norm(way, axis=1).max()
    if way_mm > 0:
        said += f"; cameras stand up to {way_mm:.2g} mm and {np.rad2deg(turn_rad):.2g} deg from where those put them"
    return f"{said}; what is stated has the difference in it"


SURELY, LEAST_OFF = 4.0, 2e-3
"""Standard deviations, and parts, from which on a target's size is said to be off."""
MOTION_ROUNDS = 3
"""Of telling the target's motion by frames that are solved with it."""


def adjusted(observations: RigObservations, options: RigOptions, starts: Sequence[Sequence[Alone]]) -> RigCalibration:
    """The rig that is most likely of those that some starts lead to; arguments as those of `start_rig`.

    Raises:
        InputError: what `start_rig` raises, or it has no minimum in space.
    """
    begin = time.perf_counter()
    ends = []
    for alone in starts:
        start = start_rig(observations, alone, options)
        ends.append((*_down(start), start))
    image, problem, start = min(ends, key=lambda end: (not end[0].converged, _unlikeliness(end[1])))
    is_image = options.minimise == IMAGE or not image.converged
    there = None if is_image else rig_in_space(problem, image, start.observations, start.alone, start.options)
    return _calibration(image, problem, there, start, begin)


def _down(start: RigStart) -> tuple[Found, RigProblem]:
    """Down to the minimum at which the observations are worth what their residuals say."""
    observations, options, problem, state = start.observations, start.options, start.problem, start.state
    steps = options.max_iterations
    thin = thinned(problem)
    for places in (without_params(thin), thin):
        rough = replace(places, scale=np.maximum(problem.scale, scales_left(places, state)))
        state = descend_rig(rough, state, DescentSteps(steps, small_decrease=1e-4), loss="cauchy").state
        if options.estimates_delays:
            problem = replace(problem, motion=motion_of(state.rig_from_target, frame_times(observations)))
            thin = thinned(problem)
    found = descend_rig(problem, state, DescentSteps(steps, small_decrease=1e-6), loss="cauchy")
    for _ in range(MOTION_ROUNDS if options.estimates_delays else 0):  # by poses of which all sightings tell
        problem = replace(problem, motion=motion_of(found.state.rig_from_target, frame_times(observations)))
        found = descend_rig(problem, found.state, DescentSteps(steps, small_decrease=1e-6), loss="cauchy")
    return settled(problem, found, observations, start.alone, options)


def _unlikeliness(problem: RigProblem) -> float:
    """Minus the logarithm of the likelihood, each camera's noise being what it leaves over; a constant apart."""
    counts = np.array([2 * int(one.problem.is_used.sum()) for one in problem.seen])
    return float(counts @ np.log(problem.scale))


def _calibration(
    image: Found, problem: RigProblem, there: tuple[Found, Array] | None, start: RigStart, begin: float
) -> RigCalibration:
    """The result, of the minimum in the image or of that in space if there is one."""
    observations, alone, options, remarks = start.observations, start.alone, start.options, start.remarks
    found, scale = there or (image, problem.scale)
    state, packed = found.state, _sized(problem, found.state)
    accuracy = accuracy_of_rig(problem, image, _labels(problem, observations, state), KNEE[options.loss])
    if there is not None:
        remarks = (space_remark(options.minimise, problem, image.state, state, accuracy), *remarks)
        accuracy = with_step(accuracy, problem, image.state, state)
    frames = target_poses(packed, state.rig_from_target)
    rigid = replace(problem, motion=None, slack=())
    carrier = None
    if problem.prior is not None:
        carrier = replace(_mechanism_fit(found, problem, accuracy), undetermined=start.undetermined)
        remarks = (*remarks, *start.undetermined, *_size_remark(carrier))
    remarks = (*remarks, *_contradicted(problem, state, alone, observations.camera_names, accuracy.covariance))
    remarks = (*remarks, *_why_disagreeing(disagreement(problem, state, alone), observations, alone, options))
    status: Status = "degenerate" if accuracy.weakest else "converged" if found.converged else "stopped"
    if accuracy.weakest:
        remarks = (accuracy.weakest, *remarks)
    elif not found.converged:
        remarks = (f"stopped after {found.iterations} steps, short of the minimum", *remarks)
    reference = options.reference if problem.prior is None else -1
    bend = None
    if options.free_bend:
        sigma_mm = problem.amount_sigma[1:]
        bend = plane_bend(observations.points).told(state.amount[1:], accuracy.amount_covariance[1:, 1:], sigma_mm)
        remarks = (bend.sentence, *remarks)
        observations = replace(observations, sightings=tuple(bend.bent(own) for own in observations.sightings))
    return RigCalibration(
        observations=observations, cameras=state.cameras, cam_from_rig=state.cam_from_rig, rig_from_target=frames,
        residual_px=tuple(np.ascontiguousarray(one.T) for one in residuals(problem, state)),
        is_outlier=tuple(~one.problem.is_used for one in problem.seen), scale=scale, covariance=accuracy.covariance,
        frame_covariance=target_covariance(packed, state.rig_from_target, accuracy.frame_covariance),
        pose_covariance=tuple(
            target_covariance(packed, seen_poses(rigid, state, k)[1], one)
            for k, one in enumerate(accuracy.pose_covariance)
        ),
        reference=reference,
        rig_frame=observations.camera_names[reference] if problem.prior is None else _frame_name(options),
        fixed=tuple(one.tie.fixed for one in alone),
        weighted=options.weighted and all(one.cov_px2 is not None for one in observations.sightings), status=status,
        remarks=remarks, iterations=found.iterations, seconds=time.perf_counter() - begin,
        delay_s=state.delay_s if options.estimates_delays else None,
        delay_sigma_s=accuracy.delay_sigma_s if options.estimates_delays else None, carrier=carrier,
        slack=problem.slack[0].size if problem.slack else None, alone_scale=np.array([one.scale for one in alone]),
        target_bend=bend,
        priors=tuple(one.priors for one in alone),
    )  # fmt: skip


def _contradicted(
    problem: RigProblem, state: RigState, alone: Sequence[Alone], names: Sequence[str], covariance: Array
) -> list[str]:
    """A word on each prior of a camera that the photos contradict."""
    said, row, sigma = [], 0, np.sqrt(np.diagonal(covariance)).tolist()
    for name, seen, camera, one in zip(names, problem.seen, state.cameras, alone, strict=True):
        told = dict(zip(camera.parameters, sigma[row : row + len(camera.params)], strict=True))
        said += [f"{printable(name)}: {line}" for line in contradictions(one.priors, camera.parameters, told)]
        row += len(camera.params) + len(seen.pose)
    return said


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
        "; each photo counts as little as that shows, and what is stated has it in it" if options.allows_offsets else ""
    )
    return [f"photos that fit each camera alone do not fit together (residuals{unit}: {told}): {cause}{slack}"]


def _sized(problem: RigProblem, state: RigState) -> Problem:
    """The first camera's sightings with the points' middle where it is on a target of the solved size."""
    packed = problem.seen[0].problem
    return replace(packed, origin_mm=state.size * packed.origin_mm)


def _size_remark(carrier: MechanismFit) -> list[str]:
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
    for number, place in enumerate(problem.amount.tolist()):
        label[place] = f"the {'bend' if number else 'size'} of the target"
    return label[:-1]


def _frame_name(options: RigOptions) -> str:
    """Whose frame the rig's is, with a carrier."""
    carrier = options.carrier
    if carrier is None or carrier.is_camera_in_hand:
        return "flange"
    return "table" if carrier.is_turntable else "base"


def _mechanism_fit(found: Found, problem: RigProblem, accuracy: RigAccuracy) -> MechanismFit:
    """What the photos show of the carrier."""
    prior, state = problem.prior, found.state
    if prior is None or accuracy.mechanism_covariance is None:
        raise ValueError("a rig without a carrier")
    packed = _sized(problem, state)
    target = state.carrier_from_target[None]
    error = mechanism_errors(prior, state.rig_from_target, state.carrier_from_target)
    angle = None
    if prior.carrier.is_turntable:
        turn = prior.carrier.rig_from_mechanism
        angle = np.arctan2(turn[:, 1, 0], turn[:, 0, 0]) + (error[:, 2] if prior.carrier.has_free_angles else 0.0)
    return MechanismFit(
        prior.carrier.kind, target_poses(packed, target)[0],
        target_covariance(packed, target, accuracy.mechanism_covariance[None])[0],
        float(prior.sigma[0]), float(prior.sigma[1]), error, angle, size=state.size,
        size_sigma=float(np.sqrt(accuracy.amount_covariance[0, 0])) if len(problem.amount) else 0.0,
        size_sigma_before=prior.carrier.size_sigma or FREE_SIZE,
    )  # fmt: skip
