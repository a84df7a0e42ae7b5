"""`detected.json` in a folder of overlays: what was found in each photo, and which picture shows it."""

import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from calib.files import write_files
from calib.inputs.records import ImageRecord, Records, image_record, measurable
from calib.report.own_file import MOST_PHOTOS, own_to_json, read_own, require_counts
from designer.errors import InputError

if TYPE_CHECKING:
    from calib.detect.batch import PhotoResult
    from designer.target import TargetGeometry

DETECTED_FILE = "detected.json"
FORMAT = "ringsolid.detected"
REMEDY = "detect again"


@dataclass(frozen=True)
class DetectedPhoto:
    """A photo that was searched, or could not be."""

    record: ImageRecord
    sigma_px: float | None  # median standard deviation of the centres; None: there are none
    overlay: str  # within the folder; "": there is none
    overlay_failure: str = ""  # why

    @property
    def expected(self) -> int:
        """Features of the faces that show, without those that are seen too flat."""
        return sum(measurable(face) for face in self.record.faces if face.face is not None)


@dataclass(frozen=True)
class DetectedFile:
    """The file's keys."""

    target: str  # its file, as it was given
    face_count: int
    layout_id: str
    geometry_id: str
    detector: str
    table: str  # the detections, as they were given
    table_from_here: str  # the same from this folder; "" if there is no way
    photos: tuple[DetectedPhoto, ...]
    failures: tuple[str, ...]  # arguments that stood for no photo, one line each
    format: Literal["ringsolid.detected"] = "ringsolid.detected"
    version: Literal[1] = 1

    @property
    def records(self) -> Records:
        """What happened to each photo, as the records beside the detections have it."""
        return Records(self.detector, self.layout_id, self.geometry_id, tuple(photo.record for photo in self.photos))


def write_detected(
    folder: Path,
    target: Path,
    geometry: "TargetGeometry",
    table: Path,
    results: "Sequence[PhotoResult]",
    sigmas_px: Sequence[float],
    failures: Sequence[str],
    *,
    overlays: Path | None = None,
) -> Path:
    """Write `detected.json`; its path.

    Args:
        folder: of the page.
        target: its file.
        geometry: the target.
        table: the detections that were written.
        results: of each photo.
        sigmas_px: median standard deviation of each photo's centres; nan without centres.
        failures: arguments that stood for no photo.
        overlays: their folder, within the page's (default: the page's).

    Raises:
        InputError: another file has that name, or it cannot be written.
    """
    from designer.answer import program

    path = folder / DETECTED_FILE
    way = "" if overlays is None or overlays == folder else f"{overlays.relative_to(folder).as_posix()}/"
    file = DetectedFile(
        str(target), geometry.face_count, geometry.layout_id, geometry.geometry_id, program(), str(table),
        _from_folder(table, folder),
        tuple(_photo(result, sigma, way) for result, sigma in zip(results, sigmas_px, strict=True)), tuple(failures),
    )  # fmt: skip
    write_files({path: own_to_json(asdict(file))})
    return path


def _from_folder(path: Path, folder: Path) -> str:
    """The way from a folder to a file, with "/" between folders."""
    try:
        return Path(os.path.relpath(os.path.realpath(path), os.path.realpath(folder))).as_posix()
    except ValueError:  # on another drive
        return ""


def _photo(result: "PhotoResult", sigma_px: float, way: str) -> DetectedPhoto:
    if result.seen is None:
        return DetectedPhoto(ImageRecord(result.photo.name, None, 0, 0, (), (), result.failure), None, "")
    overlay = "" if result.overlay is None else f"{way}{result.overlay.name}"
    known = sigma_px if math.isfinite(sigma_px) else None
    return DetectedPhoto(image_record(result.seen), known, overlay, result.overlay_failure)


def read_detected(folder: Path) -> DetectedFile:
    """Read `detected.json`.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names it.
    """
    path = folder / DETECTED_FILE
    file = read_own(path, DetectedFile, REMEDY)
    if not 0 < len(file.photos) <= MOST_PHOTOS:
        raise InputError(f"{path}: {len(file.photos)} photos; there are 1 to {MOST_PHOTOS}; {REMEDY}")
    faces = [face for photo in file.photos for face in photo.record.faces]
    require_counts(path, (file.face_count, *_counts(file)), REMEDY)
    if any(face.face is not None and not 0 <= face.face < file.face_count for face in faces):
        raise InputError(f"{path}: names a face that the target does not have; {REMEDY}")
    return file


def _counts(file: DetectedFile) -> list[int]:
    """All numbers of things in it."""
    counts: list[int] = []
    for photo in file.photos:
        record = photo.record
        counts += (record.features, record.rejected, photo.expected)
        for face in record.faces:
            counts += (face.rings_found, face.rings_expected, abs(face.margin), *(count for _, count in face.missing))
    return counts
