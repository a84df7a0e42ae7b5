"""Luxonis' OAK cameras: the JSON of DepthAI's CalibrationHandler, a camera a socket; lengths are in centimetres.

`distortionCoeff` are OpenCV's 14, of a fisheye the first four. `extrinsics` take points from a camera's frame to that
of the camera at `toCameraSocket` (`getCameraExtrinsics`); `specTranslation`, the design's, stands in where nothing was
measured.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over
from calib.cameras.formats.lens_names import NamedLens
from calib.cameras.formats.opencv import camera_of, matrix_numbers
from calib.cameras.formats.parsing import image_size, json_object, mapping, number, pick, pose_of, required, shown_plain
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import compose, invert
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (
    FileLens("Perspective", "opencv14", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y"),
    FileLens("Fisheye", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""By their numbers as `cameraType`."""
SOCKETS = tuple(f"CAM_{letter}" for letter in "ABCDEFGHIJ")
CAMERAS, NOWHERE, COEFFICIENTS = "cameraData", -1, 14
UNITS = ("m", "cm", "mm")
"""By their numbers as `lengthUnit`."""
CAMERA_KEYS = (
    *("cameraType", "distortionCoeff", "extrinsics", "height", "intrinsicMatrix", "lensPosition", "specHfovDeg"),
    "width",
)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model, at the first socket."""
    return _text([(0, _entry(camera, lens, np.eye(4), NOWHERE))])


def _entry(camera: Camera, lens: FileLens, to_from_cam: Array, to: int) -> dict[str, JsonValue]:
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    shift: JsonValue = dict(zip("xyz", to_from_cam[:3, 3].tolist(), strict=True))
    return {
        "cameraType": LENSES.index(lens),
        "distortionCoeff": list[JsonValue]([*rest, *[0.0] * COEFFICIENTS][:COEFFICIENTS]),
        "extrinsics": {
            "rotationMatrix": to_from_cam[:3, :3].tolist(),
            "specTranslation": shift,
            "toCameraSocket": to,
            "translation": shift,
        },
        "height": height,
        "intrinsicMatrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        "lensPosition": 0,
        "specHfovDeg": 0.0,
        "width": width,
    }


def _text(cameras: Sequence[tuple[int, dict[str, JsonValue]]]) -> str:
    nothing: JsonValue = dict.fromkeys("xyz", 0.0)
    document: dict[str, JsonValue] = {
        **dict.fromkeys(("batchName", "boardConf", "boardCustom", "boardName", "boardRev", "hardwareConf"), ""),
        "batchTime": 0,
        "boardOptions": 0,
        "productName": NAME,
        CAMERAS: [[socket, entry] for socket, entry in cameras],
        "imuExtrinsics": {
            "rotationMatrix": [],
            "specTranslation": nothing,
            "toCameraSocket": NOWHERE,
            "translation": nothing,
        },
        "miscellaneousData": [],
        "stereoRectificationData": {
            "leftCameraSocket": NOWHERE,
            "rectifiedRotationLeft": [],
            "rectifiedRotationRight": [],
            "rightCameraSocket": NOWHERE,
        },
        "version": 7,
        "format": f"{NAME}.depthai-json",  # ours; DepthAI skips it
    }
    return laid_out(document) + "\n"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one at that socket, such as CAM_B."""
    return _camera(pick(_cameras(json_object(text, origin), origin), name, origin), origin)


def _cameras(tree: Mapping[str, object], origin: str) -> dict[str, Mapping[str, object]]:
    """What the file says of each camera with a focal length, by its socket."""
    entries, found = required(tree, (CAMERAS,), origin), dict[str, Mapping[str, object]]()
    for pair in entries if isinstance(entries, list) else []:
        socket, given = pair if isinstance(pair, list) and len(pair) == 2 else (None, None)
        values = mapping(given, CAMERAS, origin)
        matrix = values.get("intrinsicMatrix")
        if isinstance(matrix, list) and any(isinstance(row, list) and any(row) for row in matrix[:2]):
            found[_socket(socket, origin)] = values
    if not found:
        raise InputError(f"{origin}: {CAMERAS} must list sockets with their cameras, and has none with a focal length")
    return found


def _socket(value: object, origin: str) -> str:
    if not isinstance(value, int) or not 0 <= value < len(SOCKETS):
        raise InputError(f"{origin}: camera socket {shown_plain(value)}: must be 0 to {len(SOCKETS) - 1}")
    return SOCKETS[value]


