"""Where a robot's or a turntable's adjustment starts, and how a target moves between frames."""

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, invert, log_rotation, look_at, make_pose
from calib.rigs.carrier import start_turntable, turned_by
from calib.rigs.hand_eye import start_hand_eye
from calib.rigs.motion import Motion, motion_of
from designer.base.arrays import Array

X = make_pose(exp_rotation(np.array([0.3, -2.0, 1.0])), np.array([30.0, -20.0, 80.0]))
Z = make_pose(exp_rotation(np.array([2.0, -0.2, 1.0])), np.array([300.0, -200.0, -700.0]))
OFFSET = make_pose(exp_rotation(np.array([0.5, 0.6, 0.7])), np.array([100.0, -100.0, 500.0]))
AXIS = np.array([0.6, 0.0, 0.8])


def _moves(
    rng: np.random.Generator,
    count: int,
    turn_rad: float,
    shift_mm: float,
    axis: Array | None = None,
    along: Array | None = None,
) -> Array:
    turn, shift = rng.normal(size=(count, 3)) * turn_rad, rng.normal(size=(count, 3)) * shift_mm
    turn = turn if axis is None else (turn @ axis)[:, None] * axis
    shift = shift if along is None else (shift @ along)[:, None] * along
    return make_pose(exp_rotation(turn), shift)


def _noise(rng: np.random.Generator, count: int) -> Array:
    rad, mm = 1e-3, 0.1
    return make_pose(exp_rotation(rng.normal(size=(count, 3)) * rad), rng.normal(size=(count, 3)) * mm)


@pytest.mark.parametrize(("count", "turn_rad"), [(3, 0.4), (12, 0.4), (12, 2.0), (300, 0.4)])
def test_a_start_of_exact_poses_is_exact(count: int, turn_rad: float) -> None:
    """Three poses with turns about two axes tell all, and turns near half a circle mislead nothing."""
    told = _moves(np.random.default_rng(1), count, turn_rad, 200.0) @ OFFSET
    start = start_hand_eye(X @ told @ Z, told)
    assert np.abs(start.cam_from_rig - X).max() < 1e-8
    assert np.abs(start.carrier_from_target - Z).max() < 1e-8
    assert start.undetermined == ()


def test_poses_far_off_are_named_and_change_nothing() -> None:
    """Three of twelve poses belong to other photos."""
    rng = np.random.default_rng(2)
    told = _moves(rng, 12, 0.4, 200.0) @ OFFSET
    seen = X @ told @ _noise(rng, 12) @ Z
    seen[[1, 5, 6]] = seen[[1, 5, 6]] @ _moves(rng, 3, 0.5, 100.0)
    start = start_hand_eye(seen, told)
    assert np.flatnonzero(start.is_far_off).tolist() == [1, 5, 6]
    assert np.linalg.norm(log_rotation(start.cam_from_rig[:3, :3] @ X[:3, :3].T)) < 3e-3
    assert 3e-4 < start.rotation_rms_rad < 6e-3


@pytest.mark.parametrize("is_noisy", [False, True])
def test_turns_about_one_axis_leave_the_shift_along_it_open(is_noisy: bool) -> None:
    """A robot that turns about one axis and shifts: all but one direction is found, and that one is named."""
    rng = np.random.default_rng(3)
    told = _moves(rng, 12, 0.4, 200.0, axis=AXIS) @ OFFSET
    noise = _noise(rng, 12) if is_noisy else np.eye(4)
    start = start_hand_eye(X @ noise @ told @ Z, told)
    off = X[:3, :3].T @ (start.cam_from_rig[:3, 3] - X[:3, 3])
    assert np.linalg.norm(off - AXIS * (AXIS @ off)) < (30.0 if is_noisy else 1e-8)
    assert np.linalg.norm(log_rotation(start.cam_from_rig[:3, :3] @ X[:3, :3].T)) < (3e-3 if is_noisy else 1e-8)
    (line,) = start.undetermined
    assert "one axis" in line
    assert "the shift along (0.60 0.00 0.80)" in line


@pytest.mark.parametrize(
    ("moves", "named"),
    [
        ({"turn_rad": 0.4, "shift_mm": 0.0, "axis": AXIS}, ["shift along (0.60 0.00 0.80)", "turn about"]),
        ({"turn_rad": 0.0, "shift_mm": 200.0}, ["the robot does not turn: the shift of the camera"]),
        ({"turn_rad": 0.0, "shift_mm": 200.0, "along": AXIS}, ["shift of the camera", "turn about (0.60 0.00 0.80)"]),
        ({"turn_rad": 0.0, "shift_mm": 0.0}, ["shift of the camera", "turn of the camera"]),
    ],
)
def test_what_motions_do_not_tell_is_named(moves: dict[str, float], named: list[str]) -> None:
    """Mere arcs, mere shifts, shifts along a line, no motion: neither more nor less is open than is said."""
    told = _moves(np.random.default_rng(4), 10, **moves) @ OFFSET
    start = start_hand_eye(X @ told @ Z, told)
    assert len(start.undetermined) == len(named)
    assert all(part in line for part, line in zip(named, start.undetermined, strict=True))
    assert start.shift_rms_mm < 1e-6  # the rest is found


def test_inverted_poses_fit_worse() -> None:
    """Poses the other way round leave a residual by which they are known."""
    told = _moves(np.random.default_rng(5), 8, 0.3, 200.0) @ OFFSET
    start = start_hand_eye(X @ told @ Z, invert(told))
    assert start.rotation_rms_rad > 0.02
    assert start.shift_rms_mm > 20


