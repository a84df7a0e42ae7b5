"""MATLAB's cameras as structs in a MAT file of version 5 to 7: cameraParameters, cameraIntrinsics, fisheye and stereo.

Objects are not read; `s = toStruct(cameraParams)` makes a struct of one. Pixels are counted from 1. `IntrinsicMatrix`
is K transposed, `RotationOfCamera2` R transposed, as MATLAB multiplied rows; ImageSize is rows, columns. The lens is
OpenCV's of k1 k2 k3 and p1 p2. A fisheye's is Scaramuzza's polynomial without its linear term (its documentation).

As a text, which all but the first and the last step work with, such a file is JSON: its structs' numbers by name.
"""

import json
import re
import struct
import zlib
from collections.abc import Mapping
from io import BytesIO

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens_names import NamedLens
from calib.cameras.formats.ocamcalib import polynomial_camera
from calib.cameras.formats.opencv import camera_by_name, linear_part, matrix_numbers
from calib.cameras.formats.parsing import image_size, json_object, mapping, pick, pose_of, required
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from designer.base.errors import InputError
from designer.base.file_kind import laid_out
from designer.base.files import JsonValue
from designer.base.words import NAME

LENSES = (FileLens("cameraParameters", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),)
FIRST = 1.0
"""The position of the first pixel's centre."""
VARIABLE, STEREO, FISHEYE = "cameraParams", "stereoParams", "MappingCoefficients"
CAMERAS = ("CameraParameters1", "CameraParameters2")
UNITS = {"m": "m", "meters": "m", "cm": "cm", "centimeters": "cm", "mm": "mm", "millimeters": "mm"}
HEADER, MOST_BYTES, MOST_NUMBERS, DEEPEST = 128, 2**24, 64, 12
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy's types by MATLAB's numbers for what is stored."""
MATRIX, COMPRESSED, STRUCT, TEXT, OBJECT, OF_NUMBERS = 14, 15, 2, 4, 17, range(6, 16)


def encode(text: str) -> bytes:
    """The MAT file of a text."""
    from scipy.io import savemat

    content = BytesIO()
    savemat(content, {name: _arrays(value) for name, value in json.loads(text)["matlab"].items()})
    return f"MATLAB 5.0 MAT-file, {NAME} camera".ljust(116).encode() + content.getvalue()[116:]


def _arrays(value: JsonValue) -> object:
    if isinstance(value, dict):
        return {key: _arrays(one) for key, one in value.items()}
    return value if isinstance(value, str) else np.atleast_2d(np.array(value, dtype=np.float64))


def decode(content: bytes, origin: str) -> str:
    """The text of a MAT file.

    Raises:
        InputError: it is no such file, or of version 7.3, or cut off.
    """
    if content.startswith(b"MATLAB 7.3"):
        raise InputError(f'{origin}: a MAT file of version 7.3; in MATLAB save(..., "-v7")')
    if len(content) < HEADER or content[126:128] not in (b"IM", b"MI"):
        raise InputError(f"{origin}: not a MAT file of MATLAB 5 to 7")
    reader = _MatReader("<" if content[126:128] == b"IM" else ">", MOST_BYTES)
    try:
        variables = dict(reader.variables(content[HEADER:]))
    except (struct.error, ValueError, zlib.error, KeyError, RecursionError):
        raise InputError(f"{origin}: a MAT file that is cut off or damaged; save it again") from None
    return json.dumps({"matlab": variables})


class _MatReader:
    """Elements, each a type, a length and so many bytes; what is compressed, up to a length in all."""

    def __init__(self, order: str, left: int) -> None:
        self.order, self.left = order, left

    def elements(self, data: bytes) -> "list[tuple[int, bytes]]":
        found, at = [], 0
        while at + 8 <= len(data):
            kind, length = struct.unpack_from(f"{self.order}2I", data, at)
            start, ends = at + 8, at + 8 + (length if kind == COMPRESSED else -(-length // 8) * 8)
            if kind >> 16:  # small: the length stands above the type, four bytes follow
                kind, length, start, ends = kind & 0xFFFF, kind >> 16, at + 4, at + 8
            if start + length > len(data):
                raise ValueError
            found.append((kind, data[start : start + length]))
            at = ends
        return found

    def variables(self, data: bytes, depth: int = 0) -> "list[tuple[str, JsonValue]]":
        if depth > DEEPEST:
            raise RecursionError
        found = []
        for kind, part in self.elements(data):
            if kind == COMPRESSED:
                opened = zlib.decompressobj()
                whole = opened.decompress(part, self.left)
                self.left -= len(whole)
                if self.left <= 0:
                    raise ValueError
                found += self.variables(whole, depth + 1)
            elif kind == MATRIX:
                found.append(self.matrix(part, depth))
        return found

    def matrix(self, data: bytes, depth: int) -> "tuple[str, JsonValue]":
        """Name and value: numbers row by row, a text, a struct's fields; of anything else what it is."""
        parts = self.elements(data)
        if len(parts) < 3:  # an empty one, or an object, which has other parts
            return "", "(object)"
        of = parts[0][1][0 if self.order == "<" else 3]
        name, shape = parts[1 if of == OBJECT else 2][1].decode("ascii"), list(map(int, self.numbers(*parts[1])))
        if of in OF_NUMBERS and len(parts) > 3 and len(shape) == 2 and np.prod(shape) <= MOST_NUMBERS:
            return name, np.array(self.numbers(*parts[3]), dtype=float).reshape(shape, order="F").tolist()
        if of == TEXT and len(parts) > 3:
            return name, "".join(chr(int(one)) for one in self.numbers(*parts[3])[:MOST_NUMBERS])
        if of == STRUCT and len(parts) > 4 and shape == [1, 1]:
            each, (_, names) = int(self.numbers(*parts[3])[0]), parts[4]
            keys = [names[at : at + each].split(b"\0")[0].decode("ascii") for at in range(0, len(names), max(each, 1))]
            values = [self.matrix(part, depth + 1)[1] for _, part in parts[5:]] if depth < DEEPEST else []
            return name, dict(zip(keys, values, strict=False))
        return name, "(object)" if of not in OF_NUMBERS else None

    def numbers(self, kind: int, data: bytes) -> "list[float]":
        if kind == 16:  # UTF-8
            return list(map(float, data))
        values: list[float] = np.frombuffer(data, f"{self.order}{NUMBERS[kind]}").tolist()
        return values


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model."""
    return laid_out({"matlab": {VARIABLE: _struct(camera, lens)}}) + "\n"


def _struct(camera: Camera, lens: FileLens) -> JsonValue:
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lens.values(camera)
    matrix = np.array([[fx, 0, cx + FIRST], [0, fy, cy + FIRST], [0, 0, 1]])
    return {
        "RadialDistortion": [k1, k2, k3],
        "TangentialDistortion": [p1, p2],
        "ImageSize": list(camera.image_size[::-1]),
        "FocalLength": [fx, fy],
        "PrincipalPoint": [cx + FIRST, cy + FIRST],
        "Skew": 0.0,
        "K": matrix.tolist(),
        "IntrinsicMatrix": matrix.T.tolist(),
    }


def _variables(text: str, origin: str) -> Mapping[str, object]:
    variables = mapping(required(json_object(text, origin), ("matlab",), origin), "the file", origin)
    for name, value in variables.items():
        if value == "(object)":
            what = name or "what it holds"
            raise InputError(f"{origin}: {what} is an object of MATLAB's; save s = toStruct({name or '...'})")
    return {"": variables, **variables}  # save(..., "-struct") leaves a struct's fields alone


def read(text: str, origin: str, name: str | None = None) -> ReadCamera:
    """The camera in a text, or the one of that variable; a pair's are called by their fields."""
    found = dict[str, Mapping[str, object]]()
    for key, value in _variables(text, origin).items():
        inner = {key: value} | ({one: value[one] for one in CAMERAS if one in value} if isinstance(value, dict) else {})
        found |= {
            one or VARIABLE: fields
            for one, fields in inner.items()
            if isinstance(fields, dict) and {"RadialDistortion", FISHEYE, "Intrinsics"} & fields.keys()
        }
    return _camera(pick(found, name, origin), origin)


