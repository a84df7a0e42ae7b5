"""The file that tells a robot's program where a camera sits: `hand_eye.json`."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.core.se3 import invert
from calib.core.types import freeze
from calib.judge.verdict import MOST_POSES, NextPose
from calib.observe.rotations import to_quaternion
from calib.rigs.carrier import turned_by
from calib.rigs.result import RigCalibration
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.marks import PACKED, Length, Shape

HAND_EYE_FILE = "hand_eye.json"


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where a camera sits on a robot, or beside it: `found.hand_eye.flange_from_cam`."""

    carried: Annotated[str, Length(1, 100)]  # what moved, as in "robot, camera in hand"
    frame: Annotated[str, Length(1, 100)]  # the camera's pose is in: flange, base or table
    frame_from_cam: Annotated[Array, Shape(4, 4)]
    quaternion_xyzw: Annotated[Array, Shape(4)]  # of its rotation
    covariance: Annotated[Array, Shape(6, 6), PACKED] | None  # of its inverse, camera axes: turn (rad), shift (mm)
    carrier_from_target: Annotated[Array, Shape(4, 4)]  # base_from_target; target in hand: flange_from_target
    robot_sigma_rad: float  # of the carrier's own errors, a coordinate
    robot_sigma_mm: float
    target_size: float  # as a part of what its file says, as the robot's ways tell it
    target_size_sigma: float
    next_poses: Annotated[tuple[NextPose, ...], Length(0, MOST_POSES)] = ()  # from which photos would tell most

    def __post_init__(self) -> None:
        freeze(self, "frame_from_cam", "quaternion_xyzw", "covariance", "carrier_from_target")

    @property
    def flange_from_cam(self) -> Array:
        """(4, 4), of a camera in hand.

        Raises:
            InputError: it is not in hand.
        """
        if self.frame != "flange":
            raise InputError(
                f"the camera does not sit on the flange: take frame_from_cam, which is in the {self.frame}'s"
            )
        return self.frame_from_cam

    def base_from_flange(self, cam_from_target: Array) -> Array:
        """Where a robot's flange is for the camera to see the target so: poses (..., 4, 4) for poses (..., 4, 4).

        The target stands where it stood, or is held as it was held, when this was solved.

        Raises:
            InputError: no robot moves.
        """
        target_from_cam = invert(np.asarray(cam_from_target, dtype=np.float64))
        if self.frame == "flange":
            there: Array = self.carrier_from_target @ target_from_cam @ invert(self.frame_from_cam)
            return there
        if self.frame != "base":
            raise InputError(f"a {self.carried} has no flange: take cam_from_target_on_table")
        held: Array = self.frame_from_cam @ cam_from_target @ invert(self.carrier_from_target)
        return held

    def cam_from_target_on_table(self, angle_rad: Array) -> Array:
        """How the camera sees the target at a turntable's angles (V,).  # (V, 4, 4)

        Raises:
            InputError: no table turns.
        """
        if self.frame != "table":
            raise InputError(f"nothing turns on a table: what moves is a {self.carried}")
        seen: Array = invert(self.frame_from_cam) @ turned_by(angle_rad) @ self.carrier_from_target
        return seen


HAND_EYE = FileKind(HandEye, "hand_eye", "a hand_eye.json", "solve it again")


def hand_eye_of(solved: RigCalibration, stated: Array | None, next_poses: tuple[NextPose, ...] = ()) -> HandEye:
    """What a robot's program needs of a rig that was carried.

    Args:
        solved: the rig.
        stated: its covariance as it is to be told.
        next_poses: that would make it better known.

    Raises:
        ValueError: nothing carried the rig.
    """
    carrier = solved.carrier
    if carrier is None:
        raise ValueError("a rig that nothing carried")
    pose = invert(solved.cam_from_rig[0])
    rows = solved.rig.pose_rows(0)
    return HandEye(
        carrier.kind, solved.rig_frame, pose, to_quaternion(pose[:3, :3]),
        None if stated is None else stated[rows, rows],
        carrier.carrier_from_target, carrier.sigma_rad, carrier.sigma_mm, carrier.size, carrier.size_sigma,
        next_poses,
    )  # fmt: skip
