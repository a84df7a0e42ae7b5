"""Rigs to be simulated: where cameras stand in a room, and how people move a target before them.

A template, or a person's TOML file: cameras one by one or in rings, lengths and angles with units. The room's x and y
lie on the floor, its z points up; the rig's frame is the first camera's.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Annotated, cast

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.formats.reading import open_camera, open_rig, rig_format_of
from calib.cameras.rig import MOST_CAMERAS, Rig
from calib.core.se3 import invert, look_at
from calib.renderer.quantities import bounded, length_range, parse_degrees, parsed
from designer.base.arrays import Array
from designer.base.codec import BadValueError, decode
from designer.base.errors import InputError
from designer.base.files import JsonValue, read_spec_file
from designer.base.marks import AtLeast, AtMost, Length, Line, Word
from designer.base.units import parse_length_mm, parse_lengths_mm, parse_quantity
from designer.base.words import shown
from designer.kinds.presets import preset_names, preset_or_file

DISTANCE_MM = (1.0, 10_000.0)
MOST_TILT_DEG = 80.0
MM_S_PER_UNIT = {"": 1.0, "mm/s": 1.0, "cm/s": 10.0, "m/s": 1000.0}
FASTEST_MM_S, LEAST_MM_S = 1e4, 1.0
MOST_HZ, LEAST_HZ = 1000.0, 0.1
SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,98}")
"""Of a camera whose photos lie in a folder of that name."""


@dataclass(frozen=True)
class HeldTarget:
    """How people hold and move a target before the cameras of a rig."""

    distance_mm: tuple[float, float]  # from the camera it is held to
    tilt_rad: float = math.radians(45)  # of a flat one, at most, against that camera's line of sight
    speed_mm_s: float = 150.0  # where it does not stand still
    rate_hz: float = 10.0  # frames a second, then


@dataclass(frozen=True, eq=False)
class SimulatedRig:
    """A rig, and what happens before it."""

    name: str
    title: str
    purpose: str
    rig: Rig  # the truth, without a covariance
    held: HeldTarget | None  # None: a rig's file does not say


@dataclass(frozen=True)
class PlacedCamera:
    """A camera of a template."""

    name: str
    camera: str
    at: str
    towards: str
    roll: str = "0deg"

    def poses(self) -> Iterator[tuple[str, str, Array]]:
        """Its name, its camera and `cam_from_room`."""
        at, towards = (
            np.array(parsed(key, text, lambda one: parse_lengths_mm(one, 3)))
            for key, text in (("at", self.at), ("towards", self.towards))
        )
        if not np.linalg.norm(towards - at) > 0:
            raise ValueError(f"camera {shown(self.name)} stands where it looks to; move one of at and towards")
        roll_deg = parsed("roll", self.roll, parse_degrees)
        yield self.name, self.camera, look_at(at, towards, math.radians(roll_deg))


@dataclass(frozen=True)
class CameraRing:
    """Cameras of a template on a circle about the room's z axis, that look inwards; of two, each looks at the other."""

    name: str  # before the number of each
    camera: str
    count: Annotated[int, AtLeast(1), AtMost(MOST_CAMERAS)]
    radius: str
    height: str = "0mm"
    tilt: str = "0deg"  # down

    def poses(self) -> Iterator[tuple[str, str, Array]]:
        """As `PlacedCamera`."""
        radius, height = (
            parsed(key, text, parse_length_mm) for key, text in (("radius", self.radius), ("height", self.height))
        )
        if not radius >= 1:
            raise ValueError(f"radius {shown(self.radius)}: must be at least 1mm")
        tilt_deg = bounded("tilt", self.tilt, parse_degrees, -MOST_TILT_DEG, MOST_TILT_DEG, "deg")
        aim = np.array([0, 0, height - radius * math.tan(math.radians(tilt_deg))])
        for number in range(self.count):
            angle = math.tau * number / self.count
            eye = np.array([radius * math.cos(angle), radius * math.sin(angle), height])
            yield f"{self.name}{number + 1}", self.camera, look_at(eye, aim)


@dataclass(frozen=True)
class HeldEntry:
    """The table `target` of a template."""

    distance: str
    tilt: str = "45deg"
    speed: str = "150mm/s"
    rate: str = "10Hz"

    def held(self) -> HeldTarget:
        """The same in numbers."""
        such = "a speed such as 150mm/s"
        speed = parsed("speed", self.speed, lambda text: parse_quantity(text, MM_S_PER_UNIT, such, FASTEST_MM_S))
        rate = parsed("rate", self.rate, lambda text: parse_quantity(text, {"": 1.0, "Hz": 1.0}, "10Hz", MOST_HZ))
        if not (speed >= LEAST_MM_S and rate >= LEAST_HZ):
            what = f"speed {self.speed}" if speed < LEAST_MM_S else f"rate {self.rate}"
            raise ValueError(f"{what}: must be at least {LEAST_MM_S:g}mm/s, and {LEAST_HZ:g}Hz")
        tilt_deg = bounded("tilt", self.tilt, parse_degrees, 0, MOST_TILT_DEG, "deg")
        return HeldTarget(length_range("distance", self.distance, *DISTANCE_MM), math.radians(tilt_deg), speed, rate)


