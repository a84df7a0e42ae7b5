"""OpenCV's YAML and JSON files, as `cv2.FileStorage` writes and reads them or a Python program dumps matrices.

A stereo pair is one such file: `x2 = R x1 + T` takes points from the first camera's frame to the second's,
`x2^T E x1 = 0`, F is E of pixels, and R1 R2 P1 P2 Q rectify, as cv2.stereoCalibrate and cv2.stereoRectify return them.
OpenCV has no unit of length: P2, Q and points from disparities are in that of T; `length_unit` says it, which OpenCV
skips.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import QUICK_OF_OPENCV, SKEWED, brown_camera, fit_foreign, lens_camera
from calib.cameras.formats.lens_names import NamedLens, mentions_lens, named_lens, names_lens
from calib.cameras.formats.parsing import (
    image_size,
    make_camera,
    number,
    numbers,
    parse_tree,
    pose_of,
    real,
    required,
    unit_said,
)
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.rig import rectified_pair
from calib.core.se3 import exp_rotation, skew
from designer.base.arrays import Array
from designer.base.errors import InputError

MATRIX = ("camera_matrix", "cameraMatrix", "K", "mtx", "camera_mtx", "intrinsic_matrix")
LENS = (
    *("distortion_coefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "distortion_coeffs", "D", "dist"),
    "distortion",
)
SIZE = ("image_size", "imageSize", "image_width", "image_height", "width", "height")
FISHEYE = "fisheye_model"
LENSES = (
    FileLens("standard", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("rational", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("thin_prism", "opencv12", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"),
    FileLens("tilted", "opencv14", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y"),
    FileLens("fisheye", "fisheye", "fx fy cx cy k1 k2 k3 k4"),
)
"""What its functions of calib3d take, by the names of their flags; those of `cv2.fisheye` are the last."""
WIDE = LENSES[-1]
MOST_NUMBERS = 20
COUNTS = (0, 4, 5, 8, 12, 14)
FISHEYES = (4,)
NO_SKEW_PX = 1e-6
"""A skew that moves no pixel by more is rounding."""
MAX_FILE_BYTES = 2**22
"""A file may hold all image points of a calibration."""

_RECOGNISED = re.compile(rf"^[\"']?(?:{'|'.join(MATRIX)})[\"']?\s*:|!!opencv-matrix", re.MULTILINE)


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
    values = parse_tree(text, (*MATRIX, *LENS, *SIZE), mentions_lens, origin)
    return camera_of(values, MATRIX, LENS, size_of(values, origin), named_lens(values, origin), origin)


def camera_of(
    values: Mapping[str, object],
    matrix: Sequence[str],
    lenses: Sequence[str],
    size: tuple[int, int],
    named: NamedLens | None,
    origin: str,
) -> ReadCamera:
    """The camera whose matrix and lens are called so, and whose lens is named so."""
    linear, skew = linear_part(matrix_numbers(required(values, matrix, origin), matrix[0], origin, (9,)), origin)
    lens = data_of(required(values, lenses, origin), lenses[0], origin)
    return camera_by_name(linear, skew, lens, lenses[0], COUNTS, size, named, origin)


def camera_by_name(
    linear: Sequence[float],
    skew: float,
    given: object,
    name: str,
    counts: Sequence[int],
    size: tuple[int, int],
    named: NamedLens | None,
    origin: str,
) -> ReadCamera:
    """The camera of a linear part and of coefficients, which are called `name`: Brown's, unless a fisheye is named.

    Raises:
        InputError: other numbers than such a lens has, or another lens is named.
    """
    is_fisheye = named is not None and named.model == WIDE.model
    if named is not None and not (is_fisheye or named.is_brown):
        raise InputError(f"{origin}: {named.said}: not supported; there are {', '.join(one.name for one in LENSES)}")
    lens = coefficients(given, name, origin, FISHEYES if is_fisheye else counts, is_fisheye=is_fisheye)
    if named is not None and named.is_without and any(lens):
        raise InputError(f"{origin}: {named.said}, but {name} is not zero; leave the one that is right")
    if is_fisheye:
        found = lens_camera(WIDE, [*linear, *lens], size, origin)
    else:
        found = brown_camera(linear, lens, size, origin)
    if abs(skew) * size[1] > NO_SKEW_PX * linear[1]:
        found = _skewed(found.camera, skew, origin)
    return replace(found, remarks=(*found.remarks, *_doubts(lens, name, named)))


def _doubts(lens: Sequence[float], name: str, named: NamedLens | None) -> tuple[str, ...]:
    """How four numbers are taken that may be those of either lens."""
    remarks = () if named is None else named.remarks
    if len(lens) not in FISHEYES or not any(lens) or (named is not None and named.is_certain):
        return remarks
    return (
        *remarks,
        f"{name} has four numbers, and no lens is named: taken as k1 k2 p1 p2; "
        "if they are k1 k2 k3 k4 of a fisheye, add distortion_model: equidistant",
    )


def _skewed(camera: Camera, skew: float, origin: str) -> ReadCamera:
    """The camera that shows, right of a camera's pixels, as much more as they are below the centre; or the nearest."""
    if camera.model in SKEWED:
        return ReadCamera(make_camera(SKEWED[camera.model], [*camera.params.tolist(), skew], camera.image_size, origin))
    _, fy, _, cy = linear = camera.params[:4].tolist()

    def rays(pixel: Array) -> Array:
        return camera.rays(np.column_stack([pixel[:, 0] - skew * (pixel[:, 1] - cy) / fy, pixel[:, 1]]))

    models = None if camera.model == WIDE.model else QUICK_OF_OPENCV
    return fit_foreign(rays, linear, camera.image_size, f"its lens with skew {skew:g} px", origin, models)


