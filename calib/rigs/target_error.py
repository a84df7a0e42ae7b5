"""What a target that is not quite as its file says may have done to a rig that was solved from photos of it.

    found = with_target_error(found, how_made(target, "fdm-board"))
    found.stated_covariance

As `calib.solver.target_error` has it for one camera, for the parameters and places of all cameras at once. One thing is
new: a target that is too large by one part in a thousand moves all cameras apart by as much, and no photo tells it.

What each frame of a rig tells of its cameras and where they sit, the frame's own pose eliminated.

With H of the sightings by the shared unknowns and the frame's pose F, a frame tells `A - B C^-1 B'` of the blocks of
`[A B; B' C] = H'H`. Where a robot carries the cameras or the target, F is held to the robot's word by the robot's noise
(`calib.rigs.carrier`): with E of the robot's errors it is `H'H + E'E`. Errors that all of a photo share
(`RigProblem.slack`, k times what its noise lets it tell of its pose) first take `k / (1 + k) h W^-1 h'` from the
sightings' part, W being its block of the pose and h its columns.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from calib.cameras import linearise, parameter_names
from calib.cameras.rig import POSE
from calib.core.linear_algebra import symmetric_inverse
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, invert, make_pose
from calib.rigs.carrier import error_derivatives, error_weights
from calib.rigs.problem import Mechanism, MechanismPrior
from calib.rigs.result import MechanismFit, RigCalibration
from calib.solver.free_shape import PosedSightings, ShapeEquations, equations_of, free_directions, posed_prior, weights
from calib.solver.problem import prior_of
from calib.solver.target_error import added_covariance, unbent
from designer.base.arrays import Array, Rows
from designer.tolerance.made import Made
from designer.tolerance.prior import ShapePrior

AT_A_TIME = 256
"""Frames times cameras: derivatives of all would take much memory."""
MOST_SIGHTINGS = 120_000
"""That the equations are made of, which takes a few seconds."""


@one_thread
def with_target_error(found: RigCalibration, made: Made | None) -> RigCalibration:
    """The rig with what its target's errors may have done to it; as it was if nobody knows how that was made."""
    if made is None:
        return found
    covariance = np.zeros_like(found.covariance)
    basis = free_directions(found.covariance)
    if made.prior is not None and basis.size:
        prior = unbent(made.prior, found.target_bend, found.observations.points)
        covariance = added_covariance(rig_equations(found, basis, prior))
    return replace(found, target_covariance=covariance)


def rig_equations(found: RigCalibration, basis: Array, prior: ShapePrior) -> ShapeEquations:
    """The normal equations over directions (N, Q) of the joint covariance and the shape of the target.

    Of very many sightings those of evenly spread frames stand for all.
    """
    used = _used(found)
    moves = np.abs(prior.modes_mm[:, used]).max(axis=(1, 2), initial=0.0) > 0
    return _at_minimum(_equations(found, basis, used, prior.modes_mm[moves], prior.ring_modes_mm))


def unseen_errors(found: RigCalibration, priors: Sequence[ShapePrior]) -> tuple[Array, ...]:
    """What each of several kinds of errors does to a rig that is solved with the target as drawn: (N, N) each.

    Mean squares over all prints: the error of one is `-N_cc^-1 N_cs s`, to first order.
    """
    basis, used = free_directions(found.covariance), _used(found)
    modes_mm = np.concatenate([one.modes_mm for one in priors])
    own_mm = np.concatenate([one.ring_modes_mm for one in priors], axis=2)
    equations = _equations(found, basis, used, modes_mm, own_mm)
    camera = equations.camera
    gain = equations.basis @ symmetric_inverse(equations.normal[camera, camera]).inverse
    by_shared = gain @ equations.normal[camera, camera.stop :]
    by_own = (gain @ equations.own.cross[camera]).reshape(len(gain), len(used), -1)
    shared, own, moved = 0, 0, []
    for one in priors:
        some = by_shared[:, shared : shared + len(one.modes_mm)]
        each = by_own[:, :, own : own + one.ring_modes_mm.shape[2]].reshape(len(gain), -1)
        shared, own = shared + len(one.modes_mm), own + one.ring_modes_mm.shape[2]
        moved.append(some @ some.T + each @ each.T)
    return tuple(moved)


