"""Tables of photos: `camera,frame,file[,time_s]`, and time stamps `camera,file,time_s`."""

import os
from collections.abc import Sequence
from pathlib import Path, PureWindowsPath

import numpy as np

from calib.observe.csv_table import CsvTable, column_fault, column_names, read_table, read_text
from calib.observe.rig_photos import RigPhoto
from calib.observe.rig_sightings import SEEN, TIME, time_stamps
from designer.base.errors import InputError

MAX_FILE_BYTES = 64 * 2**20
FRAME, FILE = "frame", "file"
KIND = "a table of files or of sightings"


def is_sightings(path: Path) -> bool:
    """Whether a table holds pixels, not files."""
    return FILE not in column_names(path, KIND) or tells_cameras(path)


def tells_cameras(path: Path) -> bool:
    """Whether a table holds pixels, of cameras that it names."""
    return column_names(path, KIND) >= set(SEEN)


def read_photo_table(path: Path) -> tuple[RigPhoto, ...]:
    """Photos by a table, files as they are from its folder; without a column frame they are joined by their times.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names it.
    """
    table = _read(path, ("camera", FILE), f"the columns must be camera,{FILE}, {FRAME} or {TIME}, or both")
    if FRAME not in table.cells and TIME not in table.cells:
        raise InputError(f"{path}: has neither a column {FRAME} nor {TIME}; one tells which photos were taken at once")
    table.require_filled(*(name for name in ("camera", FRAME, FILE) if name in table.cells))
    table.require(np.array(["\0" not in name for name in table.cells[FILE]]), f"{FILE} must be the name of one")
    count = len(table.lines)
    frames = table.cells.get(FRAME, ("",) * count)
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
    text = read_text(path, "a table of photos", MAX_FILE_BYTES)
    return read_table(path, text, lambda names: column_fault(names, required, wanted), holds="photos")
