"""Photos of several cameras, joined to frames by their files' names, by a pattern of them, or by a table.

A table of photos is `camera,frame,file[,time_s]`, one of time stamps `camera,file,time_s`.
"""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from calib.core.csv_table import CsvTable, column_fault, column_names, read_table, read_text
from calib.images.photo import Photo
from calib.observe.photos import PhotoFile, find_photos, images_in, in_order, not_read_in, photos_of_arrays
from calib.observe.rig_observations import SEEN, TIME, require_names, some, time_stamps
from designer.base.errors import InputError
from designer.base.words import shown

CAMERA, FRAME = "{camera}", "{frame}"
FILE = "file"
_TABLE = "a table of files or of sightings"
MAX_TABLE_BYTES = 64 * 2**20
EXAMPLE = "'{camera}_{frame}.png'"
_USUAL = [f"{first}{gap}{last}.*" for gap in ("_", "-", "") for first, last in ((CAMERA, FRAME), (FRAME, CAMERA))]
_USUAL += [f"*_{one}" for one in _USUAL[:2]]
"""Patterns of names that one folder for all cameras may have."""


@dataclass(frozen=True)
class RigPhoto:
    """A photo that one camera of a rig took."""

    camera: str
    path: Path
    frame: str = ""  # photos of one frame were taken at once; "": not joined yet
    time_s: float | None = None  # its time stamp
    opened: Callable[[], Photo] | None = None  # reads what is no file, as that of `calib.observe.photos.PhotoFile`

    @classmethod
    def taken(cls, camera: str, photo: PhotoFile, frame: str = "") -> "RigPhoto":
        """A photo, as one that a camera took."""
        return cls(camera, photo.path, frame, photo.time_s, photo.opened)

    @property
    def file(self) -> PhotoFile:
        """The photo as it is searched, whoever took it."""
        return PhotoFile(self.path, time_s=self.time_s, opened=self.opened)


