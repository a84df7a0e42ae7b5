"""Where a camera sits, of pairs of poses."""

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose
from calib.rigs.pose_pairs import InHand, PairsSolution, PosePairs, solve_pose_pairs, solve_pose_streams
from designer.base.arrays import Array
from designer.base.errors import InputError

X = make_pose(exp_rotation(np.array([0.3, -1.2, 2.0])), np.array([40.0, -25.0, 90.0]))
Z = make_pose(exp_rotation(np.array([-0.5, 0.2, 0.4])), np.array([350.0, 120.0, -600.0]))


def robot(count: int, rng: np.random.Generator) -> Array:
    """`rig_from_mechanism` of poses with turns about all axes."""
    return make_pose(exp_rotation(rng.uniform(-0.6, 0.6, (count, 3))), rng.uniform(-150, 150, (count, 3)))


def noisy(pose: Array, rng: np.random.Generator, turn_rad: float, shift_mm: Array | float) -> Array:
    """Poses that err in the camera's axes."""
    turn = exp_rotation(rng.normal(0, turn_rad, (len(pose), 3)))
    return make_pose(turn @ pose[:, :3, :3], pose[:, :3, 3] + rng.normal(0, 1, (len(pose), 3)) * shift_mm)


def off(found: PairsSolution) -> Array:
    """How far the camera's place is off (6,): a turn and a shift, as its covariance has them."""
    return np.concatenate(
        [log_rotation(X[:3, :3] @ found.cam_from_rig[:3, :3].T), X[:3, 3] - found.cam_from_rig[:3, 3]]
    )


@pytest.mark.parametrize("hand", ["camera", "target"])
@pytest.mark.parametrize("scale", [1.0, 0.31])
def test_exact_poses_give_the_place(hand: InHand, scale: float) -> None:
    """`A = X L Z` holds for a camera in the hand and beside the robot; lengths in another unit give their scale."""
    told = robot(12, np.random.default_rng(1))
    seen = X @ told @ Z
    seen[:, :3, 3] *= scale
    found = solve_pose_pairs(PosePairs(seen, told, hand), has_scale=scale != 1.0)
    assert np.abs(off(found)).max() < 1e-5
    np.testing.assert_allclose(found.scale, scale, rtol=1e-6)
    np.testing.assert_allclose(found.carrier_from_target, Z, atol=1e-4)
    assert not found.undetermined
    assert not found.is_off.any()


def test_ellipsoids_hold_the_truth() -> None:
    """Of poses that err by turns and shifts of several sizes, stated 95 % ellipsoids hold the place in 90 to 98 %."""
    held = []
    for seed in range(70):
        rng = np.random.default_rng(seed)
        told = robot(12, rng)
        seen = noisy(X @ told @ Z, rng, 2e-3, np.array([0.5, 0.5, 2.0]))
        found = solve_pose_pairs(PosePairs(seen, noisy(told, rng, 3e-4, 0.2)))
        error = off(found)
        held.append(error @ np.linalg.solve(found.covariance[:6, :6], error) < 12.59)
    assert 0.88 <= np.mean(held) <= 0.99


def test_wrong_poses_are_named() -> None:
    """Four of twenty poses of something else are left out, these and no others, and do not move the place."""
    rng = np.random.default_rng(3)
    told = robot(20, rng)
    seen = noisy(X @ told @ Z, rng, 1e-3, 0.5)
    wrong = [2, 7, 8, 15]
    seen[wrong] = seen[[5, 1, 3, 18]] @ make_pose(exp_rotation(np.array([0.0, 0.4, 0.2])), np.array([30.0, 0, 10]))
    found = solve_pose_pairs(PosePairs(seen, told))
    assert np.flatnonzero(found.is_off).tolist() == wrong
    assert np.linalg.norm(off(found)[3:]) < 1.5


def test_clocks_are_brought_together() -> None:
    """Of two streams the offset of the clocks is solved with the place, within its stated uncertainty."""
    rng = np.random.default_rng(5)
    time_s = np.linspace(0, 5, 301)
    phase = time_s[:, None] * np.array([1.1, 1.7, 2.3]) + np.array([0, 1, 2.0])
    told = make_pose(exp_rotation(0.5 * np.sin(phase)), 120 * np.cos(phase))
    cam_s = np.arange(0.2, 4.8, 1 / 30)
    phase = (cam_s - 0.043)[:, None] * np.array([1.1, 1.7, 2.3]) + np.array([0, 1, 2.0])
    there = make_pose(exp_rotation(0.5 * np.sin(phase)), 120 * np.cos(phase))
    seen = noisy(X @ there @ Z, rng, 1e-3, 0.5)
    found = solve_pose_streams(cam_s, seen, time_s, told)
    assert abs(found.offset_s - 0.043) < 4 * found.offset_sigma_s < 2e-3
    assert np.linalg.norm(off(found)[3:]) < 1.0


def test_errors_that_add_up_are_known_as_such() -> None:
    """Odometry drifts; by differences of neighbours the place is as sure as stated, by independent poses it is not."""
    rng = np.random.default_rng(7)
    phase = np.linspace(0, 12, 150)[:, None] * np.array([1.1, 1.7, 2.3])
    told = make_pose(exp_rotation(0.5 * np.sin(phase)), 120 * np.cos(phase))
    seen, drift = X @ told @ Z, np.eye(4)
    for row in range(1, len(seen)):
        drift = drift @ make_pose(exp_rotation(rng.normal(0, 1e-3, 3)), rng.normal(0, 1.0, 3))
        seen[row] = seen[row] @ drift
    found = solve_pose_pairs(PosePairs(seen, told))
    assert found.adds_up
    error = off(found)
    assert error @ np.linalg.solve(found.covariance[:6, :6], error) < 22.5
    as_independent = solve_pose_pairs(PosePairs(seen, told), adds_up=False)
    assert np.linalg.norm(error[3:]) < np.linalg.norm(off(as_independent)[3:])


def test_turns_about_one_axis_are_named() -> None:
    """Where all turns are about one axis, the shift along it is said not to be determined."""
    rng = np.random.default_rng(9)
    told = make_pose(exp_rotation(np.outer(rng.uniform(-1, 1, 15), [0, 0, 1])), rng.uniform(-100, 100, (15, 3)))
    found = solve_pose_pairs(PosePairs(noisy(X @ told @ Z, rng, 1e-3, 0.5), told))
    assert any("0.00 0.00 1.00" in line for line in found.undetermined)


def test_too_few_poses_are_refused() -> None:
    """Two pairs tell nothing."""
    told = robot(2, np.random.default_rng(1))
    with pytest.raises(InputError, match="2 pairs of poses"):
        solve_pose_pairs(PosePairs(X @ told @ Z, invert(told)))
