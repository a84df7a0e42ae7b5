"""What a format of camera or rig files is, the lenses that it holds, and what comes out of a file."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath
from typing import NoReturn

import numpy as np

from calib.cameras import ABILITIES, LINEAR, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.formats import ACCEPTED_PX
from calib.cameras.formats.parsing import MAX_FILE_BYTES, in_unit
from calib.cameras.refit import Refit
from calib.cameras.rig import MOST_CAMERAS, Rig
from calib.core.se3 import compose, invert
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import shown

NOTHING = "0"
"""Stands for a number of a file's lens that is none of ours, and has to be zero."""
EMPTY: tuple[object, ...] = (None, "", 0, False, [], {})
MOST_TOLD = 8
"""Keys of a file that are named."""


@dataclass(frozen=True, eq=False)
class ReadCamera:
    """A camera from a file."""

    camera: Camera
    refit: Refit | None = None  # where the file's lens is none of this program's; None: taken as it is
    remarks: tuple[str, ...] = ()  # what the file held besides, and what was done about it


def told(found: ReadCamera, *lines: str) -> ReadCamera:
    """The camera with more to say of its file."""
    return replace(found, remarks=(*found.remarks, *lines))


def left_over(found: ReadCamera, values: Mapping[str, object], *used: str) -> ReadCamera:
    """The camera with a word on what its file says besides, under keys that are not used."""
    names = [shown(key) for key, value in values.items() if key not in (*used, "format") and value not in EMPTY]
    listed = ", ".join(names[:MOST_TOLD]) + (", ..." if len(names) > MOST_TOLD else "")
    return told(found, f"not used: {listed}") if names else found


@dataclass(frozen=True)
class FileLens:
    """A lens of a format: `Lens("OPENCV", "opencv", "fx fy cx cy k1 k2 p1 p2")`.

    Its numbers are parameters of a camera model, without their units and in the file's order; those that are not among
    them have no place in the file. Of a lens that is no model of ours, `approximate` says what it leaves over.
    """

    name: str  # as the format calls it
    model: str | None  # of the cameras that it holds; None: any
    numbers: str = ""  # `f` is both focal lengths, such lenses are only read; `0` is none of ours
    approximate: Callable[[Camera], Refit] | None = None
    keeps_edges: bool = False  # where the image shows no light is in the file

    @property
    def names(self) -> tuple[str, ...]:
        """The numbers, a word each."""
        return tuple(self.numbers.split())

    @property
    def is_written(self) -> bool:
        """Whether cameras are written with it; else they are only read."""
        return "f" not in self.names

    @property
    def is_wide(self) -> bool:
        """Whether it shows light from the side and from behind."""
        return self.model is None or ABILITIES[self.model].is_wide

    @property
    def cannot_hold(self) -> tuple[str, ...]:
        """Parameters of its model that must be as without a lens."""
        if self.model is None or not self.numbers:
            return ()
        return tuple(name for name in parameter_names(self.model)[4:] if name.removesuffix("_px") not in self.names)

    @property
    def is_plain(self) -> bool:
        """Whether it is the camera without a lens."""
        return self.model == LINEAR

    def values(self, camera: Camera) -> list[float]:
        """The numbers of a camera of its model, in the file's order."""
        known = {name.removesuffix("_px"): value for name, value in camera.parameters.items()}
        return [0.0 if name == NOTHING else known[name] for name in self.names]


def only_read(*_: object) -> NoReturn:
    """What writes files of a format that are only read."""
    raise TypeError("a format that is only read has no files to write")


@dataclass(frozen=True, kw_only=True)
class CameraFormat:
    """One kind of camera file. Its functions are pure; `read` names the file in what it raises."""

    name: str  # on the command line
    title: str  # in a sentence
    file_name: str  # what a file is usually called
    opens_with: str = ""  # how to use the file in its tool; {file} is its path, {url} its address
    recognised: re.Pattern[str]  # is found in the beginning of such a file
    lenses: tuple[FileLens, ...] = ()  # the first that holds a camera is written, so the more widely read first
    write: Callable[[Camera, FileLens], str] = only_read
    read: Callable[[str, str, str | None], ReadCamera]  # text, what messages name, which of several cameras
    holds_many: bool = False  # a file may hold several cameras, each with a name
    max_bytes: int = MAX_FILE_BYTES
    encode: Callable[[str], bytes] = str.encode  # what a file holds, of a text
    decode: Callable[[bytes, str], str] | None = None  # the text of a file, and what messages name; None: it is one
    files: Callable[[Camera], Mapping[str, bytes]] | None = None  # by name, of a format that is no text
    accurate_to: "Callable[[float | None], CameraFormat] | None" = None  # by px, of a format with a choice of it
    accept_px: float = ACCEPTED_PX  # how far off a fit may be

    @property
    def written(self) -> dict[str, FileLens]:
        """The lenses that cameras are written with, by name."""
        return {lens.name: lens for lens in self.lenses if lens.is_written}


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

    name: str  # on the command line
    title: str  # in a sentence
    file_name: str  # what a file, or a folder of several, is usually called
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
    has_own_unit: bool = False  # the tool knows no other
    words: Callable[[tuple[str, ...]], tuple[str, ...]] = plain_words  # what it calls cameras of those names

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
