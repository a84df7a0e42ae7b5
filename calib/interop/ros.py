"""ROS camera_info files, as `camera_calibration` writes and drivers read them; and printed CameraInfo messages."""

import re
from collections.abc import Sequence

from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, FileLens, ReadCamera
from calib.interop.lens import lens_camera, lens_named
from calib.interop.opencv import linear_part
from calib.interop.parsing import image_size, mapping, numbers, only_keys, parse_yaml, real, required, shown_plain
from designer.base.errors import InputError

LENSES = (
    FileLens("plumb_bob", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("rational_polynomial", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("equidistant", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""Its distortion models (sensor_msgs/distortion_models)."""
SHORTER = {"plumb_bob": (0, 4)}
"""Of these some numbers at the end may be missing."""

COEFFICIENTS = ("distortion_coefficients", "D", "d")
KEYS = (
    *("image_width", "image_height", "camera_matrix", "distortion_model", *COEFFICIENTS),
    *("width", "height", "K", "k"),
)

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

_RECOGNISED = re.compile(r"\A(?=(?s:.*?)^distortion_model\s*:)(?=(?s:.*?)^(?:camera_matrix|K|k)\s*:)", re.MULTILINE)


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
    tree = parse_yaml(only_keys(text, KEYS), origin)
    values = mapping({} if tree is None else tree, "the file", origin)
    size = image_size([required(values, (f"image_{side}", side), origin) for side in ("width", "height")], origin)
    model = values.get("distortion_model", "plumb_bob")
    lens = lens_named(LENSES, model) if isinstance(model, str) else None
    if lens is None:
        hint = f"calibrate with {' or '.join(one.name for one in LENSES)}"
        raise InputError(f"{origin}: distortion_model {shown_plain(model)}: not supported; {hint}")
    matrix = numbers(_data(required(values, ("camera_matrix", "K", "k"), origin)), "camera_matrix", origin, (9,))
    count = len(lens.names) - 4
    counts = (*SHORTER.get(lens.name, ()), count)
    found = numbers(_data(required(values, COEFFICIENTS, origin)), COEFFICIENTS[0], origin, counts)
    return lens_camera(lens, [*linear_part(matrix, origin), *found, *[0.0] * (count - len(found))], size, origin)


def _data(matrix: object) -> object:
    """The numbers of a matrix: under `data` in a file, plain in a printed message."""
    return matrix.get("data") if isinstance(matrix, dict) else matrix


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
