"""Boards that look the same turned are named alike by all cameras, and as a robot's motions tell."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.core.se3 import invert, make_pose
from calib.core.types import Observations, RigObservations
from calib.observe.observations import known_points
from calib.rigs.problem import Mechanism
from calib.rigs.turned_names import named_alike, turns_of
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import target_of_marks

EVEN = Chessboard((6, 4), 20.0)
BOARDS = {"half a turn": EVEN, "a quarter of a turn": Circles((4, 4), 30.0, 10.0)}
each_board = pytest.mark.parametrize("marks", BOARDS.values(), ids=BOARDS)
ALL = (range(12), range(3, 12), range(10))


def poses(count: int, rng: np.random.Generator, tilt: float = 0.6) -> Array:
    """Of a board before cameras, tilted and rolled at random."""
    roll = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi, (count, 1)) * [0.0, 0.0, 1.0])
    turn = Rotation.from_rotvec(rng.normal(0, tilt, (count, 3))) * roll * Rotation.from_euler("x", np.pi)
    return make_pose(turn.as_matrix(), np.column_stack([rng.normal(0, 80, (count, 2)), rng.uniform(400, 700, count)]))


def confused(
    marks: FaceMarks, rig_from_target: Array, cam_from_rig: Array, seen: tuple[range, ...], rng: np.random.Generator
) -> tuple[RigObservations, list[Array]]:
    """What cameras see whose detections take any of the ways in which the board looks the same, and their poses."""
    target = target_of_marks([marks], np.eye(4)[None])
    points = known_points(target)
    assert points.turned is not None
    turns, found, sightings = turns_of(points), [], []
    for camera, frames in enumerate(seen):
        chosen = rng.integers(len(turns), size=len(frames))
        # A point that is named i is truly turned[k, i], so that the pose by the names is P S.
        found.append(cam_from_rig[camera] @ rig_from_target[list(frames)] @ turns[chosen])
        true = np.tile(np.arange(target.ring_count), len(frames))
        named = np.argsort(points.turned, axis=1)[np.repeat(chosen, target.ring_count), true]
        sightings.append(
            Observations(
                (640, 480), tuple(f"{frame}" for frame in frames), np.repeat(np.arange(len(frames)), target.ring_count),
                named, np.column_stack([true, true]).astype(np.float64), None, points,
            )
        )  # fmt: skip
    names = tuple(f"camera {row}" for row in range(len(seen)))
    every = tuple(f"frame {row}" for row in range(len(rig_from_target)))
    return RigObservations(names, every, tuple(sightings), tuple(np.array(rows) for rows in seen)), found


def turned_by(found: RigObservations) -> list[set[tuple[int, ...]]]:
    """For each frame the orders of points that its views give; one if they are named alike."""
    orders: list[set[tuple[int, ...]]] = [set() for _ in found.frame_names]
    for frames, seen in zip(found.frame, found.sightings, strict=True):
        for view, frame in enumerate(frames.tolist()):
            rows = seen.view == view
            orders[frame].add(tuple(seen.point[rows][np.argsort(seen.center_px[rows, 0])].tolist()))
    return orders


@each_board
@pytest.mark.parametrize("is_known", [False, True])
def test_cameras_name_a_frame_alike(marks: FaceMarks, is_known: bool) -> None:
    """Whatever detections took, all cameras of a frame give a point one name; so do cameras whose places are known."""
    rng = np.random.default_rng(1)
    cam_from_rig = np.concatenate([np.eye(4)[None], poses(2, rng, 0.2)])
    cam_from_rig[1:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.4, (2, 3))).as_matrix()
    observations, found = confused(marks, poses(12, rng), cam_from_rig, ALL, rng)
    assert max(map(len, turned_by(observations))) > 1
    named = named_alike(observations, found, cam_from_rig=cam_from_rig if is_known else None)
    assert max(map(len, turned_by(named))) == 1
    assert named.points.turned is None
    assert any("named turned" in one for one in named.remarks)


@each_board
def test_a_robots_motions_tell_how_a_board_is_turned(marks: FaceMarks) -> None:
    """With a robot whose poses err by 1 degree, all frames give a point one name, or the same other one."""
    rng = np.random.default_rng(2)
    cam_from_flange, base_from_target = poses(1, rng)[0], poses(1, rng)[0]
    rig_from_target = poses(20, rng)
    # cam_from_target = cam_from_flange flange_from_base base_from_target
    flange_from_base = invert(cam_from_flange) @ rig_from_target @ invert(base_from_target)
    error = make_pose(Rotation.from_rotvec(rng.normal(0, 0.01, (20, 3))).as_matrix(), rng.normal(0, 1, (20, 3)))
    robot = Mechanism("eye in hand", flange_from_base @ error, is_camera_in_hand=True)
    observations, found = confused(marks, rig_from_target, np.eye(4)[None], (range(20),), rng)
    named = named_alike(observations, found, robot)
    assert len(set.union(*turned_by(observations))) > 1
    assert len(set.union(*turned_by(named))) == 1


def test_what_cannot_be_told_is_refused() -> None:
    """Frames that show the board alike, or a robot that does not turn it out of its quarter turns, are refused."""
    rng = np.random.default_rng(3)
    cam_from_rig = np.tile(np.eye(4), (2, 1, 1))
    cam_from_rig[1, 0, 3] = -100.0
    same = np.repeat(poses(1, rng), 6, axis=0)
    observations, found = confused(EVEN, same, cam_from_rig, (range(6), range(6)), rng)
    with pytest.raises(InputError, match="looks the same turned, and the 6 frames"):
        named_alike(observations, found)
    turns = Rotation.from_rotvec(np.arange(4)[:, None] * [0.0, 0.0, np.pi / 2]).as_matrix()
    quarter = make_pose(same[0, :3, :3] @ turns, np.tile([0.0, 0.0, 500.0], (4, 1)))
    observations, found = confused(EVEN, quarter[[0, 1]], np.eye(4)[None], (range(2),), rng)
    robot = Mechanism("eye in hand", quarter[[0, 1]], is_camera_in_hand=True)
    with pytest.raises(InputError, match="the robot's poses do not tell"):
        named_alike(observations, found, robot)


def test_boards_that_tell_are_left_alone() -> None:
    """A chessboard whose squares sum to an odd number has nothing to be told."""
    rng = np.random.default_rng(4)
    points = known_points(target_of_marks([replace(EVEN, squares=(6, 5))], np.eye(4)[None]))
    assert points.turned is None
    observations, found = confused(EVEN, poses(3, rng), np.eye(4)[None], (range(3),), rng)
    plain = replace(observations, sightings=(replace(observations.sightings[0], points=points),))
    assert named_alike(plain, found) is plain
