"""`calib hand-eye` of poses alone."""

import json
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.core.se3 import exp_rotation, invert, make_pose, quaternion_wxyz
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.command_line import calib as run_calib

FLANGE_FROM_CAM = make_pose(exp_rotation(np.array([0.1, -0.2, 2.0])), np.array([40.0, -25.0, 90.0]))
BASE_FROM_TARGET = make_pose(exp_rotation(np.array([3.0, 0.2, 0.1])), np.array([500.0, 30.0, 0.0]))


def poses(count: int = 12) -> tuple[Array, Array]:
    """base_from_flange and cam_from_target that fit, but for some noise."""
    rng = np.random.default_rng(2)
    robot = make_pose(exp_rotation(rng.uniform(-0.5, 0.5, (count, 3))), rng.uniform(-100, 100, (count, 3)) + 400)
    seen = invert(robot @ FLANGE_FROM_CAM) @ BASE_FROM_TARGET
    seen[:, :3, 3] += rng.normal(0, 0.2, (count, 3))
    return robot, seen


def tum(path: Path, pose: Array, first_s: float = 0.0) -> Path:
    """A trajectory in TUM's form: m, and the quaternion's w last."""
    turn = np.roll(quaternion_wxyz(pose[:, :3, :3]), -1, axis=1)
    np.savetxt(path, np.column_stack([first_s + 0.1 * np.arange(len(pose)), pose[:, :3, 3] / 1e3, turn]), header="q")
    return path


def test_arrays_and_files_say_the_same(tmp_path: Path) -> None:
    """Arrays in mm, files of trajectories in m, and inverted ones lead to one place, near the true one."""
    robot, seen = poses()
    found = calib.hand_eye_poses(seen, poses=robot)
    np.testing.assert_allclose(found.place[:3, 3], FLANGE_FROM_CAM[:3, 3], atol=1.0)
    np.testing.assert_allclose(found.target_place[:3, 3], BASE_FROM_TARGET[:3, 3], atol=1.0)
    files = {"poses": tum(tmp_path / "robot.tum", robot), "target_poses": tum(tmp_path / "cam.txt", invert(seen))}
    read = calib.hand_eye(**files, target_inverted=True)  # type: ignore[arg-type]  # as the function of one name does
    np.testing.assert_allclose(read.place, found.place, atol=1e-6)


def test_the_table_of_calib_pose_is_read_with_its_covariances(tmp_path: Path) -> None:
    """`calib pose -o poses.csv` goes into hand-eye as it is; its covariances count."""
    from calib.observe.target_poses import poses_to_csv, target_pose

    robot, seen = poses()
    table = tmp_path / "poses.csv"
    variances = np.diag([1e-8, 1e-8, 1e-8, 0.04, 0.04, 0.04])
    made = [target_pose(f"{row}.png", pose, variances, np.zeros((8, 2))) for row, pose in enumerate(seen)]
    table.write_bytes(poses_to_csv(made))
    by_table = calib.hand_eye_poses(table, poses=robot)
    by_array = calib.hand_eye_poses(seen, poses=robot, covariances=np.broadcast_to(variances, (12, 6, 6)))
    np.testing.assert_allclose(by_table.place, by_array.place, atol=1e-7)
    assert set(by_table.noise) == {"robot_turn_rad", "robot_shift_mm"}


def test_a_shell_gives_both_files(tmp_path: Path) -> None:
    """The command tells the place, names poses that do not follow, and writes its files."""
    robot, seen = poses()
    seen[3] = seen[8]
    place = tmp_path / "out"
    files = "--poses", tum(tmp_path / "a.tum", robot), "--target-poses", tum(tmp_path / "b.tum", seen)
    answer = run_calib("hand-eye", *files, "-o", place)
    assert answer.code == 0
    assert "11 of 12" in answer.out
    assert "left out" in answer.out.lower()
    assert {one.name for one in place.iterdir()} >= {"hand_eye_poses.json", "pose_errors.csv", "index.html"}
    told = json.loads(run_calib("hand-eye", *files, "-o", tmp_path / "again", "--json").out)
    kept = json.loads((place / "hand_eye_poses.json").read_text())
    assert told["answer"]["place"] == kept["place"]
    page = (place / "index.html").read_bytes()
    assert run_calib("report", place).code == 0
    assert (place / "index.html").read_bytes() == page


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"target_poses": np.eye(4)}, r"shape \(4, 4\)"),
        ({"poses": 2.0 * poses()[0]}, "pose 0"),
        ({"covariances": np.eye(6)}, "one of each"),
        ({"covariances": np.zeros((12, 6, 6))}, "positive definite"),
    ],
)
def test_what_is_no_pose_is_refused(change: dict[str, Array], said: str) -> None:
    """Shapes, scaled rotations and covariances that cannot be are named."""
    robot, seen = poses()
    given = {"target_poses": seen, "poses": robot, **change}
    with pytest.raises(InputError, match=said):
        calib.hand_eye_poses(**given)  # type: ignore[arg-type]  # arrays by name


