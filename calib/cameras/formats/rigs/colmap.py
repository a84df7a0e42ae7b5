"""COLMAP's rigs, since 3.12: `rig_config.json` for `colmap rig_configurator`, `rigs.txt` of a model, and cameras.txt.

Quaternions are `w x y z` and poses sensor_from_rig; the reference sensor's frame is the rig's. Its pixel (0, 0) is the
corner of the image. COLMAP has no unit of length.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from calib.cameras.formats import FORMATS
from calib.cameras.formats.colmap import HEAD, camera_line, read_lines, read_words
from calib.cameras.formats.format import ReadCamera
from calib.cameras.formats.parsing import mapping, number, numbers, real, required
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.formats.rigs.poses import UNIT_WORDS, quaternion_pose, unit_said
from calib.core.se3 import quaternion_wxyz
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue, parse_json
from designer.base.words import NAME, shown

CONFIG, RIGS, CAMERAS = "rig_config.json", "rigs.txt", "cameras.txt"
UNIT = "length_unit"
OURS = f"{NAME}.colmaprig-json"
SHORTEST, SENSOR, WITHOUT_POSE = 4, 10, 3
"""Words of a rig's line before its other sensors, and of each of those, with a pose and without."""


def write(written: WrittenRig) -> Mapping[str, str]:
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
        CONFIG: f"[{laid_out({'cameras': config, UNIT: written.unit, 'format': OURS})}]\n",
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


def read(files: RigFiles) -> ReadRig:
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


FORMAT = RigFormat(
    name="colmap",
    title="COLMAP rig",
    file_name="colmap",
    opens_with="colmap rig_configurator --database_path DATABASE --rig_config_path {file}/rig_config.json",
    cameras=FORMATS["colmap"],
    unit="m",
    write=write,
    read=read,
    recognised=re.compile(r'"cam_from_rig_rotation"|"ref_sensor"|^#\s*RIG_ID, NUM_SENSORS', re.MULTILINE),
    patterns=(CONFIG, RIGS, CAMERAS),
    needed=(CONFIG, RIGS),
    keeps_frame=False,
)
