"""What a command tells of its photos, one by one and all together, in the blocks of a page."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import rigid_fault
from designer.base.arrays import Array
from designer.base.marks import Hash, Length, Shape
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Level, Paragraph, Steps, Table

GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the rings that could have been measured, of the readable photos with the target or a pose, and of the photos that
could be read. From 95 % on, what is missing is what nobody can see to: a hair on a ring, a finger at the edge. Below a
half, something is wrong with target file, light or focus, and what was found is no fair sample of the image."""
SHARE_RULE = f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %"
_WORST_FIRST: tuple[Level, ...] = ("bad", "usable", "good")
MOST_PHOTOS = 100_000
Kind: TypeAlias = Literal["photos"]


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
