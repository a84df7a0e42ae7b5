"""Frames of a robot over time, as bags hold them; SciPy interpolates beside us."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from calib.core.se3 import exp_rotation, interpolated, invert, make_pose
from calib.images.bag import Bag
from calib.observe.bag_photos import chosen
from calib.observe.robot_poses import RobotPoses, stream_times
from calib.observe.transforms import transforms_in
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.bags import KINDS, START_NS, Said, transforms, write_bag

RNG = np.random.default_rng(7)


def poses(count: int) -> Array:
    """Any."""
    return make_pose(exp_rotation(RNG.normal(size=(count, 3))), 300 * RNG.normal(size=(count, 3)))


def at(k: int) -> int:
    """The stamp of a message."""
    return START_NS + k * 10**7


def test_between_two_poses_a_turn_is_steady_and_a_way_straight() -> None:
    """As SciPy's slerp and NumPy's interp say; held before the first and after the last."""
    time_s, pose = np.sort(RNG.uniform(0, 9, 8)), poses(8)
    there = np.linspace(time_s[0], time_s[-1], 50)
    found = interpolated(time_s, pose, there)
    turns = Slerp(time_s, Rotation.from_matrix(pose[:, :3, :3]))(there).as_matrix()
    np.testing.assert_allclose(found[:, :3, :3], turns, atol=1e-12)
    for axis in range(3):
        np.testing.assert_allclose(found[:, axis, 3], np.interp(there, time_s, pose[:, axis, 3]), atol=1e-9)
    np.testing.assert_allclose(interpolated(time_s, pose, np.array([-5.0, 99.0])), pose[[0, -1]], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_way_through_a_tree_is_the_product_of_its_transforms(kind: str, tmp_path: Path) -> None:
    """Up to the common parent and down again, in mm; what stands still counts at all times; ROS 1 writes a slash."""
    fixed, left, right = poses(1)[0], poses(20), poses(20)
    said = [transforms("/tf_static", START_NS, {("/world", "/base"): fixed})]
    said += [transforms("/tf", at(k), {("world", "body"): left[k], ("body", "tool"): right[k]}) for k in range(20)]
    found = transforms_in(Bag(write_bag(tmp_path / f"run.{kind}", said))).poses("base", "/tool")
    expected = invert(fixed) @ left @ right
    assert found.time_s is not None
    np.testing.assert_allclose(found.time_s, [1e-9 * at(k) for k in range(20)], atol=1e-6)
    np.testing.assert_allclose(found.base_from_flange, expected, atol=1e-9)


def test_joints_of_other_rates_are_interpolated(tmp_path: Path) -> None:
    """At the stamps of the one that is told most often, where all are known."""
    slow, quick = poses(5), np.broadcast_to(np.eye(4), (41, 4, 4))
    said = [transforms("/tf", at(10 * k), {("a", "b"): slow[k]}) for k in range(5)]
    said += [transforms("/tf", at(k + 2), {("b", "c"): quick[k]}) for k in range(41)]
    found = transforms_in(Bag(write_bag(tmp_path / "run.mcap", said))).poses("a", "c")
    assert found.time_s is not None
    assert len(found.time_s) == 39
    expected = interpolated(np.arange(5) * 0.1, slow, found.time_s - 1e-9 * START_NS)
    np.testing.assert_allclose(found.base_from_flange, expected, atol=1e-3)


def two_trees() -> list[Said]:
    """One of a robot and one of a camera."""
    pose = poses(4)
    return [transforms("/tf", at(k), {("base", "tool"): pose[k], ("cam", "lens"): pose[k]}) for k in range(4)]


def two_parents() -> list[Said]:
    """Of one frame."""
    return [*two_trees(), transforms("/tf", at(9), {("cam", "tool"): np.eye(4)})]


def set_back() -> list[Said]:
    """A clock that was set by ten seconds."""
    return [transforms("/tf", at(k - 1000 * (k > 2)), {("base", "tool"): np.eye(4)}) for k in range(6)]


def far_off() -> list[Said]:
    """No robot reaches so far."""
    return [transforms("/tf", at(0), {("base", "tool"): make_pose(np.eye(3), np.full(3, 1e12))})]


def still() -> list[Said]:
    """Nothing moves."""
    return [transforms("/tf_static", START_NS, {("base", "tool"): np.eye(4)})]


@pytest.mark.parametrize(
    ("said", "flange", "line"),
    [
        (two_trees(), "lens", "from 'base' to 'lens': base, tool are connected, and apart from them cam, lens"),
        (two_trees(), "hand", "no frame 'hand'; there are base, cam, lens, tool"),
        (two_parents(), "tool", "frame 'tool' has two parents, 'base' and 'cam'; a tree has one"),
        (set_back(), "tool", "its time stamps go back by 9.99 s at message 4 of 6: a clock was set"),
        (still(), "tool", "'tool' does not move against 'base'"),
        (far_off(), "tool", "1 of 1 are no rigid motions, such as x y z qx qy qz qw"),
    ],
)  # fmt: skip
def test_frames_that_tell_no_way_are_a_line(said: list[Said], flange: str, line: str, tmp_path: Path) -> None:
    """With the frames that there are."""
    ordered = sorted(said, key=lambda one: one.log_ns)
    kept = said if "go back" in line else ordered
    for k, one in enumerate(kept):
        object.__setattr__(one, "log_ns", START_NS + k)  # recorded one after the other
    with pytest.raises(InputError, match=line):
        transforms_in(Bag(write_bag(tmp_path / "run.mcap", kept))).poses("base", flange)


def test_no_robot_has_thousands_of_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bag that names ever new ones is refused before ways are sought among them."""
    monkeypatch.setattr("calib.observe.transforms.MOST_FRAMES", 1)
    with pytest.raises(InputError, match="more than 1 frames; cut the bag"):
        transforms_in(Bag(write_bag(tmp_path / "run.mcap", two_trees())))


def test_a_stream_tells_no_pose_in_a_gap() -> None:
    """Nor before it begins and after it ends; a table of a pose a photo is no stream."""
    time_s = np.concatenate([np.arange(100), np.arange(200, 300)]) * 0.01
    robot = RobotPoses(
        tuple(f"{one:.9f}" for one in time_s), np.broadcast_to(np.eye(4), (200, 4, 4)), "r", time_s=time_s
    )
    asked = np.array([-0.01, 0.005, 0.995, 1.5, 2.0, 2.985, 3.0])
    assert robot.is_known(asked).tolist() == [False, True, False, False, True, True, False]
    assert stream_times(robot, ["a.png"], np.array([0.5])) is not None
    assert stream_times(robot, ["a.png"], None) is None
    assert stream_times(robot, ["a.png"] * 150, np.zeros(150)) is None


def test_of_a_stop_and_go_one_image_a_stop_is_chosen() -> None:
    """And none in motion; of a steady motion as many as may be; a few pictures are all taken."""
    step = np.tile(np.r_[np.full(9, 0.1), np.full(5, 20.0)], 30)
    around = np.maximum(np.r_[step, 0], np.r_[0, step])
    rows, said = chosen(step, around, 1.0, "images")
    assert 28 <= len(rows) <= 100
    assert (around[rows] < 1).all()
    assert len(set(np.array(rows) // 14)) >= 28
    assert said == (f"{len(rows)} of 421 images are searched: those around which least moves",)
    steady, _ = chosen(np.ones(999), np.ones(1000), 0.1, "images")
    assert len(steady) == 100
    assert max(np.diff(steady)) <= 12
    assert chosen(step[:50], around[:51], 1.0, "images") == (list(range(51)), ())
