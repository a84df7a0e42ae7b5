"""Where a camera sits on a robot, of poses alone: `calib hand-eye --poses robot.csv --target-poses camera.csv`."""

import math
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Annotated

from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.marks import NOT_IN_FILE, Gap
from designer.base.options import option
from designer.base.words import capital, cut, figure, printable
from designer.page.capability import capability
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.observe.robot_poses import RobotPoses
    from calib.rigs.pose_pairs import InHand, PairsSolution
    from designer.base.arrays import Array
    from designer.page.blocks import Headline, Page

MOST_ROWS = 20
ARRAY = "an array"
"""Where poses are from that have no names."""
QUESTION = "Where does the camera sit, by its poses of a target and the robot's poses alone?"
MEANING = (
    "Standard deviations are by the scatter of the poses, of which the noise of camera and robot is estimated. What is "
    "wrong in all poses alike, such as the robot's own geometry, the target's size or the lens, is not in them: photos "
    "instead of poses tell more."
)
TargetInHand = Annotated[bool, option("the robot holds the target; the camera stands beside it")]
Inverted = Annotated[bool, option("the robot's file holds flange_from_base")]
PoseUnit = Annotated[str | None, option("of columns that do not name it: mm, m, deg, rad, or m,deg")]
Euler = Annotated[str | None, option("convention of Euler angles: xyz-extrinsic, kuka, fanuc")]


