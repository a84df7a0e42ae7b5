"""COLMAP's cameras.txt, and its cameras.bin, which is read as the text that it stands for.

Its pixel (0, 0) is the corner of the image, so that cx and cy are larger by half a pixel.

Rigs, since 3.12, are `rig_config.json` for `colmap rig_configurator` or `rigs.txt` of a model, with cameras.txt.
Quaternions are `w x y z` and poses sensor_from_rig; the reference sensor's frame is the rig's. COLMAP has no unit of
length.
"""

import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import lens_camera, lens_named
from calib.cameras.formats.parsing import (
    UNIT_WORDS,
    image_size,
    mapping,
    number,
    numbers,
    pick,
    quaternion_pose,
    real,
    required,
    unit_said,
)
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import quaternion_wxyz
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue, parse_json
from designer.base.words import NAME, shown

CORNER = 0.5
"""A position counted from the image's corner, of a pixel whose centre is 0."""

LENSES = (
    FileLens("PINHOLE", "pinhole", "fx fy cx cy"),
    FileLens("OPENCV", "opencv", "fx fy cx cy k1 k2 p1 p2"),
    FileLens("FULL_OPENCV", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("OPENCV_FISHEYE", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("EUCM", "eucm", "fx fy cx cy alpha beta"),
    FileLens("DIVISION", "division", "fx fy cx cy k1"),
    FileLens("THIN_PRISM_FISHEYE", "thin_prism_fisheye", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    FileLens("FISHEYE", "fisheye", "fx fy cx cy"),
    FileLens("SIMPLE_PINHOLE", "pinhole", "f cx cy"),
    FileLens("SIMPLE_RADIAL", "opencv", "f cx cy k1"),
    FileLens("RADIAL", "opencv", "f cx cy k1 k2"),
    FileLens("SIMPLE_FISHEYE", "fisheye", "f cx cy"),
    FileLens("SIMPLE_RADIAL_FISHEYE", "fisheye", "f cx cy k1"),
    FileLens("RADIAL_FISHEYE", "fisheye", "f cx cy k1 k2"),
    FileLens("SIMPLE_DIVISION", "division", "f cx cy k1"),
)
"""Its camera models, with the numbers that it gives them (COLMAP's sensor/models.h)."""

NUMBERED = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"),
    *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"),
    *("SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM"),
)
"""Its camera models by the numbers that binary files have for them."""
COUNTS = {"FOV": 5, "RAD_TAN_THIN_PRISM_FISHEYE": 16} | {lens.name: len(lens.names) for lens in LENSES}
_COUNT, _CAMERA = struct.Struct("<Q"), struct.Struct("<IiQQ")

_RECOGNISED = re.compile(r"^[ \t]*[0-9]+[ \t]+[A-Z][A-Z_0-9]*[ \t]+[0-9]+[ \t]+[0-9]+[ \t]+[-+.0-9]", re.MULTILINE)


HEAD = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    return f"{HEAD}# Number of cameras: 1\n{camera_line('1', camera, lens)}"


def camera_line(number_of: str, camera: Camera, lens: FileLens) -> str:
    """The line of a camera, by its id."""
    width, height = camera.image_size
    fx, fy, cx, cy, *rest = camera.params
    from_corner = replace(camera, params=np.array([fx, fy, cx + CORNER, cy + CORNER, *rest]))
    return f"{number_of} {lens.name} {width} {height} {' '.join(map(real, lens.values(from_corner)))}\n"


def text_of(content: bytes, origin: str) -> str:
    """The cameras.txt of a cameras.bin: a count, then id, model, width, height and parameters of each camera.

    Raises:
        InputError: it is no such file, or cut off.
    """
    lines, place = [], _COUNT.size
    try:
        (count,) = _COUNT.unpack_from(content)
        if count * _CAMERA.size > len(content):
            raise struct.error
        for _ in range(count):
            number_of, model, width, height = _CAMERA.unpack_from(content, place)
            if not 0 <= model < len(NUMBERED):
                raise InputError(f"{origin}: camera {number_of}: its model {model} is none that is known")
            params = struct.unpack_from(f"<{COUNTS[NUMBERED[model]]}d", content, place + _CAMERA.size)
            place += _CAMERA.size + 8 * len(params)
            lines.append(f"{number_of} {NUMBERED[model]} {width} {height} {' '.join(map(repr, params))}\n")
    except struct.error:
        raise InputError(f"{origin}: not a cameras.bin of COLMAP, or cut off; export the model again") from None
    if place != len(content):
        raise InputError(
            f"{origin}: {len(content) - place} bytes after its {count} cameras; not a cameras.bin of COLMAP"
        )
    return f"{HEAD}{''.join(lines)}"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that id."""
    row, words = pick(_lines(text, origin), name, origin)
    return read_words(words, f"{origin}: line {row}")


def read_lines(text: str, origin: str) -> dict[str, ReadCamera]:
    """All cameras in a text, by their ids."""
    return {name: read_words(words, f"{origin}: line {row}") for name, (row, words) in _lines(text, origin).items()}


def _lines(text: str, origin: str) -> dict[str, tuple[int, list[str]]]:
    """Number and words of each camera's line, by its id."""
    lines: dict[str, tuple[int, list[str]]] = {}
    for row, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            if words[0] in lines:
                raise InputError(f"{origin}: line {row}: camera {shown(words[0])} a second time; ids must differ")
            lines[words[0]] = row, words
    return lines


def read_words(words: list[str], origin: str) -> ReadCamera:
    """The camera of a line's words."""
    if len(words) < 4:
        raise InputError(f"{origin}: must be CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
    lens = lens_named(LENSES, words[1], f"camera model {shown(words[1])}", origin, "in COLMAP use one of")
    if len(words) != 4 + len(lens.names):
        raise InputError(
            f"{origin}: {lens.name} has {len(words) - 4} parameters; it must have {len(lens.names)}: {lens.numbers}"
        )
    size = image_size(words[2:4], origin)
    values = [number(word, name, origin) for name, word in zip(lens.names, words[4:], strict=True)]
    from_corner = [
        value - CORNER if name in ("cx", "cy") else value for name, value in zip(lens.names, values, strict=True)
    ]
    return lens_camera(lens, from_corner, size, origin)


FORMAT = CameraFormat(
    name="colmap",
    title="COLMAP cameras.txt",
    file_name="cameras.txt",
    opens_with="beside images.txt and points3D.txt in a model folder; or its numbers after "
    "colmap feature_extractor --ImageReader.camera_params",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    decode=text_of,
    holds_many=True,
)


CONFIG, RIGS, CAMERAS = "rig_config.json", "rigs.txt", "cameras.txt"
UNIT = "length_unit"
OWN_FORMAT = f"{NAME}.colmaprig-json"
SHORTEST, SENSOR, WITHOUT_POSE = 4, 10, 3
"""Words of a rig's line before its other sensors, and of each of those, with a pose and without."""


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The texts for a rig: photos of camera NAME are in the folder NAME, as the configuration says."""
    each = zip(written.rig.cameras, written.lenses, strict=True)
    lines = [camera_line(str(row), camera, lens) for row, (camera, lens) in enumerate(each, start=1)]
    poses = [[*quaternion_wxyz(pose[:3, :3]).tolist(), *pose[:3, 3].tolist()] for pose in written.cam_from_first]
    sensors = "".join(f" CAMERA {row} 1 {' '.join(map(real, pose))}" for row, pose in enumerate(poses[1:], start=2))
    config: list[JsonValue] = [
        _configured(row, word, line.split(), pose)
        for row, (word, line, pose) in enumerate(zip(written.words, lines, poses, strict=True))
    ]
    return {
        CONFIG: f"[{laid_out({'cameras': config, UNIT: written.unit, 'format': OWN_FORMAT})}]\n",
        RIGS: "# RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[]\n"
        f"# Lengths are in {UNIT_WORDS[written.unit]}\n1 {len(lines)} CAMERA 1{sensors}\n",
        CAMERAS: f"{HEAD}# Number of cameras: {len(lines)}\n{''.join(lines)}",
    }


def _configured(row: int, word: str, line: Sequence[str], pose: Sequence[float]) -> JsonValue:
    """A camera of the configuration, from its line in cameras.txt; the first is the reference."""
    _, model, _, _, *params = line
    place: dict[str, JsonValue] = {"ref_sensor": True}
    if row:
        place = {"cam_from_rig_rotation": [*pose[:4]], "cam_from_rig_translation": [*pose[4:]]}
    return {
        "image_prefix": f"{word}/",
        **place,
        "camera_model_name": model,
        "camera_params": [float(value) for value in params],
    }


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a configuration with the cameras.txt beside it, or of a model's rigs.txt with its cameras.txt."""
    if CAMERAS not in files.texts:
        raise InputError(f"{files.origin}: {CAMERAS} is missing, which has the cameras' image sizes")
    lines = read_lines(files.texts[CAMERAS], files.origin_of(CAMERAS))
    return _of_config(files, lines) if CONFIG in files.texts else _of_model(files, lines)


def _of_config(files: RigFiles, lines: Mapping[str, ReadCamera]) -> ReadRig:
    """A configuration's cameras are in the order of cameras.txt, as COLMAP imports folders."""
    origin = files.origin_of(CONFIG)
    document = parse_json(files.texts[CONFIG], Path(origin), "a rig configuration")
    if not isinstance(document, list) or len(document) != 1:
        count = len(document) if isinstance(document, list) else 0
        raise InputError(f"{origin}: must be a list of one rig; it holds {count}; leave the one to read")
    values = mapping(document[0], "a rig", origin)
    cameras = required(values, ("cameras",), origin)
    if not isinstance(cameras, list) or len(cameras) != len(lines):
        count = len(cameras) if isinstance(cameras, list) else 0
        raise InputError(f"{origin}: has {count} cameras, and {CAMERAS} {len(lines)}; as many each, in one order")
    unit = unit_said(values.get(UNIT), origin)
    entries = [mapping(one, "a camera", origin) for one in cameras]
    names = [str(one.get("image_prefix", row)).strip("/") or str(row) for row, one in enumerate(entries)]
    poses = [
        _config_pose(one, unit or files.unit, f"{origin}: {shown(name)}")
        for name, one in zip(names, entries, strict=True)
    ]
    found = [_config_camera(one, line, origin) for one, line in zip(entries, lines.values(), strict=True)]
    return assembled(files, names, found, poses, unit)


def _config_camera(values: Mapping[str, object], line: ReadCamera, origin: str) -> ReadCamera:
    """The camera of a configuration that has its parameters, with the image of its line; else that of the line."""
    model, params = values.get("camera_model_name"), values.get("camera_params")
    if not isinstance(model, str) or not isinstance(params, list):
        return line
    return read_words(["1", model, *map(str, line.camera.image_size), *map(str, params)], origin)


def _config_pose(values: Mapping[str, object], unit: str, origin: str) -> Array:
    if values.get("ref_sensor") is True:
        return np.eye(4)
    turn = numbers(required(values, ("cam_from_rig_rotation",), origin), "cam_from_rig_rotation", origin, (4,))
    shift = numbers(required(values, ("cam_from_rig_translation",), origin), "cam_from_rig_translation", origin, (3,))
    return quaternion_pose(turn, shift, unit, origin)


def _of_model(files: RigFiles, lines: Mapping[str, ReadCamera]) -> ReadRig:
    """The first rig of a model that has several sensors, named by their camera ids."""
    origin = files.origin_of(RIGS)
    rows = [line.split("#", 1)[0].split() for line in files.texts[RIGS].splitlines()]
    rigs = [words for words in rows if len(words) > SHORTEST and words[2] == "CAMERA"]
    if len(rigs) != 1:
        raise InputError(f"{origin}: holds {len(rigs)} rigs of several cameras; leave the one to read")
    names, poses, remarks, words = [rigs[0][3]], [np.eye(4)], [], rigs[0][SHORTEST:]
    while words:
        size = SENSOR if words[2:3] == ["1"] else WITHOUT_POSE
        if len(words) < size or words[0] != "CAMERA" or (size == WITHOUT_POSE and words[2] != "0"):
            raise InputError(f"{origin}: a sensor must be CAMERA ID 1 QW QX QY QZ TX TY TZ, or CAMERA ID 0")
        if size == WITHOUT_POSE:
            remarks.append(f"camera {words[1]} has no pose, so it is left out")
        else:
            values = [number(word, "a pose", origin) for word in words[3:size]]
            names.append(words[1])
            poses.append(quaternion_pose(values[:4], values[4:], files.unit, f"{origin}: camera {shown(words[1])}"))
        words = words[size:]
    without = [name for name in names if name not in lines]
    if without:
        raise InputError(f"{origin}: camera {shown(without[0])} is not in {CAMERAS}")
    return assembled(files, names, [lines[name] for name in names], poses, remarks=remarks)


RIG_FORMAT = RigFormat(
    title="COLMAP rig",
    file_name="colmap",
    opens_with="colmap rig_configurator --database_path DATABASE --rig_config_path {file}/rig_config.json",
    cameras=FORMAT,
    unit="m",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(r'"cam_from_rig_rotation"|"ref_sensor"|^#\s*RIG_ID, NUM_SENSORS', re.MULTILINE),
    patterns=(CONFIG, RIGS, CAMERAS),
    needed=(CONFIG, RIGS),
    keeps_frame=False,
    has_own_unit=False,
)
