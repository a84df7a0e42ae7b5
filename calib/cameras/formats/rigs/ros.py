"""What ROS wants of a rig: a camera_info file a camera, a launch file of static transforms, and the same as a URDF.

A transform takes points from the child's frame to the parent's: rig_from_cam, in metres, its quaternion as x y z w. A
camera's frame is its optical one, z forward and y down (REP 103). Of a pair, P is of the rectified pictures, and
-P[0, 3] / P[0, 0] of the second camera is the baseline in metres (sensor_msgs/CameraInfo).

ROS's files of a rig read: cameras' places by the launch file that we write, or of a pair by the rectification.

`camera_calibration` says of a pair only how it is rectified: R turns each camera's frame into the rectified one, and
the last column of P is K' t with the shift t in metres from the rectified frame of the first (sensor_msgs/CameraInfo).
"""

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from calib.cameras.camera import linear_part
from calib.cameras.formats import FORMATS
from calib.cameras.formats.format import ReadCamera
from calib.cameras.formats.opencv import matrix_numbers
from calib.cameras.formats.parsing import mapping, number, parse_yaml, real, required
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled, plain_words
from calib.cameras.formats.rigs.poses import pose_of, quaternion_pose, roll_pitch_yaw_rad
from calib.cameras.formats.ros import info_text
from calib.cameras.formats.ros import read as read_info
from calib.cameras.rectification import rectified_pair
from calib.core.se3 import invert, quaternion_wxyz
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

LAUNCH, SUFFIX, FRAME = "static_transforms.launch.yaml", ".yaml", "_optical_frame"
RIG_LINK = "rig"
"""Of a rig whose frame is a camera's."""
ARGUMENTS = ("--qw", "--qx", "--qy", "--qz", "--x", "--y", "--z")


def read(files: RigFiles) -> ReadRig:
    """The rig of a folder, a camera_info file a camera."""
    infos = {name: text for name, text in files.texts.items() if name != LAUNCH and name.endswith(SUFFIX)}
    if LAUNCH in files.texts:
        return _by_transforms(files, infos)
    if len(infos) != 2:
        raise InputError(f"{files.origin}: holds {len(infos)} cameras without {LAUNCH}; without it, two are a pair")
    found = [read_info(text, files.origin_of(name)) for name, text in infos.items()]
    first, second = (_rectification(text, files.origin_of(name)) for name, text in infos.items())
    shift = second[1] - first[1]
    if not np.linalg.norm(shift) > 0:
        raise InputError(f"{files.origin}: the projection matrices tell no baseline; calibrate the two as a pair")
    rotation, moved = second[0].T @ first[0], second[0].T @ shift
    pose = pose_of(rotation, moved.tolist(), files.unit, f"{files.origin}: rectification_matrix")
    return assembled(files, [name.removesuffix(SUFFIX) for name in infos], found, [np.eye(4), pose], "m")


def _rectification(text: str, origin: str) -> tuple[Array, Array]:
    """R (3, 3), and the shift (3,) that P holds, in metres."""
    values = mapping(parse_yaml(text, origin), "the file", origin)
    names = ("rectification_matrix", "projection_matrix")
    turn, flat = (
        matrix_numbers(required(values, (name,), origin), name, origin, (count,))
        for name, count in zip(names, (9, 12), strict=True)
    )
    projection = np.array(flat).reshape(3, 4)
    focal = projection[[0, 1], [0, 1]]
    if not (focal > 0).all() or projection[2].tolist() != [0, 0, 1, 0]:
        raise InputError(f"{origin}: projection_matrix must be fx 0 cx Tx, 0 fy cy Ty, 0 0 1 0, row by row")
    rotation = pose_of(np.array(turn).reshape(3, 3), (0.0, 0.0, 0.0), "m", f"{origin}: rectification_matrix")
    return rotation[:3, :3], np.array([*(projection[:2, 3] / focal), 0.0])


