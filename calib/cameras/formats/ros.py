"""ROS camera_info files, as `camera_calibration` writes and drivers read them, its ost.txt, and CameraInfo messages.

K of a message is that of the full sensor; the photos of its topic are a region of it, and binned (REP 104, and
sensor_msgs/CameraInfo): `u' = (u - x_offset + 1/2) / binning_x - 1/2`, as pixel (0, 0) is the centre of the first.

A rig is a camera_info file a camera, a launch file of static transforms, and the same as a URDF. A transform takes
points from the child's frame to the parent's: rig_from_cam, in metres, its quaternion as x y z w. A camera's frame is
its optical one, z forward and y down, and hangs on the one of its body, x forward and z up (REP 103): that turn is
always the same. Of a pair, P is of the rectified pictures, and -P[0, 3] / P[0, 0] of
the second camera is the baseline in metres (sensor_msgs/CameraInfo). Cameras' places are read from the launch file that
we write, or of a pair from the rectification.

`camera_calibration` says of a pair only how it is rectified: R turns each camera's frame into the rectified one, and
the last column of P is K' t with the shift t in metres from the rectified frame of the first (sensor_msgs/CameraInfo).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from xml.sax.saxutils import quoteattr

import numpy as np

from calib.cameras import COMMON, LINEAR
from calib.cameras.camera import MAX_SIDE_PX, Camera, linear_part
from calib.cameras.formats import opencv
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens_names import mentions_lens, named_lens
from calib.cameras.formats.opencv import matrix_numbers
from calib.cameras.formats.parsing import (
    mapping,
    number,
    parse_tree,
    parse_yaml,
    pose_of,
    quaternion_pose,
    real,
    required,
    roll_pitch_yaw_rad,
)
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled, plain_words
from calib.cameras.rig import rectified_pair
from calib.core.se3 import invert, make_pose, quaternion_wxyz
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

LENSES = (
    FileLens("plumb_bob", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("rational_polynomial", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("equidistant", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""Its distortion models (sensor_msgs/distortion_models)."""
COUNTS = {COMMON: (0, 4, 5), "opencv8": (8, 12, 14)}
"""How many coefficients they may have: OpenCV's functions take them, so that a long list goes on as theirs."""

MATRIX, COEFFICIENTS = (*opencv.MATRIX, "k"), (*opencv.LENS, "d")
KEYS = (*MATRIX, *COEFFICIENTS, *opencv.SIZE, "binning_x", "binning_y", "roi")

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

_OST = re.compile(r"^\[image\]\s*$(?=(?s:.*?)^camera matrix\s*$)", re.MULTILINE)
_RECOGNISED = re.compile(
    rf"\A(?=(?s:.*?)^[\"']?distortion_model[\"']?\s*:)(?=(?s:.*?)^[\"']?(?:camera_matrix|K|k)[\"']?\s*:)|{_OST.pattern}",
    re.MULTILINE,
)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model; rectified images keep its focal lengths and centre."""
    fx, fy, cx, cy = camera.params[:4].tolist()
    return info_text(camera, lens, "camera", IDENTITY, (fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0))


def info_text(
    camera: Camera, lens: FileLens, name: str, rectification: Sequence[float], projection: Sequence[float]
) -> str:
    """The text for a camera with that name, whose rectified pictures are made with these 9 and 12 numbers."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n"
        f"camera_matrix:{_matrix(3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1])}"
        f"distortion_model: {lens.name}\n"
        f"distortion_coefficients:{_matrix(1, len(rest), rest)}"
        f"rectification_matrix:{_matrix(3, 3, rectification)}"
        f"projection_matrix:{_matrix(3, 4, projection)}"
    )


def _matrix(rows: int, columns: int, values: Sequence[float]) -> str:
    return f"\n  rows: {rows}\n  cols: {columns}\n  data: [{', '.join(map(real, values))}]\n"


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    values = ost(text, origin) if _OST.search(text) else parse_tree(text, KEYS, mentions_lens, origin)
    size = opencv.size_of(values, origin)
    named = named_lens(values, origin)
    if named is not None and named.model not in (None, LINEAR, *(lens.model for lens in LENSES)):
        hint = f"calibrate with {' or '.join(one.name for one in LENSES)}"
        raise InputError(f"{origin}: {named.said}: not supported; {hint}")
    matrix = matrix_numbers(required(values, MATRIX, origin), MATRIX[0], origin, (9,))
    linear, skew = opencv.linear_part(matrix, origin)
    window = _window(values, size, origin)
    if window is not None:
        linear, skew, size = window.of(linear), skew / window.binning[0], window.size
    lens = opencv.data_of(required(values, COEFFICIENTS, origin), COEFFICIENTS[0], origin)
    counts = COUNTS.get(named.model or "", opencv.COUNTS) if named is not None else opencv.COUNTS
    found = opencv.camera_by_name(linear, skew, lens, COEFFICIENTS[0], counts, size, named, origin)
    return found if window is None else replace(found, remarks=(window.remark, *found.remarks))


