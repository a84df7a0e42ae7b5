"""The folder of a session: photos are written to it as they are taken, and a record by which it can be resumed.

    OUT/session.json     what is photographed, by which sources, and which photos were deleted
    OUT/photos/0001.png  each frame that was taken, grey, as it was judged
    OUT/photos/left/...  of several cameras a folder each, photos of one moment named alike
    OUT/photos.csv       of several cameras, at the end: which photos count, and which are of one moment
    OUT/...              at the end what `calib run` writes

A photo that is deleted on the page stays where it is and is only left out, so that nothing is ever lost.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2

from calib.core.csv_table import csv_bytes, csv_cell
from calib.images.photo import Grey
from calib.observe.photos import images_in
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import check_folder, write_files
from designer.base.marks import Length, Line, Word
from designer.base.own_files import require_ours
from designer.base.words import counted, shown
from designer.target import TargetGeometry

PHOTOS, SESSION_FILE = "photos", "session.json"
TABLE_FILE = "photos.csv"
"""Which photos count, and which were taken at once, as `calib rig --table` reads it."""
LIGHTLY = (cv2.IMWRITE_PNG_COMPRESSION, 1)
"""A photo of a megapixel is written in 20 ms; thoroughly packed it takes ten times as long and is hardly smaller."""
MOST_PHOTOS, MOST_SOURCES = 9999, 16


@dataclass(frozen=True)
class SessionRecord:
    """What a folder keeps of a session."""

    layout_id: Word  # of the target
    geometry_id: Word
    sources: Annotated[tuple[Line, ...], Length(1, MOST_SOURCES)]
    left_out: Annotated[tuple[Annotated[str, Length(1, 4000)], ...], Length(0, MOST_PHOTOS)] = ()  # deleted photos


SESSION = FileKind(SessionRecord, "session", "a session.json", "begin another session, in another folder with -o")


class PhotoFolder:
    """Where one session's photos go.

    Args:
        folder: of the session.
        target: that is photographed.
        sources: what the page calls the cameras.
        resume: whether it holds a session that is to go on.
        cameras: the cameras' names, of which folders are made; as the sources are called, unless told.

    Raises:
        InputError: the folder takes no files, holds another session's photos, or another target's.
    """

    def __init__(
        self, folder: Path, target: TargetGeometry, sources: tuple[str, ...], *, resume: bool,
        cameras: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        self.folder, self.photos = folder, folder / PHOTOS
        names = cameras or sources
        self._place_of = {name: self.photos / name if len(names) > 1 else self.photos for name in names}
        for place in (folder, *self._place_of.values()):
            check_folder(place)
        require_ours(folder / SESSION_FILE, kind=SESSION.format)
        before = SESSION.read_if_there(folder / SESSION_FILE)
        there = self.kept
        if not resume and (there or before is not None):
            raise InputError(
                f"{folder}: holds a session with {counted(len(there), 'photo')}; go on by --resume, "
                "or choose another folder with -o"
            )
        if resume and before is None:
            raise InputError(f"{folder}: holds no session ({SESSION_FILE}); leave --resume out to begin one")
        if before is not None and before.layout_id != target.layout_id:
            raise InputError(
                f"{folder}: its session is of a target of layout {shown(before.layout_id)}, this one has "
                f"{target.layout_id}; give the target file that it was begun with"
            )
        if before is not None and before.sources != sources:
            raise InputError(
                f"{folder}: its session is of {', '.join(map(shown, before.sources))}, not of "
                f"{', '.join(map(shown, sources))}; give the cameras that it was begun with, in their order"
            )
        left_out = () if before is None else before.left_out
        self.record = SessionRecord(target.layout_id, target.geometry_id, sources, left_out)
        self._number = max((int(path.stem) for _, path in there if path.stem.isdecimal()), default=0)

    def begin(self) -> None:
        """Write the record; InputError: the folder cannot be written."""
        write_files({self.folder / SESSION_FILE: SESSION.text(self.record)})

    @property
    def kept(self) -> list[tuple[str, Path]]:
        """The photos that were written, with their cameras, in their order, those that are left out among them."""
        return [(name, path) for name, place in self._place_of.items() if place.is_dir() for path in images_in(place)]

    def write(self, pixels_of: Mapping[str, Grey]) -> dict[str, Path]:
        """Write the frames of some cameras under one name, all or none; where they are.

        Raises:
            NotWrittenError: the disk is full, or the folder is gone and cannot be made.
            InputError: somebody else's file has the name.
        """
        name = f"{self._number + 1:04d}.png"
        files = {camera: self._place_of[camera] / name for camera in pixels_of}
        write_files({files[camera]: _packed(pixels, files[camera]) for camera, pixels in pixels_of.items()})
        self._number += 1
        return files

    def leave_out(self, name: str, *, is_left_out: bool = True) -> None:
        """Note that a photo is not to count, or is to count again; NotWrittenError: the disk is full."""
        others = tuple(one for one in self.record.left_out if one != name)
        record = replace(self.record, left_out=(*others, name) if is_left_out else others)
        write_files({self.folder / SESSION_FILE: SESSION.text(record)})
        self.record = record

    def write_table(self, moments: Mapping[str, Mapping[str, Path]]) -> Path:
        """Write which photos count, and which were taken at once: `{"0001": {"left": ..., "right": ...}}`.

        Raises:
            InputError: the folder cannot be written.
        """
        rows = (
            (camera, moment, csv_cell(os.path.relpath(files[camera], self.folder)))
            for moment, files in moments.items()
            for camera in self._place_of
            if camera in files
        )
        write_files({self.folder / TABLE_FILE: csv_bytes((), ("camera", "frame", "file"), rows)})
        return self.folder / TABLE_FILE


def _packed(pixels: Grey, path: Path) -> bytes:
    is_packed, packed = cv2.imencode(".png", pixels, LIGHTLY)
    if not is_packed:
        raise InputError(f"{path}: a frame of shape {pixels.shape} cannot be written; choose another resolution")
    return packed.tobytes()
