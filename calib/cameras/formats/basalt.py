"""Basalt's calibration JSON, of one camera at the IMU's place.

Its types are those of basalt-headers (serialization of its cameras): `ds`, `eucm` and `kb4` have the equations of ours,
`ucm` is `eucm` with beta = 1, `pinhole-radtan8` is OpenCV's rational lens up to the radius `rpmax` from the axis.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import lens_camera, lens_named
from calib.cameras.formats.lens_names import require_agreement
from calib.cameras.formats.parsing import image_size, mapping, number, pick, required, shown_plain
from calib.cameras.parameters import slopes
from calib.cameras.refit import image_grid
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue, parse_json
from designer.base.words import NAME

LENSES = (
    FileLens("pinhole", "pinhole", "fx fy cx cy"),
    FileLens("pinhole-radtan8", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("kb4", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("ds", "ds", "fx fy cx cy xi alpha"),
    FileLens("eucm", "eucm", "fx fy cx cy alpha beta"),
    FileLens("ucm", "eucm", "fx fy cx cy alpha"),
)
"""Its camera types, with their numbers."""
LIMITED = "pinhole-radtan8"
MAX_FILE_BYTES = 2**22
"""A file may hold the vignettes of all cameras."""

_RECOGNISED = re.compile(r'\A\s*\{(?=(?s:.*?)"camera_type")(?s:.*?)"intrinsics"\s*:\s*\[')


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model, with Basalt's usual numbers of an IMU."""
    values: dict[str, JsonValue] = dict(zip(lens.names, lens.values(camera), strict=True))
    if lens.name == LIMITED:
        shown = slopes(camera.rays(image_grid(camera.image_size)))  # in the plane z = 1
        values["rpmax"] = float(np.nanmax(np.linalg.norm(shown, axis=-1)))
    place: dict[str, JsonValue] = {**dict.fromkeys(("px", "py", "pz", "qx", "qy", "qz"), 0.0), "qw": 1.0}
    document: dict[str, JsonValue] = {
        "T_imu_cam": [place],
        "intrinsics": [{"camera_type": lens.name, "intrinsics": values}],
        "resolution": [list(camera.image_size)],
        "calib_accel_bias": [0.0] * 9,
        "calib_gyro_bias": [0.0] * 12,
        "imu_update_rate": 200.0,
        "accel_noise_std": [0.016] * 3,
        "gyro_noise_std": [0.000282] * 3,
        "accel_bias_std": [0.001] * 3,
        "gyro_bias_std": [0.0001] * 3,
        "cam_time_offset_ns": 0,
        "vignette": [],
    }
    return laid_out({"value0": document, "format": f"{NAME}.basalt-json"}) + "\n"  # the last is ours; Basalt skips it


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that number, which counts from 0."""
    tree = mapping(parse_json(text, Path(origin), "a camera file"), "the file", origin)
    values = mapping(tree.get("value0", tree), "value0", origin)
    cameras = required(values, ("intrinsics",), origin)
    sizes = required(values, ("resolution",), origin)
    if not isinstance(cameras, list) or not isinstance(sizes, list) or len(cameras) != len(sizes):
        raise InputError(f"{origin}: intrinsics and resolution must be two lists, with an entry for each camera")
    given, size = pick({str(k): one for k, one in enumerate(zip(cameras, sizes, strict=True))}, name, origin)
    return _camera(mapping(given, "intrinsics", origin), image_size(size, origin), origin)


def _camera(given: Mapping[str, object], size: tuple[int, int], origin: str) -> ReadCamera:
    kind = required(given, ("camera_type",), origin)
    lens = lens_named(LENSES, kind, f"camera_type {shown_plain(kind)}", origin, "in Basalt use one of")
    require_agreement(given, lens.model, origin, "camera_type")
    values = mapping(required(given, ("intrinsics",), origin), "intrinsics", origin)
    found = [number(required(values, (name,), origin), name, origin) for name in lens.names]
    return lens_camera(lens, found, size, origin)


FORMAT = CameraFormat(
    name="basalt",
    title="Basalt calibration",
    file_name="calibration.json",
    opens_with="basalt_vio --cam-calib {file} ...; first put your IMU's place and noise into it",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
    max_bytes=MAX_FILE_BYTES,
)
