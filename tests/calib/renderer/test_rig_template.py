"""Templates of rigs: where their cameras stand, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.core.se3 import log_rotation
from calib.renderer.held_target import LEAST_SEEN, held_poses, seen_shares, way_of
from calib.renderer.rig_template import HeldTarget, SimulatedRig, read_simulated_rig
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.kinds.presets import preset_names
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for

RING = """
title = "a ring"
purpose = "a test"
[[rings]]
name = "cam"
camera = "machine-vision"
count = 4
radius = "60cm"
height = "200mm"
tilt = "30deg"
[target]
distance = "50..75cm"
speed = "20cm/s"
"""


@pytest.mark.parametrize("name", preset_names("rigs"))
def test_each_template_is_a_rig_in_its_first_cameras_frame(name: str) -> None:
    """A template reads, its first camera is the rig's frame as in `calib rig`, and no two stand at one place."""
    found = read_simulated_rig(name)
    assert found.held is not None
    assert np.allclose(found.rig.cam_from_rig[0], np.eye(4), atol=1e-12)
    assert list(found.rig.names) == sorted(found.rig.names)
    apart_mm = np.linalg.norm(found.rig.center_mm[:, None] - found.rig.center_mm, axis=2)
    assert (apart_mm + 1e9 * np.eye(len(apart_mm)) > 10).all()
    assert found.title
    assert found.purpose


def test_a_ring_looks_inwards_and_down(tmp_path: Path) -> None:
    """Cameras stand on the circle, a quarter turn apart, and their axes meet on its axis, tilted as was said."""
    path = tmp_path / "ring.toml"
    path.write_text(RING)
    found = read_simulated_rig(str(path))
    rig, axis = found.rig, found.rig.rig_from_cam[:, :3, 2]
    assert np.allclose(np.linalg.norm(np.diff(rig.center_mm, axis=0), axis=1), 600 * np.sqrt(2))
    met = rig.center_mm + axis * 600 / np.cos(np.pi / 6)
    assert np.allclose(met, met[0])
    assert np.allclose(axis[0] @ axis[2], -np.cos(np.pi / 3))  # each 30 degrees down
    assert (found.held.distance_mm, found.held.speed_mm_s) == ((500.0, 750.0), 200.0)


def test_a_camera_sees_to_where_it_looks(tmp_path: Path) -> None:
    """A point that a camera looks to lies on its axis, and the room's z points up in its image."""
    path = tmp_path / "pair.toml"
    cameras = "".join(
        f'[[cameras]]\nname = "{name}"\ncamera = "webcam"\nat = "{at}"\ntowards = "0x500x100mm"\n'
        for name, at in (("a", "0x0x0mm"), ("b", "300x0x50mm"))
    )
    path.write_text(f'title = "t"\npurpose = ""\n{cameras}[target]\ndistance = "500mm"\n')
    rig = read_simulated_rig(str(path)).rig
    first_axis = np.array([0, 500.0, 100]) / np.hypot(500, 100)
    seen = rig.rig_from_cam[1][:3, :3] @ [0, 0, np.linalg.norm([-300, 500, 50])] + rig.center_mm[1]
    assert np.allclose(seen, [0, 0, np.hypot(500, 100)])
    right, up = rig.center_mm[1][0], -rig.center_mm[1][1]
    assert np.isclose(right, 300)
    assert np.isclose(up, 50 * first_axis[1])  # of the second camera as the first one sees it


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("count = 4", "count = 0", "rings.0.count 0: must be 1 or more"),
        ('camera = "machine-vision"', 'camera = "machine-vison"', "did you mean 'machine-vision'"),
        ('radius = "60cm"', 'radius = "0mm"', "radius '0mm': must be at least 1mm"),
        ('tilt = "30deg"', 'tilt = "90deg"', "must be from -80deg to 80deg"),
        ('name = "cam"', 'name = "../cam"', "its photos get a folder of that name"),
        ('distance = "50..75cm"', 'distance = "75..50cm"', "the smaller length comes first"),
        ('speed = "20cm/s"', 'speed = "0mm/s"', "must be at least 1mm/s"),
    ],
)
def test_what_breaks_a_rule_is_refused_in_a_line(old: str, new: str, message: str, tmp_path: Path) -> None:
    """The line names the file and the value."""
    path = tmp_path / "ring.toml"
    assert old in RING
    path.write_text(RING.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_simulated_rig(str(path))
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_names_that_cannot_be_folders_are_refused(tmp_path: Path) -> None:
    """Cameras of a rig's file may have any names; their photos do not leave the folder, nor share one."""
    camera = Camera("pinhole", np.array([100.0, 100, 50, 50]), (100, 100))
    for number, names in enumerate((("a", "../b"), ("a", "A"), ("a", ".hidden"), ("a", "b/c"))):
        place = Rig(names, (camera, camera), np.tile(np.eye(4), (2, 1, 1))).save(tmp_path / f"{number}.json")
        with pytest.raises(InputError, match="camera"):
            read_simulated_rig(str(place))


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
