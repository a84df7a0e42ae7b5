"""Where a camera sits on a robot, by its own poses of a target and the robot's: closed forms, and what they leave open.

The camera saw the target at `A_v`, the robot was at `B_v`; the equation `A_v = X B_v Z` holds for `cam_from_rig` X and
`carrier_from_target` Z of any arrangement (camera in hand, target in hand, turntable). A start for the adjustment in
pixels, which weighs each sighting.
"""

from dataclasses import dataclass

import numpy as np

from calib.core.linear_algebra import least_squares
from calib.core.se3 import exp_rotation, log_rotation, make_pose, nearest_rotation, rotation_between, skew
from calib.core.types import freeze
from designer.base.arrays import Array, Flags, Rows

MOST_PAIRS = 20_000
LEAST_TURN_RAD = 0.01
"""Robots that turn less, root mean square, are taken as not turning for the first guess; the refinement sees all."""
ENOUGH_TURN_RAD = 0.1
"""Robots that turn more about two axes leave nothing open, unless their poses and the camera's do not fit."""
DO_NOT_FIT = (
    "the poses of camera and robot do not fit each other as they are read (by unit, inversion, or what is in the hand)"
)
FARTHEST_TURN_RAD = 2.9
"""Beyond it the axis of a turn may show the other way by a little noise."""
FEWEST_JUDGED = 5
"""Poses, of fewer of which none can be told to be wrong."""
FAR_OFF = 4.0
"""Times what most poses are off, or most pairs' angles differ: not followed."""
FLOOR_RAD, FLOOR_MM = 3e-4, 0.05
"""No robot, and no camera's pose, is surer."""
UNDETERMINED = 0.02
"""Radians, or parts of the target's distance: what stays less sure than that is called not determined."""
STEPS, SURE_STEPS = 20, 5
"""Of these the first ones as if nothing but gross errors were left: what is far off yet, tells no noise."""
PART = 0.1
"""Of a direction in twelve unknowns that is to be named."""


@dataclass(frozen=True, eq=False)
class HandEyeStart:
    """A first guess of where a camera and a target sit on what moves: `start.cam_from_rig`."""

    cam_from_rig: Array  # (4, 4)
    carrier_from_target: Array  # (4, 4)
    rotation_rms_rad: float  # of what is left between the camera's poses and the robot's, poses far off left out
    shift_rms_mm: float  # likewise, of the target's origin in the camera's frame
    error: Array  # (V, 6) of each frame: rotation vector (rad), shift (mm), in the camera's axes
    is_far_off: Flags  # (V,) poses that do not follow the others
    undetermined: tuple[str, ...] = ()  # what the motions do not tell, one line each

    def __post_init__(self) -> None:
        freeze(self, "cam_from_rig", "carrier_from_target", "error")


def start_hand_eye(cam_from_target: Array, rig_from_mechanism: Array, own: Array | None = None) -> HandEyeStart:
    """`start_hand_eye(cam_from_target, flange_from_base).cam_from_rig` is cam_from_flange.

    Rotations from the turns between all pairs of frames, shifts by linear equations, both then refined together by
    Gauss-Newton steps, to which poses far off count nothing. Where all turns are about one axis, or there are none,
    the shifts tell what they can of the rotation, and what nothing tells is named.

    Args:
        cam_from_target: (V, 4, 4) by the camera alone.
        rig_from_mechanism: (V, 4, 4) by the robot: camera in hand, flange_from_base; target in hand, base_from_flange.
        own: standard deviations of the camera's poses (V, 2), rad and mm, of which few points tell some poorly; None:
            they are alike.
    """
    seen, told = np.asarray(cam_from_target, dtype=np.float64), np.asarray(rig_from_mechanism, dtype=np.float64)
    keep, own = _agreeing(seen, told), np.zeros((len(seen), 2)) if own is None else own
    guesses = [_refined(seen, told, turn, keep, own) for turn in first_turns(seen[keep], told[keep])]
    return min(guesses, key=lambda start: _badness(start.error))


def _badness(error: Array) -> float:
    """How far off most poses are, in units of the floors."""
    turn, shift = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
    return float(np.median(turn) / FLOOR_RAD + np.median(shift) / FLOOR_MM)


