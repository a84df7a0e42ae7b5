"""TOML files of motion-capture programs: a table for each camera, with OpenCV's matrix and lens and its pose.

The pose is that of OpenCV, from the world to the camera: a rotation vector in rad, or a matrix, and a shift. Anipose's
calibration.toml, which aniposelib and programs around it read, has its lengths in the unit of the board that it was
calibrated with, which the file does not say.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats import FORMATS
from calib.cameras.formats.format import FileLens, ReadCamera
from calib.cameras.formats.lens_names import named_lens
from calib.cameras.formats.opencv import COUNTS, WIDE, camera_by_name, data_of, linear_part, matrix_numbers
from calib.cameras.formats.parsing import image_size, mapping, matrix_pose, real, required, unit_said, vector_pose
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import log_rotation
from designer.base.arrays import Array
from designer.base.errors import InputError

LENSES = tuple(lens for lens in FORMATS["opencv"].lenses if lens.name in ("standard", "fisheye"))
"""What both programs take: of OpenCV's lenses the one with five numbers, and the fisheye's."""


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


def read_camera_table(
    given: object, unit: str, origin: str, common: Mapping[str, object] | None = None
) -> tuple[ReadCamera, Array]:
    """The camera of a table, and its pose from the world in mm (4, 4); `common` tables may name the lens too."""
    values = mapping(given, "a camera", origin)
    size = image_size(required(values, ("size",), origin), origin)
    linear, skew = linear_part(matrix_numbers(required(values, ("matrix",), origin), "matrix", origin, (9,)), origin)
    lens = data_of(required(values, ("distortions",), origin), "distortions", origin)
    named = named_lens({**(common or {}), **values}, origin)
    camera = camera_by_name(linear, skew, lens, "distortions", COUNTS, size, named, origin)
    return camera, _pose(values, unit, origin)


def _pose(values: Mapping[str, object], unit: str, origin: str) -> Array:
    shift = matrix_numbers(required(values, ("translation",), origin), "translation", origin, (3,))
    turn = matrix_numbers(required(values, ("rotation",), origin), "rotation", origin, (3, 9))
    if len(turn) == 9:
        rows = np.column_stack([np.array(turn).reshape(3, 3), shift]).tolist()
        return matrix_pose(rows, "rotation", unit, origin)
    return vector_pose(turn, shift, unit, origin)


METADATA, UNIT = "metadata", "length_unit"


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a rig."""
    each = zip(written.words, written.rig.cameras, written.lenses, written.cam_from_rig, strict=True)
    tables = (
        f'[cam_{row}]\nname = "{word}"\n{camera_lines(camera, lens, pose)}\n'
        for row, (word, camera, lens, pose) in enumerate(each)
    )
    return {RIG_FORMAT.file_name: f'{"".join(tables)}[{METADATA}]\n{UNIT} = "{written.unit}"\n'}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a text; a camera is called what it says, or else as its table."""
    (text,), origin = files.texts.values(), files.origin
    tables = parse_toml(text, origin)
    cameras = {key: one for key, one in tables.items() if isinstance(one, dict) and "matrix" in one}
    if not cameras:
        raise InputError(f"{origin}: holds no camera")
    metadata = tables.get(METADATA)
    unit = unit_said(metadata.get(UNIT) if isinstance(metadata, dict) else None, origin)
    common = {key: one for key, one in tables.items() if key not in cameras}
    both = [read_camera_table(one, unit or files.unit, f"{origin}: {key}", common) for key, one in cameras.items()]
    names = [str(one.get("name", key)) for key, one in cameras.items()]
    return assembled(files, names, [one for one, _ in both], [pose for _, pose in both], unit)


RIG_FORMAT = RigFormat(
    name="anipose",
    file_name="calibration.toml",
    opens_with='in Python: aniposelib.cameras.CameraGroup.load("{file}")',
    cameras=replace(FORMATS["opencv"], title="Anipose calibration", lenses=LENSES),
    unit="mm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(r"\A(?=(?s:.*?)^matrix\s*=)(?=(?s:.*?)^rotation\s*=)(?!(?s:.*?)^\[cameras\.)", re.MULTILINE),
    has_own_unit=False,
)
