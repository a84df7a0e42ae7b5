"""OpenCV's YAML files, as `cv2.FileStorage` writes and reads them."""

import re
from collections.abc import Mapping, Sequence

from calib.cameras.camera import Camera
from calib.interop.format import CameraFormat, FileLens, ReadCamera
from calib.interop.lens import brown_camera, lens_camera
from calib.interop.parsing import image_size, mapping, numbers, only_keys, parse_yaml, real, required
from designer.base.errors import InputError

MATRIX = ("camera_matrix", "cameraMatrix", "K")
LENS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D")
SIZE = ("image_size", "imageSize", "image_width", "image_height", "width", "height")
FISHEYE = "fisheye_model"
LENSES = (
    FileLens("standard", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("rational", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("thin_prism", "opencv12", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"),
    FileLens("fisheye", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""What its functions of calib3d take, by the names of their flags; those of `cv2.fisheye` are the last."""
WIDE = LENSES[-1]
COUNTS = (4, 5, 8, 12, 14)
TILT = slice(12, 14)
MAX_FILE_BYTES = 2**22
"""A file may hold all image points of a calibration."""

_RECOGNISED = re.compile(rf"^(?:{'|'.join(MATRIX)})\s*:|!!opencv-matrix", re.MULTILINE)


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    width, height = camera.image_size
    matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    return (
        f"%YAML:1.0\n---\nimage_width: {width}\nimage_height: {height}\n{FISHEYE}: {int(lens == WIDE)}\n"
        f"camera_matrix: {matrix_text(3, 3, matrix)}"
        f"distortion_coefficients: {matrix_text(1, len(rest), rest)}"
    )


def matrix_text(rows: int, columns: int, values: Sequence[float]) -> str:
    """The lines of a matrix, after its name."""
    data = ", ".join(map(real, values))
    return f"!!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    tree = parse_yaml(only_keys(text, (*MATRIX, *LENS, *SIZE, FISHEYE)), origin)
    values = mapping({} if tree is None else tree, "the file", origin)
    return camera_of(values, MATRIX, LENS, size_of(values, origin), origin)


def camera_of(
    values: Mapping[str, object], matrix: Sequence[str], lenses: Sequence[str], size: tuple[int, int], origin: str
) -> ReadCamera:
    """The camera whose matrix and lens are called so."""
    linear = linear_part(numbers(data_of(required(values, matrix, origin)), matrix[0], origin, (9,)), origin)
    lens = numbers(data_of(required(values, lenses, origin)), lenses[0], origin, (0, *COUNTS))
    if any(lens[TILT]):
        raise InputError(f"{origin}: a tilted sensor (tau) is not supported; calibrate without CALIB_TILTED_MODEL")
    if values.get(FISHEYE) not in (None, "", "0", "false"):
        if len(lens) != len(WIDE.names) - len(linear):
            raise InputError(f"{origin}: {lenses[0]} has {len(lens)} numbers; those of a fisheye lens are k1 k2 k3 k4")
        return lens_camera(WIDE, [*linear, *lens], size, origin)
    return brown_camera(linear, lens[: TILT.start], size, origin)


def size_of(values: Mapping[str, object], origin: str) -> tuple[int, int]:
    """Width and height, however they are said."""
    both = values.get("image_size", values.get("imageSize"))
    if both is not None:
        return image_size(both, origin)
    hint = "; add image_width and image_height, in pixels"
    return image_size([required(values, (f"image_{side}", side), origin, hint) for side in ("width", "height")], origin)


def data_of(matrix: object) -> object:
    """The numbers of a matrix: under `data`, or a plain list."""
    return matrix.get("data") if isinstance(matrix, dict) else matrix


def linear_part(matrix: list[float], origin: str) -> list[float]:
    """Values fx fy cx cy of a camera matrix, row by row."""
    fx, skew, cx, zero, fy, cy, *last = matrix
    if [zero, *last] != [0.0, 0.0, 0.0, 1.0]:
        raise InputError(f"{origin}: not a camera matrix: it must be fx 0 cx, 0 fy cy, 0 0 1, row by row")
    if skew:
        raise InputError(
            f"{origin}: camera matrix with skew {skew:g}: not supported; calibrate with rectangular pixels"
        )
    return [fx, fy, cx, cy]


FORMAT = CameraFormat(
    name="opencv",
    title="OpenCV YAML",
    file_name="camera.yaml",
    opens_with='in Python: file = cv2.FileStorage("{file}", cv2.FILE_STORAGE_READ); '
    'file.getNode("camera_matrix").mat(); '
    "where fisheye_model is 1 the functions of cv2.fisheye take it",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    max_bytes=MAX_FILE_BYTES,
)