@dataclass(frozen=True)
class RigFile:
    """The keys of a template."""

    title: Word
    purpose: Line
    target: HeldEntry
    cameras: Annotated[tuple[PlacedCamera, ...], Length(0, MOST_CAMERAS)] = ()
    rings: Annotated[tuple[CameraRing, ...], Length(0, MOST_CAMERAS)] = ()


def read_simulated_rig(name: str) -> SimulatedRig:
    """The rig of a template, of a person's TOML file, of a `rig.json`, or of another tool's file or folder.

    Raises:
        InputError: neither, or a key or value that breaks a rule; the message says which.
    """
    if Path(name).suffix.lower() == ".json" or rig_format_of(Path(name)) is not None:
        rig = open_rig(Path(name)).read.rig
        return SimulatedRig(Path(name).stem, f"the rig of {Path(name).name}", "", with_folder_names(rig, name), None)
    path = preset_or_file("rigs", name)
    try:
        file = decode(RigFile, cast("JsonValue", read_spec_file(path)))
        held, rig = file.target.held(), _rig(file, path.parent)
    except (BadValueError, ValueError) as error:
        if isinstance(error, InputError) and str(error).startswith(str(path)):
            raise
        raise InputError(f"{path}: {error}") from None
    return SimulatedRig(path.stem, file.title, file.purpose, rig, held)


def simulated_rig(rig: Rig | SimulatedRig | str | PathLike[str]) -> SimulatedRig:
    """The true rig, without what a calibration knows of it, whatever it is given as.

    Raises:
        InputError: as `read_simulated_rig`, or a value of another type.
    """
    if isinstance(rig, SimulatedRig):
        return rig
    if isinstance(rig, Rig):
        found = SimulatedRig("rig", "a rig", "", with_folder_names(rig, "rig"), None)
    elif isinstance(rig, str | PathLike):
        found = read_simulated_rig(fspath(rig))
    else:
        raise InputError(
            f"rig {shown(rig)}: is of type {type(rig).__name__}; give a template, a TOML file or a rig.json"
        )
    return replace(found, rig=replace(found.rig, covariance=None, noise_px=None, delay_s=None, geometry_id=""))


def held_before(simulated: SimulatedRig, distance_mm: float | tuple[float, float] | None) -> HeldTarget:
    """How the target is held before a rig: as its template says, or at other distances.

    Raises:
        InputError: neither is known.
    """
    if distance_mm is None:
        if simulated.held is None:
            raise InputError(
                f"--rig {simulated.name}: says where the cameras are, not where the target is held; "
                "add --distance, such as 400mm..800mm"
            )
        return simulated.held
    near, far = distance_mm if isinstance(distance_mm, tuple | list) else (distance_mm, distance_mm)
    return HeldTarget((near, far)) if simulated.held is None else replace(simulated.held, distance_mm=(near, far))


def with_folder_names(rig: Rig, origin: str) -> Rig:
    """The rig, if each camera's name can be that of the folder of its photos.

    Raises:
        InputError: one cannot.
    """
    for name in rig.names:
        if not SAFE_NAME.fullmatch(name) or name != name.strip() or name.endswith("."):
            raise InputError(
                f"{origin}: camera {shown(name)}: its photos get a folder of that name; use letters, digits, dashes"
            )
    twice, count = Counter(name.lower() for name in rig.names).most_common(1)[0]
    if count > 1:
        raise InputError(
            f"{origin}: {count} cameras are named {shown(twice)}, but for capitals; give each its own name"
        )
    return rig


def _rig(file: RigFile, folder: Path) -> Rig:
    """The cameras of a template, in the first one's frame."""
    entries: tuple[PlacedCamera | CameraRing, ...] = (*file.cameras, *file.rings)
    placed = [one for entry in entries for one in entry.poses()]
    if not placed:
        raise ValueError("no camera: give [[cameras]] with name, camera, at, towards, or [[rings]]")
    if len(placed) > MOST_CAMERAS:
        raise ValueError(f"{len(placed)} cameras; at most {MOST_CAMERAS}")
    opened = {camera: _camera(camera, folder) for _, camera, _ in placed}
    cam_from_room = np.array([pose for _, _, pose in placed])
    rig = Rig(
        tuple(name for name, _, _ in placed),
        tuple(opened[camera] for _, camera, _ in placed),
        cam_from_room @ invert(cam_from_room[0]),
    )
    return with_folder_names(rig, "cameras")


def _camera(name: str, folder: Path) -> Camera:
    """A camera's template, or a file beside the rig's."""
    beside = folder / name
    return open_camera(str(beside) if name not in preset_names("cameras") and beside.exists() else name).read.camera
