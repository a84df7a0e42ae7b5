"""The measurement: from photos of a print to its geometry, with cameras and poses."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import linearise
from calib.core.parallel import one_thread
from calib.core.types import Observations
from calib.measure_target.accuracy import TargetAccuracy, accuracy_of, outlying_faces, remarks_of
from calib.measure_target.back import tells_thickness, with_back
from calib.measure_target.blocks import TargetMinimum, minimise
from calib.measure_target.datum import SeenParts, gauge_rows, laid_over, moved_target, what_is_seen
from calib.measure_target.expected import (
    is_same_spread,
    with_expected_deviations,
    with_seen_deviations,
    with_seen_spread,
)
from calib.measure_target.lengths import CaliperLength, Scale, scale_from
from calib.measure_target.problem import HeldPoses, Joint, State, joint_problem, without
from calib.measure_target.result import AsBuilt, face_shift_mm, left_open_mm, target_of
from calib.measure_target.unknowns import AsBuiltOptions, nominal_shape, place_rings, strain_matrix, unknowns_of
from calib.observe.observations import known_points
from calib.rigs.result import RigCalibration
from calib.solver.calibration import Calibration, Status
from calib.solver.levenberg import DescentSteps
from calib.solver.outliers import deviations
from calib.solver.problem import Tie, tie_parameters
from calib.solver.solve import far_off, solve
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import printable
from designer.target import TargetGeometry, bounding_radius_mm

ROUNDS = 8
"""Of judging what an observation is worth, against the priors, and solving again."""
SAME_SCALE = 0.01
SAME_SPREAD = 0.05
NEAR = 1e-9
"""Damping to begin a descent with that starts at another minimum."""
PERFECT = 1e-5
"""Least standard deviation of an observation: with less, what the priors alone hold were lost in rounding."""
FEW = 0.5
"""Part of the equations that must be left over, or the unknowns are counted exactly."""
LEAST_NOISE_PX = 1e-3
"""Photos whose centres are better are not known; what is less is not noticed."""
UNSURE = 3.0
"""A face is not determined whose rings may be farther off than the noise of so many centres."""


@one_thread
def measure(
    sets: Sequence[Observations],
    target: TargetGeometry,
    model: str,
    options: AsBuiltOptions | None = None,
    lengths: Sequence[CaliperLength] = (),
) -> AsBuilt:
    """Solve cameras, poses and the printed target together.

    Least squares of the distances in the image and of the priors, the poses or the rings eliminated block by block.
    What photos do not tell (where the target is and how large) is fixed as `calib.measure_target.datum` says; the
    size comes from lengths, if there are any.

    Args:
        sets: what each camera saw of the same print; every view has four points or more.
        target: as designed.
        model: of all cameras; one that is its parameters alone.
        options: which deviations to look for.
        lengths: measured on the print.

    Raises:
        InputError: a camera cannot be solved, or the lengths contradict each other.
        ValueError: no sets, or observations of another target.
    """
    begin = time.perf_counter()
    options = with_known_weights(options or AsBuiltOptions(), sets)
    if not sets or any(len(one.points.face) != target.ring_count for one in sets):
        raise ValueError("observations of the target's own rings are needed")
    points = known_points(target)
    # Beside a target that is not as designed, residuals say nothing of the sigmas: the stated ones stand.
    started = [solve(replace(one, points=points), model, options.solve, noise_px2=one.cov_px2) for one in sets]
    ties = [tie_parameters(model, options.solve)] * len(started)
    return _measured(_Start(started, ties), target, options, lengths, begin)


@one_thread
def measure_rig(
    found: RigCalibration,
    target: TargetGeometry,
    options: AsBuiltOptions | None = None,
    lengths: Sequence[CaliperLength] = (),
) -> AsBuilt:
    """Solve cameras that are held together, and the printed target, from frames that they took at once.

    As `measure`, with a pose of the target a frame and one a camera instead of one a photo: faces that no camera sees
    together are joined by cameras that see them at once.

    Args:
        found: the rig, solved with the target as designed; what it kept fixed of a camera stays so.
        target: as designed.
        options: which deviations to look for.
        lengths: measured on the print.

    Raises:
        InputError: a rig whose photos were not taken at once, a board with a back, or lengths that contradict.
        ValueError: a rig of another target.
    """
    begin = time.perf_counter()
    if len(found.observations.points.face) != target.ring_count:
        raise ValueError("a rig of the target's own rings is needed")
    if found.delay_s is not None:
        raise InputError("the cameras of this rig took their photos one after another, by delays that were estimated; "
                         "measure from photos of a target that stands still")  # fmt: skip
    if target.has_back:
        raise InputError("a rig may see front and back of a board at once, which measuring takes for two boards; "
                         "measure it from photos without a rig")  # fmt: skip
    options = with_known_weights(options or AsBuiltOptions(), found.observations.sightings)
    points = known_points(target)
    started = [replace(one, observations=replace(one.observations, points=points)) for one in found.alone]
    started[0] = replace(started[0], remarks=found.remarks)
    fixed = [tuple((name, None) for name in one.fixed) for one in found.alone]
    ties = [
        tie_parameters(one.camera.model, replace(options.solve, fixed=held, shared=()) if held else options.solve)
        for one, held in zip(found.alone, fixed, strict=True)
    ]
    held = HeldPoses(found.cam_from_rig, found.rig_from_target)
    built = _measured(
        _Start(started, ties, found.observations.frame, held, max(found.reference, 0)), target, options, lengths, begin
    )
    unused = [
        f"{printable(name)}: what the rig knew of its lens beforehand is not used here ({', '.join(named)})"
        for name, own in zip(found.observations.camera_names, found.alone, strict=True)
        if (named := [prior.name for prior in own.priors])
    ]
    return replace(built, remarks=(*built.remarks, *unused))


@dataclass(frozen=True, eq=False)
class _Start:
    """Cameras solved with the target as designed, from which the descent begins."""

    cameras: Sequence[Calibration]
    ties: Sequence[Tie]
    frame: tuple[Rows, ...] | None = None  # of each camera's views, if cameras are held together
    held: HeldPoses | None = None
    reference: int = -1


def _measured(
    start: _Start, target: TargetGeometry, options: AsBuiltOptions, lengths: Sequence[CaliperLength], begin: float
) -> AsBuilt:
    """From a start to the result."""
    started = start.cameras
    joint, found, seen = _descend(start, target, options)
    iterations = found.iterations
    joint, found, accuracy = _accurate(joint, found, seen, options)
    state = laid_over(joint.unknowns, seen, found.state)
    noise_mm = _centre_noise_mm(joint, state)
    is_determined = _determined(accuracy, joint, seen, noise_mm)
    scale: Scale | None = None
    sizes = [one for one in lengths if not tells_thickness(target, one.name)]
    if sizes:
        # Without the faces of which little is known, if there are others.
        unscaled = target_of(joint.unknowns, seen, state.shape, accuracy.face)
        scale = scale_from(unscaled, sizes, is_determined if is_determined.any() else None)
        state = moved_target(joint.unknowns, state, scale.value, np.eye(3), np.zeros(3))
    minimum = _Measured(joint, found, seen, accuracy, state, noise_mm, is_determined, scale)
    built = _as_built(started, target, minimum, iterations, begin)
    errors = None if options.made is None else options.made.errors
    return with_back(built, errors, [one for one in lengths if one not in sizes])


def with_known_weights(options: AsBuiltOptions, sets: Sequence[Observations]) -> AsBuiltOptions:
    """Weigh by covariances only if all cameras have them: one without could not be weighed against the others."""
    weighted = options.solve.weighted and all(one.cov_px2 is not None for one in sets)
    return replace(options, solve=replace(options.solve, weighted=weighted))


def _descend(start: _Start, target: TargetGeometry, options: AsBuiltOptions) -> tuple[Joint, TargetMinimum, SeenParts]:
    """Down to the minimum at which the observations are worth what their residuals say."""
    started = start.cameras
    unknowns = with_expected_deviations(unknowns_of(target, options), options)
    observations = [one.observations for one in started]
    keeps = [~one.is_outlier for one in started]
    if options.solve.reject_sigma is not None:
        keeps = [np.ones_like(keep) for keep in keeps]  # what looked far off may be the target's own deviation
    seen = what_is_seen(unknowns, list(zip(observations, keeps, strict=True)), start.frame)
    gauge = gauge_rows(unknowns, seen, bounding_radius_mm(target))
    joint = joint_problem(
        observations, start.ties, unknowns, gauge, weighted=options.solve.weighted, frame=start.frame,
        reference=start.reference,
    )  # fmt: skip
    joint = replace(without(joint, keeps), scale=1.0 if options.solve.weighted else 0.05)
    poses = tuple(one.cam_from_target for one in started)
    state = State(tuple(one.camera for one in started), poses, nominal_shape(target), start.held)
    found = minimise(joint, state, DescentSteps(options.solve.max_iterations, small_decrease=1e-4))
    iterations = found.iterations
    for number in range(ROUNDS):
        keeps = _kept(joint, found, observations, options)
        joint = without(joint, keeps)
        scale = _posterior_scale(joint, found, seen)
        spread = joint.unknowns
        if options.ring_sigma_from_photos:
            spread = with_seen_spread(spread, seen, found.state.shape, found.equations)
        spread = with_seen_deviations(spread, seen, found.state.shape)
        is_last = number > 0 and abs(scale / joint.scale - 1) < SAME_SCALE
        is_last = is_last and is_same_spread(spread, joint.unknowns, SAME_SPREAD)
        joint = joint if is_last else replace(joint, scale=scale, unknowns=spread)
        found = minimise(joint, found.state, DescentSteps(options.solve.max_iterations, damping=NEAR))
        iterations += found.iterations
        if is_last:
            break
    seen = replace(seen, outlying=outlying_faces(joint.unknowns, seen, found.state.shape))
    return joint, replace(found, iterations=iterations), seen


def _kept(
    joint: Joint, found: TargetMinimum, observations: Sequence[Observations], options: AsBuiltOptions
) -> list[Flags]:
    """The observations that are not too far off, if a limit was asked for."""
    limit = options.solve.reject_sigma
    if limit is None:
        return [one.problem.is_used for one in joint.sets]
    return [
        np.asarray(deviations(residual, seen.cov_px2) <= limit)
        for residual, seen in zip(found.equations.residual_px, observations, strict=True)
    ]


def _posterior_scale(joint: Joint, found: TargetMinimum, seen: SeenParts, effective: float | None = None) -> float:
    """Standard deviation of an observation, the unknowns beside the poses that the photos determine taken off.

    `effective` is how many these are; None: about, where they are few, else exact.

    Raises:
        InputError: as many as there are observations.
    """
    equations = 2 * sum(int(one.problem.is_used.sum()) for one in joint.sets)
    if effective is None:
        effective = _about_effective(joint, found, seen)
        if equations - 6 * joint.pose_count - effective < FEW * equations:
            effective = _require(accuracy_of(joint, found.state.shape, seen, found.equations)).effective
    redundancy = equations - 6 * joint.pose_count - effective
    if redundancy < 1:
        raise InputError(
            f"{equations // 2} observations for {6 * joint.pose_count + effective:.0f} unknowns: too few; take more "
            "photos, or expect smaller deviations"
        )
    return max(joint.scale * float(np.sqrt(found.equations.squares / redundancy)), PERFECT)


def _about_effective(joint: Joint, found: TargetMinimum, seen: SeenParts) -> float:
    """About how many unknowns beside the poses the photos determine, each taken on its own."""
    unknowns = joint.unknowns
    of_faces = (unknowns.count - unknowns.first_motion) * float(seen.face.mean())
    effective = joint.param_count + unknowns.first_motion + of_faces - len(joint.gauge)
    if unknowns.ring_sigma_mm is not None:
        inverse = np.linalg.inv(found.equations.ring)
        effective += float((1 - np.einsum("rii->ri", inverse) / unknowns.ring_sigma_mm**2).sum())
    return effective


def _accurate(
    joint: Joint, found: TargetMinimum, seen: SeenParts, options: AsBuiltOptions
) -> tuple[Joint, TargetMinimum, TargetAccuracy]:
    """The minimum with the exact posterior scale, and the accuracies there."""
    accuracy = _require(accuracy_of(joint, found.state.shape, seen, found.equations))
    scale = _posterior_scale(joint, found, seen, accuracy.effective)
    if abs(scale / joint.scale - 1) < SAME_SCALE or scale <= PERFECT:
        return joint, found, accuracy
    joint = replace(joint, scale=scale)
    found = minimise(joint, found.state, DescentSteps(options.solve.max_iterations, damping=NEAR))
    return joint, found, _require(accuracy_of(joint, found.state.shape, seen, found.equations))


def _require(accuracy: TargetAccuracy | None) -> TargetAccuracy:
    """Refuse what has none.

    Raises:
        InputError: there is none.
    """
    if accuracy is None:
        raise InputError("the photos do not determine cameras and target together; take more, from more sides")
    return accuracy


def _centre_noise_mm(joint: Joint, state: State) -> Array:
    """What the noise of one centre along an axis is on each face, at the photos' scale.  # (F,)"""
    target, place = joint.unknowns.target, place_rings(joint.unknowns, state.shape).position_mm
    square, count = np.zeros(target.face_count), np.zeros(target.face_count)
    for one, camera, poses in zip(joint.sets, state.cameras, state.poses, strict=True):
        a, b, c = one.problem.whitener
        pose = poses[one.problem.view]
        point = (pose[:, :3, :3] @ place[one.ring][:, :, None])[:, :, 0] + pose[:, :3, 3]
        by_point = linearise(camera, np.ascontiguousarray(point.T)).by_point  # (2, 3, M)
        whitened = (a * by_point[0]) ** 2 + (b * by_point[0] + c * by_point[1]) ** 2
        whitened = 1 / (joint.scale**2 / whitened.sum(axis=0) + LEAST_NOISE_PX**2 / (by_point**2).sum(axis=(0, 1)))
        face, used = target.ring_face[one.ring], one.problem.is_used
        square += np.bincount(face[used], 0.5 * whitened[used], target.face_count)
        count += np.bincount(face[used], minlength=target.face_count)
    mean = np.where(count > 0, square, square.sum()) / np.where(count > 0, count, count.sum())
    noise: Array = 1 / np.sqrt(mean)
    return noise