def _camera(values: Mapping[str, object], origin: str) -> ReadCamera:
    kind = values.get("cameraType", 0)
    if not isinstance(kind, int) or not 0 <= kind < len(LENSES):
        known = ", ".join(f"{row} {one.name}" for row, one in enumerate(LENSES))
        raise InputError(f"{origin}: cameraType {shown_plain(kind)}: not supported; there are {known}")
    lens = LENSES[kind]
    size = image_size([number(values.get(side), side, origin) for side in ("width", "height")], origin)
    given = values.get("distortionCoeff")
    if lens.is_wide and isinstance(given, list):
        values = {**values, "distortionCoeff": given[:4]}
    found = camera_of(
        values, ("intrinsicMatrix",), ("distortionCoeff",), size, NamedLens("cameraType", lens.model), origin
    )
    return left_over(found, values, *CAMERA_KEYS)


FORMAT = CameraFormat(
    name="depthai",
    title="DepthAI calibration",
    file_name="oak_calibration.json",
    opens_with='in Python: depthai.CalibrationHandler("{file}"); device.flashCalibration(...) puts it on the OAK',
    recognised=re.compile(rf'"{CAMERAS}"\s*:'),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
)


def sockets(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names where they are sockets, else the first sockets."""
    return names if set(names) <= set(SOCKETS) else SOCKETS[: len(names)]


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for cameras that all stand by the first one."""
    rows = [SOCKETS.index(word) for word in written.words]
    each = zip(rows, written.rig.cameras, written.lenses, invert(written.cam_from_first), strict=True)
    entries = [
        (row, _entry(camera, lens, pose, NOWHERE if row == rows[0] else rows[0])) for row, camera, lens, pose in each
    ]
    return {RIG_FORMAT.file_name: _text(entries)}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a text; its frame is that of the first camera."""
    (text,), origin = files.texts.values(), files.origin
    cameras = _cameras(json_object(text, origin), origin)
    names = list(cameras)
    links = [link for name, values in cameras.items() if (link := _link(name, values, origin)) is not None]
    poses = {names[0]: np.eye(4)}
    for _ in names:  # a camera farther along the chains each time
        for name, to, to_from_cam in links:
            if to in poses and name not in poses:
                poses[name] = compose(invert(to_from_cam), poses[to])
            elif name in poses and to not in poses and to in cameras:
                poses[to] = compose(to_from_cam, poses[name])
    lost = [name for name in names if name not in poses]
    if lost:
        raise InputError(
            f"{origin}: nothing says where {lost[0]} stands to {names[0]}; name one camera, as in FILE#{lost[0]}"
        )
    found = [_camera(values, f"{origin}: {name}") for name, values in cameras.items()]
    return assembled(files, names, found, [poses[name] for name in names], "cm")


def _link(name: str, values: Mapping[str, object], origin: str) -> tuple[str, str, Array] | None:
    """A camera, the one it says its place to, and to_from_cam in mm (4, 4); None: it says none."""
    place = mapping(values.get("extrinsics", {}), "extrinsics", f"{origin}: {name}")
    to = place.get("toCameraSocket", NOWHERE)
    if to == NOWHERE:
        return None
    where = f"{origin}: {name}: extrinsics"
    shifts = [
        [number(mapping(place.get(key, {}), key, where).get(axis, 0.0), f"{key}.{axis}", where) for axis in "xyz"]
        for key in ("translation", "specTranslation")
    ]
    unit = place.get("lengthUnit", UNITS.index("cm"))
    if not isinstance(unit, int) or not 0 <= unit < len(UNITS):
        raise InputError(f"{where}: lengthUnit {shown_plain(unit)}: must be 0 to {len(UNITS) - 1}, {', '.join(UNITS)}")
    turn = matrix_numbers(required(place, ("rotationMatrix",), where), "rotationMatrix", where, (9,))
    shift = shifts[0] if any(shifts[0]) else shifts[1]
    return name, _socket(to, where), pose_of(np.array(turn).reshape(3, 3), shift, UNITS[unit], where)


RIG_FORMAT = RigFormat(
    opens_with=FORMAT.opens_with,
    cameras=FORMAT,
    unit="cm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(rf'"{CAMERAS}"\s*:(?s:.*?)"toCameraSocket"\s*:\s*[0-9]'),
    most=len(SOCKETS),
    keeps_frame=False,
    words=sockets,
)