@pytest.mark.parametrize("are_given", [True, False])
def test_a_turntable_is_found_with_and_without_its_angles(are_given: bool) -> None:
    """The table's frame has its origin nearest the target's and its x axis to the camera's side."""
    rng = np.random.default_rng(6)
    x = look_at(np.array([600.0, 0.0, 300.0]), np.zeros(3))
    z = make_pose(exp_rotation(np.array([0.3, 0.2, 0.1])), np.array([20.0, 30.0, 0.0]))
    angle = np.arange(36) * np.pi / 18
    found = start_turntable(x @ turned_by(angle) @ _noise(rng, 36) @ z, angle if are_given else None)
    assert np.abs(found.start.cam_from_rig - x).max() < 0.3
    assert np.abs(found.start.carrier_from_target - z).max() < 0.3
    assert np.abs(np.angle(np.exp(1j * (found.angle_rad - angle)))).max() < 5e-3


def _path(time_s: Array, turn_rad_s: float) -> Array:
    """To and fro along x, and round z.  # (N, 4, 4)"""
    angle = turn_rad_s * time_s
    zero = np.zeros_like(angle)
    return make_pose(
        exp_rotation(np.stack([zero, zero, 0.5 * np.sin(angle)], axis=1)),
        np.stack([100 * np.sin(angle), zero, zero], axis=1),
    )


@pytest.mark.parametrize(("step_s", "noise_mm"), [(0.1, 0.0), (0.3, 0.0), (0.1, 0.05), (0.03, 0.05)])
def test_speed_and_its_change_are_those_of_the_motion(step_s: float, noise_mm: float) -> None:
    """Few poses of a curved way and many noisy ones alike tell its speed to a hundredth."""
    time_s = step_s * np.arange(40)
    pose = _path(time_s, 2.0)
    pose[:, :3, 3] += np.random.default_rng(0).normal(0, noise_mm, (40, 3))
    motion = motion_of(pose, time_s).derivative[:, 5:-5]
    middle = time_s[5:-5]
    assert np.abs(motion[0, :, 3] - 200 * np.cos(2 * middle)).max() < 2.0
    assert np.abs(motion[0, :, 2] - np.cos(2 * middle)).max() < 0.01
    assert np.abs(motion[1, :, 3] + 400 * np.sin(2 * middle)).max() < 20 if noise_mm == 0 else True


def test_a_way_is_followed_for_a_step_and_its_speed_is_its_derivative() -> None:
    """Photos up to a step from their frame's time: the pose there, to a thousandth of what the step is long."""
    time_s = 0.2 * np.arange(40)
    motion = motion_of(_path(time_s, 2.0), time_s)
    middle, gap = np.arange(8, 32), np.full(24, 0.15)
    there = 100 * np.sin(2 * (time_s[middle] + gap)) - 100 * np.sin(2 * time_s[middle])
    assert np.abs(motion.way(middle, gap)[:, 3] - there).max() < 0.04
    change = (motion.way(middle, gap + 1e-5) - motion.way(middle, gap - 1e-5)) / 2e-5
    np.testing.assert_allclose(motion.speed(middle, gap), change, rtol=1e-6, atol=1e-6)


def _wild(time_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """A hand: what sums of waves up to 1.2 Hz do, slow ones by far the most; shifts (N, 3) and their speeds."""
    wave, begin = 2 * np.pi * rng.uniform(0.1, 1.2, (12, 3)), rng.uniform(0, 2 * np.pi, (12, 3))
    size = 10 / np.maximum(wave / (2 * np.pi), 0.2) ** 2
    angle = time_s[:, None, None] * wave + begin
    return (size * np.sin(angle)).sum(axis=1), (size * wave * np.cos(angle)).sum(axis=1)


@pytest.mark.parametrize("rate_hz", [3, 10, 30])
def test_speeds_are_off_by_what_is_stated(rate_hz: int) -> None:
    """Of few frames, where the way between is a guess, as of many, where noise decides; singly, and in their sum."""
    rng = np.random.default_rng(rate_hz)
    speeds, times = [], []
    for _ in range(6):
        time_s = np.arange(60) / rate_hz + rng.uniform(-1e-3, 1e-3, 60)
        shift, true = _wild(time_s, rng)
        pose = make_pose(np.tile(np.eye(3), (60, 1, 1)), shift + rng.normal(0, 0.02, shift.shape))
        motion: Motion = motion_of(pose, time_s)
        ((rows, covariance),) = motion.speed_covariance()
        for axis in range(3, 6):
            told = motion.derivative[0, rows, axis]
            off = (told - true[rows, axis - 3])[3:-3]
            speeds.append(np.mean(off**2 / np.diagonal(covariance[axis])[3:-3]))
            weight = told / (told @ told)
            times.append((weight @ (told - true[rows, axis - 3])) ** 2 / (weight @ covariance[axis] @ weight))
    assert 0.7 < np.sqrt(np.mean(speeds)) < 1.5
    assert 0.5 < np.sqrt(np.mean(times)) < 1.5


def test_a_target_at_rest_has_no_speed() -> None:
    """Nor has one of which hardly a pose is known."""
    still = motion_of(np.tile(np.eye(4), (12, 1, 1)), 0.1 * np.arange(12))
    assert not still.derivative.any()
    assert all(not covariance.any() for _, covariance in still.speed_covariance())
    assert not motion_of(_path(np.array([0.0, 0.1]), 1.0), np.array([0.0, 0.1])).derivative.any()
