"""Files of cameras and rigs of any kind that is known, found out by their content, or by the files of a folder."""

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import CAMERA, Camera, camera_or_preset
from calib.cameras.formats import ACCEPTED_PX, FORMATS, OWN, READ_FORMATS, READ_RIG_FORMATS, RIG_FORMATS
from calib.cameras.formats.format import CameraFormat, ReadCamera
from calib.cameras.formats.parsing import UNIT_WORDS, outline, pick, unit_mm
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat
from calib.cameras.refit import FOCAL_AND_CENTRE, Refit
from calib.cameras.rig import ALONE, MOST_CAMERAS, RIG, Rig, rig_of_one
from calib.core.registry import Registry
from designer.base.errors import InputError
from designer.base.files import parse_json, read_small, read_small_text, read_spec_file
from designer.base.words import shown, suggestion_or_all
from designer.kinds.presets import preset_names

HEAD = 2**16
"""Characters from which a file's kind is told."""
ONE_OF = "#"
"""Between a file of several cameras and the name of one."""
VERDICT_FILE, POSES_ONLY, LARGEST_VERDICT = "verdict.json", "pose_errors.csv", 16 * 2**20
"""Of a folder of results: the verdict, and what `calib hand-eye --poses` writes, which solves no camera."""
BINARY = {".bin": "colmap", ".mat": "matlab"}
"""The formats of files that are no text, by their ends."""
Format = TypeVar("Format", CameraFormat, RigFormat)
CLOSE_MM, FAR_MM = 2.0, 1e5
"""Cameras whose centres are all closer than this, or all farther apart, may be in another unit."""
_OWN_CAMERA = re.compile(rf'\A\s*\{{\s*"format"\s*:\s*"{re.escape(CAMERA.format)}"')


@dataclass(frozen=True, eq=False)
class OpenedRig:
    """A rig with the kind of file it came from."""

    format: RigFormat
    read: ReadRig
    paths: tuple[Path, ...] = ()  # of the files it was read from; (): of none

    def is_file(self, place: Path) -> bool:
        """Whether a place is one of the files the rig was read from."""
        try:
            return any(place.samefile(path) for path in self.paths if place.exists())
        except OSError:
            return False


def open_rig(
    place: Path, format_name: str | None = None, unit: str | None = None, accept_px: float = ACCEPTED_PX
) -> OpenedRig:
    """The rig of a file, or of a folder with its files; a camera's file is that of a rig of one.

    Args:
        place: of a file or folder, or one camera of a file, `rig.json#left`.
        format_name: one of `RIG_FORMATS`; None: found out.
        unit: of lengths, "mm" or "m", where the format has none of its own; None: what the file says, or usually has.
        accept_px: how far a camera may be off from the file's lens, where that is none of ours and is fitted.

    Raises:
        InputError: no such file, of no known kind, or not valid, or a lens that no camera comes close to; the message
            names it.
    """
    kind = rig_format_of(place) if format_name is None else find_format(format_name, READ_RIG_FORMATS, "rig")
    if kind is None and _is_of_one(place):
        if unit is not None:
            raise InputError(f"--from-unit {unit}: is of lengths, and {place} is one camera; leave it out")
        name = ALONE if os.path.lexists(place) else str(place).rpartition(ONE_OF)[2]
        return as_rig(open_camera(str(place), accept_px=accept_px), name)
    if kind is None:
        if not place.is_dir():
            file_text(place, RIG.largest_bytes, "a rig file")  # says what is wrong with it, if it is not read
        titles = ", ".join(one.title for one in READ_RIG_FORMATS.values())
        raise InputError(f"{place}: not a rig file of a known kind; there are {titles}")
    require_unit(kind, unit, "--from-unit")
    files, paths = _files(place, kind)
    origin = place.parent if kind.is_folder and not place.is_dir() else place
    found = kind.read(RigFiles(files, str(origin), unit or kind.unit))
    for name, fit in zip(found.rig.names, found.refits, strict=True):
        _require_close(fit, accept_px, f"{place}: camera {shown(name)}")
    if found.unit is not None:
        if unit is not None and unit != found.unit:
            raise InputError(f"{place}: says that its lengths are in {shown(found.unit)}; leave out --from-unit {unit}")
        return OpenedRig(kind, found, paths)
    said = "as told" if unit is not None else f"as {kind.title} usually has it; another with --from-unit"
    remarks = (f"lengths are taken as {UNIT_WORDS[unit or kind.unit]}, {said}", *_doubts(found.rig))
    return OpenedRig(kind, replace(found, remarks=(*remarks, *found.remarks)), paths)


