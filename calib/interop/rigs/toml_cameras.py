"""TOML files of motion-capture programs: a table for each camera, with OpenCV's matrix and lens and its pose.

The pose is that of OpenCV, from the world to the camera: a rotation vector in rad, or a matrix, and a shift.
"""

import tomllib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import log_rotation
from calib.interop import FORMATS
from calib.interop.format import FileLens, ReadCamera
from calib.interop.lens import brown_camera, lens_camera
from calib.interop.opencv import WIDE, linear_part
from calib.interop.parsing import image_size, mapping, numbers, real, required
from calib.interop.rigs.poses import matrix_pose, vector_pose
from designer.base.errors import InputError

Array = NDArray[np.float64]

LENSES = tuple(lens for lens in FORMATS["opencv"].lenses if lens.name in ("standard", "fisheye"))
"""What both programs take: of OpenCV's lenses the one with five numbers, and the fisheye's."""
COUNTS = (0, 4, 5, 8, 12)


def camera_lines(camera: Camera, lens: FileLens, pose: Array) -> str:
    """The lines for a camera of a lens's model, with its pose (4, 4) in the file's unit."""
    fx, fy, cx, cy, *rest = lens.values(camera)
    matrix = ", ".join(_row(row) for row in ([fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]))
    width, height = camera.image_size
    return (
        f"size = [{width}, {height}]\n"
        f"matrix = [{matrix}]\n"
        f"distortions = {_row(rest)}\n"
        f"rotation = {_row(log_rotation(pose[:3, :3]).tolist())}\n"
        f"translation = {_row(pose[:3, 3].tolist())}\n"
        f"fisheye = {'true' if lens == WIDE else 'false'}\n"
    )


def _row(values: list[float]) -> str:
    return f"[{', '.join(map(real, values))}]"


def parse_toml(text: str, origin: str) -> Mapping[str, object]:
    """The tables of a text."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{origin}: {' '.join(str(error).split())[:120]}; not valid TOML") from None
    except (RecursionError, ValueError, OverflowError):
        raise InputError(f"{origin}: nested too deep, or a number too long; not a file of cameras") from None


def read_camera_table(given: object, unit: str, origin: str) -> tuple[ReadCamera, Array]:
    """The camera of a table, and its pose from the world in mm (4, 4)."""
    values = mapping(given, "a camera", origin)
    size = image_size(required(values, ("size",), origin), origin)
    rows = required(values, ("matrix",), origin)
    if not isinstance(rows, list) or len(rows) != 3:
        raise InputError(f"{origin}: matrix must be 3 x 3, row by row")
    entries = [one for index, row in enumerate(rows) for one in numbers(row, f"matrix[{index}]", origin, (3,))]
    linear = linear_part(entries, origin)
    lens = numbers(_flat(required(values, ("distortions",), origin)), "distortions", origin, COUNTS)
    if values.get("fisheye") is True:
        if len(lens) != len(WIDE.names) - len(linear):
            raise InputError(f"{origin}: distortions has {len(lens)} numbers; those of a fisheye lens are k1 k2 k3 k4")
        camera = lens_camera(WIDE, [*linear, *lens], size, origin)
    else:
        camera = brown_camera(linear, lens, size, origin)
    return camera, _pose(values, unit, origin)


def _pose(values: Mapping[str, object], unit: str, origin: str) -> Array:
    shift = numbers(_flat(required(values, ("translation",), origin)), "translation", origin, (3,))
    turn = required(values, ("rotation",), origin)
    if isinstance(turn, list) and len(turn) == 3 and all(isinstance(row, list) and len(row) == 3 for row in turn):
        return matrix_pose([[*row, one] for row, one in zip(turn, shift, strict=True)], "rotation", unit, origin)
    return vector_pose(numbers(_flat(turn), "rotation", origin, (3,)), shift, unit, origin)


def _flat(value: object) -> object:
    """A column or a row of numbers as a list."""
    if isinstance(value, list) and value and all(isinstance(one, list) and len(one) == 1 for one in value):
        return [one[0] for one in value]
    return value[0] if isinstance(value, list) and len(value) == 1 and isinstance(value[0], list) else value
