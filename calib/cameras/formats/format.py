"""What a camera-file format is, the lenses that it holds, and what comes out of a file."""

import re
from collections.abc import Callable
from dataclasses import dataclass

from calib.cameras import ABILITIES, LINEAR, parameter_names
from calib.cameras.camera import Camera
from calib.cameras.refit import Refit

MAX_FILE_BYTES = 2**17
"""A camera file of a few numbers is never larger."""
NOTHING = "0"
"""Stands for a number of a file's lens that is none of ours, and has to be zero."""


@dataclass(frozen=True, eq=False)
class ReadCamera:
    """A camera from a file."""

    camera: Camera
    refit: Refit | None = None  # where the file's lens is none of this program's; None: taken as it is
    remarks: tuple[str, ...] = ()  # what the file held besides, and what was done about it


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
        return tuple(name for name in parameter_names(self.model)[4:] if name not in self.names)

    @property
    def is_plain(self) -> bool:
        """Whether it is the camera without a lens."""
        return self.model == LINEAR

    def values(self, camera: Camera) -> list[float]:
        """The numbers of a camera of its model, in the file's order."""
        known = {name.removesuffix("_px"): value for name, value in camera.parameters.items()}
        return [0.0 if name == NOTHING else known[name] for name in self.names]


@dataclass(frozen=True)
class CameraFormat:
    """One kind of camera file. Its functions are pure; `read` names the file in what it raises."""

    name: str  # on the command line
    title: str  # in a sentence
    file_name: str  # what a file is usually called
    opens_with: str  # how to use the file in its tool; {file} is its path, {url} its address
    recognised: re.Pattern[str]  # is found in the beginning of such a file
    lenses: tuple[FileLens, ...]  # the first that holds a camera is written, so the more widely read first
    write: Callable[[Camera, FileLens], str]
    read: Callable[[str, str, str | None], ReadCamera]  # text, what messages name, which of several cameras
    holds_many: bool = False  # a file may hold several cameras, each with a name
    max_bytes: int = MAX_FILE_BYTES

    @property
    def written(self) -> dict[str, FileLens]:
        """The lenses that cameras are written with, by name."""
        return {lens.name: lens for lens in self.lenses if lens.is_written}