@dataclass(frozen=True, eq=False)
class HandEyeOfPoses(
    Result, kind="hand_eye_poses", title="Hand-eye calibration of poses", doing="solving",
    files={"pose_errors.csv": "how far each pose is off"},
):  # fmt: skip
    """Where the camera sits: `hand_eye(poses="robot.csv", target_poses="camera.csv").place`.

    `place` is flange_from_cam of a camera in the hand, else base_from_cam; `target_place` is base_from_target, else
    flange_from_target: X and Y of `A X = Y B`. Their covariances are of a turn (rad) and a shift (mm) on the left.
    """

    program: str
    settings: dict[str, str]
    in_hand: str  # what the robot carries: camera or target
    pairs: int  # poses that both have
    place: "Array"  # (4, 4)
    target_place: "Array"  # (4, 4)
    covariance: "Array"  # (6, 6) of place
    target_covariance: "Array | None"  # (6, 6) of target_place; None: errors add up, and no pose tells it better
    turn_sigma_rad: Gap  # about the least sure axis
    shift_sigma_mm: Gap  # along the least sure one
    scale: Gap  # lengths of the camera's poses over the robot's; nan: not sought
    scale_sigma: Gap
    offset_s: Gap  # by which the camera's clock is ahead; nan: not sought
    offset_sigma_s: Gap
    noise: dict[str, float]  # standard deviations of the poses, as estimated
    left_out: tuple[str, ...]  # poses that do not follow the others
    outside: tuple[str, ...]  # poses of the camera at times for which the robot has none
    errors_add_up: bool
    undetermined: tuple[str, ...]
    remarks: tuple[str, ...]
    names: Annotated[tuple[str, ...], NOT_IN_FILE]  # of the pairs
    found: Annotated["PairsSolution", NOT_IN_FILE]

    @property
    def is_negative(self) -> bool:
        """Whether the poses do not determine it."""
        return bool(self.undetermined)

    @property
    def remedy(self) -> str:
        """What to do first."""
        from calib.rigs.hand_eye import DO_NOT_FIT

        if any(one.startswith(DO_NOT_FIT) for one in self.undetermined):
            return "try another --unit, --inverted, --target-inverted or --target-in-hand"
        return "turn the robot about two axes, by 30 degrees or more" if self.undetermined else ""

    def page(self) -> "Page":
        """The place, how sure it is, and which poses do not follow."""
        return _page(self)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without the figure."""
        return page or _page(self, is_drawn=False)

    def tables(self) -> dict[str, bytes]:
        """`pose_errors.csv`."""
        from calib.core.csv_table import csv_bytes, csv_cell

        rows = (
            [csv_cell(name), *map(repr, [*error.tolist(), float(off)]), str(int(is_off))]
            for name, error, off, is_off in zip(
                self.names, self.found.error, self.found.off, self.found.is_off, strict=True
            )
        )
        head = ["pose", "rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm", "weighed", "left_out"]
        return {"pose_errors.csv": csv_bytes(("# ringsolid pose-errors, version 1", ERRORS_TOLD), head, rows)}


ERRORS_TOLD = "# cam_from_target less what the solution says: a turn and a shift in the camera's axes"


@capability
def hand_eye_poses(
    target_poses: Annotated[
        "RobotPoses | Array | Place",
        option("instead of photos: cam_from_target of each pose: of calib pose, .csv, .json, .yaml, .tum"),
    ],
    *,
    poses: Annotated[
        "RobotPoses | Array | Place", option("base_from_flange of each pose, or of a stream with times", flag="--poses")
    ],
    covariances: "Array | None" = None,
    target_in_hand: TargetInHand = False,
    inverted: Inverted = False,
    target_inverted: Annotated[bool, option("the camera's file holds target_from_cam, as odometry does")] = False,
    unit: PoseUnit = None,
    euler: Euler = None,
    free_scale: Annotated[bool, option("the camera's lengths are in no known unit: solve their scale")] = False,
    odometry: Annotated[
        bool | None,
        option(
            "errors of the camera's poses add up from pose to pose (default: as the poses say)", off="--no-odometry"
        ),
    ] = None,
    same_clock: Annotated[bool, option("times of both are of one clock; else its offset is solved")] = False,
) -> HandEyeOfPoses:
    """Solve where a camera sits on a robot, of poses: `hand_eye(poses="robot.csv", target_poses="camera.csv")`.

    Pairs of poses, by names, or two streams with times, of which the offset of the clocks is solved. The noise of
    camera and robot is estimated with the place; poses that do not follow the others are named and left out.

    >>> found = calib.hand_eye(poses=base_from_flange, target_poses=cam_from_target)
    >>> found.place, found.shift_sigma_mm

    Args:
        target_poses: cam_from_target of each pose (V, 4, 4) in mm, or a file: of `calib pose`, or as robots' are.
        poses: base_from_flange of each pose (V, 4, 4) in mm, or its file; or a stream with times.
        covariances: (V, 6, 6) of the camera's poses: a turn (rad) and a shift (mm) on the left, in the camera's axes;
            None: those of a table of `calib pose`, or estimated.

    Raises:
        InputError: files that break a rule, poses that do not pair, or fewer than three.
    """
    import numpy as np

    from calib.app.solved_rig import settings_of
    from calib.core.linear_algebra import moved_covariance
    from calib.core.se3 import inverse_slope, invert
    from calib.rigs.pose_pairs import COMPONENTS, PosePairs, solve_pose_pairs, solve_pose_streams

    if (unit is not None or euler is not None) and not any(
        isinstance(one, str | PathLike) for one in (poses, target_poses)
    ):
        raise InputError("unit, euler: tell how files of poses are read; these poses are read already")
    robot = _poses(poses, "poses", unit, euler, is_inverted=inverted)
    seen = _poses(target_poses, "target_poses", unit, euler, is_inverted=target_inverted)
    if covariances is not None:
        seen = replace(seen, covariance=_covariances(covariances, len(seen.images)))
    elif seen.covariance is not None and target_inverted:
        raise InputError(
            f"--target-inverted: {seen.origin} is of calib pose, which writes cam_from_target; leave it out"
        )
    robot, seen = robot.sorted_by_time(), seen.sorted_by_time()
    told = robot.base_from_flange if target_in_hand else invert(robot.base_from_flange)
    given = seen.covariance
    hand: InHand = "target" if target_in_hand else "camera"
    remark, cam_time_s, robot_time_s = "", seen.time_s, robot.time_s
    if cam_time_s is None or robot_time_s is None or np.array_equal(cam_time_s, robot_time_s):
        if same_clock:
            raise InputError(
                "--same-clock: is of two streams with times of their own; these pose pairs have one time each"
            )
        rows, of_robot, remark = _paired(seen, robot)
        pairs = PosePairs(seen.base_from_flange[rows], told[of_robot], hand, None if given is None else given[rows])
        found = solve_pose_pairs(pairs, has_scale=free_scale, adds_up=odometry)
        offset_s = math.nan
    else:
        rows = list(range(len(seen.images)))
        found = solve_pose_streams(
            cam_time_s, seen.base_from_flange, robot_time_s, told, hand, given, has_scale=free_scale, adds_up=odometry,
            offset_s=0.0 if same_clock else None,
        )  # fmt: skip
        offset_s = math.nan if same_clock else found.offset_s
    names = tuple(seen.images[row] for row in rows)
    told_of = list(zip(names, found.is_off.tolist(), found.off.tolist(), strict=True))
    place, other = found.cam_from_rig, found.carrier_from_target
    covariance, second = found.covariance[:6, :6], found.covariance[6:, 6:]
    if hand == "camera":  # of the inverse: the same error, seen from the other side
        place, covariance = invert(place), moved_covariance(inverse_slope(place)[None], covariance)[0]
    turn, shift = (float(np.sqrt(np.linalg.eigvalsh(one)[-1])) for one in (covariance[:3, :3], covariance[3:, 3:]))
    components = COMPONENTS if given is None else COMPONENTS[-2:]
    return HandEyeOfPoses(
        program(), dict(settings_of(("poses", poses), ("target-poses", target_poses))), hand, len(names), place, other,
        covariance, None if found.adds_up else second, turn, shift, found.scale if free_scale else math.nan,
        found.scale_sigma if free_scale else math.nan, offset_s,
        math.nan if math.isnan(offset_s) else found.offset_sigma_s,
        dict(zip(components, found.sigma[-len(components) :], strict=True)),
        tuple(name for name, off, length in told_of if off and math.isfinite(length)),
        tuple(name for name, _, length in told_of if not math.isfinite(length)), found.adds_up, found.undetermined,
        tuple(one for one in (remark,) if one), names, found,
    )  # fmt: skip


def _poses(
    given: "RobotPoses | Array | Place", what: str, unit: str | None, euler: str | None, *, is_inverted: bool
) -> "RobotPoses":
    """Poses as they are, of an array, or of a file."""
    import numpy as np

    from calib.core.se3 import invert, rigid_fault
    from calib.observe.robot_poses import RobotPoses, read_robot_poses
    from designer.base.files import place_of

    if isinstance(given, np.ndarray):
        if given.ndim != 3 or given.shape[1:] != (4, 4):
            raise InputError(f"{what}: an array of shape {given.shape}; give poses of shape (V, 4, 4), in mm")
        pose = np.asarray(given, dtype=np.float64)
        if fault := rigid_fault(pose):
            raise InputError(f"{what}: pose {fault[0]}: {fault[1]}")
        return RobotPoses(tuple(map(str, range(len(pose)))), invert(pose) if is_inverted else pose, ARRAY)
    if isinstance(given, RobotPoses):
        if is_inverted:
            raise InputError(f"{what}: are read already, and as they are; tell the reader that its file is inverted")
        return given
    return read_robot_poses(place_of(given, "a file of poses"), unit=unit, euler=euler, is_inverted=is_inverted)


def _covariances(given: "Array", count: int) -> "Array":
    """One a pose, and such as can be; InputError: they are none."""
    import numpy as np

    covariance = np.asarray(given, dtype=np.float64)
    if covariance.shape != (count, 6, 6):
        raise InputError(
            f"covariances: shape {covariance.shape}; give ({count}, 6, 6), one of each of the target's poses"
        )
    is_odd = np.asarray(~np.isfinite(covariance).all(axis=(1, 2)))
    is_odd |= np.linalg.eigvalsh(np.where(is_odd[:, None, None], 0.0, covariance))[:, 0] <= 0
    if is_odd.any():
        raise InputError(f"covariances: that of pose {np.flatnonzero(is_odd)[0]} is not positive definite")
    return covariance


def _paired(seen: "RobotPoses", robot: "RobotPoses") -> tuple[list[int], list[int], str]:
    """Rows of the camera's poses and of the robot's that belong together, and what is left over, in a line."""
    from calib.observe.robot_poses import poses_of

    counts = len(seen.images), len(robot.images)
    if ARRAY in (seen.origin, robot.origin):
        if counts[0] != counts[1]:
            raise InputError(f"{counts[0]} poses of the target and {counts[1]} of the robot; an array has one of each")
        return list(range(counts[0])), list(range(counts[0])), ""
    pairs = poses_of(robot, seen.images)
    rows = [row for row, of_robot in enumerate(pairs.row) if of_robot is not None]
    said = [pairs.remark] if pairs.remark else []
    if len(rows) < counts[0]:
        said.append(f"{counts[0] - len(rows)} of the camera's poses have none of the robot's")
    if pairs.unused:
        said.append(f"{len(pairs.unused)} of the robot's have none of the camera's")
    return rows, [row for row in pairs.row if row is not None], "; ".join(said)


def _page(found: HandEyeOfPoses, *, is_drawn: bool = True) -> "Page":
    from calib.draw.rig_tables import pose_errors_drawing
    from calib.draw.style import figure_of
    from designer.page.blocks import Facts, Page, Section
    from designer.page.folders import Shown, notes, table_of

    sits, other = ("flange", "base") if found.in_hand == "camera" else ("base", "flange")
    turn, counts = math.degrees(found.turn_sigma_rad), found.pairs - len(found.left_out) - len(found.outside)
    sure = (
        f"{figure(found.shift_sigma_mm, 2)} mm and {figure(turn, 2)} deg, along and about the least sure axes (1 sigma)"
    )
    adds = ", errors add up from pose to pose" if found.errors_add_up else ""
    facts = [
        ("camera", _words(found.place, f"{sits}_from_cam")),
        ("target", _words(found.target_place, f"{other}_from_target")),
        ("known to", sure),
        ("poses", f"{counts} of {found.pairs}{adds}"),
    ]
    if not math.isnan(found.scale):
        sigma = figure(found.scale_sigma, 1)
        facts.append(("scale", f"{found.scale:.5g} ± {sigma} camera's lengths a mm of the robot's"))
    if not math.isnan(found.offset_s):
        sigma = figure(1e3 * found.offset_sigma_s, 1)
        facts.append(("clocks", f"the camera's is ahead by {1e3 * found.offset_s:.2f} ± {sigma} ms"))
    part = Shown["tuple[str, float]"]
    noise = table_of(
        found.noise.items(), part("noise of a pose (1 sigma)", lambda one: NOISE[one[0]]),
        part("estimated", lambda one: _sized(*one)),
    )  # fmt: skip
    said = [*found.undetermined, *found.remarks]
    for names, why in (
        (found.left_out, "left out, as they do not follow the others"),
        (found.outside, "left out, as the robot has no poses of their times"),
    ):
        few, more = ", ".join(cut(printable(one), 40) for one in names[:MOST_ROWS]), len(names) - MOST_ROWS
        said += [f"{why}: {few}{f' and {more} more' if more > 0 else ''}"] if names else []
    drawn = [figure_of(pose_errors_drawing(found.found))] if is_drawn else []
    sections = Section("Poses", (*drawn, *notes(said))), Section("Noise", (noise, *notes((MEANING,))))
    return Page("", QUESTION, _headline(found), sections, lead=(Facts(tuple(facts)),))


def _headline(found: HandEyeOfPoses) -> "Headline":
    from designer.page.blocks import Headline

    if found.undetermined:
        return Headline("bad", "not determined", f"{capital(found.undetermined[0])}.")
    what = "flange" if found.in_hand == "camera" else "base"
    return Headline(
        "note", f"{figure(found.shift_sigma_mm, 2)} mm",
        f"so sure is the camera's place on the robot's {what} (1 sigma along its least sure axis), "
        f"{figure(math.degrees(found.turn_sigma_rad), 2)} deg its turn.",
    )  # fmt: skip


NOISE = {
    "camera_turn_across_rad": "camera, turn about axes across its own",
    "camera_turn_axial_rad": "camera, turn about its own axis",
    "camera_shift_across_mm": "camera, shift across its axis",
    "camera_shift_axial_mm": "camera, shift along its axis",
    "robot_turn_rad": "robot, turn",
    "robot_shift_mm": "robot, shift",
}


def _sized(name: str, value: float) -> str:
    return f"{figure(math.degrees(value), 2)} deg" if name.endswith("_rad") else f"{figure(value, 2)} mm"


def _words(pose: "Array", name: str) -> str:
    """A pose for a person: shift and rotation vector."""
    import numpy as np

    from calib.core.se3 import log_rotation

    x, y, z = pose[:3, 3].tolist()
    turn = np.degrees(log_rotation(pose[:3, :3])).tolist()
    turned = ", ".join(f"{one:.3f}" for one in turn)
    return f"{name}: {x:.2f}, {y:.2f}, {z:.2f} mm, turned by {turned} deg (rotation vector)"