def _determined(accuracy: TargetAccuracy, joint: Joint, seen: SeenParts, noise_mm: Array) -> Flags:
    """The faces whose rings the photos, or what is expected of the print, place as well as an image shows.  # (F,)"""
    if not joint.unknowns.has_motion:
        return seen.face
    determined: Flags = (
        seen.main & seen.face & (face_shift_mm(joint.unknowns.target, accuracy.face) < UNSURE * noise_mm)
    )
    return determined


@dataclass(frozen=True, eq=False)
class _Measured:
    """A minimum in its datum and size."""

    joint: Joint
    minimum: TargetMinimum
    seen: SeenParts
    accuracy: TargetAccuracy
    state: State
    centre_noise_mm: Array  # (F,)
    is_determined: Flags
    scale: Scale | None


def _as_built(
    started: Sequence[Calibration], target: TargetGeometry, measured: _Measured, iterations: int, begin: float
) -> AsBuilt:
    """The result."""
    joint, accuracy, scale, seen = measured.joint, measured.accuracy, measured.scale, measured.seen
    size = 1.0 if scale is None else scale.value
    unit = size ** np.repeat([0, 1], 3)
    by_scale = accuracy.face_by_scale * unit
    face = accuracy.face * unit[:, None] * unit
    strain_covariance = accuracy.strain * size**2
    if scale is not None:
        face = face + (scale.sigma / size) ** 2 * by_scale[:, :, None] * by_scale[:, None, :]
        isotropic = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        strain_covariance = strain_covariance + scale.sigma**2 * isotropic[:, None] * isotropic
    found, state = measured.minimum, measured.state
    status: Status = "converged" if found.converged else "stopped"
    if not measured.is_determined.any() or any(one.status == "degenerate" for one in started):
        status = "degenerate"
    params = []
    for one in joint.sets:
        place = np.where(one.tie.row >= 0, one.first_param + one.tie.row, -1)
        spread = (place[:, None] == np.arange(joint.param_count)).astype(np.float64)
        params.append(spread @ accuracy.params @ spread.T)
    return AsBuilt(
        target=target_of(
            joint.unknowns,
            seen,
            state.shape,
            0.5 * (face + face.transpose(0, 2, 1)),
            left_open_mm(joint.unknowns, state.shape, strain_covariance, accuracy.bow),
        ),
        nominal=target,
        observations=tuple(one.observations for one in started),
        cameras=state.cameras,
        param_covariance=tuple(params),
        poses=state.poses,
        residual_px=tuple(np.ascontiguousarray(residual.T) for residual in found.equations.residual_px),
        is_outlier=tuple(~one.problem.is_used for one in joint.sets),
        scale=joint.scale,
        strain=strain_matrix(state.shape.strain),
        strain_covariance=strain_covariance,
        motion=state.shape.motion,
        motion_covariance=accuracy.motion,
        bow_mm=state.shape.bow,
        bow_covariance=accuracy.bow,
        offset_mm=state.shape.offset_mm,
        ring_sigma_mm=None
        if joint.unknowns.ring_sigma_mm is None
        else tuple(joint.unknowns.ring_sigma_mm[1:].tolist()),
        offset_sigma_mm=accuracy.offset_sigma_mm,
        scale_known=scale is not None,
        scale_sigma=float("nan") if scale is None else scale.sigma,
        lengths=() if scale is None else scale.lengths,
        is_determined=measured.is_determined,
        face_views=seen.views,
        is_outlying=seen.outlying,
        centre_noise_mm=size * measured.centre_noise_mm,
        is_ring_seen=seen.ring,
        remarks=_remarks(started, target, measured),
        status=status,
        iterations=iterations,
        seconds=time.perf_counter() - begin,
    )


def _remarks(started: Sequence[Calibration], target: TargetGeometry, measured: _Measured) -> tuple[str, ...]:
    """What a person must know, the worst first."""
    said: list[str] = []
    for one in started:
        if one.status == "degenerate":
            said.append(one.remarks[0])
        said.extend(line for line in one.remarks if ": left out: " in line)
    if not measured.minimum.converged:
        said.append("stopped short of the minimum")
    for one, residual in zip(started, measured.minimum.equations.residual_px, strict=True):
        said.extend(far_off(one.observations, residual, deviations(residual, one.observations.cov_px2)))
    left_out = sum(int((~one.problem.is_used).sum()) for one in measured.joint.sets)
    if left_out:
        said.append(f"{left_out} of {sum(len(one.ring) for one in measured.joint.sets)} observations left out")
    said.extend(remarks_of(measured.seen, measured.is_determined, target))
    return tuple(said)