def file_text(path: Path, most: int, what: str, format_name: str | None = None) -> str:
    """The text of a file, or the one that a binary file stands for.

    Raises:
        InputError: it cannot be read; the message names it.
    """
    kind = READ_FORMATS[BINARY[path.suffix.lower()]] if path.suffix.lower() in BINARY else None
    if kind is None or kind.decode is None or format_name not in (None, kind.name):
        return read_small_text(path, most, what)
    return kind.decode(read_small(path, kind.max_bytes, what), str(path))


def _is_of_one(place: Path) -> bool:
    """Whether a place is that of one camera: its file, a folder with its `camera.json`, or one of several in a file."""
    if not os.path.lexists(place):
        before, mark, _ = str(place).rpartition(ONE_OF)
        return bool(mark) and os.path.lexists(before)
    if place.is_dir():
        return (place / FORMATS[OWN].file_name).is_file()
    return place.is_file() and recognise(file_text(place, RIG.largest_bytes, "a rig file")) is not None


def rig_format_of(place: Path) -> RigFormat | None:
    """The kind of rig that a file or a folder looks like, if it looks like any; a broken place is none."""
    if place.is_dir():
        return next((kind for kind in READ_RIG_FORMATS.values() if _in_folder(place, kind)), None)
    try:
        text = file_text(place, RIG.largest_bytes, "a rig file")[:HEAD]
    except InputError:
        return None
    return recognise_rig(text)


def recognise_rig(text: str) -> RigFormat | None:
    """The kind of rig file a text looks like, if it looks like any; a camera's of ours is none."""
    if _OWN_CAMERA.match(text):
        return None
    return _recognised(READ_RIG_FORMATS, text)


def _recognised(formats: Registry[Format], text: str) -> Format | None:
    """The first kind that is found in the beginning of a text, or else in the names of its JSON."""
    parts = (text[:HEAD], outline(text))
    return next((kind for part in parts for kind in formats.values() if kind.recognised.search(part)), None)


def find_format(name: str, formats: Registry[Format], what: str) -> Format:
    """The format of that name, of a camera or a rig.

    Raises:
        InputError: there is none.
    """
    if name not in formats:
        hint = suggestion_or_all(name, formats)
        raise InputError(f"unknown {what} format {shown(name)}{hint}")
    return formats[name]


def require_unit(kind: RigFormat, unit: str | None, option: str) -> None:
    """Refuse a unit that is none, or that the format's tool does not know.

    Raises:
        InputError: the message names the option.
    """
    if unit is None:
        return
    unit_mm(unit)
    if kind.has_own_unit and unit != kind.unit:
        raise InputError(f"{option} {unit}: {kind.title} is in {UNIT_WORDS[kind.unit]}; leave out {option}")


def _in_folder(folder: Path, kind: RigFormat) -> bool:
    """Whether a folder holds files of a kind; of cameras that are a file each it takes two."""
    if not kind.is_folder:
        return (folder / kind.file_name).is_file()
    if kind.needed:
        return any((folder / name).is_file() for name in kind.needed)
    return len(_matching(folder, kind)) > 1


def _matching(folder: Path, kind: RigFormat) -> list[Path]:
    found = sorted({path for pattern in kind.patterns for path in folder.glob(pattern) if path.is_file()})
    if len(found) > MOST_CAMERAS + len(kind.patterns):
        raise InputError(f"{folder}: {len(found)} files of {kind.title}; a rig has at most {MOST_CAMERAS} cameras")
    return found


def _files(place: Path, kind: RigFormat) -> tuple[Mapping[str, str], tuple[Path, ...]]:
    """The texts by name, and where they are: of one file, or of those beside it that belong to it."""
    if kind.is_folder:
        folder = place if place.is_dir() else place.parent
        paths = _matching(folder, kind)
        if not paths:
            raise InputError(f"{place}: no file of {kind.title}; it has {', '.join(kind.patterns)}")
        if not place.is_dir() and place.name in kind.needed:  # what was named, not what lies beside it
            paths = [path for path in paths if path.name == place.name or path.name not in kind.needed]
    else:
        paths = [place / kind.file_name if place.is_dir() else place]
    most = RIG.largest_bytes if kind.name == OWN else kind.cameras.max_bytes
    return {path.name: file_text(path, most, f"a file of {kind.title}", kind.name) for path in paths}, tuple(paths)


