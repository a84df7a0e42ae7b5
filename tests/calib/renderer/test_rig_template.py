"""Templates of rigs: where their cameras stand, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.renderer.rig_template import read_simulated_rig
from designer.base.errors import InputError
from designer.kinds.presets import preset_names

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
    assert found.held is not None
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
        ("count = 4", "count = 1000", "must be 256 or less"),
        ('camera = "machine-vision"', 'camera = "machine-vison"', "did you mean 'machine-vision'"),
        ('radius = "60cm"', 'radius = "60deg"', "radius '60deg': unknown unit"),
        ('radius = "60cm"', 'radius = "0mm"', "radius '0mm': must be at least 1mm"),
        ('tilt = "30deg"', 'tilt = "90deg"', "must be from -80deg to 80deg"),
        ('name = "cam"', 'name = "../cam"', "its photos get a folder of that name"),
        ("count = 4", "cuont = 4", "did you mean 'count'"),
        ("count = 4", 'count = "4"', "must be a whole number"),
        ("[target]", "[tagret]", "unknown key 'tagret'"),
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
