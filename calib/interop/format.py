"""What a camera-file format is, and what comes out of a file."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from calib.cameras import COMMON
from calib.cameras.camera import Camera
from calib.cameras.refit import Refit

MAX_FILE_BYTES = 2**17
"""A camera file of a few numbers is never larger."""


@dataclass(frozen=True, eq=False)
class ReadCamera:
    """A camera from a file."""

    camera: Camera
    refit: Refit | None = None  # where the file's lens is none of this program's; None: taken as it is
    remarks: tuple[str, ...] = ()  # what the file held besides, and what was done about it


@dataclass(frozen=True)
class CameraFormat:
    """One kind of camera file. Its functions are pure; `read` names the file in what it raises."""

    name: str  # on the command line
    title: str  # in a sentence
    file_name: str  # what a file is usually called
    opens_with: str  # how to use the file in its tool; {file} is its path, {url} its address
    recognised: re.Pattern[str]  # is found in the beginning of such a file
    write: Callable[[Camera], str]
    read: Callable[[str, str, str | None], ReadCamera]  # text, what messages name, which of several cameras
    model: str | None = COMMON  # what `write` takes, besides the linear one; None: every model
    cannot_hold: tuple[str, ...] = ()  # lens parameters that must be 0
    holds_many: bool = False  # a file may hold several cameras, each with a name
    max_bytes: int = MAX_FILE_BYTES
