"""`photos.json` in a folder of pictures: what a command tells of its photos, one by one and all together.

The command that made the pictures knows all there is to be said. It says it once, in the blocks of a page; one builder
makes the page of them, at once and whenever it is built again.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pydantic
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.camera_file import camera_from_mapping, camera_to_json
from calib.core.files import write_files
from calib.core.rigid import rigid_fault
from designer.errors import InputError
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Level, Paragraph, Steps, Table
from designer.small_file import JsonValue, parse_json, read_small_text
from designer.words import printable

PHOTOS_FILE = "photos.json"
MAX_FILE_BYTES = 256 * 2**20
MOST_PHOTOS = 100_000
LONGEST_PLACE = 200
REMEDY = "give the command that made the pictures again"
Kind: TypeAlias = Literal["photos", "undistorted", "detections", "poses"]
KIND_WORDS: Mapping[Kind, str] = {
    "photos": "Rendered photos", "undistorted": "Undistorted photos", "detections": "Detections",
    "poses": "Camera poses",
}  # fmt: skip
Row: TypeAlias = tuple[float, float, float, float]
Matrix: TypeAlias = tuple[Row, Row, Row, Row]
CameraMapping: TypeAlias = dict[str, pydantic.JsonValue]
"""A camera as its own file has it."""


@dataclass(frozen=True)
class ToldPhoto:
    """What is told of one photo."""

    name: str
    cells: tuple[Cell, ...]  # one a column, without links
    picture: str = ""  # of it, within the folder; "": there is none
    caption: str = ""
    level: Level | None = None  # None: like the others
    badness: float | None = None  # the worst are shown first; None of all: evenly from first to last
    cam_from_target: Matrix | None = None


@dataclass(frozen=True)
class ToldSection:
    """A part of the page; its tables have no links."""

    title: str
    blocks: tuple[Findings | Table | Command | Steps | Paragraph, ...]
    lead: str = ""


@dataclass(frozen=True)
class ToldPhotos:
    """The file's keys."""

    kind: Kind
    headline: Headline
    facts: tuple[tuple[str, str], ...]
    columns: tuple[Column, ...]  # of the table of photos, after the one with their names
    photos: tuple[ToldPhoto, ...]
    order: str  # of the pictures, as a sentence
    files: tuple[tuple[str, str], ...]  # of the folder, and what they are for
    lead: str = ""  # of the photos, in a sentence
    notes: tuple[Finding, ...] = ()  # on the photos
    table_note: str = ""
    before: tuple[ToldSection, ...] = ()  # the photos
    after: tuple[ToldSection, ...] = ()
    geometry_id: str = ""  # of the target; "": without one
    camera: CameraMapping | None = None  # that took the photos
    pinhole: CameraMapping | None = None  # that undistorted photos are of
    format: Literal["ringsolid.photos"] = "ringsolid.photos"
    version: Literal[1] = 1

    @property
    def posed(self) -> tuple[ToldPhoto, ...]:
        """The photos of which it is known where they were taken."""
        return tuple(photo for photo in self.photos if photo.cam_from_target is not None)

    @property
    def cam_from_target(self) -> NDArray[np.float64]:
        """Where these were taken.  # (V, 4, 4)"""
        return np.array([photo.cam_from_target for photo in self.posed], dtype=np.float64).reshape(-1, 4, 4)


KEYS = {field.name for field in fields(ToldPhotos)}


def camera_mapping(camera: Camera) -> CameraMapping:
    """A camera for the file."""
    mapping: CameraMapping = json.loads(camera_to_json(camera))
    return mapping


def matrix_of(pose: NDArray[np.float64]) -> Matrix:
    """A pose (4, 4) for the file."""
    (a, b, c, d) = ((float(row[0]), float(row[1]), float(row[2]), float(row[3])) for row in pose)
    return a, b, c, d


def write_photos(folder: Path, told: ToldPhotos) -> Path:
    """Write `photos.json`, a line a field, its format first; its path.

    Raises:
        InputError: another file has that name, or it cannot be written.
    """
    path = folder / PHOTOS_FILE
    document = asdict(told)
    first = {name: document[name] for name in ("format", "version")}
    lines = (
        f"{json.dumps(name)}: {json.dumps(value, allow_nan=False)}" for name, value in {**first, **document}.items()
    )
    write_files({path: ("{\n" + ",\n".join(lines) + "\n}\n").encode()})
    return path


def read_photos(folder: Path) -> ToldPhotos:
    """Read `photos.json`, all its text but the pictures' paths as one can print it.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names file and place.
    """
    path, what = folder / PHOTOS_FILE, "a photos.json"
    document = _on_one_line(parse_json(read_small_text(path, MAX_FILE_BYTES, what), path, what))
    if not isinstance(document, dict) or document.keys() != KEYS:
        raise InputError(f"{path}: its keys are not those of this version; {REMEDY}")
    try:
        told = pydantic.TypeAdapter(ToldPhotos).validate_python(document)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))[:LONGEST_PLACE] or "the document"
        raise InputError(f"{path}: {printable(place)}: {first['msg']}; {REMEDY}") from None
    if fault := _fault(told):
        raise InputError(f"{path}: {fault}; {REMEDY}")
    for key, mapping in (("camera", told.camera), ("pinhole", told.pinhole)):
        if mapping is not None:
            camera_in(folder, mapping, key)
    return told


def _on_one_line(value: JsonValue) -> JsonValue:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [_on_one_line(one) for one in value]
    if isinstance(value, dict):
        return {key: one if key == "picture" else _on_one_line(one) for key, one in value.items()}
    return value


def _fault(told: ToldPhotos) -> str:
    """What makes it none that a command wrote; "" if nothing does."""
    if not 0 < len(told.photos) <= MOST_PHOTOS:
        return f"{len(told.photos)} photos; there are 1 to {MOST_PHOTOS}"
    poses = told.cam_from_target
    if fault := rigid_fault(poses):
        return f"pose {fault[0]} (from 0) {fault[1]}"
    if not poses[:, :3, 3].any(axis=1).all():
        return "a camera stands in the target's origin"
    tables = [(told.columns, [photo.cells for photo in told.photos])]
    for part in (*told.before, *told.after):
        tables += [(block.columns, list(block.rows)) for block in part.blocks if isinstance(block, Table)]
    if any(len(row) != len(columns) or any(cell.path for cell in row) for columns, rows in tables for row in rows):
        return "a row does not fit its table"
    return ""


def camera_in(folder: Path, mapping: CameraMapping, key: str) -> Camera:
    """A camera of the file.

    Raises:
        InputError: it is none; the message names file and key.
    """
    return camera_from_mapping(mapping, f"{folder / PHOTOS_FILE}: {key}")