def _doubts(rig: Rig) -> tuple[str, ...]:
    """That a unit is hardly right, if so it is."""
    center = rig.center_mm
    span = np.linalg.norm(center - center[0], axis=1).max()
    if len(center) > 1 and (0 < span < CLOSE_MM or span > FAR_MM):
        return (f"the cameras are {span:.3g} mm apart at most; if that cannot be, say the unit with --from-unit",)
    return ()


@dataclass(frozen=True, eq=False)
class OpenedCamera:
    """A camera with the kind of file it came from."""

    format: CameraFormat
    read: ReadCamera
    path: Path | None = None  # of the file it was read from; None: a template

    def is_file(self, place: Path) -> bool:
        """Whether a place is the very file the camera was read from."""
        try:
            return self.path is not None and place.samefile(self.path)
        except OSError:
            return False


def as_rig(opened: OpenedCamera, name: str = ALONE) -> OpenedRig:
    """A camera as a rig of that camera alone."""
    rig = ReadRig(rig_of_one(opened.read.camera, name), (opened.read.refit,), "mm", opened.read.remarks)
    return OpenedRig(RIG_FORMATS[OWN], rig, () if opened.path is None else (opened.path,))


def only_camera(opened: OpenedRig, row: int = 0) -> OpenedCamera:
    """A camera of a rig; where it stands is left behind."""
    found = opened.read
    camera = ReadCamera(found.rig.cameras[row], found.refits[row], found.remarks if len(found.refits) == 1 else ())
    return OpenedCamera(FORMATS[OWN], camera, next(iter(opened.paths), None))


def _require_close(fit: Refit | None, accept_px: float, camera: str) -> None:
    """Refuse a fit to a file's lens, which is none of ours, that is off by more."""
    if fit is not None and fit.max_px > accept_px:
        allowed = math.ceil(fit.max_px * 100) / 100
        raise InputError(
            f"{camera}: its lens is none of ours, and the closest, {fit.camera.model}, is off by up to "
            f"{fit.max_px:.3g} px, more than {accept_px:g} px; where that will do, make a camera of it by calib "
            f"convert --to json --accept {allowed:g}px"
        )


def open_camera(name: str, format_name: str | None = None, accept_px: float = ACCEPTED_PX) -> OpenedCamera:
    """The camera of a file, of a template, or of one of a file's several cameras, named as in `FILE#NAME`.

    A folder stands for its `camera.json`, or for its `rig.json`, as in `FOLDER#NAME`. The format is found out if it is
    not given. A lens that is none of ours is fitted, and may be off by `accept_px`.

    Raises:
        InputError: no such file, of no known kind, or not valid, or a lens that no camera comes close to; the message
            names it.
    """
    known = None if format_name is None else find_format(format_name, READ_FORMATS, "camera")
    path, is_preset = Path(name), name in preset_names("cameras")
    before, mark, after = name.rpartition(ONE_OF)
    is_there = path.exists() or os.path.lexists(before)
    is_misspelt = not path.suffix and not path.parent.name and not is_there  # perhaps a template
    if format_name in (None, OWN) and (is_preset or is_misspelt or path.suffix.lower() == ".toml"):
        own = None if is_preset else path
        camera = camera_or_preset(name)
        return OpenedCamera(FORMATS[OWN], ReadCamera(camera, remarks=_taken_as_none(camera, own)), own)
    is_one_of = bool(mark) and not os.path.lexists(name)  # a file may have the mark in its own name
    path, wanted = (Path(before), after) if is_one_of else (Path(name), None)
    said: tuple[str, ...] = ()
    if path.is_dir():
        name_in, of_rig = FORMATS[OWN].file_name, path / RIG_FORMATS[OWN].file_name
        is_rig = not (path / name_in).exists() and of_rig.is_file()
        path, said = (of_rig, ()) if is_rig else solved_in(path, name_in)
    largest = max(RIG.largest_bytes, FORMATS[OWN].max_bytes) if known is None else known.max_bytes
    text = file_text(path, largest, "a camera file", format_name)
    kind = known or recognise(text)
    rig_kind = None if known is not None or (kind is not None and kind.holds_many) else recognise_rig(text)
    if rig_kind is not None:
        found = open_rig(path, rig_kind.name, accept_px=math.inf)
        row = pick({name: row for row, name in enumerate(found.read.rig.names)}, wanted, str(path))
        _require_close(found.read.refits[row], accept_px, name)
        return replace(only_camera(found, row), path=path)
    if kind is None:
        if text.lstrip()[:1] == "{":
            parse_json(text, path, "a camera file")  # which says what is wrong with it, if it is no JSON
        raise InputError(f"{path}: {_why_unknown(text)}; if you know, say --from {'|'.join(READ_FORMATS)}")
    if len(text) > kind.max_bytes:
        raise InputError(f"{path}: more than {kind.max_bytes} bytes; {kind.title} is smaller")
    if wanted is not None and not kind.holds_many:
        raise InputError(f"{path}: {kind.title} holds one camera; leave out {shown('#' + wanted)}")
    read = kind.read(text, str(path), wanted)
    _require_close(read.refit, accept_px, name)
    return OpenedCamera(kind, replace(read, remarks=(*said, *read.remarks)), path)


