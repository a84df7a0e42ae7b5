import numpy as np
import pytest

from calib.core.se3 import exp_rotation, invert, log_rotation, look_at, make_pose
from calib.rigs.carrier import start_turntable, turned_by
from calib.rigs.hand_eye import start_hand_eye
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
