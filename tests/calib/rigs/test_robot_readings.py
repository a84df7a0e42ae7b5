"""Poses of a robot that are not what their columns say: what they are is named, or nothing is."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.core.se3 import invert
from calib.observe.robot_poses import RobotPoses
from calib.rigs.robot_readings import why_size, why_wrong
from tests.support.robot_files import (
    QUATERNION,
    Array,
    Written,
    a_row_on,
    angles,
    in_unit,
    mirrored,
    quaternions,
    read,
    robot,
    rolled,
    vectors,
    wobbling,
)

ABC, RXYZ = "a_deg,b_deg,c_deg", "rx_rad,ry_rad,rz_rad"
KINDS: dict[str, tuple[Callable[[Array], Written], str]] = {
    "as said": (quaternions, ""),
    "as KUKA says": (angles(ABC, "ZYX"), ""),
    "cm": (in_unit(0.1), "positions in cm that are taken for mm"),
    "m": (in_unit(1e-3), "positions in m that are taken for mm"),
    "inches": (in_unit(1 / 25.4), "positions in in that are taken for mm"),
    "w first": (lambda pose: (QUATERNION, *rolled(pose, 1)), "quaternions w first"),
    "w last": (lambda pose: ("qw,qx,qy,qz", *rolled(pose, 0)), "quaternions w last"),
    "inverted": (lambda pose: quaternions(invert(pose)), "flange_from_base"),
    "left-handed": (mirrored(np.diag([1.0, -1.0, 1.0])), "poses in a left-handed frame"),
    "y and z swapped": (mirrored(np.eye(3)[[0, 2, 1]]), "poses in a left-handed frame"),
    "late": (a_row_on(1), "poses that stand a row too late"),
    "early": (a_row_on(-1), "poses that stand a row too early"),
    "zyz": (angles(ABC, "ZYZ"), "Euler angles zyz-intrinsic (kawasaki)"),
    "xyz": (angles(ABC, "xyz"), "Euler angles xyz-extrinsic (fanuc, rpy)"),
    "angles as a vector": (angles(RXYZ, "xyz", degrees=False), "Euler angles xyz-extrinsic (fanuc, rpy)"),
    "KUKA's as a vector": (angles(RXYZ, "ZYX", degrees=False), "Euler angles zyx-intrinsic (kuka)"),
    "a vector as angles": (vectors("roll_rad,pitch_rad,yaw_rad"), "rotation vectors"),
    "rad as deg": (vectors("rx_deg,ry_deg,rz_deg"), "angles in rad"),
    "w first in cm": (
        lambda pose: (QUATERNION, 0.1 * pose[:, :3, 3], rolled(pose, 1)[1]),
        "quaternions w first; positions in cm",
    ),
    "inverted in m": (
        lambda pose: (QUATERNION, 1e-3 * invert(pose)[:, :3, 3], quaternions(invert(pose))[2]),
        "flange_from_base; positions in m",
    ),
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_reading_is_named_and_nothing_else(kind: str, tmp_path: Path) -> None:
    """Of a camera in hand and of a target in hand, one time in two with a fifth of the poses wrong."""
    write, said = KINDS[kind]
    number = list(KINDS).index(kind)
    seen, base_from_flange = robot(number, is_camera_in_hand=number % 2 == 0)
    if number % 4 < 2:
        lost = np.arange(len(seen)) % 5 == 2
        seen[lost] = seen[lost] @ wobbling(np.random.default_rng(number), int(lost.sum()), 0.5, 60.0)
    why = why_wrong(
        seen, read(write(base_from_flange), tmp_path), np.arange(len(seen)), is_camera_in_hand=number % 2 == 0
    )
    if not said:
        assert why == ""
    else:
        assert f"these look like {said}" in why
        assert "alike" not in why


def test_poses_of_other_photos_are_not_given_a_cause(tmp_path: Path) -> None:
    """No reading explains them, and that is what is said."""
    seen, base_from_flange = robot(3, is_camera_in_hand=True)
    mixed = np.random.default_rng(0).permutation(base_from_flange)
    why = why_wrong(seen, read(quaternions(mixed), tmp_path), np.arange(len(seen)), is_camera_in_hand=True)
    assert "do not fit the photos" in why
    assert "look like" not in why


def test_what_no_photo_tells_apart_is_not_decided(tmp_path: Path) -> None:
    """A camera that circles a target, which stays where it is in the image, tells neither sense nor unit."""
    seen, base_from_flange = robot(4, is_camera_in_hand=True, is_orbit=True)
    rows = np.arange(len(seen))
    written = QUATERNION, *rolled(base_from_flange, 1)
    why = why_wrong(seen, read(written, tmp_path), rows, is_camera_in_hand=True)
    assert "explain them alike" in why
    assert why_wrong(seen, read(quaternions(base_from_flange), tmp_path), rows, is_camera_in_hand=True) == ""


@pytest.mark.parametrize(
    ("size", "said"),
    [
        (0.98, ""),
        (0.1, "positions in cm that are taken for mm"),
        (0.04, "positions in in that"),
        (10.0, "points in cm that"),
        (0.5, "no unit explains"),
    ],
)
def test_a_size_that_no_target_has_is_another_unit(size: float, said: str) -> None:
    """Where too few turns tell no reading, the target's size by the robot's ways does."""
    why = why_size(RobotPoses(("a.png",), np.eye(4)[None], "robot.csv"), size)
    assert said in why if said else why == ""