def _taken_as_none(camera: Camera, path: Path | None) -> tuple[str, ...]:
    """Which numbers of its lens a TOML file lacks, which may be cut off; one that has none of them means none."""
    given = {} if path is None else read_spec_file(path).get("parameters")
    names = parameter_names(camera.model)[FOCAL_AND_CENTRE:]
    missing = [name for name in names if isinstance(given, dict) and name not in given]
    if not missing or len(missing) == len(names):
        return ()
    return (f"of the lens's {len(names)} numbers the file lacks {' '.join(missing)}: taken as of a lens without",)


def solved_in(folder: Path, name: str) -> tuple[Path, tuple[str, ...]]:
    """The file of a name in a folder of results; of several models that which its verdict names, which is said.

    Raises:
        InputError: it holds those of several models and no verdict, or of a rig's cameras, one of which is to be named.
    """
    if (folder / name).exists():
        return folder / name, ()
    of_rig = sorted(folder.glob(f"cameras/*/{name}"))
    if len(of_rig) == 1:
        return of_rig[0], ()
    inside = of_rig or sorted(folder.glob(f"*/{name}"))
    best = "" if of_rig else _best_model(folder)
    folders = [str(path.parent) for path in inside]
    for path in inside:
        if path.parent.name == best:
            others = ", ".join(one for one in folders if one != str(path.parent))
            return path, (f"of several models that which the verdict names is taken, {best}; or name one: {others}",)
    if inside:
        what = "camera" if of_rig else "model"
        raise InputError(
            f"{folder}: holds results in a folder of each {what}; name the folder of one: {', '.join(folders)}"
        )
    require_camera(folder, name)
    return folder / name, ()


def _best_model(folder: Path) -> str:
    """The model that a folder's verdict names; "": there is none."""
    place = folder / VERDICT_FILE
    try:
        document = parse_json(read_small_text(place, LARGEST_VERDICT, "a verdict"), place, "a verdict")
    except InputError:
        return ""
    verdict = document.get("verdict") if isinstance(document, dict) else None
    return str(verdict.get("model")) if isinstance(verdict, dict) else ""


def require_camera(folder: Path, name: str) -> None:
    """Refuse a folder of what was solved from poses, without a camera's file of that name.

    Raises:
        InputError: it holds none.
    """
    if (folder / POSES_ONLY).is_file() and not (folder / name).exists():
        raise InputError(f"{folder}: holds poses only, no camera; name the folder or the file of a camera")


def recognise(text: str) -> CameraFormat | None:
    """The kind of camera file a text looks like, if it looks like any."""
    return _recognised(READ_FORMATS, text)


def _why_unknown(text: str) -> str:
    """What a file may be that is no camera file."""
    head = text[:HEAD]
    if "<opencv_storage>" in head:
        return "OpenCV's XML is not read; save it as .yaml"
    if '"ringsolid.' in head:
        return "no camera file; name the camera.json beside it"
    return "not a camera file of a known kind"
