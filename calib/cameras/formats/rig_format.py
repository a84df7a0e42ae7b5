"""What a format of rig files is, and what comes out of them."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath

import numpy as np

from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera, only_read
from calib.cameras.formats.parsing import in_unit
from calib.cameras.refit import Refit
from calib.cameras.rig import MOST_CAMERAS, Rig
from calib.core.se3 import compose, invert
from designer.base.arrays import Array
from designer.base.errors import InputError

NEVER = re.compile(r"(?!)")
"""Found in no file: of formats that are known by the files of a folder."""
LONGEST_WORD, LONGEST_NAME = 60, 100
AT_HOME = 1e-9
"""A pose that differs by less from the identity is it."""
WORLD = "world"
"""What the frame of a file is called that is none of its cameras'."""


def plain_words(names: tuple[str, ...]) -> tuple[str, ...]:
    """Letters, digits, `_` and `-` for each name; numbered all where that leaves two the same, or none."""
    words = [re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-") for name in names]
    if len({word.lower() for word in words}) < len(words) or not all(0 < len(word) <= LONGEST_WORD for word in words):
        return tuple(f"cam{row}" for row in range(len(names)))
    return tuple(words)


@dataclass(frozen=True, eq=False)
class RigFiles:
    """What a rig is read from: one file, or those of a folder that belong together."""

    texts: Mapping[str, str]  # by name
    origin: str  # what messages name: the file, or the folder
    unit: str  # of lengths in it, unless they say their own

    def origin_of(self, name: str) -> str:
        """What messages name a file of a folder."""
        return str(PurePath(self.origin) / name) if len(self.texts) > 1 else self.origin


@dataclass(frozen=True, eq=False)
class ReadRig:
    """A rig from files."""

    rig: Rig
    refits: tuple[Refit | None, ...]  # (C,) where a file's lens is none of this program's; None: taken as it is
    unit: str | None = None  # that the file says; None: none
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class WrittenRig:
    """A rig as a format is to write it."""

    rig: Rig  # each camera of its lens's model
    lenses: tuple[FileLens, ...]  # (C,)
    unit: str
    words: tuple[str, ...]  # (C,) what the cameras are called in the files

    @cached_property
    def cam_from_rig(self) -> Array:
        """Lengths in the file's unit.  # (C, 4, 4)"""
        return in_unit(self.rig.cam_from_rig, self.unit)

    @cached_property
    def cam_from_first(self) -> Array:
        """Likewise, from the frame of the first camera.  # (C, 4, 4)"""
        poses = compose(self.cam_from_rig, invert(self.cam_from_rig[0]))
        poses[0] = np.eye(4)
        return poses


@dataclass(frozen=True, kw_only=True)
class RigFormat:
    """One kind of rig file. Its functions are pure; `read` names the file in what it raises."""

    name: str = ""  # on the command line; "": as the cameras' format has it, and so are the next two
    title: str = ""  # in a sentence
    file_name: str = ""  # what a file, or a folder of several, is usually called
    opens_with: str = ""  # how to use it in its tool; {file} is its path
    cameras: CameraFormat  # whose lenses hold its cameras
    unit: str  # of lengths, unless another is asked for
    write: Callable[[WrittenRig], Mapping[str, str]] = only_read  # texts by name; of a format of one file under its own
    read: Callable[[RigFiles], ReadRig]
    recognised: re.Pattern[str] = NEVER  # is found in the beginning of such a file
    patterns: tuple[str, ...] = ()  # files of a folder that belong to it; (): it is one file
    needed: tuple[str, ...] = ()  # of which a folder has one, if it is of this format; (): all patterns
    most: int = 256  # cameras that it holds
    fewest: int = 1
    keeps_frame: bool = True  # else the file's frame is that of the first camera
    has_own_unit: bool = True  # the tool knows no other
    words: Callable[[tuple[str, ...]], tuple[str, ...]] = plain_words  # what it calls cameras of those names

    def __post_init__(self) -> None:
        for key in ("name", "title", "file_name"):
            object.__setattr__(self, key, getattr(self, key) or getattr(self.cameras, key))

    @property
    def is_folder(self) -> bool:
        """Whether it is several files."""
        return bool(self.patterns)


def assembled(
    files: RigFiles,
    names: Sequence[str],
    found: Sequence[ReadCamera],
    poses: Sequence[Array],
    unit: str | None = None,
    frame: str | None = None,
    remarks: Sequence[str] = (),
) -> ReadRig:
    """A rig of a file's cameras and their poses in mm; its frame is that of a camera, or else `frame`, or the world's.

    Raises:
        InputError: they make no rig; the message names the file.
    """
    if len(names) > MOST_CAMERAS:
        raise InputError(f"{files.origin}: {len(names)} cameras; a rig has at most {MOST_CAMERAS}")
    if any(not 0 < len(name) <= LONGEST_NAME for name in names):
        raise InputError(f"{files.origin}: a camera's name must have 1 to {LONGEST_NAME} characters")
    cam_from_rig = np.stack(poses)
    at_home = np.abs(cam_from_rig - np.eye(4)).max(axis=(1, 2)) < AT_HOME
    whose = frame or (names[int(np.argmax(at_home))] if at_home.any() else WORLD)
    try:
        rig = Rig(tuple(names), tuple(one.camera for one in found), cam_from_rig, rig_frame=whose)
    except InputError as error:
        raise InputError(f"{files.origin}: {error}") from None
    told = [f"{name}: {line}" for name, one in zip(names, found, strict=True) for line in one.remarks]
    return ReadRig(rig, tuple(one.refit for one in found), unit, (*remarks, *told))