def _pairs(count: int) -> tuple[Rows, Rows]:
    """Pairs of frames: all, or of very many each with as many others."""
    if count * (count - 1) // 2 <= MOST_PAIRS:
        first, second = np.triu_indices(count, 1)
        return first, second
    apart = np.linspace(1, count // 2, max(MOST_PAIRS // count, 1)).astype(np.int64)
    first = np.tile(np.arange(count), len(apart))
    return first, (first + np.repeat(apart, count)) % count


def relative_turns(pose: Array, first: Rows | None = None, second: Rows | None = None) -> Array:
    """Rotation vectors (N, 3) that lead from second poses to first; of all pairs, if none are named."""
    if first is None or second is None:
        first, second = _pairs(len(pose))
    rotation = pose[:, :3, :3]
    return log_rotation(rotation[first] @ rotation[second].transpose(0, 2, 1))


def _agreeing(seen: Array, told: Array) -> Flags:
    """Poses that turn from most others by the angle that the robot turned: no rotation of axes changes an angle."""
    count = len(seen)
    if count < FEWEST_JUDGED:
        return np.ones(count, dtype=np.bool_)
    first, second = _pairs(count)
    turned = [np.linalg.norm(relative_turns(pose, first, second), axis=1) for pose in (seen, told)]
    differs = np.abs(turned[0] - turned[1])
    typical = np.array([np.median(differs[(first == v) | (second == v)]) for v in range(count)])
    return np.asarray(typical <= FAR_OFF * max(float(np.median(typical)), FLOOR_RAD))


def first_turns(seen: Array, told: Array) -> list[Array]:
    """Guesses of the rotation in X: one, but for turns about one axis without another hint."""
    first, second = _pairs(len(seen))
    a, b = relative_turns(seen, first, second), relative_turns(told, first, second)
    near = (np.linalg.norm(a, axis=1) < FARTHEST_TURN_RAD) & (np.linalg.norm(b, axis=1) < FARTHEST_TURN_RAD)
    if near.any():
        a, b = a[near], b[near]
    spread = _spread(b)
    if spread[1] > LEAST_TURN_RAD:
        return [nearest_rotation(a.T @ b)]
    if spread[2] > LEAST_TURN_RAD:
        return _about_one_axis(a, b, seen, told)
    shift_seen, shift_told = (pose[:, :3, 3] - pose[:, :3, 3].mean(axis=0) for pose in (seen, told))
    return [nearest_rotation(shift_seen.T @ shift_told)]


def _spread(turns: Array) -> Array:
    """Root mean squares of rotation vectors (N, 3) along their principal axes, ascending."""
    spread: Array = np.sqrt(np.linalg.eigvalsh(turns.T @ turns / max(len(turns), 1)).clip(min=0.0))
    return spread


def _about_one_axis(a: Array, b: Array, seen: Array, told: Array) -> list[Array]:
    """The axis goes onto the axis; how X turns about it, the shifts along the arcs say, if they are no mere arcs."""
    axis = np.linalg.eigh(b.T @ b)[1][:, 2]
    length = b @ axis
    onto = (a * length[:, None]).sum(axis=0)
    onto = onto / max(float(np.linalg.norm(onto)), np.finfo(float).tiny)
    base = rotation_between(axis, onto)
    cross = skew(axis)
    along = np.outer(axis, axis)
    shift = told[:, :3, 3]
    # In base's axes: t_A = w' turned with the robot + (cos, sin) of the angle sought on t_B + t_X, all linear.
    around = told[:, :3, :3] @ told[0, :3, :3].T
    count = len(seen)
    rows = np.concatenate(
        [
            around,
            (shift - shift @ along)[:, :, None],
            (shift @ cross.T)[:, :, None],
            np.broadcast_to(np.eye(3), (count, 3, 3)),
        ],
        axis=2,
    ).reshape(3 * count, 8)
    right = (seen[:, :3, 3] @ base - shift @ along).ravel()
    found = least_squares(rows, right)
    angle = float(np.arctan2(found[4], found[3]))
    return [base @ exp_rotation(axis * (angle + more)) for more in (0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi)]


def _refined(seen: Array, told: Array, turn: Array, keep: Flags, own: Array) -> HandEyeStart:
    """From the rotation in X to all of X and Z."""
    turn_z = nearest_rotation(((turn @ told[:, :3, :3]).transpose(0, 2, 1) @ seen[:, :3, :3])[keep].sum(axis=0))
    length = max(float(np.median(np.linalg.norm(seen[keep, :3, 3], axis=1))), FLOOR_MM)
    unit = np.tile(np.repeat([1.0, length], 3), 2)
    x, z = make_pose(turn, np.zeros(3)), make_pose(turn_z, np.zeros(3))
    error, design = equations(seen, told, x, z)
    design[:, :, :3] = design[:, :, 6:9] = 0.0  # the shifts alone, which are linear
    surest = keep[:, None] / np.repeat([FLOOR_RAD, FLOOR_MM], 3)
    x, z, _ = _stepped(x, z, error, design, unit, surest)
    for step in range(STEPS):
        error, design = equations(seen, told, x, z)
        weight = surest if step < SURE_STEPS else _weights(error, keep, own)
        x, z, loose = _stepped(x, z, error, design, unit, weight)
    error, _ = equations(seen, told, x, z)
    counts = _weights(error, keep, own)[:, 0] > 0
    rms = np.sqrt((error[counts] ** 2).sum(axis=0) / max(int(counts.sum()), 1))
    return HandEyeStart(
        x, z, float(np.linalg.norm(rms[:3])), float(np.linalg.norm(rms[3:])), error, ~counts, _named(told, x, loose)
    )


def _stepped(x: Array, z: Array, error: Array, design: Array, unit: Array, weight: Array) -> tuple[Array, Array, Array]:
    """A Gauss-Newton step of X and Z along what is determined; and what is not (6, K), of X alone, in units."""
    part = design * weight[:, :, None] * unit
    value, vector = np.linalg.eigh(np.einsum("vij,vik->jk", part, part))
    is_told = value > UNDETERMINED**-2
    pull = np.einsum("vij,vi->j", part, error * weight) @ vector
    step = unit * (vector @ np.where(is_told, pull / np.where(is_told, value, 1.0), 0.0))
    return moved_by(x, step[:6]), moved_by(z, step[6:]), vector[:6, ~is_told]


def moved_by(pose: Array, step: Array) -> Array:
    """A pose turned by the first three numbers and shifted by the others, in its own axes on the left."""
    return make_pose(exp_rotation(step[:3]) @ pose[:3, :3], pose[:3, 3] + step[3:])


def equations(seen: Array, told: Array, x: Array, z: Array) -> tuple[Array, Array]:
    """How far A is from X B Z (V, 6), and how that moves with steps of X and Z (V, 6, 12)."""
    to_z = x[:3, :3] @ told[:, :3, :3]
    away = (told[:, :3, :3] @ z[:3, 3] + told[:, :3, 3]) @ x[:3, :3].T
    turn = seen[:, :3, :3] @ (to_z @ z[:3, :3]).transpose(0, 2, 1)
    error = np.concatenate([log_rotation(turn), seen[:, :3, 3] - away - x[:3, 3]], axis=1)
    design = np.zeros((len(seen), 6, 12))
    design[:, :3, :3] = design[:, 3:, 3:6] = np.eye(3)
    design[:, 3:, :3] = -skew(away)
    design[:, :3, 6:9] = design[:, 3:, 9:] = to_z
    return error, design


def _weights(error: Array, keep: Flags, own: Array) -> Array:
    """One over what most poses are off, or are sure to; nothing for those much farther off (V, 6)."""
    length = np.linalg.norm(error.reshape(-1, 2, 3), axis=2)
    typical = np.maximum(np.median(length[keep], axis=0), [FLOOR_RAD, FLOOR_MM])
    expected = np.hypot(typical, own)
    counts = (length <= FAR_OFF * expected).all(axis=1) | (len(error) < FEWEST_JUDGED)
    if counts.sum() < FEWEST_JUDGED:
        counts = keep
    weight: Array = np.repeat(counts[:, None] / expected * np.sqrt(3), 3, axis=1)
    return weight


def _named(told: Array, x: Array, loose: Array) -> tuple[str, ...]:
    """What is not determined of X, of which `loose` (6, K) are directions in the camera's axes."""
    if not loose.size:
        return ()
    pairs = relative_turns(told)
    spread = _spread(pairs)
    lines = []
    for part, what, along in ((loose[3:], "shift", "along"), (loose[:3], "turn", "about")):
        left, size, _ = np.linalg.svd(part, full_matrices=False)
        axes = x[:3, :3].T @ left[:, size > PART]
        if axes.shape[1] == 3:
            lines.append(f"the {what} of the camera against what it is fixed to")
        else:
            lines += [f"the {what} {along} ({_words(axis)}) of what the camera is fixed to" for axis in axes.T]
    why = (
        "the robot does not turn"
        if spread[2] < LEAST_TURN_RAD
        else "all turns are about one axis, or nearly"
        if spread[1] < LEAST_TURN_RAD
        else "the robot turns too little"
        if spread[1] < ENOUGH_TURN_RAD
        else DO_NOT_FIT
    )
    return tuple(f"{why}: {line} is not determined" for line in lines)


def _words(axis: Array) -> str:
    """A direction without a sign: its largest part is positive."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return " ".join(f"{value + 0.0:.2f}".replace("-0.00", "0.00") for value in axis)
