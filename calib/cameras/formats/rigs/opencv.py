"""A stereo pair as OpenCV's functions have it, in one YAML file of `cv2.FileStorage`.

`x2 = R x1 + T` takes points from the first camera's frame to the second's, `x2^T E x1 = 0`, F is E of pixels, and R1 R2
P1 P2 Q rectify, as cv2.stereoCalibrate and cv2.stereoRectify return them. OpenCV has no unit of length: P2, Q and
points from disparities are in that of T; `length_unit` says it, which OpenCV skips.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from calib.cameras.formats import FORMATS
from calib.cameras.formats.lens_names import mentions_lens, named_lens, names_lens
from calib.cameras.formats.opencv import FISHEYE, SIZE, WIDE, camera_of, matrix_numbers, matrix_text, size_of
from calib.cameras.formats.parsing import image_size, parse_tree, required
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.formats.rigs.poses import pose_of, unit_said
from calib.cameras.rectification import rectified_pair
from calib.core.se3 import exp_rotation, skew
from designer.base.arrays import Array

UNIT, SECOND_SIZE = "length_unit", "image_size_2"
WIDES = (FISHEYE, f"{FISHEYE}_2")
NAMES = ("camera_1", "camera_2")

ELSEWHERE = "; if it stands in another file, such as extrinsics.yml, copy it from there"


def _both(*names: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the first camera's and the second's are called."""
    first, second = (tuple(name.format(row) for name in names) for row in (1, 2))
    return first, second


MATRICES = _both("K{}", "M{}", "cameraMatrix{}", "camera_matrix_{}", "camera_matrix{}", "mtx{}")
LENSES = _both("D{}", "distCoeffs{}", "dist_coeffs{}", "dist_coeffs_{}", "distortion_coefficients_{}", "dist{}")
ROTATION, SHIFT = ("R", "rotation_matrix"), ("T", "translation_vector", "t")
KEYS = (*MATRICES[0], *MATRICES[1], *LENSES[0], *LENSES[1], *ROTATION, *SHIFT, *SIZE, *NAMES, *WIDES, UNIT, SECOND_SIZE)


def write(written: WrittenRig) -> Mapping[str, str]:
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
    return {FORMAT.file_name: _text(written, matrices)}


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


def read(files: RigFiles) -> ReadRig:
    """The pair of a text; its frame is the first camera's."""
    (text,), origin = files.texts.values(), files.origin
    values = parse_tree(text, KEYS, mentions_lens, origin)
    size = size_of(values, origin)
    second = values.get(SECOND_SIZE)
    sizes = (size, size if second is None else image_size(second, origin))
    each = zip(MATRICES, LENSES, sizes, "12", strict=True)
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


FORMAT = RigFormat(
    name="opencv",
    title="OpenCV stereo YAML",
    file_name="stereo.yaml",
    opens_with='in Python: file = cv2.FileStorage("{file}", cv2.FILE_STORAGE_READ); file.getNode("P1").mat(); '
    "where fisheye_model (of the second fisheye_model_2) is 1 the functions of cv2.fisheye take it",
    cameras=FORMATS["opencv"],
    unit="mm",
    write=write,
    read=read,
    recognised=re.compile(rf"^[\"']?(?:{'|'.join(MATRICES[1])})[\"']?\s*:", re.MULTILINE),
    fewest=2,
    most=2,
    keeps_frame=False,
)