@dataclass(frozen=True)
class RigPhotos:
    """The photos of a rig, joined to frames."""

    photos: tuple[RigPhoto, ...]
    frame_names: tuple[str, ...]  # in their order
    remarks: tuple[str, ...] = ()

    @cached_property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras, in the order in which they come."""
        return tuple(dict.fromkeys(photo.camera for photo in self.photos))

    def of(self, camera: str) -> tuple[RigPhoto, ...]:
        """What one camera took."""
        return tuple(photo for photo in self.photos if photo.camera == camera)


def photos_in_folders(folders: Sequence[str]) -> tuple[RigPhoto, ...]:
    """The photos of one folder a camera, or of one folder with a subfolder a camera; not joined yet.

    Raises:
        InputError: a folder without images, no folder, or one camera only.
    """
    places = [Path(folder) for folder in folders]
    for place in places:
        if not place.is_dir():
            what = "is a file, not a folder" if place.exists() else "no such folder"
            raise InputError(f"{place}: {what}; give a folder a camera, or --table files.csv, or --pattern {EXAMPLE}")
    if len(places) == 1 and not images_in(places[0]):
        places = sorted((one for one in _subfolders(places[0]) if images_in(one)), key=in_order)
        if not places:
            raise InputError(f"{folders[0]}: holds neither images nor folders of images, one a camera")
    elif len(places) == 1:
        raise InputError(f"{folders[0]}: one folder of images; give a folder a camera, or {_usual_pattern(places[0])}")
    names = camera_names_of(places)
    require_names(names)
    photos: list[RigPhoto] = []
    for name, place in zip(names, places, strict=True):
        found = find_photos([str(place)])
        if not found.paths:
            raise InputError(found.failures[0] if found.failures else f"{place}: holds overlays only")
        photos += [RigPhoto(name, path) for path in found.paths]
    return tuple(photos)


def _usual_pattern(folder: Path) -> str:
    """The pattern that its names may have: that by which most frames are of the same cameras, two or more."""
    names = [path.name for path in images_in(folder)]
    frames: dict[str, tuple[int, list[str]]] = {}
    for pattern in _USUAL:
        parts = [match.group("camera", "frame") for name in names if (match := _expression(pattern).fullmatch(name))]
        cameras = sorted({camera for camera, _ in parts})
        count = len({frame for _, frame in parts})
        if 1 < len(cameras) <= count and len(parts) > 0.9 * len(names) and len(parts) > 0.7 * len(cameras) * count:
            frames[pattern] = count, cameras
    if not frames:
        return f"--pattern {EXAMPLE}"
    best = max(frames, key=lambda pattern: (frames[pattern][0], -len("".join(frames[pattern][1]))))
    return f"--pattern '{best}', by which they are of {some(frames[best][1])}"


def _expression(pattern: str) -> re.Pattern[str]:
    """What finds camera and frame in a name; where they touch, the frame is all of the digits there."""
    named = re.escape(pattern).replace(r"\*", "[^/]*")
    digits = "[0-9]+" if CAMERA + FRAME in pattern or FRAME + CAMERA in pattern else "[^/]+?"
    for word, what in ((CAMERA, "[^/]+?"), (FRAME, digits)):
        named = named.replace(re.escape(word), f"(?P<{word[1:-1]}>{what})")
    return re.compile(named)


def _subfolders(folder: Path) -> list[Path]:
    try:
        return [one for one in folder.iterdir() if one.is_dir() and not one.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}; check the path") from None


def camera_names_of(folders: Sequence[Path]) -> list[str]:
    """A name for each camera: the last part of its folder's path in which all differ.

    Raises:
        InputError: a folder is given twice.
    """
    parts = [Path(os.path.abspath(folder)).parts[::-1] for folder in folders]
    again = next((folder for folder, one in zip(folders, parts, strict=True) if parts.count(one) > 1), None)
    if again is not None:
        raise InputError(f"{again}: is given twice; two cameras need folders of their own")
    for part in range(min(map(len, parts))):
        names = [one[part] for one in parts]
        if len(set(names)) == len(names):
            return names
    return ["-".join(one[1::-1]) for one in parts]


def photos_by_pattern(folders: Sequence[str], pattern: str) -> RigPhotos:
    """The photos whose names a pattern tells apart, as `{camera}_{frame}.png` or `{camera}{frame}.png`; `*`: anything.

    Args:
        folders: that hold them; with a `/` in the pattern it is of paths from there on.
        pattern: of names.

    Raises:
        InputError: a pattern without both words, or one that no file has.
    """
    for word in (CAMERA, FRAME):
        if pattern.count(word) != 1:
            raise InputError(f"--pattern {shown(pattern)}: must hold {word} once, as in {EXAMPLE}")
    expression = _expression(pattern)
    photos: list[RigPhoto] = []
    unlike: list[str] = []
    for folder in folders:
        place = Path(folder)
        if not place.is_dir():
            raise InputError(f"{place}: no such folder; --pattern {shown(pattern)} is of the files in a folder")
        depth = pattern.count("/")
        for path in sorted(_files_at(place, depth), key=in_order):
            match = expression.fullmatch(path.relative_to(place).as_posix())
            if match is None:
                unlike.append(path.name)
            else:
                photos.append(RigPhoto(match["camera"], path, match["frame"]))
    if not photos:
        seen = f"; there are {some(unlike)}" if unlike else "; there are no images"
        raise InputError(f"--pattern {shown(pattern)}: no image in {', '.join(folders)} is named so{seen}")
    said = (f"{len(unlike)} images are not named as {pattern}, and left out: {some(unlike)}",) if unlike else ()
    return framed(photos, said)


def _files_at(folder: Path, depth: int) -> Iterator[Path]:
    """The images of a folder, so many folders below it."""
    if depth == 0:
        yield from images_in(folder)
        return
    for one in sorted(_subfolders(folder)):
        yield from _files_at(one, depth - 1)


def framed(photos: Sequence[RigPhoto], remarks: Sequence[str] = ()) -> RigPhotos:
    """Photos whose frames are known, the frames in the order of their names, or of their time stamps.

    Raises:
        InputError: cameras that cannot be, two photos of one camera in a frame, or a photo of two cameras.
    """
    folders = dict.fromkeys(photo.path.parent for photo in photos)
    left_out = [f"{folder}: {'; '.join(told)}" for folder in folders if (told := not_read_in(folder))]
    found = RigPhotos(tuple(photos), (), (*remarks, *left_out))
    require_names(found.camera_names)
    count = Counter((photo.camera, photo.frame) for photo in photos)
    (camera, frame), times = count.most_common(1)[0]
    if times > 1:
        raise InputError(
            f"camera {shown(camera)} has {times} photos of frame {shown(frame)}: "
            f"{some([one.path.name for one in photos if (one.camera, one.frame) == (camera, frame)])}; keep one"
        )
    first: dict[str, RigPhoto] = {}
    for photo in photos:
        other = first.setdefault(os.path.realpath(photo.path), photo)
        if other is not photo:
            raise InputError(
                f"{photo.path}: is given twice, for cameras {shown(other.camera)} and {shown(photo.camera)}"
            )
    of_frame: dict[str, float] = {}
    for photo in photos:
        if photo.time_s is not None:
            of_frame[photo.frame] = min(photo.time_s, of_frame.get(photo.frame, photo.time_s))
    names = sorted(dict.fromkeys(photo.frame for photo in photos), key=lambda name: in_order(Path(name)))
    if len(of_frame) == len(names):
        names.sort(key=lambda name: of_frame[name])
    found = replace(found, frame_names=tuple(names))
    if len({(photo.frame, photo.camera) for photo in photos}) == len(names):
        seen = "; ".join(f"{name} has {some([photo.frame for photo in found.of(name)])}" for name in found.camera_names)
        raise InputError(f"no frame is of two cameras: {seen}; name the files of one moment alike, or give --table")
    return found


def photos_of_images(images: Mapping[str, Iterable[NDArray[np.generic]]]) -> RigPhotos:
    """Images in memory by their cameras' names: the first of each are a frame, the second, and so on.

    Raises:
        InputError: fewer than two cameras, or what is no image.
    """
    photos = []
    for camera, arrays in images.items():
        try:
            found = photos_of_arrays(arrays).photos
        except InputError as error:
            raise InputError(f"camera {shown(camera)}: {error}") from None
        photos += [RigPhoto(camera, camera / one.path, one.path.name, opened=one.opened) for one in found]
    return framed(photos)


def joined_by_name(photos: Sequence[RigPhoto]) -> RigPhotos:
    """Photos of one moment have one name, which may differ by the camera's name, or in all but their number.

    Raises:
        InputError: no name is that of photos of two cameras.
    """
    most, best, how = 0, [photo.path.stem for photo in photos], ""
    for key, said in _KEYS:
        frames = [key(photo) for photo in photos]
        count = Counter(zip((photo.camera for photo in photos), frames, strict=True))
        if "" in frames or max(count.values()) > 1:
            continue
        cameras = Counter(frame for _, frame in count)
        shared = sum(times > 1 for times in cameras.values())
        if shared > most:
            most, best, how = shared, frames, said
    remarks = (f"photos are joined by {how}, as their names differ otherwise",) if how else ()
    return framed([replace(photo, frame=frame) for photo, frame in zip(photos, best, strict=True)], remarks)


def _without_camera(photo: RigPhoto) -> str:
    """The name without the camera's in it, and what joined the two."""
    left = re.sub(re.escape(photo.camera), "", photo.path.stem, count=1, flags=re.IGNORECASE)
    return left.strip(" _-.")