def _used(found: RigCalibration) -> Rows:
    """The points that count somewhere."""
    seen = zip(found.observations.sightings, found.is_outlier, strict=True)
    return np.unique(np.concatenate([one.point[~outlier] for one, outlier in seen]))


def _equations(found: RigCalibration, basis: Array, used: Rows, modes_mm: Array, own_mm: Array) -> ShapeEquations:
    """The equations of all that was solved for, and of displacements of the target's points."""
    frames = some_frames(found)
    wide, posed = posed_unknowns(found, frames, basis)
    equations = equations_of(posed, used, wide, modes_mm, own_mm)
    return _for_all(equations, found.observations.frame_count / len(frames))


def posed_unknowns(
    found: RigCalibration, frames: Rows, basis: Array | None = None
) -> tuple[Array, Iterable[PosedSightings]]:
    """What is seen and said of each frame, by all unknowns: the rig's own directions, and behind these all others.

    Args:
        found: the rig.
        frames: rows of frames.
        basis: the rig's directions (N, Q); None: those that were estimated.

    Returns:
        these directions with zeros for the others (N, Q + ...), and the equations of the frames by all.
    """
    basis = free_directions(found.covariance) if basis is None else basis
    besides = 0 if found.carrier is None else POSE + tells_size(found)  # the target's size, and its place on a carrier
    wide = np.concatenate([basis, np.zeros((len(basis), besides))], axis=1)
    posed = posed_frames(found, wide, frames)
    posed = posed if found.carrier is None else _carried(found, posed, frames, wide.shape[1])
    return wide, chain(posed, posed_priors(found, wide, frames))


def posed_priors(found: RigCalibration, basis: Array, frames: Rows, more: int = 0) -> Iterator[PosedSightings]:
    """What is known of the cameras' parameters beforehand, as much of it as frames are taken; see `posed_frames`."""
    part = len(frames) / found.observations.frame_count
    for camera, (one, priors) in enumerate(zip(found.cameras, found.priors, strict=True)):
        if priors:
            prior = prior_of(priors, parameter_names(one.model), part)
            rows = np.pad(basis[found.rig.params_rows(camera)], ((0, 0), (0, more)))
            yield posed_prior(prior, one.params, rows, int(found.observations.sightings[camera].point[0]))