def _camera(given: object, origin: str) -> ReadCamera:
    values = mapping(given, "a camera", origin)
    if isinstance(values.get("Intrinsics"), dict):
        values = mapping(values["Intrinsics"], "Intrinsics", origin)
    height, width = matrix_numbers(required(values, ("ImageSize",), origin), "ImageSize", origin, (2,))
    size = image_size([width, height], origin)
    if FISHEYE in values:
        a0, a2, a3, a4 = matrix_numbers(values[FISHEYE], FISHEYE, origin, (4,))
        c, d, e, _ = matrix_numbers(required(values, ("StretchMatrix",), origin), "StretchMatrix", origin, (4,))
        u, v = matrix_numbers(required(values, ("DistortionCenter",), origin), "DistortionCenter", origin, (2,))
        return polynomial_camera([a0, 0.0, a2, a3, a4], (c, d, e), (u - FIRST, v - FIRST), size, origin)
    key = "K" if "K" in values else "IntrinsicMatrix"
    matrix = np.reshape(matrix_numbers(required(values, (key,), origin), key, origin, (9,)), (3, 3))
    (fx, fy, cx, cy), skew = linear_part((matrix if key == "K" else matrix.T).ravel().tolist(), origin)
    k1, k2, *k3 = matrix_numbers(required(values, ("RadialDistortion",), origin), "RadialDistortion", origin, (2, 3))
    tangential = values.get("TangentialDistortion", [0.0, 0.0])
    p1, p2 = matrix_numbers(tangential, "TangentialDistortion", origin, (2,))
    lens, named = [k1, k2, p1, p2, *k3], NamedLens("RadialDistortion", LENSES[0].model)
    return camera_by_name([fx, fy, cx - FIRST, cy - FIRST], skew, lens, "RadialDistortion", (4, 5), size, named, origin)