@dataclass(frozen=True)
class _Window:
    """The part of the full sensor that photos show."""

    first: tuple[int, int]
    side: tuple[int, int]  # of the full sensor's pixels
    binning: tuple[int, int]

    @property
    def size(self) -> tuple[int, int]:
        """Of the photos."""
        return self.side[0] // self.binning[0], self.side[1] // self.binning[1]

    @property
    def remark(self) -> str:
        """What was done."""
        (x, y), (width, height), (across, down) = self.first, self.side, self.binning
        return (
            f"binning {across} x {down} and the region of {width} x {height} px at {x}, {y} are applied, as K is that "
            f"of the full sensor (REP 104): the photos have {self.size[0]} x {self.size[1]} px"
        )

    def of(self, linear: Sequence[float]) -> list[float]:
        """Values fx fy cx cy of the photos."""
        fx, fy, cx, cy = linear
        (x, y), (across, down) = self.first, self.binning
        return [fx / across, fy / down, (cx - x + 0.5) / across - 0.5, (cy - y + 0.5) / down - 0.5]


def _window(values: Mapping[str, object], full: tuple[int, int], origin: str) -> _Window | None:
    """Which part of the full sensor a message is about; None: all of it."""

    def whole(given: Mapping[str, object], name: str) -> int:
        value = number(given.get(name, 0), name, origin)
        if value != int(value) or not 0 <= value <= MAX_SIDE_PX:
            raise InputError(f"{origin}: {name} {value:g}: must be a whole number of pixels, 0 or more")
        return int(value)

    binning = max(1, whole(values, "binning_x")), max(1, whole(values, "binning_y"))
    roi = mapping(values.get("roi") or {}, "roi", origin)
    first, side = (whole(roi, "x_offset"), whole(roi, "y_offset")), (whole(roi, "width"), whole(roi, "height"))
    if side == (0, 0) and first == (0, 0):
        side = full
    if (first, side, binning) == ((0, 0), full, (1, 1)):
        return None
    if 0 in side or any(begin + long > most for begin, long, most in zip(first, side, full, strict=True)):
        raise InputError(
            f"{origin}: roi of {side[0]} x {side[1]} px at {first[0]}, {first[1]} is no part of the sensor's "
            f"{full[0]} x {full[1]} px; width and height are those of the full sensor"
        )
    if any(by > long for by, long in zip(binning, side, strict=True)):
        raise InputError(f"{origin}: binning {binning[0]} x {binning[1]} leaves no pixel of {side[0]} x {side[1]}")
    return _Window(first, side, binning)


def ost(text: str, origin: str) -> Mapping[str, object]:
    """The values of an `ost.txt`: names of a line, each before its lines of numbers.

    Raises:
        InputError: it holds several cameras.
    """
    values: dict[str, list[object]] = {}
    name = ""
    for line in text.splitlines():
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if re.match(r"[-+.0-9]", words[0]):
            values.setdefault(name, []).extend(words)
        elif (name := "_".join(words).lower()) in values:
            raise InputError(f"{origin}: holds {name} a second time, so several cameras; leave one of them")
    for side in ("width", "height"):
        if len(values.get(side, ())) != 1:
            raise InputError(f"{origin}: {side} must be one number")
    return {
        "width": values["width"][0],
        "height": values["height"][0],
        **{new: values[old] for old, new in (("camera_matrix", "K"), ("distortion", "D")) if old in values},
    }


FORMAT = CameraFormat(
    name="ros",
    title="ROS camera_info",
    file_name="camera_info.yaml",
    opens_with="in the camera driver's parameters: camera_info_url: {url}",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
)


