"""Where a turntable's axis is, by a camera's own poses of a target that stands on it.

`A_v = X Rz(angle_v) Z`, with X `cam_from_table` and Z `table_from_target`. Any turn about the axis, or shift along it,
of the table's frame leaves that as it is: so the origin is where the axis is closest to the target's own origin, and
the x axis points to the camera's side.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import exp_rotation, make_pose
from calib.core.types import freeze
from calib.rigs.hand_eye import HandEyeStart, relative_turns, start_hand_eye

Array = NDArray[np.float64]

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
    start = HandEyeStart(
        x, z, found.rotation_rms_rad, found.shift_rms_mm, found.error, found.is_far_off, loose
    )  # fmt: skip
    return TurntableStart(start, angle)


def turned_by(angle_rad: Array) -> Array:
    """Turns about z: `rig_from_carrier` of a table.  # (V, 4, 4)"""
    vector = np.asarray(angle_rad, dtype=np.float64)[:, None] * np.array([0.0, 0.0, 1.0])
    return make_pose(exp_rotation(vector), np.zeros_like(vector))


def _angles(seen: Array) -> Array:
    """Turns about the axis that all relative turns have in common, from the first pose on."""
    count = len(seen)
    axis = np.linalg.eigh(_scatter(relative_turns(seen)))[1][:, 2]
    turns = relative_turns(seen, np.arange(count), np.zeros(count, dtype=np.int64))
    # The turn about the axis that leaves least of R: by the trace of Rz(-a) R (in a frame with z along the axis).
    length = np.linalg.norm(turns, axis=1)
    share = turns @ axis / np.where(length > 0, length, 1.0)
    angle = 2 * np.arctan2(np.sin(0.5 * length) * share, np.cos(0.5 * length))
    angle = np.arctan2(np.sin(angle), np.cos(angle))
    steps = np.diff(angle)
    signs = np.sign(np.arctan2(np.sin(steps), np.cos(steps)))
    return np.asarray(-angle if signs.sum() < 0 else angle)


def _scatter(turns: Array) -> Array:
    scatter: Array = turns.T @ turns
    return scatter


def _anchored(x: Array, z: Array) -> tuple[Array, Array]:
    """X and Z with the table's frame where the head of this file says."""
    middle = -x[:3, :3].T @ x[:3, 3]
    side = middle[:2] if np.hypot(*middle[:2]) > ON_AXIS * np.linalg.norm(middle) else x[0, :2]
    turn = exp_rotation(np.array([0.0, 0.0, float(np.arctan2(side[1], side[0]))]))
    frame = make_pose(turn, np.array([0.0, 0.0, z[2, 3]]))
    back = make_pose(turn.T, -frame[:3, 3])
    return x @ frame, back @ z
