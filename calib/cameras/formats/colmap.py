"""COLMAP's cameras.txt, and its cameras.bin, which is read as the text that it stands for.

Its pixel (0, 0) is the corner of the image, so that cx and cy are larger by half a pixel.
"""

import re
import struct
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import lens_camera, lens_named
from calib.cameras.formats.parsing import image_size, number, pick, real
from designer.base.errors import InputError
from designer.base.words import shown

CORNER = 0.5
"""A position counted from the image's corner, of a pixel whose centre is 0."""

LENSES = (
    FileLens("PINHOLE", "pinhole", "fx fy cx cy"),
    FileLens("OPENCV", "opencv", "fx fy cx cy k1 k2 p1 p2"),
    FileLens("FULL_OPENCV", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("OPENCV_FISHEYE", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
    FileLens("EUCM", "eucm", "fx fy cx cy alpha beta"),
    FileLens("DIVISION", "division", "fx fy cx cy k1"),
    FileLens("THIN_PRISM_FISHEYE", "thin_prism_fisheye", "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1"),
    FileLens("FISHEYE", "fisheye", "fx fy cx cy"),
    FileLens("SIMPLE_PINHOLE", "pinhole", "f cx cy"),
    FileLens("SIMPLE_RADIAL", "opencv", "f cx cy k1"),
    FileLens("RADIAL", "opencv", "f cx cy k1 k2"),
    FileLens("SIMPLE_FISHEYE", "fisheye", "f cx cy"),
    FileLens("SIMPLE_RADIAL_FISHEYE", "fisheye", "f cx cy k1"),
    FileLens("RADIAL_FISHEYE", "fisheye", "f cx cy k1 k2"),
    FileLens("SIMPLE_DIVISION", "division", "f cx cy k1"),
)
"""Its camera models, with the numbers that it gives them (COLMAP's sensor/models.h)."""

NUMBERED = (
    *("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV"),
    *("SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE"),
    *("SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM"),
)
"""Its camera models by the numbers that binary files have for them."""
COUNTS = {"FOV": 5, "RAD_TAN_THIN_PRISM_FISHEYE": 16} | {lens.name: len(lens.names) for lens in LENSES}
_COUNT, _CAMERA = struct.Struct("<Q"), struct.Struct("<IiQQ")

_RECOGNISED = re.compile(r"^\s*[0-9]+[ \t]+[A-Z][A-Z_0-9]*[ \t]+[0-9]+[ \t]+[0-9]+[ \t]+[-+.0-9]", re.MULTILINE)


HEAD = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    return f"{HEAD}# Number of cameras: 1\n{camera_line('1', camera, lens)}"


def camera_line(number_of: str, camera: Camera, lens: FileLens) -> str:
    """The line of a camera, by its id."""
    width, height = camera.image_size
    fx, fy, cx, cy, *rest = camera.params
    from_corner = replace(camera, params=np.array([fx, fy, cx + CORNER, cy + CORNER, *rest]))
    return f"{number_of} {lens.name} {width} {height} {' '.join(map(real, lens.values(from_corner)))}\n"


def text_of(content: bytes, origin: str) -> str:
    """The cameras.txt of a cameras.bin: a count, then id, model, width, height and parameters of each camera.

    Raises:
        InputError: it is no such file, or cut off.
    """
    lines, place = [], _COUNT.size
    try:
        (count,) = _COUNT.unpack_from(content)
        if count * _CAMERA.size > len(content):
            raise struct.error
        for _ in range(count):
            number_of, model, width, height = _CAMERA.unpack_from(content, place)
            if not 0 <= model < len(NUMBERED):
                raise InputError(f"{origin}: camera {number_of}: its model {model} is none that is known")
            params = struct.unpack_from(f"<{COUNTS[NUMBERED[model]]}d", content, place + _CAMERA.size)
            place += _CAMERA.size + 8 * len(params)
            lines.append(f"{number_of} {NUMBERED[model]} {width} {height} {' '.join(map(repr, params))}\n")
    except struct.error:
        raise InputError(f"{origin}: not a cameras.bin of COLMAP, or cut off; export the model again") from None
    if place != len(content):
        raise InputError(
            f"{origin}: {len(content) - place} bytes after its {count} cameras; not a cameras.bin of COLMAP"
        )
    return f"{HEAD}{''.join(lines)}"


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that id."""
    row, words = pick(_lines(text, origin), name, origin)
    return read_words(words, f"{origin}: line {row}")


def read_lines(text: str, origin: str) -> dict[str, ReadCamera]:
    """All cameras in a text, by their ids."""
    return {name: read_words(words, f"{origin}: line {row}") for name, (row, words) in _lines(text, origin).items()}


def _lines(text: str, origin: str) -> dict[str, tuple[int, list[str]]]:
    """Number and words of each camera's line, by its id."""
    lines: dict[str, tuple[int, list[str]]] = {}
    for row, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            if words[0] in lines:
                raise InputError(f"{origin}: line {row}: camera {shown(words[0])} a second time; ids must differ")
            lines[words[0]] = row, words
    return lines


def read_words(words: list[str], origin: str) -> ReadCamera:
    """The camera of a line's words."""
    if len(words) < 4:
        raise InputError(f"{origin}: must be CAMERA_ID MODEL WIDTH HEIGHT PARAMS")
    lens = lens_named(LENSES, words[1])
    if lens is None:
        known = ", ".join(one.name for one in LENSES if one.is_written)
        raise InputError(f"{origin}: camera model {shown(words[1])}: not supported; in COLMAP use one of {known}")
    if len(words) != 4 + len(lens.names):
        raise InputError(
            f"{origin}: {lens.name} has {len(words) - 4} parameters; it must have {len(lens.names)}: {lens.numbers}"
        )
    size = image_size(words[2:4], origin)
    values = [number(word, name, origin) for name, word in zip(lens.names, words[4:], strict=True)]
    from_corner = [
        value - CORNER if name in ("cx", "cy") else value for name, value in zip(lens.names, values, strict=True)
    ]
    return lens_camera(lens, from_corner, size, origin)


FORMAT = CameraFormat(
    name="colmap",
    title="COLMAP cameras.txt",
    file_name="cameras.txt",
    opens_with="beside images.txt and points3D.txt in a model folder; or its numbers after "
    "colmap feature_extractor --ImageReader.camera_params",
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
)
