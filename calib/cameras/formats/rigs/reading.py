"""Rig files of any kind that is known, found out by their content, or by the files of a folder."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.cameras.camera import CAMERA
from calib.cameras.formats.parsing import outline
from calib.cameras.formats.rigs import OWN_RIG, RIG_FORMATS
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat
from calib.cameras.formats.rigs.poses import UNIT_WORDS, unit_mm
from calib.cameras.rig import MOST_CAMERAS, RIG, Rig
from designer.base.errors import InputError
from designer.base.files import read_small_text
from designer.base.words import shown, suggestion

HEAD = 2**16
"""Characters from which a file's kind is told."""
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


def open_rig(place: Path, format_name: str | None = None, unit: str | None = None) -> OpenedRig:
    """The rig of a file, or of a folder with its files.

    Args:
        place: of a file or folder.
        format_name: one of `RIG_FORMATS`; None: found out.
        unit: of lengths, "mm" or "m", where the format has none of its own; None: what the file says, or usually has.

    Raises:
        InputError: no such file, of no known kind, or not valid; the message names it.
    """
    kind = find_rig_format(format_name) if format_name is not None else rig_format_of(place)
    if kind is None:
        if not place.is_dir():
            read_small_text(place, largest_bytes(), "a rig file")  # which says what is wrong with it, if it is not read
        titles = ", ".join(one.title for one in RIG_FORMATS.values())
        raise InputError(f"{place}: not a rig file of a known kind; there are {titles}")
    require_unit(kind, unit, "--from-unit")
    files, paths = _files(place, kind)
    origin = place.parent if kind.is_folder and not place.is_dir() else place
    found = kind.read(RigFiles(files, str(origin), unit or kind.unit))
    if found.unit is not None:
        if unit is not None and unit != found.unit:
            raise InputError(f"{place}: says that its lengths are in {shown(found.unit)}; leave out --from-unit {unit}")
        return OpenedRig(kind, found, paths)
    said = "as told" if unit is not None else f"as {kind.title} usually has it; another with --from-unit"
    remarks = (f"lengths are taken as {UNIT_WORDS[unit or kind.unit]}, {said}", *_doubts(found.rig))
    return OpenedRig(kind, replace(found, remarks=(*remarks, *found.remarks)), paths)


def rig_format_of(place: Path) -> RigFormat | None:
    """The kind of rig that a file or a folder looks like, if it looks like any; a broken place is none."""
    if place.is_dir():
        return next((kind for kind in RIG_FORMATS.values() if _in_folder(place, kind)), None)
    try:
        text = read_small_text(place, largest_bytes(), "a rig file")[:HEAD]
    except InputError:
        return None
    return recognise_rig(text)


def recognise_rig(text: str) -> RigFormat | None:
    """The kind of rig file a text looks like, if it looks like any; a camera's of ours is none."""
    if _OWN_CAMERA.match(text):
        return None
    kinds = RIG_FORMATS.values()
    found = next((kind for kind in kinds if kind.recognised.search(text[:HEAD])), None)
    if found is None and (names := outline(text)):
        found = next((kind for kind in kinds if kind.recognised.search(names)), None)
    return found


def find_rig_format(name: str) -> RigFormat:
    """The rig format of that name.

    Raises:
        InputError: there is none.
    """
    if name not in RIG_FORMATS:
        hint = suggestion(name, list(RIG_FORMATS)) or f"; there are {', '.join(RIG_FORMATS)}"
        raise InputError(f"unknown rig format {shown(name)}{hint}")
    return RIG_FORMATS[name]


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


def largest_bytes() -> int:
    """Of a rig's file: one of ours holds a covariance."""
    return RIG.largest_bytes


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
    most = largest_bytes() if kind.name == OWN_RIG else kind.cameras.max_bytes
    return {path.name: read_small_text(path, most, f"a file of {kind.title}") for path in paths}, tuple(paths)


def _doubts(rig: Rig) -> tuple[str, ...]:
    """That a unit is hardly right, if so it is."""
    center = rig.center_mm
    span = np.linalg.norm(center - center[0], axis=1).max()
    if len(center) > 1 and (0 < span < CLOSE_MM or span > FAR_MM):
        return (f"the cameras are {span:.3g} mm apart at most; if that cannot be, say the unit with --from-unit",)
    return ()
