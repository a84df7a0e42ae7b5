"""PhotonVision's calibrations: JSON with OpenCV's matrix and coefficients, one for each resolution of a camera.

The keys are those of its class CameraCalibrationCoefficients; files of before 2024 call the coefficients
`cameraExtrinsics`, and name no lens. It has as many coefficients as mrcal's OPENCV models up to 8.
"""

import re
from collections.abc import Mapping

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, left_over
from calib.cameras.formats.lens_names import NamedLens
from calib.cameras.formats.opencv import camera_of
from calib.cameras.formats.parsing import image_size, json_object, mapping, number, pick, required, shown_plain
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (
    FileLens("LENSMODEL_OPENCV", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("LENSMODEL_OPENCV8", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
)
"""The file says LENSMODEL_OPENCV for both; their numbers tell which."""
MATRIX, COEFFICIENTS = "cameraIntrinsics", ("distCoeffs", "cameraExtrinsics")
USED = (MATRIX, *COEFFICIENTS, "resolution", "lensmodel", "calobjectWarp", "calobjectSize", "calobjectSpacing")
ALL = "calibrations"
CV_64F = 6
MAX_FILE_BYTES = 2**26
"""Older files hold the photos, too."""


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = map(float, camera.image_size)
    document: dict[str, JsonValue] = {
        "resolution": {"width": width, "height": height},
        MATRIX: {"rows": 3, "cols": 3, "type": CV_64F, "data": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]},
        COEFFICIENTS[0]: {"rows": 1, "cols": len(rest), "type": CV_64F, "data": list(rest)},
        "calobjectWarp": [0.0, 0.0],
        "observations": [],
        "calobjectSize": {"width": 0.0, "height": 0.0},
        "calobjectSpacing": 0.0,
        "lensmodel": LENSES[0].name,
        "format": f"{NAME}.photonvision-json",  # ours; PhotonVision skips it
    }
    return laid_out(document) + "\n"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or of a camera's settings the one of that resolution, such as 1280x720."""
    tree = json_object(text, origin)
    each = tree.get(ALL, [tree])
    if not isinstance(each, list):
        raise InputError(f"{origin}: {ALL} must be a list")
    values = [mapping(one, ALL, origin) for one in each]
    return _camera(pick({_resolution(one, origin): one for one in values}, name, origin), origin)


def _resolution(values: Mapping[str, object], origin: str) -> str:
    width, height = _size(values, origin)
    return f"{width}x{height}"


def _size(values: Mapping[str, object], origin: str) -> tuple[int, int]:
    size = mapping(required(values, ("resolution",), origin), "resolution", origin)
    return image_size([number(size.get(side), side, origin) for side in ("width", "height")], origin)


def _camera(values: Mapping[str, object], origin: str) -> ReadCamera:
    said = values.get("lensmodel") or LENSES[0].name
    if said != LENSES[0].name:
        raise InputError(f"{origin}: lensmodel {shown_plain(said)}: not supported; there is {LENSES[0].name}")
    named = NamedLens(f"lensmodel is {said}", LENSES[0].model)
    found = camera_of(values, (MATRIX,), COEFFICIENTS, _size(values, origin), named, origin)
    return left_over(found, values, *USED)


FORMAT = CameraFormat(
    name="photonvision",
    title="PhotonVision calibration",
    file_name="photon_calibration.json",
    opens_with="in PhotonVision: Cameras, Camera Calibration, Import from file",
    recognised=re.compile(rf'"{MATRIX}"\s*:'),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
    max_bytes=MAX_FILE_BYTES,
)