def _numbers(photo: RigPhoto) -> str:
    return "-".join(str(int(digits)) for digits in re.findall(r"[0-9]{1,30}", _without_camera(photo)))


_KEYS: tuple[tuple[Callable[[RigPhoto], str], str], ...] = (
    (lambda photo: photo.path.stem, ""),
    (_without_camera, ""),
    (_numbers, "the numbers in their names"),
    (lambda photo: _numbers(photo).rpartition("-")[2], "the last number in their names"),
)


def with_stamps(photos: Sequence[RigPhoto], stamps: Mapping[Path, float]) -> tuple[RigPhoto, ...]:
    """The photos with time stamps, by the real paths of their files; InputError: a photo has none."""
    without = [photo.path.name for photo in photos if Path(os.path.realpath(photo.path)) not in stamps]
    if without:
        raise InputError(f"no time stamp for {some(without)}; add {'them' if len(without) > 1 else 'it'}")
    return tuple(replace(photo, time_s=stamps[Path(os.path.realpath(photo.path))]) for photo in photos)


def is_sightings(path: Path) -> bool:
    """Whether a table holds pixels, not files."""
    return FILE not in column_names(path, _TABLE) or tells_cameras(path)


def tells_cameras(path: Path) -> bool:
    """Whether a table holds pixels, of cameras that it names."""
    return column_names(path, _TABLE) >= set(SEEN)


def read_photo_table(path: Path) -> tuple[RigPhoto, ...]:
    """Photos by a table, files as they are from its folder; without a column frame they are joined by their times.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names it.
    """
    table = _read(path, ("camera", FILE), f"the columns must be camera,{FILE}, frame or {TIME}, or both")
    if "frame" not in table.cells and TIME not in table.cells:
        raise InputError(f"{path}: has neither a column frame nor {TIME}; one tells which photos were taken at once")
    table.require_filled(*(name for name in ("camera", "frame", FILE) if name in table.cells))
    count = len(table.lines)
    frames = table.cells.get("frame", ("",) * count)
    times: Sequence[float | None] = time_stamps(table) if TIME in table.cells else [None] * count
    files = [path.parent / _of_any_system(path.parent, name) for name in table.cells[FILE]]
    return tuple(
        RigPhoto(camera, file, frame, time_s)
        for camera, file, frame, time_s in zip(table.cells["camera"], files, frames, times, strict=True)
    )


def read_stamps(path: Path, photos: Sequence[RigPhoto]) -> dict[Path, float]:
    """The time stamps of photos, by their real paths; a table names them as they are called, or from its folder.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names it.
    """
    table = _read(path, ("camera", FILE, TIME), f"the columns must be camera,{FILE},{TIME}")
    by_name = {(photo.camera, photo.path.name): photo.path for photo in photos}
    found: dict[Path, float] = {}
    for camera, file, time_s in zip(table.cells["camera"], table.cells[FILE], time_stamps(table), strict=True):
        place = by_name.get((camera, file), path.parent / _of_any_system(path.parent, file))
        found[Path(os.path.realpath(place))] = time_s
    return found


def _of_any_system(folder: Path, name: str) -> str:
    """A file's name, of which backslashes are those of Windows unless a file is called so."""
    is_windows = "\\" in name and "/" not in name and "\0" not in name and not (folder / name).exists()
    return PureWindowsPath(name).as_posix() if is_windows else name


def _read(path: Path, required: Sequence[str], wanted: str) -> CsvTable:
    text = read_text(path, "a table of photos", MAX_TABLE_BYTES)
    table = read_table(path, text, lambda names: column_fault(names, required, wanted), holds="photos")
    table.require(np.array(["\0" not in name for name in table.cells[FILE]]), f"{FILE} must be the name of one")
    return table
