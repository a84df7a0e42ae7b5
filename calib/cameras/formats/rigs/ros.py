"""What ROS wants of a rig: a camera_info file a camera, a launch file of static transforms, and the same as a URDF.

A transform takes points from the child's frame to the parent's: rig_from_cam, in metres, its quaternion as x y z w. A
camera's frame is its optical one, z forward and y down (REP 103). Of a pair, P is of the rectified pictures, and
-P[0, 3] / P[0, 0] of the second camera is the baseline in metres (sensor_msgs/CameraInfo).
"""

from collections.abc import Mapping, Sequence
from xml.sax.saxutils import quoteattr

import numpy as np

from calib.cameras.formats import FORMATS
from calib.cameras.formats.parsing import real
from calib.cameras.formats.rigs.format import RigFormat, WrittenRig, plain_words
from calib.cameras.formats.rigs.poses import roll_pitch_yaw_rad
from calib.cameras.formats.rigs.ros_reading import FRAME, LAUNCH, RIG_LINK, SUFFIX, read
from calib.cameras.formats.ros import info_text
from calib.cameras.linear_part import linear_part
from calib.cameras.rectification import rectified_pair
from calib.core.se3 import invert, quaternion_wxyz
from designer.base.arrays import Array

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
