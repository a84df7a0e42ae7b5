"""How a target is held before a rig."""

import numpy as np
import pytest

from calib.core.se3 import log_rotation
from calib.renderer.held_target import LEAST_SEEN, held_poses, seen_shares, way_of
from calib.renderer.rig_template import HeldTarget, SimulatedRig, read_simulated_rig
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for


def _target(kind: str, values: dict[str, object]) -> TargetGeometry:
    return lay_out(size_job(asked_for(kind, values)).job.target)


ICO = _target("ico", {"edge": "100mm", "rings_per_side": 5})
BOARD = _target("board", {"size": "200x200mm"})


def _held(found: SimulatedRig) -> HeldTarget:
    assert found.held is not None
    return found.held


@pytest.mark.parametrize("name", ["ring-of-eight", "back-to-back-fisheyes", "stereo-pair"])
def test_every_camera_sees_a_solid_and_frames_join_all(name: str) -> None:
    """In thirty frames each camera sees the icosahedron in three and more, and shared frames chain all cameras."""
    found = read_simulated_rig(name)
    poses = held_poses(found.rig, ICO, _held(found), 30, np.random.default_rng(3))
    sees = (seen_shares(found.rig, ICO, poses) >= LEAST_SEEN).astype(int)
    shared = sees.T @ sees
    assert (shared.diagonal() >= 3).all()
    assert (np.linalg.matrix_power(shared, len(shared)) > 0).all()


def test_a_target_is_held_at_the_distances_asked_for() -> None:
    """From the camera of each frame in turn, and never into another camera."""
    found = read_simulated_rig("ring-of-eight")
    held = HeldTarget((300.0, 310.0))
    poses = held_poses(found.rig, ICO, held, 16, np.random.default_rng(0))
    away_mm = np.linalg.norm(poses[:, None, :3, 3] - found.rig.center_mm, axis=2)
    own = away_mm[np.arange(16), np.arange(16) % 8]
    assert ((own >= 300) & (own <= 310)).all()


def test_a_board_faces_the_camera_it_is_held_to() -> None:
    """Its front is tilted against the line of sight by no more than was asked for."""
    found = read_simulated_rig("ring-of-eight")
    held = HeldTarget((400.0, 700.0), tilt_rad=np.radians(20))
    poses = held_poses(found.rig, BOARD, held, 24, np.random.default_rng(1))
    back = found.rig.center_mm[np.arange(24) % 8] - poses[:, :3, 3]
    cosine = (poses[:, :3, 2] * back).sum(axis=1) / np.linalg.norm(back, axis=1)
    assert cosine.min() > np.cos(np.radians(20.01))
    assert cosine.min() < np.cos(np.radians(15))


def test_a_moving_target_goes_smoothly_at_its_speed() -> None:
    """It is no faster than asked for nor turned at a whirl, and goes on as it went: no jump of place, turn or speed."""
    found = read_simulated_rig("stereo-pair")
    held = HeldTarget((400.0, 800.0), speed_mm_s=200.0)
    way = way_of(found.rig, ICO, held, (-0.1, 6.0), np.random.default_rng(2))
    poses = way.at(np.arange(-0.1, 6.0, 0.01))
    step = np.diff(poses[:, :3, 3], axis=0)
    speed = np.linalg.norm(step, axis=1) / 0.01
    assert 50 < speed.mean() < 220
    assert np.abs(np.diff(step, axis=0)).max() < 0.3
    turn = log_rotation(poses[1:, :3, :3] @ poses[:-1, :3, :3].transpose(0, 2, 1))
    assert 0.3 < np.linalg.norm(turn, axis=1).mean() / 0.01 < 1.5
    assert np.abs(np.diff(turn, axis=0)).max() < 0.01


def test_a_target_held_into_the_camera_is_refused() -> None:
    """Its size is told."""
    found = read_simulated_rig("stereo-pair")
    with pytest.raises(InputError, match="the target reaches 95mm"):
        held_poses(found.rig, ICO, HeldTarget((90.0, 200.0)), 2, np.random.default_rng(0))