LAUNCH, SUFFIX, FRAME, BODY = "static_transforms.launch.yaml", ".yaml", "_optical_frame", "_link"
BODY_FROM_OPTICAL = make_pose(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
"""To the right is against y, down is against z, forward is along x (REP 103)."""
RIG_LINK = "rig"
"""Of a rig whose frame is a camera's."""
ARGUMENTS = ("--qw", "--qx", "--qy", "--qz", "--x", "--y", "--z")


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a folder, a camera_info file a camera."""
    infos = {name: text for name, text in files.texts.items() if name != LAUNCH and name.endswith(SUFFIX)}
    if LAUNCH in files.texts:
        return _by_transforms(files, infos)
    if len(infos) != 2:
        raise InputError(f"{files.origin}: holds {len(infos)} cameras without {LAUNCH}; without it, two are a pair")
    found = [read(text, files.origin_of(name)) for name, text in infos.items()]
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
    hangs: dict[str, tuple[str, Array]] = {}  # of a child: its parent, and parent_from_child in mm
    for one in nodes:
        node = mapping(mapping(one, "an entry", origin).get("node"), "a node", origin)
        words = str(required(node, ("args",), origin)).split()
        given = dict(zip(words[::2], words[1::2], strict=False))
        parent, child = (str(required(given, (key,), origin)) for key in ("--frame-id", "--child-frame-id"))
        values = [number(required(given, (key,), origin), key, origin) for key in ARGUMENTS]
        hangs[child] = parent, quaternion_pose(values[:4], values[4:], files.unit, f"{origin}: {shown(child)}")
    last = [child for child in hangs if all(child != parent for parent, _ in hangs.values())]
    names, found, poses, root = [child.removesuffix(FRAME) for child in last], list[ReadCamera](), list[Array](), ""
    for name, child in zip(names, last, strict=True):
        if f"{name}{SUFFIX}" not in infos:
            raise InputError(f"{origin}: there is no {shown(name + SUFFIX)} beside it")
        found.append(read(infos[f"{name}{SUFFIX}"], files.origin_of(f"{name}{SUFFIX}")))
        root, pose, way = child, np.eye(4), {child}
        while root in hangs:
            root, step = hangs[root]
            pose = step @ pose
            if root in way:
                raise InputError(f"{origin}: frame {shown(root)} hangs on itself")
            way.add(root)
        poses.append(invert(pose))
    if not names:
        raise InputError(f"{origin}: each frame hangs on another; one has to hang on none")
    return assembled(files, names, found, poses, "m", root if root not in ("", RIG_LINK) else None)


URDF = "rig.urdf"


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The texts for a rig; a pair that sees alike is rectified."""
    rectified = _rectified(written)
    each = zip(written.words, written.rig.cameras, written.lenses, rectified, strict=True)
    infos = {
        f"{word}{SUFFIX}": info_text(camera, lens, word, turn.ravel().tolist(), projection.ravel().tolist())
        for word, camera, lens, (turn, projection) in each
    }
    frame = written.rig.rig_frame  # a robot's own link, or one of the rig's
    parent = plain_words((frame,))[0] if frame and frame not in written.rig.names else RIG_LINK
    hangs = dict[str, tuple[str, Array]]()
    for word, rig_from_cam in zip(written.words, invert(written.cam_from_rig), strict=True):
        hangs[f"{word}{BODY}"] = parent, rig_from_cam @ invert(BODY_FROM_OPTICAL) + 0.0
        hangs[f"{word}{FRAME}"] = f"{word}{BODY}", BODY_FROM_OPTICAL
    return {**infos, LAUNCH: _launch(hangs), URDF: _urdf(parent, hangs)}


def _rectified(written: WrittenRig) -> list[tuple[Array, Array]]:
    """R (3, 3) and P (3, 4) of each camera; those of one that is no part of a pair show its middle in its size."""
    cameras = written.rig.cameras
    flat = rectified_pair(cameras, written.cam_from_first[1]) if len(cameras) == 2 else None
    if flat is not None:
        return list(zip(flat.rect_from_cam, flat.projection, strict=True))
    return [(np.eye(3), np.column_stack([linear_part(camera).matrix, np.zeros(3)])) for camera in cameras]


def _launch(hangs: Mapping[str, tuple[str, Array]]) -> str:
    nodes = "".join(
        "- node:\n    pkg: tf2_ros\n    exec: static_transform_publisher\n"
        f"    name: {child}_broadcaster\n"
        f'    args: "{_arguments(pose)} --frame-id {parent} --child-frame-id {child}"\n'
        for child, (parent, pose) in hangs.items()
    )
    return f"# ros2 launch {LAUNCH}; lengths are in metres\nlaunch:\n{nodes}"


def _arguments(pose: Array) -> str:
    w, *xyz = quaternion_wxyz(pose[:3, :3]).tolist()
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return " ".join(
        f"--{name} {real(value)}" for name, value in zip(names, [*pose[:3, 3].tolist(), *xyz, w], strict=True)
    )


def _urdf(root: str, hangs: Mapping[str, tuple[str, Array]]) -> str:
    joints = "".join(
        f"  <link name={quoteattr(child)}/>\n"
        f'  <joint name={quoteattr(f"{child}_joint")} type="fixed">\n'
        f"    <parent link={quoteattr(parent)}/>\n    <child link={quoteattr(child)}/>\n"
        f'    <origin xyz="{_words(pose[:3, 3].tolist())}" rpy="{_words(roll_pitch_yaw_rad(pose[:3, :3]))}"/>\n'
        "  </joint>\n"
        for child, (parent, pose) in hangs.items()
    )
    return f'<?xml version="1.0"?>\n<robot name="rig">\n  <link name={quoteattr(root)}/>\n{joints}</robot>\n'


def _words(values: Sequence[float]) -> str:
    return " ".join(map(real, values))


RIG_FORMAT = RigFormat(
    title="ROS camera_info and transforms",
    file_name="ros",
    opens_with=f"ros2 launch {{file}}/{LAUNCH}; the .yaml of each camera goes to its driver as camera_info_url",
    cameras=FORMAT,
    unit="m",
    write=write_rig,
    read=read_rig,
    patterns=(f"*{SUFFIX}",),
    needed=(LAUNCH, f"left{SUFFIX}"),
)
