"""How a target moves in a frame, from its poses in the frames around."""

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, make_pose
from calib.rigs.motion import Motion, motion_of
from designer.base.arrays import Array


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