def _by_transforms(files: RigFiles, infos: Mapping[str, str]) -> ReadRig:
    """The cameras in the order of the launch file, whose frames are called after them."""
    origin = files.origin_of(LAUNCH)
    tree = mapping(parse_yaml(files.texts[LAUNCH], origin), "the file", origin)
    nodes = required(tree, ("launch",), origin)
    if not isinstance(nodes, list) or not nodes:
        raise InputError(f"{origin}: launch must be a list of nodes")
    names: list[str] = []
    found: list[ReadCamera] = []
    poses, parent = [], ""
    for one in nodes:
        node = mapping(mapping(one, "an entry", origin).get("node"), "a node", origin)
        words = str(required(node, ("args",), origin)).split()
        given = dict(zip(words[::2], words[1::2], strict=False))
        parent = str(required(given, ("--frame-id",), origin))
        name = str(required(given, ("--child-frame-id",), origin)).removesuffix(FRAME)
        if f"{name}{SUFFIX}" not in infos:
            raise InputError(f"{origin}: there is no {shown(name + SUFFIX)} beside it")
        values = [number(required(given, (key,), origin), key, origin) for key in ARGUMENTS]
        names.append(name)
        found.append(read_info(infos[f"{name}{SUFFIX}"], files.origin_of(f"{name}{SUFFIX}")))
        poses.append(invert(quaternion_pose(values[:4], values[4:], files.unit, f"{origin}: {shown(name)}")))
    return assembled(files, names, found, poses, "m", parent if parent not in ("", RIG_LINK) else None)


URDF = "rig.urdf"


def write(written: WrittenRig) -> Mapping[str, str]:
    """The texts for a rig; a pair that sees alike is rectified."""
    rectified = _rectified(written)
    each = zip(written.words, written.rig.cameras, written.lenses, rectified, strict=True)
    infos = {
        f"{word}{SUFFIX}": info_text(camera, lens, word, turn.ravel().tolist(), projection.ravel().tolist())
        for word, camera, lens, (turn, projection) in each
    }
    parent = _parent(written)
    rig_from_cam = dict(
        zip((f"{word}{FRAME}" for word in written.words), invert(written.cam_from_rig) + 0.0, strict=True)
    )
    return {**infos, LAUNCH: _launch(parent, rig_from_cam), URDF: _urdf(parent, rig_from_cam)}


def _rectified(written: WrittenRig) -> list[tuple[Array, Array]]:
    """R (3, 3) and P (3, 4) of each camera; those of one that is no part of a pair show its middle in its size."""
    cameras = written.rig.cameras
    flat = rectified_pair(cameras, written.cam_from_first[1]) if len(cameras) == 2 else None
    if flat is not None:
        return list(zip(flat.rect_from_cam, flat.projection, strict=True))
    return [(np.eye(3), np.column_stack([linear_part(camera).matrix, np.zeros(3)])) for camera in cameras]


def _parent(written: WrittenRig) -> str:
    """The link that the cameras stand on: a robot's own, or one of the rig's."""
    frame = written.rig.rig_frame
    return plain_words((frame,))[0] if frame and frame not in written.rig.names else RIG_LINK


def _launch(parent: str, rig_from_cam: Mapping[str, Array]) -> str:
    nodes = "".join(
        "- node:\n    pkg: tf2_ros\n    exec: static_transform_publisher\n"
        f"    name: {child}_broadcaster\n"
        f'    args: "{_arguments(pose)} --frame-id {parent} --child-frame-id {child}"\n'
        for child, pose in rig_from_cam.items()
    )
    return f"# ros2 launch {LAUNCH}; lengths are in metres\nlaunch:\n{nodes}"


def _arguments(pose: Array) -> str:
    w, *xyz = quaternion_wxyz(pose[:3, :3]).tolist()
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return " ".join(
        f"--{name} {real(value)}" for name, value in zip(names, [*pose[:3, 3].tolist(), *xyz, w], strict=True)
    )


def _urdf(parent: str, rig_from_cam: Mapping[str, Array]) -> str:
    joints = "".join(
        f"  <link name={quoteattr(child)}/>\n"
        f'  <joint name={quoteattr(f"{child}_joint")} type="fixed">\n'
        f"    <parent link={quoteattr(parent)}/>\n    <child link={quoteattr(child)}/>\n"
        f'    <origin xyz="{_words(pose[:3, 3].tolist())}" rpy="{_words(roll_pitch_yaw_rad(pose[:3, :3]))}"/>\n'
        "  </joint>\n"
        for child, pose in rig_from_cam.items()
    )
    return f'<?xml version="1.0"?>\n<robot name="rig">\n  <link name={quoteattr(parent)}/>\n{joints}</robot>\n'


def _words(values: Sequence[float]) -> str:
    return " ".join(map(real, values))


FORMAT = RigFormat(
    name="ros",
    title="ROS camera_info and transforms",
    file_name="ros",
    opens_with=f"ros2 launch {{file}}/{LAUNCH}; the .yaml of each camera goes to its driver as camera_info_url",
    cameras=FORMATS["ros"],
    unit="m",
    write=write,
    read=read,
    patterns=(f"*{SUFFIX}",),
    needed=(LAUNCH, f"left{SUFFIX}"),
    has_own_unit=True,
)
