"""`undistorted.json`: what became of each photo that was undistorted, and the camera that took them."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from pydantic import JsonValue

from calib.camera_file import camera_from_mapping, camera_to_json
from calib.files import write_files
from calib.report.own_file import own_to_json, read_own
from calib.types import Camera
from designer.errors import InputError

UNDISTORTED_FILE = "undistorted.json"
FORMAT = "ringsolid.undistorted"
REMEDY = "undistort again"


@dataclass(frozen=True)
class UndistortedPhoto:
    """A photo that was undistorted."""

    image: str  # the photo's name
    path: str  # of the undistorted photo, within the folder
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class UndistortedFile:
    """The file's keys."""

    camera_name: str  # as it was given
    camera: dict[str, JsonValue]  # of the photos, as its file has it
    photos: tuple[UndistortedPhoto, ...]
    failures: tuple[str, ...]  # why others could not be, one line each
    share_filled: float  # of the pixels of each, the others are black
    format: Literal["ringsolid.undistorted"] = "ringsolid.undistorted"
    version: Literal[1] = 1


def write_undistorted(
    folder: Path,
    camera_name: str,
    camera: Camera,
    photos: Sequence[UndistortedPhoto],
    failures: Sequence[str],
    share_filled: float,
) -> Path:
    """Write `undistorted.json`; its path.

    Raises:
        InputError: another file has that name, or it cannot be written.
    """
    path = folder / UNDISTORTED_FILE
    mapping = json.loads(camera_to_json(camera))
    file = UndistortedFile(camera_name, mapping, tuple(photos), tuple(failures), share_filled)
    write_files({path: own_to_json(asdict(file))})
    return path


def read_undistorted(folder: Path) -> tuple[UndistortedFile, Camera]:
    """Read `undistorted.json`, and the camera in it.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    path = folder / UNDISTORTED_FILE
    file = read_own(path, UndistortedFile, REMEDY)
    if not 0 <= file.share_filled <= 1:
        raise InputError(f"{path}: share_filled {file.share_filled:g} is none; {REMEDY}")
    return file, camera_from_mapping(file.camera, f"{path}: camera")
