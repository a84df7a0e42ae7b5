"""What a carrier, a robot's flange or a turntable, says of the frames' poses: residuals, derivatives, its own noise.

A carrier states L, `rig_from_mechanism`, in each frame. With Y = carrier_from_target, alike in all, the pose is

    camera in hand:  F = exp(e) L Y        else:  F = L exp(e) Y

where e, a small rotation and a shift of the flange in its own axes, is the carrier's error in that frame. So poses are
free and held to the carrier by its noise, of which the two sizes can be estimated; poses found first and a hand-eye
equation solved after would throw away how well each photo knows its pose.

Where a turntable's axis is, by a camera's own poses of a target that stands on it.

`A_v = X Rz(angle_v) Z`, with X `cam_from_table` and Z `table_from_target`. Any turn about the axis, or shift along it,
of the table's frame leaves that as it is: so the origin is where the axis is closest to the target's own origin, and
the x axis points to the camera's side.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.se3 import exp_rotation, log_rotation, make_pose, skew
from calib.core.types import freeze
from calib.rigs.hand_eye import HandEyeStart, relative_turns, start_hand_eye
from calib.rigs.problem import MechanismPrior, RigState
from calib.solver.eliminate import Normal
from designer.base.arrays import Array, Rows

SMALL_RAD = 1e-5


def mechanism_errors(prior: MechanismPrior, rig_from_target: Array, carrier_from_target: Array) -> Array:
    """The carrier's error in each frame: rotation vector (rad), shift (mm).  # (V, 6)"""
    return _errors(prior, rig_from_target, carrier_from_target)[0]


def error_derivatives(prior: MechanismPrior, rig_from_target: Array, carrier_from_target: Array) -> tuple[Array, Array]:
    """Of the errors by steps of the frames' poses and of `carrier_from_target`: (V, 6, 6) each.

    Steps as those of `calib.solver.eliminate`.
    """
    error, turn, model = _errors(prior, rig_from_target, carrier_from_target)
    carried = prior.carrier.rig_from_mechanism[:, :3, :3]
    one = np.tile(np.eye(3), (len(error), 1, 1))
    in_hand = prior.carrier.is_camera_in_hand
    of_frame, of_target = (one, carried) if in_hand else (carried.transpose(0, 2, 1), one)
    arm = (turn @ model[:, :3, 3:])[:, :, 0]
    by_frame, by_target = np.zeros((len(error), 6, 6)), np.zeros((len(error), 6, 6))
    by_frame[:, :3, :3] = _inverse_left_jacobian(error[:, :3]) @ of_frame
    by_frame[:, 3:, :3] = skew(arm) @ of_frame
    by_frame[:, 3:, 3:] = of_frame
    by_target[:, :3, :3] = -_inverse_left_jacobian(-error[:, :3]) @ of_target
    by_target[:, 3:, :3] = -turn @ skew(model[:, :3, 3]) @ of_target
    by_target[:, 3:, 3:] = -turn @ of_target
    return by_frame, by_target


def _errors(prior: MechanismPrior, rig_from_target: Array, carrier_from_target: Array) -> tuple[Array, Array, Array]:
    """The errors, their rotations (V, 3, 3), and where the carrier has the target, (V, 4, 4)."""
    carried = prior.carrier.rig_from_mechanism
    if prior.carrier.is_camera_in_hand:
        moved, model = rig_from_target, carried @ carrier_from_target
    else:
        back = carried[:, :3, :3].transpose(0, 2, 1)
        moved = rig_from_target.copy()
        moved[:, :3, :3] = back @ rig_from_target[:, :3, :3]
        moved[:, :3, 3] = (back @ (rig_from_target[:, :3, 3] - carried[:, :3, 3])[:, :, None])[:, :, 0]
        model = np.broadcast_to(carrier_from_target, carried.shape)
    turn = moved[:, :3, :3] @ model[:, :3, :3].transpose(0, 2, 1)
    shift = moved[:, :3, 3] - (turn @ model[:, :3, 3:])[:, :, 0]
    return np.concatenate([log_rotation(turn), shift], axis=1), turn, model


def _inverse_left_jacobian(vector: Array) -> Array:
    """J with `log(exp(w) exp(v)) = v + J w` for small w: `I - [v]/2 + c [v]^2` (..., 3, 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    safe = np.where(angle < SMALL_RAD, 1.0, angle)
    factor = np.where(angle < SMALL_RAD, 1 / 12, 1 / safe**2 - (1 + np.cos(safe)) / (2 * safe * np.sin(safe)))
    cross = skew(vector)
    jacobian: Array = np.eye(3) - 0.5 * cross + factor * (cross @ cross)
    return jacobian


def error_weights(prior: MechanismPrior) -> Array:
    """Inverse standard deviations of the errors' coordinates; zero of the turn that a free angle takes up.  # (6,)"""
    weight = np.repeat(1 / prior.sigma, 3)
    if prior.carrier.has_free_angles:
        weight[2] = 0.0
    return weight


