import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.core.se3 import invert
from calib.observe.robot_poses import RobotPoses, poses_of, read_robot_poses
from designer.base.arrays import Array
from designer.base.errors import InputError

TURN = Rotation.from_euler("ZYX", [30.0, -50.0, 110.0], degrees=True)
SHIFT_MM = np.array([412.5, -80.25, 733.0])


def _wanted() -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = TURN.as_matrix(), SHIFT_MM
    return pose


def _row(values: object) -> str:
    return ",".join(repr(float(value)) for value in np.ravel(np.asarray(values)))


X, Y, Z, W = TURN.as_quat()
MATRIX = _wanted()
TABLES = {
    "m, x y z w": ("x_m,y_m,z_m,qx,qy,qz,qw", [*SHIFT_MM / 1e3, X, Y, Z, W], {}),
    "mm, w x y z, negative": ("x_mm,y_mm,z_mm,qw,qx,qy,qz", [*SHIFT_MM, -W, -X, -Y, -Z], {}),
    "ABB": ("x,y,z,q1,q2,q3,q4", [*SHIFT_MM, W, X, Y, Z], {"unit": "mm"}),
    "UR": ("x_m,y_m,z_m,rx_rad,ry_rad,rz_rad", [*SHIFT_MM / 1e3, *TURN.as_rotvec()], {}),
    "KUKA": ("X,Y,Z,A,B,C", [*SHIFT_MM, *TURN.as_euler("ZYX", degrees=True)], {"unit": "mm,deg"}),
    "Fanuc": ("x_mm,y_mm,z_mm,w_deg,p_deg,r_deg", [*SHIFT_MM, *TURN.as_euler("xyz", degrees=True)], {}),
    "ROS": ("tx_mm,ty_mm,tz_mm,roll_rad,pitch_rad,yaw_rad", [*SHIFT_MM, *TURN.as_euler("xyz")], {}),
    "Kawasaki": ("x_mm,y_mm,z_mm,o_deg,a_deg,t_deg", [*SHIFT_MM, *TURN.as_euler("ZYZ", degrees=True)], {}),
    "named axes": (
        "x_mm,y_mm,z_mm,rz_deg,ry_deg,rx_deg",
        [*SHIFT_MM, *TURN.as_euler("XYZ", degrees=True)[::-1]],
        {"euler": "xyz-intrinsic"},
    ),
    "by order": (
        "x_mm,y_mm,z_mm,e1_deg,e2_deg,e3_deg",
        [*SHIFT_MM, *TURN.as_euler("zxz", degrees=True)],
        {"euler": "zxz-extrinsic"},
    ),
    "3 x 4": ("m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23", MATRIX[:3] * [1, 1, 1, 1e-3], {"unit": "m"}),
    "inverted": ("x_mm,y_mm,z_mm,qx,qy,qz,qw", [*invert(MATRIX)[:3, 3], -X, -Y, -Z, W], {"is_inverted": True}),
}


@pytest.mark.parametrize("name", TABLES)
def test_each_robots_way_of_writing_says_the_same(name: str, tmp_path: Path) -> None:
    """Rotations are those of scipy's conventions, lengths those of the column or the option."""
    columns, values, options = TABLES[name]
    path = tmp_path / "poses.csv"
    path.write_text(f"# of a robot\nimage, {columns}\na.png, {_row(values)}\n")
    found = read_robot_poses(path, **options)
    assert found.images == ("a.png",)
    assert np.abs(found.base_from_flange[0] - MATRIX).max() < 1e-9


