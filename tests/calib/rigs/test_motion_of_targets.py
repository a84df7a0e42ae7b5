"""How a target moves in a frame, from its poses in the frames around."""

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.core.se3 import exp_rotation, make_pose
from calib.rigs.trajectory import motion_of

Array = NDArray[np.float64]


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
    motion = motion_of(pose, time_s)[:, 5:-5]
    middle = time_s[5:-5]
    assert np.abs(motion[0, :, 3] - 200 * np.cos(2 * middle)).max() < 2.0
    assert np.abs(motion[0, :, 2] - np.cos(2 * middle)).max() < 0.01
    assert np.abs(motion[1, :, 3] + 400 * np.sin(2 * middle)).max() < 20 if noise_mm == 0 else True


def test_a_target_at_rest_has_no_speed() -> None:
    """Nor has one of which hardly a pose is known."""
    assert not motion_of(np.tile(np.eye(4), (12, 1, 1)), 0.1 * np.arange(12)).any()
    assert not motion_of(_path(np.array([0.0, 0.1]), 1.0), np.array([0.0, 0.1])).any()