def add_prior(into: Normal, prior: MechanismPrior, state: RigState, first_camera: Rows) -> float:
    """Add the carrier's equations to those of the sightings; returns the sum of its squares.

    `first_camera` are the shared unknowns of the first camera's pose (6,).
    """
    error = mechanism_errors(prior, state.rig_from_target, state.carrier_from_target)
    by_frame, by_target = error_derivatives(prior, state.rig_from_target, state.carrier_from_target)
    weight = error_weights(prior)
    first, second, white = weight[:, None] * by_frame, weight[:, None] * by_target, weight * error
    column = prior.column
    into.pose[:] += first.transpose(0, 2, 1) @ first
    into.pose_row[:, :, column] += first.transpose(0, 2, 1) @ second
    into.pose_row[:, :, -1] += np.einsum("vij,vi->vj", first, white)
    into.other[column[:, None], column] += np.einsum("vij,vik->jk", second, second)
    into.other[column, -1] += np.einsum("vij,vi->j", second, white)
    if prior.carrier.is_turntable:
        _hold(into, prior, state, first_camera)
    return float((white**2).sum())


def _hold(into: Normal, prior: MechanismPrior, state: RigState, first_camera: Rows) -> None:
    """Keep what is chosen of a turntable's own frame, not told: how high it is, and where its x axis points.

    That is: the target's height and its turn about the axis; and, as angles that are unknowns take up the latter, the
    first camera's turn about it. A table that wobbles does tell a height, at which it shifts least: so a held step is
    taken out of all equations, gradient and all, as one that is only made stiff would creep there forever.
    """
    turn, lift = np.zeros(6), np.zeros(6)
    turn[2] = lift[5] = 1.0
    turn[3:] = np.cross([0.0, 0.0, 1.0], state.carrier_from_target[:3, 3])
    of_turn, of_shift = len(state.rig_from_target) / prior.sigma**2  # what a carrier would tell of these
    held = [(prior.column, turn, of_turn), (prior.column, lift, of_shift)]
    if prior.carrier.has_free_angles:
        held.append((first_camera, np.concatenate([state.cam_from_rig[0, :3, 2], np.zeros(3)]), of_turn))
    for column, step, least in held:
        row = step / (step @ step)
        curve = row @ into.other[column[:, None], column] @ row
        left = np.eye(6) - np.outer(step, row)
        into.pose_row[:, :, column] = into.pose_row[:, :, column] @ left
        into.other[column] = left.T @ into.other[column]
        into.other[:, column] = into.other[:, column] @ left
        into.other[column[:, None], column] += np.outer(row, row) * max(float(curve), least)


ON_AXIS = 1e-6
"""Of its distance: a camera closer to the axis is turned by its own x axis."""


@dataclass(frozen=True, eq=False)
class TurntableStart:
    """A first guess of a table's axis and turns: `start.angle_rad`."""

    start: HandEyeStart  # the rig's frame is the table's at rest, its z along the axis
    angle_rad: Array  # (V,) as given, or as the camera saw them

    def __post_init__(self) -> None:
        freeze(self, "angle_rad")


def start_turntable(cam_from_target: Array, angle_rad: Array | None = None) -> TurntableStart:
    """`start_turntable(cam_from_target).start.cam_from_rig` is cam_from_table.

    Args:
        cam_from_target: (V, 4, 4) by the camera alone.
        angle_rad: (V,) of the table; None: by the poses, the first zero, and most steps positive.
    """
    seen = np.asarray(cam_from_target, dtype=np.float64)
    angle = _angles(seen) if angle_rad is None else np.asarray(angle_rad, dtype=np.float64)
    found = start_hand_eye(seen, turned_by(angle))
    x, z = _anchored(found.cam_from_rig, found.carrier_from_target)
    # How X and Z may turn and shift together is chosen above: it is nothing that more photos would tell.
    loose = () if np.ptp(angle) > 0 else ("the table does not turn: where its axis is, is not determined",)
    start = HandEyeStart(x, z, found.rotation_rms_rad, found.shift_rms_mm, found.error, found.is_far_off, loose)
    return TurntableStart(start, angle)


def turned_by(angle_rad: Array) -> Array:
    """Turns about z: `rig_from_mechanism` of a table.  # (V, 4, 4)"""
    vector = np.asarray(angle_rad, dtype=np.float64)[:, None] * np.array([0.0, 0.0, 1.0])
    return make_pose(exp_rotation(vector), np.zeros_like(vector))


def _angles(seen: Array) -> Array:
    """Turns about the axis that all relative turns have in common, from the first pose on."""
    count = len(seen)
    turns = relative_turns(seen)
    axis = np.linalg.eigh(turns.T @ turns)[1][:, 2]
    turns = relative_turns(seen, np.arange(count), np.zeros(count, dtype=np.int64))
    # The turn about the axis that leaves least of R: by the trace of Rz(-a) R (in a frame with z along the axis).
    length = np.linalg.norm(turns, axis=1)
    share = turns @ axis / np.where(length > 0, length, 1.0)
    angle = 2 * np.arctan2(np.sin(0.5 * length) * share, np.cos(0.5 * length))
    angle = np.arctan2(np.sin(angle), np.cos(angle))
    steps = np.diff(angle)
    signs = np.sign(np.arctan2(np.sin(steps), np.cos(steps)))
    return np.asarray(-angle if signs.sum() < 0 else angle)


def _anchored(x: Array, z: Array) -> tuple[Array, Array]:
    """X and Z with the table's frame where the head of this file says."""
    middle = -x[:3, :3].T @ x[:3, 3]
    side = middle[:2] if np.hypot(*middle[:2]) > ON_AXIS * np.linalg.norm(middle) else x[0, :2]
    turn = exp_rotation(np.array([0.0, 0.0, float(np.arctan2(side[1], side[0]))]))
    frame = make_pose(turn, np.array([0.0, 0.0, z[2, 3]]))
    back = make_pose(turn.T, -frame[:3, 3])
    return x @ frame, back @ z