def coefficients(
    given: object, name: str, origin: str, counts: Sequence[int], *, is_fisheye: bool = False
) -> list[float]:
    """Numbers of a lens, as many as one of `counts` says; zeros at the end are none."""
    if not isinstance(given, list | tuple) or len(given) > MOST_NUMBERS:
        return numbers(given, name, origin, counts)
    values = numbers(given, name, origin, (len(given),))
    count = len(values)
    while count not in counts and count and not values[count - 1]:
        count -= 1
    if count not in counts:
        what = "; those of a fisheye lens are k1 k2 k3 k4" if is_fisheye else ""
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{origin}: {name} has {len(values)} numbers; it must have {wanted}{what}")
    return values[:count]


def size_of(values: Mapping[str, object], origin: str) -> tuple[int, int]:
    """Width and height, however they are said."""
    both = values.get("image_size", values.get("imageSize"))
    if both is not None:
        return image_size(both, origin)
    hint = "; add image_width and image_height, in pixels"
    return image_size([required(values, (f"image_{side}", side), origin, hint) for side in ("width", "height")], origin)


def matrix_numbers(matrix: object, name: str, origin: str, counts: Sequence[int]) -> list[float]:
    """The numbers of a matrix, as many as one of `counts` says."""
    return numbers(data_of(matrix, name, origin), name, origin, counts)


def data_of(matrix: object, name: str, origin: str) -> object:
    """The numbers of a matrix, row by row: under `data`, a plain list, or a list of rows.

    Raises:
        InputError: they are not as many as the matrix says.
    """
    values = matrix.get("data") if isinstance(matrix, dict) else matrix
    rows = values if isinstance(values, list) and all(isinstance(row, list) for row in values) else []
    if rows and max(len(rows), *map(len, rows)) <= MOST_NUMBERS:
        values = [value for row in rows for value in row]
    if isinstance(matrix, dict) and isinstance(values, list) and {"rows", "cols"} <= matrix.keys():
        count = number(matrix["rows"], f"{name}.rows", origin) * number(matrix["cols"], f"{name}.cols", origin)
        if count != len(values):
            raise InputError(f"{origin}: {name} has {len(values)} numbers; by its rows and cols it must have {count:g}")
    return values


def linear_part(matrix: list[float], origin: str) -> tuple[list[float], float]:
    """Values fx fy cx cy of a camera matrix, row by row, and its skew."""
    fx, skew, cx, zero, fy, cy, *last = matrix
    if [zero, *last] != [0.0, 0.0, 0.0, 1.0]:
        raise InputError(f"{origin}: not a camera matrix: it must be fx 0 cx, 0 fy cy, 0 0 1, row by row")
    return [fx, fy, cx, cy], skew


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


UNIT, SECOND_SIZE = "length_unit", "image_size_2"
WIDES = (FISHEYE, f"{FISHEYE}_2")
NAMES = ("camera_1", "camera_2")

ELSEWHERE = "; if it stands in another file, such as extrinsics.yml, copy it from there"


