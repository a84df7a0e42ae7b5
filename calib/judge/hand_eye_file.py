"""The file that tells a robot's program where a camera sits: `hand_eye.json`.

A camera in a robot's hand, or beside the robot that holds the target: one adjustment with the robot's own errors.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.cameras import COMMON
from calib.cameras.rig import ALONE
from calib.core.se3 import invert
from calib.core.types import freeze, keep_views
from calib.judge.folders import RigRun
from calib.judge.rig_solution import CameraWishes, RigSeen, judged_rig
from calib.judge.verdict import MOST_POSES, Criteria, NextPose
from calib.observe.rig_observations import alone_as_rig
from calib.observe.robot_poses import RobotPoses, poses_of
from calib.observe.rotations import to_quaternion
from calib.rigs.carrier import turned_by
from calib.rigs.problem import FREE_SIZE, CameraChoice, Carrier, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.robot_readings import why_size, why_wrong
from calib.rigs.start import solve_alone
from calib.solver.plan import ALL
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.marks import PACKED, Length, Shape
from designer.page.progress import Progress

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


FEWEST_POSES = 3
SURELY = 4.0
"""Standard deviations from which on a target was not made as it is said."""
ROBOT_LENGTHS = 1e-3
"""Standard deviation of a robot's own lengths, as a part of them."""
IN_HAND, TARGET_IN_HAND = "robot, camera in hand", "robot, target in hand"


@dataclass(frozen=True)
class RobotSetting:
    """How a robot, its camera and its target go together."""

    is_target_in_hand: bool = False  # else it holds the camera
    solves_size: bool | None = None  # of the target, by the robot's ways alone; None: as sure as it was made so
    sigma_rad: float | None = None  # of a coordinate of the robot's errors; None: estimated
    sigma_mm: float | None = None


def judged_on_robot(
    seen: RigSeen, poses: RobotPoses, setting: RobotSetting, wishes: CameraWishes, limits: Criteria,
    settings: tuple[tuple[str, str], ...], progress: Progress,
) -> tuple[RigRun, RigSeen]:  # fmt: skip
    """Solve where a camera sits on a robot, or beside it, and judge that.

    Args:
        seen: by the one camera, a frame a photo.
        poses: base_from_flange of its photos.
        setting: what the robot holds, and what is known of it.
        wishes: what was asked for of the camera.
        limits: of the verdict.
        settings: for the record.
        progress: is told what is being done.

    Raises:
        InputError: too few photos have a pose, or poses look inverted or in another unit.
    """
    seen, base_from_flange = _with_poses(seen, poses, wishes, is_camera_in_hand=not setting.is_target_in_hand)
    size_sigma = FREE_SIZE * (setting.solves_size is not False)
    if setting.solves_size is None and seen.target is not None and seen.made is not None:
        # Of a target against a robot's lengths, by how both were made.
        prior = seen.made.prior
        size_sigma = math.hypot(ROBOT_LENGTHS, 0.0 if prior is None else prior.size_sigma(seen.target.center_mm))
    carrier = Carrier(
        TARGET_IN_HAND if setting.is_target_in_hand else IN_HAND,
        base_from_flange if setting.is_target_in_hand else invert(base_from_flange),
        is_camera_in_hand=not setting.is_target_in_hand, sigma_rad=setting.sigma_rad, sigma_mm=setting.sigma_mm,
        size_sigma=size_sigma,
    )  # fmt: skip

    def solved(by: Carrier) -> tuple[RigRun, RigSeen]:
        options = RigOptions(carrier=by, minimise=wishes.options.minimise)
        return judged_rig(seen, wishes, options, limits, settings, progress)

    run, told = solved(carrier)
    fit = run.found.carrier
    if fit is not None and abs(fit.size - 1) > SURELY * size_sigma > 0:
        # The robot's ways belie how the target was made: then they alone tell.
        run, told = solved(replace(carrier, size_sigma=FREE_SIZE))
        fit = run.found.carrier
    if fit is not None and (why := why_size(poses, fit.size)):
        raise InputError(f"{poses.origin}: {why}")
    return run, told


def _with_poses(
    seen: RigSeen, poses: RobotPoses, wishes: CameraWishes, *, is_camera_in_hand: bool
) -> tuple[RigSeen, Array]:
    """The photos of which the robot's pose is known, and these poses, if they explain the photos as they are read."""
    one = seen.observations.sightings[0]
    matched = poses_of(poses, one.view_names)
    keep = np.array([row is not None for row in matched.row])
    rows = [row for row in matched.row if row is not None]
    lost = [name for name, ok in zip(one.view_names, keep.tolist(), strict=True) if not ok]
    if len(rows) < FEWEST_POSES:
        raise InputError(
            f"{poses.origin}: {len(rows)} of {len(keep)} photos have a pose; {FEWEST_POSES} or more are needed: "
            "name the poses as the photos' files are"
        )
    said = [matched.remark] if matched.remark else []
    if lost:
        said.append(f"{len(lost)} photos have no robot pose and are left out, the first is {lost[0]}")
    if matched.unused:
        said.append(f"{len(matched.unused)} robot poses are of no photo in use, the first is {matched.unused[0]}")
    kept = replace(alone_as_rig(ALONE, keep_views(one, keep)), remarks=(*seen.observations.remarks, *said))
    given, model = wishes.given.get(ALONE), COMMON if wishes.model == ALL else str(wishes.model)
    choice = CameraChoice(model if given is None else given.model, given, is_refined=False)
    alone = solve_alone(kept.sightings[0], ALONE, choice, RigOptions())
    if why := why_wrong(alone.cam_from_target, poses, np.array(rows), is_camera_in_hand=is_camera_in_hand):
        raise InputError(f"{poses.origin}: {why}")
    return replace(seen, observations=kept), poses.base_from_flange[rows]