def test_an_option_that_nothing_acts_on_is_refused(tmp_path: Path) -> None:
    """Of files where there are none, of streams where there are pairs, of another frame than a table of ours has."""
    from calib.observe.robot_poses import RobotPoses
    from calib.observe.target_poses import poses_to_csv, target_pose

    robot, seen = poses()
    read = RobotPoses(tuple(map(str, range(len(robot)))), robot, "robot.csv")
    (tmp_path / "poses.csv").write_bytes(
        poses_to_csv([target_pose(f"{row}.png", one, np.eye(6), np.zeros((8, 2))) for row, one in enumerate(seen)])
    )
    for change, said in (
        ({"unit": "mm"}, "unit, euler"),
        ({"same_clock": True}, "same_clock"),
        ({"poses": read, "inverted": True}, "poses: are read already"),
        ({"target_poses": tmp_path / "poses.csv", "target_inverted": True}, "target_inverted"),
    ):
        with pytest.raises(InputError, match=said):
            calib.hand_eye_poses(**{"target_poses": seen, "poses": robot, **change})  # type: ignore[arg-type]


def test_poses_that_are_read_wrongly_are_not_said_to_turn_too_little() -> None:
    """Of another unit, inverted or of another hand they do not fit; a robot that turns by 2 deg turns too little."""
    robot, seen = poses()
    far = robot.copy()
    far[:, :3, 3] *= 1e3
    wrong: tuple[dict[str, bool], ...] = ({"inverted": True}, {"target_inverted": True}, {"target_in_hand": True})
    for told, how in ((far, {}), *((robot, one) for one in wrong)):
        found = calib.hand_eye_poses(seen, poses=told, **how)  # type: ignore[arg-type]  # options by name
        assert found.undetermined
        assert all("do not fit each other" in one for one in found.undetermined)
        assert found.remedy.startswith("try another --unit")
    still, noise = robot.copy(), np.random.default_rng(0).normal(0, 100, (12, 3))
    still[:, :3, :3] = exp_rotation(np.random.default_rng(1).uniform(-0.03, 0.03, (12, 3)))
    seen = invert(still @ FLANGE_FROM_CAM) @ BASE_FROM_TARGET
    seen[:, :3, 3] += noise
    found = calib.hand_eye_poses(seen, poses=still)
    assert found.undetermined
    assert all("turns too little" in one for one in found.undetermined)
    assert found.remedy.startswith("turn the robot")


def test_covariances_go_with_their_poses(tmp_path: Path) -> None:
    """Of a stream whose rows are not in the order of time, each covariance stays with its pose."""
    robot, seen = poses()
    covariances = np.stack([np.diag([1e-6] * 3 + [0.01 * (1 + row)] * 3) for row in range(len(seen))])
    files = [tum(tmp_path / name, pose) for name, pose in (("robot.tum", robot), ("cam.tum", seen))]
    expected = calib.hand_eye_poses(files[1], poses=files[0], covariances=covariances)
    lines = files[1].read_text().splitlines()
    files[1].write_text("\n".join([lines[0], *lines[:0:-1]]) + "\n")
    found = calib.hand_eye_poses(files[1], poses=files[0], covariances=covariances[::-1])
    np.testing.assert_allclose(found.place, expected.place, atol=1e-9)


def test_poses_at_other_times_are_told_as_such(tmp_path: Path) -> None:
    """They are no poses that do not follow; the file has numbers alone, and no more than is told."""
    moved = np.arange(30) * 0.1
    turn = exp_rotation(0.4 * np.sin(np.outer(moved, [2.0, 3.1, 4.3])))
    way = make_pose(turn, 100 * np.cos(np.outer(moved, [1, 2, 3])))
    seen = invert(way @ FLANGE_FROM_CAM) @ BASE_FROM_TARGET
    files = tum(tmp_path / "robot.tum", way[:24]), tum(tmp_path / "cam.tum", seen)
    found = calib.hand_eye_poses(files[1], poses=files[0], same_clock=True)
    assert found.left_out == ()
    assert set(found.outside) == {f"{one:.9f}" for one in moved[24:]}
    text = json.dumps(found.document(), allow_nan=False)
    assert "cam_from_rig" not in text


def test_a_line_of_a_trajectory_is_named_as_it_stands(tmp_path: Path) -> None:
    """What is wrong on the second line of the file is said of the second."""
    robot, seen = poses()
    path = tum(tmp_path / "robot.tum", robot)
    path.write_text(path.read_text().replace("\n", "\n1 2 3\n", 1))
    with pytest.raises(InputError, match="line 2: 3 values"):
        calib.hand_eye_poses(seen, poses=path)


def test_what_asks_its_folder_for_a_camera_is_told_that_there_is_none(tmp_path: Path) -> None:
    """Of poses alone no camera is solved."""
    robot, seen = poses()
    calib.hand_eye_poses(seen, poses=robot).save(tmp_path / "out")
    for ask in (calib.evaluate, calib.load_camera, lambda place: calib.convert(place, "opencv")):
        with pytest.raises(InputError, match="out: holds poses only, no camera"):
            ask(tmp_path / "out")  # type: ignore[operator]
