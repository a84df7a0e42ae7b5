"""Azure Kinect's raw calibration, the JSON of `k4a_device_get_raw_calibration`: depth and colour; only read.

ModelParameters are cx cy fx fy k1 ... k6 codx cody p2 p1 of OpenCV's rational lens, in parts of the sensor's sides and
from the image's corner. Pictures of a mode are scaled and cut from the sensor's (mode_specific_calibration.c of its
SDK). `Rt` takes points in metres from the depth camera's frame; light beyond MetricRadius is none, which is not read.
"""

import re
from collections.abc import Mapping

import numpy as np

from calib.cameras.formats.format import CameraFormat, ReadCamera, left_over
from calib.cameras.formats.lens import brown_camera
from calib.cameras.formats.metashape import CORNER
from calib.cameras.formats.opencv import matrix_numbers
from calib.cameras.formats.parsing import json_object, mapping, number, numbers, pick, pose_of, required, shown_plain
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, assembled
from designer.base.arrays import Array
from designer.base.errors import InputError

MODES: Mapping[str, Mapping[str, tuple[tuple[int, int], tuple[int, int], tuple[int, int]]]] = {
    "D0": {
        "depth": ((1024, 1024), (0, 0), (1024, 1024)),
        "depth-wfov-binned": ((512, 512), (0, 0), (512, 512)),
        "depth-nfov": ((1024, 1024), (192, 180), (640, 576)),
        "depth-nfov-binned": ((512, 512), (96, 90), (320, 288)),
    },
    "PV0": {
        "color-3072p": ((4096, 3072), (0, 0), (4096, 3072)),
        "color-2160p": ((3840, 2880), (0, 360), (3840, 2160)),
        "color-1536p": ((2048, 1536), (0, 0), (2048, 1536)),
        "color-1440p": ((2560, 1920), (0, 240), (2560, 1440)),
        "color-1080p": ((1920, 1440), (0, 180), (1920, 1080)),
        "color-720p": ((1280, 960), (0, 120), (1280, 720)),
    },
}
"""Of each camera by its location: the whole picture of a mode, what is cut off left and above, what is left."""
LENS = "CALIBRATION_LensDistortionModelBrownConrady"
SENSOR = ("SensorWidth", "SensorHeight")
TALLER = 3 / 4
"""A colour sensor that is described by 16:9 is this high, with as much more above as below."""


def _entries(text: str, origin: str) -> dict[str, tuple[str, Mapping[str, object]]]:
    """Location and entry of each camera and mode."""
    tree = json_object(text, origin)
    tree = mapping(tree.get("CalibrationInformation", tree), "CalibrationInformation", origin)
    cameras = required(tree, ("Cameras",), origin)
    found = dict[str, tuple[str, Mapping[str, object]]]()
    for one in cameras if isinstance(cameras, list) else []:
        values = mapping(one, "Cameras", origin)
        place = str(values.get("Location")).removeprefix("CALIBRATION_CameraLocation")
        found |= dict.fromkeys(MODES.get(place, {}), (place, values))
    return found


def _camera(mode: str, place: str, values: Mapping[str, object], origin: str) -> ReadCamera:
    inner = mapping(required(values, ("Intrinsics",), origin), "Intrinsics", origin)
    if (said := inner.get("ModelType")) != LENS:
        raise InputError(f"{origin}: ModelType {shown_plain(said)}: not supported; there is {LENS}")
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1 = numbers(
        required(inner, ("ModelParameters",), origin), "ModelParameters", origin, (14,)
    )
    if codx or cody:
        raise InputError(f"{origin}: a centre of distortion of its own, {codx:g}, {cody:g}, is not supported")
    sides = [number(values.get(side), side, origin) for side in SENSOR]
    if min(sides) > 0 and sides[1] / sides[0] < TALLER and place == "PV0":
        cy, fy = ((one * sides[1] + shift) / (TALLER * sides[0])
                  for one, shift in ((cy, (TALLER * sides[0] - sides[1]) / 2), (fy, 0.0)))  # fmt: skip
    (width, height), (left, above), size = MODES[place][mode]
    linear = [fx * width, fy * height, cx * width - left - CORNER, cy * height - above - CORNER]
    return brown_camera(linear, [k1, k2, p1, p2, k3, k4, k5, k6], size, origin)


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera of that mode, such as depth or color-1080p."""
    entries = _entries(text, origin)
    mode = pick({mode: mode for mode in entries}, name, origin)
    values = entries[mode][1]
    return left_over(_camera(mode, *entries[mode], origin), values, "Intrinsics", "Location", "Purpose", "Rt", *SENSOR)


FORMAT = CameraFormat(
    name="azure_kinect",
    title="Azure Kinect calibration",
    file_name="azure_kinect.json",
    recognised=re.compile(r'"CalibrationInformation"\s*:'),
    read=read,
    holds_many=True,
)


def read_rig(files: RigFiles) -> ReadRig:
    """The cameras of all modes, in the depth camera's frame; `--cameras` takes two of them."""
    (text,), origin = files.texts.values(), files.origin
    entries = _entries(text, origin)
    if not entries:
        raise InputError(f"{origin}: holds no camera of a known location, {', '.join(MODES)}")
    found = [_camera(mode, *one, origin) for mode, one in entries.items()]
    return assembled(files, list(entries), found, [_pose(values, files) for _, values in entries.values()], "m")


def _pose(values: Mapping[str, object], files: RigFiles) -> Array:
    place = mapping(required(values, ("Rt",), files.origin), "Rt", files.origin)
    turn = matrix_numbers(required(place, ("Rotation",), files.origin), "Rotation", files.origin, (9,))
    shift = numbers(required(place, ("Translation",), files.origin), "Translation", files.origin, (3,))
    return pose_of(np.reshape(turn, (3, 3)), shift, files.unit, f"{files.origin}: Rt")


RIG_FORMAT = RigFormat(cameras=FORMAT, unit="m", read=read_rig, recognised=FORMAT.recognised)
