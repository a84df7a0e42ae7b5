"""ROS camera_info files, as `camera_calibration` writes and drivers read them; and printed CameraInfo messages."""

import re

from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, ReadCamera
from calib.interop.lens import brown_camera
from calib.interop.opencv import linear_part
from calib.interop.parsing import image_size, mapping, numbers, only_keys, parse_yaml, real, required, shown_plain
from designer.base.errors import InputError

BROWN = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8,)}
"""Lens models that can be read, and how many coefficients they may have."""

KEYS = (
    *("image_width", "image_height", "camera_matrix", "distortion_model", "distortion_coefficients"),
    *("width", "height", "K", "k", "D", "d"),
)

_RECOGNISED = re.compile(r"\A(?=(?s:.*?)^distortion_model\s*:)(?=(?s:.*?)^(?:camera_matrix|K|k)\s*:)", re.MULTILINE)


def write(camera: Camera) -> str:
    """The text for a camera of model `opencv` or `pinhole`; rectified images keep its focal lengths and centre."""
    fx, fy, cx, cy, *lens = camera.params.tolist()
    width, height = camera.image_size
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: camera\n"
        f"camera_matrix:{_matrix(3, 3, [fx, 0, cx, 0, fy, cy, 0, 0, 1])}"
        "distortion_model: plumb_bob\n"
        f"distortion_coefficients:{_matrix(1, 5, lens or [0.0] * 5)}"
        f"rectification_matrix:{_matrix(3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1])}"
        f"projection_matrix:{_matrix(3, 4, [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0])}"
    )


def _matrix(rows: int, columns: int, values: list[float]) -> str:
    return f"\n  rows: {rows}\n  cols: {columns}\n  data: [{', '.join(map(real, values))}]\n"


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    tree = parse_yaml(only_keys(text, KEYS), origin)
    values = mapping({} if tree is None else tree, "the file", origin)
    size = image_size([required(values, (f"image_{side}", side), origin) for side in ("width", "height")], origin)
    model = values.get("distortion_model", "plumb_bob")
    if not isinstance(model, str) or model not in BROWN:
        hint = "calibrate with plumb_bob or rational_polynomial"
        raise InputError(f"{origin}: distortion_model {shown_plain(model)}: not supported; {hint}")
    matrix = numbers(_data(required(values, ("camera_matrix", "K", "k"), origin)), "camera_matrix", origin, (9,))
    lens = _data(required(values, ("distortion_coefficients", "D", "d"), origin))
    coefficients = numbers(lens, "distortion_coefficients", origin, BROWN[model])
    return brown_camera(linear_part(matrix, origin), coefficients, size, origin)


def _data(matrix: object) -> object:
    """The numbers of a matrix: under `data` in a file, plain in a printed message."""
    return matrix.get("data") if isinstance(matrix, dict) else matrix


FORMAT = CameraFormat(
    name="ros",
    title="ROS camera_info",
    file_name="camera_info.yaml",
    opens_with="in the camera driver's parameters: camera_info_url: {url}",
    recognised=_RECOGNISED,
    write=write,
    read=read,
)