_OPEN = (
    "s.{0}; cameraIntrinsics(c.FocalLength, c.PrincipalPoint, c.ImageSize, RadialDistortion=c.RadialDistortion, "
    "TangentialDistortion=c.TangentialDistortion)"
)
FORMAT = CameraFormat(
    name="matlab",
    title="MATLAB camera",
    file_name="camera.mat",
    opens_with='in MATLAB: s = load("{file}"); c = ' + _OPEN.format(VARIABLE),
    recognised=re.compile(r'\A\s*\{\s*"matlab"\s*:'),
    lenses=LENSES,
    write=write,
    read=read,
    holds_many=True,
    max_bytes=MOST_BYTES,
    encode=encode,
    decode=decode,
)


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a pair."""
    each = zip(CAMERAS, written.rig.cameras, written.lenses, strict=True)
    pose = written.cam_from_first[1]
    pair: dict[str, JsonValue] = {name: _struct(camera, lens) for name, camera, lens in each}
    pair |= {"RotationOfCamera2": pose[:3, :3].T.tolist(), "TranslationOfCamera2": pose[:3, 3].tolist()}
    return {RIG_FORMAT.file_name: laid_out({"matlab": {STEREO: {**pair, "WorldUnits": written.unit}}}) + "\n"}


def read_rig(files: RigFiles) -> ReadRig:
    """The pair of a text; its frame is the first camera's."""
    (text,), origin = files.texts.values(), files.origin
    pairs = [one for one in _variables(text, origin).values() if isinstance(one, dict) and set(CAMERAS) <= one.keys()]
    if len(pairs) != 1:
        raise InputError(f"{origin}: must hold one struct of a stereoParameters, and has {len(pairs)}")
    values = mapping(pairs[0], STEREO, origin)
    said = str(values.get("WorldUnits", mapping(values[CAMERAS[0]], CAMERAS[0], origin).get("WorldUnits")))
    pose = values.get("PoseCamera2")
    if isinstance(pose, dict) and "A" in pose:
        rows = np.reshape(matrix_numbers(pose["A"], "PoseCamera2.A", origin, (16,)), (4, 4))
        turn, shift = rows[:3, :3], rows[:3, 3].tolist()
    else:
        key = "RotationOfCamera2"
        turn = np.reshape(matrix_numbers(required(values, (key,), origin), key, origin, (9,)), (3, 3)).T
        key = "TranslationOfCamera2"
        shift = matrix_numbers(required(values, (key,), origin), key, origin, (3,))
    unit = UNITS.get(said)
    found = [_camera(values[name], f"{origin}: {name}") for name in CAMERAS]
    return assembled(files, CAMERAS, found, [np.eye(4), pose_of(turn, shift, unit or files.unit, origin)], unit)


RIG_FORMAT = RigFormat(
    title="MATLAB stereo cameras",
    file_name="stereo.mat",
    opens_with='in MATLAB: s = load("{file}"); c = ' + _OPEN.format(f"{STEREO}.{CAMERAS[0]}"),
    cameras=FORMAT,
    unit="mm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(rf'\A\s*\{{\s*"matlab"\s*:(?s:.*?)"{CAMERAS[1]}"'),
    fewest=2,
    most=2,
    keeps_frame=False,
    words=lambda _: CAMERAS,
    has_own_unit=False,
)