def some_frames(found: RigCalibration) -> Rows:
    """All frames, or evenly spread ones of very many sightings."""
    every = max(-(-sum(map(len, found.residual_px)) // MOST_SIGHTINGS), 1)
    return np.arange(0, found.observations.frame_count, every)


def _for_all(equations: ShapeEquations, times: float) -> ShapeEquations:
    """The equations of so many times as many sightings."""
    own = equations.own
    return replace(
        equations, normal=times * equations.normal, gradient=times * equations.gradient,
        square=times * equations.square, equations=round(times * equations.equations),
        own=replace(own, block=times * own.block, by_poses=np.sqrt(times) * own.by_poses, cross=times * own.cross,
                    gradient=times * own.gradient),
    )  # fmt: skip


def tells_size(found: RigCalibration) -> bool:
    """Whether the target's size was solved, too, by the ways of its carrier."""
    return found.carrier is not None and found.carrier.size_sigma > 0


def _at_minimum(equations: ShapeEquations) -> ShapeEquations:
    """The equations at the least squares of the cameras, to which the last step is taken here.

    What cameras can take up whole, such as the target's size, has no gradient there. A solution by a robust loss, or
    one that stopped a thousandth of a deviation short, would have one that means nothing.
    """
    camera, own = equations.camera, equations.own
    inverse = symmetric_inverse(equations.normal[camera, camera]).inverse
    step = -inverse @ equations.gradient[camera]
    return replace(
        equations,
        gradient=equations.gradient + equations.normal[:, camera] @ step,
        square=equations.square + float(equations.gradient[camera] @ step),
        own=replace(own, gradient=own.gradient + step @ own.cross[camera]),
    )


def _carried(
    found: RigCalibration, posed: Iterable[PosedSightings], frames: Rows, width: int
) -> Iterator[PosedSightings]:
    """The sightings of each frame, and what a robot or a turntable says of its pose, by its own noise.

    It tells the target's size in part: by how far it was moved.
    """
    prior, fit = mechanism_prior(found)
    by_frame, by_carrier = error_derivatives(prior, found.rig_from_target, fit.carrier_from_target)
    weight = error_weights(prior)
    for frame, one in zip(frames.tolist(), posed, strict=True):
        by_unknowns = np.zeros((POSE, width))
        by_unknowns[:, -POSE:] = weight[:, None] * by_carrier[frame]
        rows = POSE // 2
        said = PosedSightings(
            np.repeat(one.point[:1], rows), by_unknowns.reshape(rows, 2, width),
            (weight * fit.error[frame]).reshape(rows, 2, 1),
            (weight[:, None] * by_frame[frame]).reshape(rows, 2, POSE), np.zeros((rows, 2, 3)),
        )  # fmt: skip
        yield PosedSightings.joined([one, said])


def mechanism_prior(found: RigCalibration) -> tuple[MechanismPrior, MechanismFit]:
    """What the carrier said, by what its errors were found to be."""
    fit = found.carrier
    if fit is None:
        raise ValueError("a rig without a carrier")
    turn, shift = exp_rotation(fit.error[:, :3]), fit.error[:, 3:]
    if found.rig_frame == "flange":
        back = turn.transpose(0, 2, 1)
        moved = (back @ (found.rig_from_target[:, :3, 3] - shift)[:, :, None])[:, :, 0]
        carried = make_pose(back @ found.rig_from_target[:, :3, :3], moved) @ invert(fit.carrier_from_target)
    else:
        off = make_pose(turn @ fit.carrier_from_target[:3, :3], turn @ fit.carrier_from_target[:3, 3] + shift)
        carried = found.rig_from_target @ invert(off)
    carrier = Mechanism(
        fit.kind, carried, is_camera_in_hand=found.rig_frame == "flange", is_turntable=found.rig_frame == "table",
        has_free_angles=fit.angle_rad is not None and not np.allclose(fit.error[:, 2], 0.0),
    )  # fmt: skip
    return MechanismPrior(carrier, np.arange(POSE), np.array([fit.sigma_rad, fit.sigma_mm])), fit


def posed_frames(
    found: RigCalibration, basis: Array, frames: Rows, moved_px: Sequence[Array] | None = None
) -> Iterator[PosedSightings]:
    """The sightings of frames by all cameras; what moves them together is the target's pose in the rig's frame.

    Behind the directions stands what else moves each camera's centres, (C,) of (M_c, 2, K): C K columns, if any.
    """
    more = moved_px or [np.zeros((len(one), 2, 0)) for one in found.residual_px]
    cameras = [_sightings(found, camera, basis, frames, more[camera]) for camera in range(len(found.cameras))]
    for frame in frames.tolist():
        yield PosedSightings.joined(
            [one.between(*np.searchsorted(order, [frame, frame + 1]).tolist()) for order, one in cameras]
        )


def _sightings(
    found: RigCalibration, camera: int, basis: Array, frames: Rows, moved_px: Array
) -> tuple[Rows, PosedSightings]:
    """Those of one camera by its own noise, and their frames, ascending."""
    seen, rig = found.observations.sightings[camera], found.rig
    is_wanted = np.isin(found.observations.frame[camera], frames)[seen.view]
    row = np.flatnonzero(is_wanted & ~found.is_outlier[camera])
    frame = found.observations.frame[camera][seen.view[row]]
    rig_from_target, cam_from_rig = found.rig_from_target[frame], found.cam_from_rig[camera]
    size = 1.0 if found.carrier is None else found.carrier.size
    position = size * seen.points.position_mm[seen.point[row]]
    # In the axes of the rig and of the camera: places, and what turns about the pose's own origin move.
    turned = (rig_from_target[:, :3, :3] @ position[:, :, None])[:, :, 0]
    in_rig = turned + rig_from_target[:, :3, 3]
    lever = in_rig @ cam_from_rig[:3, :3].T
    linear = linearise(found.cameras[camera], np.ascontiguousarray((lever + cam_from_rig[:3, 3]).T))
    weight = weights(seen, row, weighted=found.weighted) / found.scale[camera]
    by_point = weight @ linear.by_point.transpose(2, 0, 1)
    by_rig = by_point @ cam_from_rig[:3, :3]
    by_camera = weight @ (linear.by_params.transpose(2, 0, 1) @ basis[rig.params_rows(camera)])
    by_camera += _by_motion(lever, by_point) @ basis[rig.pose_rows(camera)]
    by_target = by_rig @ rig_from_target[:, :3, :3]
    if tells_size(found):
        by_camera[:, :, -POSE - 1] = (by_target @ position[:, :, None])[:, :, 0]
    wide = np.zeros((*by_camera.shape[:2], len(found.cameras), moved_px.shape[2]))
    wide[:, :, camera] = weight @ moved_px[row]
    return (
        frame,
        PosedSightings(
            seen.point[row], np.concatenate([by_camera, wide.reshape(*wide.shape[:2], -1)], axis=2),
            weight @ found.residual_px[camera][row][:, :, None],
            _by_motion(turned, by_rig), by_target,
        ),
    )  # fmt: skip


def _by_motion(lever: Array, by_place: Array) -> Array:
    """By a turn and a shift (M, 2, 6): a turn by w moves a place p by w x p."""
    return np.concatenate([np.cross(lever[:, None, :], by_place), by_place], axis=2)


def frame_information(found: RigCalibration, basis: Array) -> Array:
    """Of each frame: `frame_information(found, free_directions(found.covariance)).sum(axis=0)`.  # (V, Q, Q)

    The Q unknowns are the basis's directions; with a carrier also the target's size if it was solved, and
    `carrier_from_target`.

    Args:
        found: a rig; with a carrier one of a single camera.
        basis: directions (N, K) of the rows of the rig's covariance.
    """
    besides = 0 if found.carrier is None else POSE + tells_size(found)
    wide = np.concatenate([basis, np.zeros((len(basis), besides))], axis=1)
    count, frames = wide.shape[1], found.observations.frame_count
    product = np.zeros((frames, count + POSE, count + POSE))
    for some in np.array_split(np.arange(frames), -(-frames * len(found.cameras) // AT_A_TIME)):
        for frame, one in zip(some.tolist(), posed_frames(found, wide, some), strict=True):
            column = np.concatenate([one.by_camera, one.by_pose], axis=2).reshape(-1, count + POSE)
            product[frame] = column.T @ column
    return told_by_frames(found, product)


def told_by_frames(found: RigCalibration, product: Array) -> Array:
    """The same of normal matrices (V, Q + 6, Q + 6) of what is seen in frames at `rig_from_target`, poses last."""
    count = product.shape[1] - POSE
    if found.slack is not None:
        pose = product[:, :, count:]
        taken = pose @ symmetric_inverse(pose[:, count:]).inverse @ pose.transpose(0, 2, 1)
        product = product - found.slack / (1 + found.slack) * taken
    if found.carrier is not None:
        prior, fit = mechanism_prior(found)
        by_frame, by_carrier = error_derivatives(prior, found.rig_from_target, fit.carrier_from_target)
        told = error_weights(prior)[:, None] * np.concatenate([by_carrier, by_frame], axis=2)
        product = product.copy()
        product[:, -2 * POSE :, -2 * POSE :] += told.transpose(0, 2, 1) @ told
    cross = product[:, :count, count:]
    left: Array = product[:, :count, :count] - (
        cross @ symmetric_inverse(product[:, count:, count:]).inverse @ cross.transpose(0, 2, 1)
    )
    return left


def expected_information(found: RigCalibration, directions: int) -> Array:
    """What is known without any frame, of the same unknowns: about how large a target is.  # (Q, Q)"""
    least = np.zeros(directions + tells_size(found) + POSE)
    if found.carrier is not None and tells_size(found):
        least[directions] = found.carrier.size_sigma_before**-2
    return np.diag(least)