def _both(*names: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the first camera's and the second's are called."""
    first, second = (tuple(name.format(row) for name in names) for row in (1, 2))
    return first, second


MATRICES = _both("K{}", "M{}", "cameraMatrix{}", "camera_matrix_{}", "camera_matrix{}", "mtx{}")
DISTORTIONS = _both("D{}", "distCoeffs{}", "dist_coeffs{}", "dist_coeffs_{}", "distortion_coefficients_{}", "dist{}")
ROTATION, SHIFT = ("R", "rotation_matrix"), ("T", "translation_vector", "t")
KEYS = (*chain(*MATRICES, *DISTORTIONS, ROTATION, SHIFT, SIZE, NAMES, WIDES), UNIT, SECOND_SIZE)


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a pair; the rectification is left out where the two see nothing alike."""
    cameras, pose = written.rig.cameras, written.cam_from_first[1]
    matrices: list[tuple[str, Array]] = []
    for row, (camera, lens) in enumerate(zip(cameras, written.lenses, strict=True), start=1):
        matrices += [(f"K{row}", camera.matrix), (f"D{row}", np.array([lens.values(camera)[4:]]))]
    essential = skew(pose[:3, 3]) @ pose[:3, :3]
    fundamental = np.linalg.inv(cameras[1].matrix).T @ essential @ np.linalg.inv(cameras[0].matrix)
    if fundamental[2, 2]:
        fundamental = fundamental / fundamental[2, 2]
    matrices += [("R", pose[:3, :3]), ("T", pose[:3, 3:]), ("E", essential), ("F", fundamental)]
    flat = rectified_pair(cameras, pose)
    if flat is not None:
        matrices += zip(("R1", "R2", "P1", "P2"), (*flat.rect_from_cam, *flat.projection), strict=True)
        matrices.append(("Q", flat.point_from_disparity))
    return {RIG_FORMAT.file_name: _text(written, matrices)}


def _text(written: WrittenRig, matrices: Sequence[tuple[str, Array]]) -> str:
    sizes = [camera.image_size for camera in written.rig.cameras]
    lines = [f"image_width: {sizes[0][0]}", f"image_height: {sizes[0][1]}"]
    if sizes[1] != sizes[0]:
        lines += [f"{SECOND_SIZE}: [ {sizes[1][0]}, {sizes[1][1]} ]"]
    lines += [f"{key}: {int(lens == WIDE)}" for key, lens in zip(WIDES, written.lenses, strict=True)]
    names = (f'{key}: "{word}"' for key, word in zip(NAMES, written.words, strict=True))
    lines += [*names, f"{UNIT}: {written.unit}"]
    body = (f"{name}: {matrix_text(len(value), value.shape[1], value.ravel().tolist())}" for name, value in matrices)
    head = "".join(f"{line}\n" for line in lines)
    return f"%YAML:1.0\n---\n{head}{''.join(body)}"


def read_rig(files: RigFiles) -> ReadRig:
    """The pair of a text; its frame is the first camera's."""
    (text,), origin = files.texts.values(), files.origin
    values = parse_tree(text, KEYS, mentions_lens, origin)
    size = size_of(values, origin)
    second = values.get(SECOND_SIZE)
    sizes = (size, size if second is None else image_size(second, origin))
    each = zip(MATRICES, DISTORTIONS, sizes, "12", strict=True)
    found = [
        camera_of(values, matrix, lens, one, named_lens(_of_camera(values, row), origin), origin)
        for matrix, lens, one, row in each
    ]
    unit = unit_said(values.get(UNIT), origin)
    turn = matrix_numbers(required(values, ROTATION, origin, ELSEWHERE), "R", origin, (9, 3))
    shift = matrix_numbers(required(values, SHIFT, origin, ELSEWHERE), "T", origin, (3,))
    whole = np.array(turn).reshape(3, 3) if len(turn) == 9 else exp_rotation(np.array(turn))
    pose = pose_of(whole, shift, unit or files.unit, f"{origin}: R")
    names = [str(values.get(key) or key) for key in NAMES]
    return assembled(files, names, found, [np.eye(4), pose], unit)


def _of_camera(values: Mapping[str, object], row: str) -> Mapping[str, object]:
    """What is said of one of the two cameras: by keys that end in its number, or else in none."""
    lens = [key for key in values if names_lens(key)]
    own = [key for key in lens if key.endswith(row)]
    others = [key for key in lens if key[-1] in "12" and key not in own]
    left_out = {*others, *((key for key in lens if key not in own) if own else ())}
    return {key: value for key, value in values.items() if key not in left_out}


RIG_FORMAT = RigFormat(
    title="OpenCV stereo YAML",
    file_name="stereo.yaml",
    opens_with='in Python: file = cv2.FileStorage("{file}", cv2.FILE_STORAGE_READ); file.getNode("P1").mat(); '
    "where fisheye_model (of the second fisheye_model_2) is 1 the functions of cv2.fisheye take it",
    cameras=FORMAT,
    unit="mm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(rf"^[\"']?(?:{'|'.join(MATRICES[1])})[\"']?\s*:", re.MULTILINE),
    fewest=2,
    most=2,
    keeps_frame=False,
    has_own_unit=False,
)
