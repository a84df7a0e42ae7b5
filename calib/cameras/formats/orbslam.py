"""ORB-SLAM3's settings: the camera's lines of its YAML, of one camera or of a pair; older files of one, too.

`Camera.type` holds for both cameras. `Stereo.T_c1_c2`, in older files `Tlr`, takes points from the second camera to the
first, in metres (its Calibration_Tutorial and Settings.cc); a rectified pair has one camera and `Stereo.b` between.
"""

import re
from collections.abc import Mapping

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over
from calib.cameras.formats.lens import lens_camera, lens_named
from calib.cameras.formats.opencv import matrix_numbers, matrix_text
from calib.cameras.formats.parsing import (
    image_size,
    mapping,
    matrix_pose,
    number,
    parse_yaml,
    pick,
    real,
    required,
    shift_mm,
    shown_plain,
)
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import invert, make_pose
from designer.base.arrays import Array
from designer.base.errors import InputError

LENSES = (
    FileLens("PinHole", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("KannalaBrandt8", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
RECTIFIED = FileLens("Rectified", "pinhole", "fx fy cx cy")
POSE, OLD_POSE, BASELINE = "Stereo.T_c1_c2", "Tlr", "Stereo.b"
NAMES = ("Camera1", "Camera2")
USED = re.compile(
    rf"Camera[12]?\.(?:{'|'.join({*LENSES[0].names, *LENSES[1].names})})|Camera\.(?:type|width|height|new\w+|RGB|fps)"
    r"|Camera[12]\.overlapping\w+|File\.version|Stereo\.\w+|Tlr|(?:ORBextractor|Viewer|System|loopClosing)\b.*"
)


def write(camera: Camera, lens: FileLens) -> str:
    """The lines for a camera of the lens's model."""
    return _head(camera, lens) + _lines(NAMES[0], camera, lens)


def _head(camera: Camera, lens: FileLens) -> str:
    width, height = camera.image_size
    return (
        f'%YAML:1.0\n---\nFile.version: "1.0"\nCamera.type: "{lens.name}"\n'
        f"Camera.width: {width}\nCamera.height: {height}\nCamera.fps: 30\nCamera.RGB: 1\n"
    )


def _lines(name: str, camera: Camera, lens: FileLens) -> str:
    pairs = zip(lens.names, lens.values(camera), strict=True)
    return "".join(f"{name}.{key}: {real(value)}\n" for key, value in pairs)


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or Camera1 or Camera2 of a pair."""
    values = mapping(parse_yaml(text, origin), "the file", origin)
    wanted = pick({key: key for key in _names(values)}, name, origin)
    rest = {key: one for key, one in values.items() if not USED.fullmatch(key)}
    return left_over(_camera(values, wanted, origin), rest)


def _names(values: Mapping[str, object]) -> tuple[str, ...]:
    """What lines of a camera begin with; in older files the first camera has no number."""
    found = tuple(name for name in NAMES if f"{name}.fx" in values)
    return ("Camera", *found) if "Camera.fx" in values and NAMES[0] not in found else found


def _camera(values: Mapping[str, object], name: str, origin: str) -> ReadCamera:
    said = values.get("Camera.type", LENSES[0].name)
    lens = lens_named((*LENSES, RECTIFIED), said, f"Camera.type {shown_plain(said)}", origin)
    size = image_size([required(values, (f"Camera.{side}",), origin) for side in ("width", "height")], origin)
    needed = lens.names if lens.is_wide else lens.names[:4]
    each = [
        number(required(values, (f"{name}.{key}",), origin) if key in needed else values.get(f"{name}.{key}", 0.0),
               f"{name}.{key}", origin)
        for key in lens.names
    ]  # fmt: skip
    return lens_camera(lens, each, size, origin)


FORMAT = CameraFormat(
    name="orbslam",
    title="ORB-SLAM3 settings",
    file_name="orbslam3.yaml",
    opens_with="mono_euroc Vocabulary/ORBvoc.txt {file} ...; first put these lines in place of its example's",
    recognised=re.compile(r"^Camera[12]?\.fx\s*:", re.MULTILINE),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
)


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The lines for a pair, whose cameras have one image size and one kind of lens."""
    (first, second), lenses = written.rig.cameras, written.lenses
    if first.image_size != second.image_size or lenses[0] != lenses[1]:
        each = " and ".join(
            f"{lens.name} of {camera.image_size[0]} x {camera.image_size[1]} px"
            for camera, lens in zip((first, second), lenses, strict=True)
        )
        raise InputError(f"ORB-SLAM3 has one Camera.type and one image size for both cameras, here are {each}")
    pose = invert(written.cam_from_first[1])
    overlap = "".join(
        f"{name}.overlappingBegin: 0\n{name}.overlappingEnd: {first.image_size[0] - 1}\n"
        for name in NAMES
        if lenses[0].is_wide
    )
    cameras = "".join(_lines(*one) for one in zip(NAMES, written.rig.cameras, lenses, strict=True))
    stereo = f"Stereo.ThDepth: 60.0\n{POSE}: {matrix_text(4, 4, pose.ravel().tolist())}"
    return {RIG_FORMAT.file_name: _head(first, lenses[0]) + cameras + overlap + stereo}


def read_rig(files: RigFiles) -> ReadRig:
    """The pair of a text; its frame is the first camera's."""
    (text,), origin = files.texts.values(), files.origin
    values = mapping(parse_yaml(text, origin), "the file", origin)
    names = _names(values)
    if BASELINE in values and POSE not in values and names:
        names = (names[0], names[0])  # a rectified pair: one camera, twice
    if len(names) != len(NAMES):
        raise InputError(f"{origin}: must hold {NAMES[0]} and {NAMES[1]}, and has {', '.join(names) or 'none'}")
    rest = {key: one for key, one in values.items() if not USED.fullmatch(key)}
    found = [_camera(values, name, origin) for name in names]
    found[0] = left_over(found[0], rest)
    return assembled(files, NAMES, found, [np.eye(4), _second(values, files)], "m")


def _second(values: Mapping[str, object], files: RigFiles) -> Array:
    """The second camera from the first, in mm (4, 4)."""
    if BASELINE in values and POSE not in values:
        baseline = number(values[BASELINE], BASELINE, files.origin)
        return make_pose(np.eye(3), shift_mm([-baseline, 0.0, 0.0], files.unit, files.origin))
    matrix = matrix_numbers(required(values, (POSE, OLD_POSE), files.origin), POSE, files.origin, (12, 16))
    return invert(matrix_pose(np.reshape(matrix, (-1, 4)).tolist(), POSE, files.unit, files.origin))


RIG_FORMAT = RigFormat(
    opens_with="stereo_euroc Vocabulary/ORBvoc.txt {file} ..., with these lines in place of its example's; as released "
    "it takes the first camera's distortion for both, so mend camera2DistortionCoef of its Settings.h",
    cameras=FORMAT,
    unit="m",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(rf"^(?:{re.escape(POSE)}|{OLD_POSE}|{re.escape(BASELINE)})\s*:", re.MULTILINE),
    fewest=2,
    most=2,
    keeps_frame=False,
    words=lambda _: NAMES,
)