@pytest.mark.parametrize(
    "entry",
    [
        {"position_m": list(SHIFT_MM / 1e3), "orientation": {"w": W, "x": X, "y": Y, "z": Z}},
        {"translation": {"x": 412.5, "y": -80.25, "z": 733.0}, "rotation": TURN.as_matrix().tolist()},
        {"matrix": MATRIX.tolist()},
        {"matrix_mm": MATRIX[:3].ravel().tolist()},
        {"position": SHIFT_MM.tolist(), "rotation_vector_rad": TURN.as_rotvec().tolist()},
    ],
)
@pytest.mark.parametrize("form", ["list", "under poses", "by name", "yaml"])
def test_trees_say_what_tables_say(entry: dict[str, object], form: str, tmp_path: Path) -> None:
    """YAML and JSON: lists of poses, alone or under a name, or names with poses."""
    path = tmp_path / ("poses.yaml" if form == "yaml" else "poses.json")
    whole = {"image": "a.png", **entry}
    path.write_text(
        json.dumps({"a.png": entry} if form == "by name" else [whole] if form == "list" else {"poses": [whole]})
    )
    named = {"position_m", "matrix_mm"} & set(entry)
    found = read_robot_poses(path, unit=None if named else "mm")
    assert np.abs(found.base_from_flange[0] - MATRIX).max() < 1e-9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,x,y,z,qx,qy,qz,qw\na,1,2,3,0,0,0,1", "do not say their unit"),
        ("image,x_mm,y_m,z_m,qx,qy,qz,qw\na,1,2,3,0,0,0,1", "one unit for all"),
        ("image,x_m,y_m,z_m,qx,qy,qz,qw\na,1,2,3,0,0,0,2", "line 2: a quaternion of length 2"),
        ("image,x_m,y_m,z_m,qx,qy,qz,qw\na,1,2,3,0,0,0,1\na,1,2,3,0,0,0,1", "line 3: 'a' was named before"),
        ("image,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\na,1,2,3,170,0,90", "are these degrees?"),
        ("image,x_m,y_m,z_m,rx,ry,rz\na,1,2,3,1,0,0", "rx_rad or rx_deg"),
        ("image,x_m,y_m,z_m\na,1,2,3", "no rotation"),
        ("image,x_m,y_m,z_m,qx,qy,qz,qw,a_deg,b_deg,c_deg\na,1,2,3,0,0,0,1,1,2,3", "two rotations"),
        ("image,qx,qy,qz,qw\na,0,0,0,1", "no position"),
        ("image,x_m,y_m,z_m,r00,r01,r02,r10,r11,r12,r20,r21,r22\na,1,2,3,1,0,0,0,1,0,0,0,-1", "a mirror image"),
        ("image,x_m,y_m,z_m,qx,qy,qz,qw\na,1e5,2,3,0,0,0,1", "check the unit"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(text: str, said: str, tmp_path: Path) -> None:
    """One line, with the place and the rule."""
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        read_robot_poses(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["[1]", "{}", "3", '{"poses": {"a": 1}}', '[{"image": "a", "matrix": [[1], [2]]}]',
                                  '[{"image": "a", "quaternion": [0, 0, 0, 1], "position_m": [1, 2, 3]}]'])  # fmt: skip
def test_trees_of_another_shape_are_refused(text: str, tmp_path: Path) -> None:
    """One line."""
    for name in ("poses.json", "poses.yaml"):
        (tmp_path / name).write_text(text)
        with pytest.raises(InputError, match=name):
            read_robot_poses(tmp_path / name)


def test_photos_have_the_poses_of_their_names(tmp_path: Path) -> None:
    """By name, by the file's name, or by that without its ending; what has none is told."""
    path = tmp_path / "poses.csv"
    rows = "".join(f"{name},1,2,3,0,0,0,1\n" for name in ("b", "a", "c"))
    path.write_text(f"image,x_m,y_m,z_m,qx,qy,qz,qw\n{rows}")
    found = poses_of(read_robot_poses(path), ["run/a.png", "run/b.png", "run/d.png"])
    assert found.row == (1, 0, None)
    assert found.unused == ("c",)
    with pytest.raises(InputError, match="names no photo"):
        poses_of(read_robot_poses(path), ["x.png"])


def test_names_that_are_times_are_paired_with_the_nearest() -> None:
    """Within half of the least time between two, of nanoseconds, microseconds or a fraction; else with none."""
    names = ("1700000000.250000", "1700000001.250000", "1700000003.250000")
    poses = RobotPoses(names, np.tile(np.eye(4), (3, 1, 1)), "poses.csv")
    found = poses_of(poses, ["1700000003249000000.png", "1700000002000000000.png", "1700000000253000000.png"])
    assert found.row == (2, None, 0)
    assert found.unused == names[1:2]
    assert found.remark.startswith("photos and robot poses are paired by their times, up to 3.0 ms apart")
    for photos in (["1700000000250000.png", "a.png"], ["1700000009000000.png", "1700000009000001.png"]):
        assert not poses_of(poses, [*photos, names[0]]).remark


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"unit": "mm"}, "--unit mm: its columns say m"),
        ({"unit": "deg"}, "--unit deg: its rotations are quaternions"),
        ({"euler": "kuka"}, "--euler 'kuka': its rotations are quaternions"),
    ],
)
def test_what_the_columns_leave_no_room_for_is_refused(options: dict[str, str], said: str, tmp_path: Path) -> None:
    """An option that says how columns are to be read which are not there."""
    path = tmp_path / "poses.csv"
    path.write_text("image,x_m,y_m,z_m,qx,qy,qz,qw\na,1,2,3,0,0,0,1\n")
    with pytest.raises(InputError, match=said):
        read_robot_poses(path, **options)


def test_a_path_of_windows_names_its_photo(tmp_path: Path) -> None:
    """What stands after the last backslash does, as after the last slash."""
    path = tmp_path / "poses.csv"
    path.write_text("image,x_m,y_m,z_m,qx,qy,qz,qw\n" + "C:\\data\\cal\\b.png,1,2,3,0,0,0,1\n")
    assert poses_of(read_robot_poses(path), ["run/a.png", "run/b.png"]).row == (None, 0)
