"""This program's own `camera.json`."""

import re
from pathlib import Path

from calib.cameras.camera import CAMERA, Camera, camera_from_mapping, camera_to_json
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from designer.base.files import parse_json


def write(camera: Camera, _: FileLens) -> str:
    """The text for a camera of any model."""
    return camera_to_json(camera)


def read(text: str, origin: str, _: str | None = None) -> ReadCamera:
    """The camera in a text."""
    return ReadCamera(camera_from_mapping(parse_json(text, Path(origin), "a camera file"), origin))


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
