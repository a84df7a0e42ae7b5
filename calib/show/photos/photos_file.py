"""`photos.json` in a folder of pictures: what a command tells of its photos, one by one and all together.

The command that made the pictures knows all there is to be said. It says it once, in the blocks of a page; one builder
makes the page of them, at once and whenever it is built again.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import rigid_fault
from designer.base.arrays import Array
from designer.base.file_kind import FileKind
from designer.base.files import JsonValue, write_files
from designer.base.marks import Hash, Length, Shape
from designer.base.words import printable
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Level, Paragraph, Steps, Table

PHOTOS_FILE = "photos.json"
GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the rings that could have been measured, of the readable photos with the target or a pose, and of the photos that
could be read. From 95 % on, what is missing is what nobody can see to: a hair on a ring, a finger at the edge. Below a
half, something is wrong with target file, light or focus, and what was found is no fair sample of the image."""
SHARE_RULE = f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %"
_WORST_FIRST: tuple[Level, ...] = ("bad", "usable", "good")
MOST_PHOTOS = 100_000
Kind: TypeAlias = Literal["photos"]
KIND_WORDS: Mapping[Kind, str] = {"photos": "Rendered photos"}


def level_of_share(share: float) -> Level:
    """Of a share of what should have been found."""
    return "good" if share >= GOOD_SHARE else "usable" if share >= USABLE_SHARE else "bad"


def worst_level(rows: Iterable[Finding]) -> Level:
    """Of checks."""
    return min((row.level for row in rows), key=_WORST_FIRST.index)


@dataclass(frozen=True, eq=False)
class ToldPhoto:
    """What is told of one photo."""

    name: str
    cells: tuple[Cell, ...]  # one a column, without links
    picture: str = ""  # of it, within the folder; "": there is none
    caption: str = ""
    level: Level | None = None  # None: like the others
    badness: float | None = None  # the worst are shown first; None of all: evenly from first to last
    cam_from_target: Annotated[Array, Shape(4, 4)] | None = None


@dataclass(frozen=True)
class ToldSection:
    """A part of the page; its tables have no links."""

    title: str
    blocks: tuple[Findings | Table | Command | Steps | Paragraph, ...]
    lead: str = ""


@dataclass(frozen=True, eq=False)
class ToldPhotos:
    """The file's keys."""

    kind: Kind
    headline: Headline
    facts: tuple[tuple[str, str], ...]
    columns: tuple[Column, ...]  # of the table of photos, after the one with their names
    photos: Annotated[tuple[ToldPhoto, ...], Length(1, MOST_PHOTOS)]
    order: str  # of the pictures, as a sentence
    files: tuple[tuple[str, str], ...]  # of the folder, and what they are for
    lead: str = ""  # of the photos, in a sentence
    notes: tuple[Finding, ...] = ()  # on the photos
    table_note: str = ""
    before: tuple[ToldSection, ...] = ()  # the photos
    after: tuple[ToldSection, ...] = ()
    geometry_id: Hash = ""  # of the target; "": without one
    camera: Camera | None = None  # that took the photos

    def __post_init__(self) -> None:
        poses = self.cam_from_target
        if fault := rigid_fault(poses):
            raise ValueError(f"pose {fault[0]} (from 0) {fault[1]}")
        if not poses[:, :3, 3].any(axis=1).all():
            raise ValueError("a camera stands in the target's origin")
        tables = [(self.columns, [photo.cells for photo in self.photos])]
        for part in (*self.before, *self.after):
            tables += [(block.columns, list(block.rows)) for block in part.blocks if isinstance(block, Table)]
        if any(len(row) != len(columns) or any(cell.path for cell in row) for columns, rows in tables for row in rows):
            raise ValueError("a row does not fit its table")

    @property
    def posed(self) -> tuple[ToldPhoto, ...]:
        """The photos of which it is known where they were taken."""
        return tuple(photo for photo in self.photos if photo.cam_from_target is not None)

    @property
    def cam_from_target(self) -> Array:
        """Where these were taken.  # (V, 4, 4)"""
        return np.array([photo.cam_from_target for photo in self.posed], dtype=np.float64).reshape(-1, 4, 4)


def told_table(told: ToldPhotos, is_linked: Callable[[str], bool] = lambda path: False) -> Table:
    """A row a photo, whose name leads to its picture where that is linked."""
    rows = tuple(
        (Cell(photo.name, path=photo.picture if is_linked(photo.picture) else "", level=photo.level), *photo.cells)
        for photo in told.photos
    )
    return Table("All photos", (Column("photo", is_number=False), *told.columns), rows, told.table_note)


PHOTOS = FileKind(
    ToldPhotos, "photos", "a photos.json", "give the command that made the pictures again", largest_bytes=256 * 2**20
)


def write_photos(folder: Path, told: ToldPhotos) -> Path:
    """Write `photos.json`; its path.

    Raises:
        InputError: another file has that name, or it cannot be written.
    """
    path = folder / PHOTOS_FILE
    write_files({path: PHOTOS.text(told)})
    return path


def read_photos(folder: Path) -> ToldPhotos:
    """Read `photos.json`, all its text but the pictures' paths as one can print it.

    Raises:
        InputError: it cannot be read, or breaks a rule; the message names file and place.
    """
    path = folder / PHOTOS_FILE
    return PHOTOS.of(_on_one_line(PHOTOS.parsed(path)), str(path))


def _on_one_line(value: JsonValue) -> JsonValue:
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, list):
        return [_on_one_line(one) for one in value]
    if isinstance(value, dict):
        return {key: one if key == "picture" else _on_one_line(one) for key, one in value.items()}
    return value
