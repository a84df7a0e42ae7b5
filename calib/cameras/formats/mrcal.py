"""mrcal's .cameramodel files, one for each camera: a Python dict of literals.

`rt_cam_ref` is the pose from the reference in metres, which is the rig's frame; older files call it `extrinsics`.
"""

import ast
import re
from collections.abc import Mapping, Sequence

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.lens import lens_camera, lens_named
from calib.cameras.formats.lens_names import require_agreement
from calib.cameras.formats.mrcal_surface import (
    CAHVOR,
    CAHVORE,
    SPLINED,
    nearest_surface,
    read_cahvore,
    read_surface,
    surface_of,
)
from calib.cameras.formats.parsing import image_size, mapping, numbers, real, required, shown_plain, vector_pose
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.core.se3 import log_rotation
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

LENSES = (
    FileLens("LENSMODEL_PINHOLE", "pinhole", "fx fy cx cy"),
    FileLens("LENSMODEL_OPENCV5", "opencv", "fx fy cx cy k1 k2 p1 p2 k3"),
    FileLens("LENSMODEL_OPENCV8", "opencv8", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    FileLens("LENSMODEL_OPENCV12", "opencv12", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4"),
    FileLens(f"{CAHVORE}0.0", "fisheye", "fx fy cx cy 0 0 0 k1 k2 0 0 0"),
    FileLens(SPLINED, None, approximate=nearest_surface),
    FileLens("LENSMODEL_OPENCV4", "opencv", "fx fy cx cy k1 k2 p1 p2"),
    FileLens(CAHVOR, "opencv", "fx fy cx cy 0 0 0 k1 k2"),
)
"""Its lens models, with the numbers that it gives them (its documentation, Camera models).

CAHVORE with a linearity of 0 takes angles where CAHVOR takes their tangents.
"""

MAX_FILE_BYTES = 2**26
"""A model may hold all observations it was made from."""

MAX_TOKENS = 100_000

_TOKEN = re.compile(
    r"""(?P<skip>\#[^\n]*|\s+)
    |(?P<mark>[\[\](){},:])
    |(?P<plain>b?'(?:[^'\\\n]++|\\.)*+'|b?"(?:[^"\\\n]++|\\.)*+"
      |[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?|True|False|None)""",
    re.VERBOSE,
)
NAMES = ("lensmodel", "lens_model", "distortion_model")
_RECOGNISED = re.compile(rf"""["'](?:{"|".join(NAMES)})["']\s*:\s*["'](?:LENSMODEL|DISTORTION)_""")


def write(camera: Camera, lens: FileLens) -> str:
    """The text for a camera of the lens's model, at the origin."""
    return model_text(camera, lens, (0.0,) * 6)


def model_text(camera: Camera, lens: FileLens, pose: Sequence[float]) -> str:
    """The text for a camera whose pose from the reference is a rotation vector in rad and a shift in m."""
    name, values = (lens.name, lens.values(camera)) if lens.approximate is None else surface_of(camera).numbers
    width, height = camera.image_size
    return (
        "{\n"
        f"    'lensmodel':  '{name}',\n\n"
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
        f"    'intrinsics': [ {', '.join(map(real, values))} ],\n\n"
        "    # extrinsics are rt_fromref\n"
        f"    'extrinsics': [ {', '.join(map(real, pose))} ],\n\n"
        f"    'imagersize': [ {width}, {height} ]\n"
        "}\n"
    )


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    return camera_of(literal(text, origin), origin)


def camera_of(values: Mapping[str, object], origin: str) -> ReadCamera:
    """The camera of a model's values."""
    model = required(values, NAMES, origin)
    name = model.replace("DISTORTION_", "LENSMODEL_") if isinstance(model, str) else ""
    size = image_size(required(values, ("imagersize",), origin), origin)
    given = required(values, ("intrinsics",), origin)
    if name.startswith(SPLINED):
        return read_surface(name, given, size, origin)
    if name == CAHVOR or name.startswith(CAHVORE):
        return read_cahvore(name, given, size, origin)
    said = f"lens model {shown_plain(model)}"
    lens = lens_named(LENSES, name, said, origin, "first run mrcal-convert-lensmodel with one of")
    require_agreement(values, lens.model, origin, *NAMES)
    return lens_camera(lens, numbers(given, "intrinsics", origin, (len(lens.names),)), size, origin)


def literal(text: str, origin: str) -> Mapping[str, object]:
    """The values of a Python literal, read only after its tokens are known to be few and plain."""
    _check_tokens(text, origin)
    try:
        value: object = ast.literal_eval(text.strip())
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        raise InputError(f"{origin}: not a mrcal camera model: it must be one Python dict of plain values") from None
    return mapping(value, "the file", origin)


def _check_tokens(text: str, origin: str) -> None:
    position = count = 0
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            line = text.count("\n", 0, position) + 1
            raise InputError(
                f"{origin}: line {line}: {shown(text[position : position + 20])}; not a mrcal camera model"
            )
        position, count = token.end(), count + 1
        if count > MAX_TOKENS:
            raise InputError(f"{origin}: more than {MAX_TOKENS} values and marks; a mrcal camera model has fewer")


FORMAT = CameraFormat(
    name="mrcal",
    title="mrcal camera model",
    file_name="camera.cameramodel",
    opens_with='mrcal-show-projection-diff {file} OTHER.cameramodel; in Python: mrcal.cameramodel("{file}")',
    recognised=_RECOGNISED,
    lenses=LENSES,
    write=write,
    read=read,
    max_bytes=MAX_FILE_BYTES,
)


SUFFIX = ".cameramodel"
POSE = ("rt_cam_ref", "extrinsics")


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The texts for a rig, a file a camera."""
    turn = log_rotation(written.cam_from_rig[:, :3, :3])
    pose = np.concatenate([turn, written.cam_from_rig[:, :3, 3]], axis=1)
    each = zip(written.words, written.rig.cameras, written.lenses, pose.tolist(), strict=True)
    return {f"{word}{SUFFIX}": model_text(camera, lens, rt) for word, camera, lens, rt in each}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of several models, named after their files."""
    found, poses = [], []
    for name, text in files.texts.items():
        camera, pose = _model(text, files.unit, files.origin_of(name))
        found.append(camera)
        poses.append(pose)
    names = [name.removesuffix(SUFFIX) for name in files.texts]
    return assembled(files, names, found, poses, "m")


def _model(text: str, unit: str, origin: str) -> tuple[ReadCamera, Array]:
    values = literal(text, origin)
    pose = numbers(required(values, POSE, origin), POSE[0], origin, (6,))
    return camera_of(values, origin), vector_pose(pose[:3], pose[3:], unit, origin)


RIG_FORMAT = RigFormat(
    title="mrcal camera models",
    file_name="cameras",
    opens_with="mrcal-show-geometry {file}/*.cameramodel; the reference is the rig's frame",
    cameras=FORMAT,
    unit="m",
    write=write_rig,
    read=read_rig,
    patterns=(f"*{SUFFIX}",),
)
