"""This program's own `camera.json` and `rig.json`."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calib.cameras.camera import CAMERA, Camera, camera_of, camera_to_json
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig
from calib.cameras.rig import RIG
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import parse_json


def write(camera: Camera, _: FileLens) -> str:
    """The text for a camera of any model."""
    return camera_to_json(camera)


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    file = CAMERA.of(parse_json(text, Path(origin), "a camera file"), origin)
    return ReadCamera(camera_of(file, origin), remarks=() if file.remark is None else (file.remark,))


FORMAT = CameraFormat(
    name="json",
    title="camera.json",
    file_name="camera.json",
    opens_with="calib undistort {file} PHOTOS... -o DIR",
    recognised=re.compile(rf'\A\s*\{{(?s:.*?)"{re.escape(CAMERA.format)}"'),
    lenses=(FileLens("camera.json", None),),
    write=write,
    read=read,
    max_bytes=CAMERA.largest_bytes,
)


LARGEST_VARIANCE = 1e100
_ROUNDING = 1e-6  # of a covariance, in its standard deviations


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a rig with cameras of any model."""
    return {"rig.json": RIG.text(written.rig).decode()}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig in a text."""
    (text,) = files.texts.values()
    rig = RIG.of(parse_json(text, Path(files.origin), RIG.what), files.origin)
    fault = None if rig.covariance is None else covariance_fault(rig.covariance)
    if fault is not None:
        raise InputError(f"{files.origin}: covariance {fault}; {RIG.remedy}")
    return ReadRig(rig, (None,) * len(rig.cameras), "mm")


def covariance_fault(matrix: Array) -> str | None:
    """Why a finite matrix (N, N) is no covariance, as its single rows and pairs of them tell; None: it may be one."""
    variance = np.diagonal(matrix)
    if (variance < 0).any():
        return f"has a variance of {variance.min():g}; it must be 0 or more"
    if (variance > LARGEST_VARIANCE).any():
        return f"has a variance of {variance.max():g}; it must be {LARGEST_VARIANCE:g} or less"
    sigma = np.sqrt(variance)
    most = np.outer(sigma, sigma)
    if (np.abs(matrix - matrix.T) > _ROUNDING * most).any():
        return "is not symmetric"
    if (np.abs(matrix) > (1 + _ROUNDING) * most).any():
        return "has a correlation beyond 1"
    return None


RIG_FORMAT = RigFormat(
    title="rig.json",
    file_name="rig.json",
    opens_with='in Python: calib.load_rig("{file}").cam_from_rig',
    cameras=FORMAT,
    unit="mm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(rf'\A\s*\{{\s*"format"\s*:\s*"{re.escape(RIG.format)}"'),
)
