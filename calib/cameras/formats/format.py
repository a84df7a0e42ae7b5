"""What a format of camera files is, the lenses that it holds, and what comes out of a file."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NoReturn

from calib.cameras import ABILITIES, LINEAR, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.formats import ACCEPTED_PX
from calib.cameras.formats.parsing import MAX_FILE_BYTES
from calib.cameras.refit import Refit
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
