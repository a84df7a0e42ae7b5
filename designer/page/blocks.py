"""What a page is made of: plain data without a word of HTML, so that no file name or remark can become markup.

Reports build these; `designer.page.shell` alone turns them into HTML, and escapes all text.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias
from urllib.parse import quote

from designer.base.marks import From, Tagged

if TYPE_CHECKING:
    from designer.page.scene import Scene  # here alone: a terminal's lines need no NumPy
    from designer.page.what_if import WhatIfModel

Level = Literal["good", "usable", "bad", "note"]
"""How a fact is to be taken: fine, with care, not at all; or neither."""
WORDS: Mapping[Level, str] = {"good": "good", "usable": "usable", "bad": "do not use", "note": ""}
"""Of a headline that says whether something may be used."""
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://|[A-Za-z]:")
ENDLESS = 1e300
"""Stands for infinity where a table is sorted."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")


@dataclass(frozen=True)
class Raster(Tagged):
    """A picture of pixels, PNG or JPEG by its content."""

    content: bytes
    width_px: int
    height_px: int


@dataclass(frozen=True)
class Svg(Tagged):
    """An SVG file that follows the page's scheme, see `designer.page.pictures`."""

    content: bytes
    width_px: float
    height_px: float


@dataclass(frozen=True)
class Link:
    """A file of the page's folder."""

    text: str
    path: str  # relative to the page, with "/" between folders; neither absolute nor upwards


@dataclass(frozen=True)
class Paragraph(Tagged):
    """Plain text."""

    text: str


@dataclass(frozen=True)
class Facts(Tagged):
    """Names and their values, a line each."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Finding:
    """One thing that was checked or noticed."""

    level: Level
    title: str
    text: str
    measured: str = ""  # the value with its unit
    rule: str = ""  # the limit with its unit


def level_of(value: float, good: float, usable: float) -> Level:
    """Of what is the better the smaller it is."""
    return "good" if value <= good else "usable" if value <= usable else "bad"


def worst_level(rows: Iterable[Finding]) -> Level:
    """Of checks."""
    return min((row.level for row in rows), key=("bad", "usable", "good", "note").index)


@dataclass(frozen=True)
class Findings(Tagged):
    """Things that were checked, the worst as they stand: the page does not sort them."""

    rows: tuple[Finding, ...]


@dataclass(frozen=True)
class Column:
    """The head of a column."""

    title: str
    is_number: bool = True  # set to the right, sorted by value
    note: str = ""  # what it means, shown on demand


@dataclass(frozen=True)
class Cell:
    """One place of a table."""

    text: str
    value: float | None = None  # to sort by; None: by the text
    path: str = ""  # of a file of the folder that it leads to
    level: Level | None = None

    def __post_init__(self) -> None:
        if self.value is not None and not math.isfinite(self.value):  # what no file can hold
            value = None if math.isnan(self.value) else math.copysign(ENDLESS, self.value)
            object.__setattr__(self, "value", value)


@dataclass(frozen=True)
class Table(Tagged):
    """A table that sorts by a click on any head."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    visible_rows: int = 12  # more are behind a scroll bar on the screen; all are in print


def text_table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], visible_rows: int = 12) -> Table:
    """A table of words."""
    columns = tuple(Column(head, is_number=False) for head in heads)
    return Table(title, columns, tuple(tuple(map(Cell, row)) for row in rows), visible_rows=visible_rows)


@dataclass(frozen=True)
class Figure(Tagged):
    """A drawing or picture with its caption."""

    title: str
    image: Svg | Raster
    alt: str  # what it shows, for those who do not see it: the finding, not "a plot"
    caption: str = ""
    files: tuple[Link, ...] = ()  # the same in files
    is_wide: bool = False  # takes the page's whole width; others stand two abreast where there is room


@dataclass(frozen=True)
class Picture:
    """One picture of a gallery."""

    image: Raster
    name: str  # as the file is called
    caption: str
    path: str = ""  # of the picture in full
    level: Level | None = None


@dataclass(frozen=True)
class Gallery(Tagged):
    """Small pictures that are shown large on a click."""

    pictures: tuple[Picture, ...]
    note: str = ""
    said_as: str = ""  # what a screen calls its captions; "": it says none


@dataclass(frozen=True, eq=False)
class View3d(Tagged):
    """A scene that turns under the mouse, a finger or the arrow keys."""

    title: str
    scene: Annotated["Scene", From("designer.page.scene")]
    alt: str
    caption: str = ""
    poster: Raster | None = None  # shown where a browser has no WebGL, and in print


@dataclass(frozen=True)
class Command(Tagged):
    """A line to type, with a button that copies it."""

    line: str
    purpose: str = ""


@dataclass(frozen=True)
class Steps(Tagged):
    """What to do, in order."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class FileRow:
    """A file of the folder."""

    path: str
    purpose: str
    size_bytes: int


@dataclass(frozen=True)
class FileList(Tagged):
    """The files of the folder."""

    rows: tuple[FileRow, ...]


@dataclass(frozen=True, eq=False)
class Sliders(Tagged):
    """Numbers that follow what a person sets; where nothing can be set, the table says them as they are at first."""

    title: str
    model: Annotated["WhatIfModel", From("designer.page.what_if")]
    table: Table
    note: str = ""


Leaf: TypeAlias = (
    Paragraph | Facts | Findings | Table | Figure | Gallery | View3d | Command | Steps | FileList | Sliders
)


@dataclass(frozen=True, eq=False)
class Fold(Tagged):
    """Blocks under a heading that opens and closes; all are open in print."""

    title: str
    blocks: tuple[Leaf, ...]
    is_open: bool = False


Block: TypeAlias = Leaf | Fold


@dataclass(frozen=True, eq=False)
class Section:
    """A part of a page, which the contents lead to."""

    title: str
    blocks: tuple[Block, ...]
    lead: str = ""  # the section's answer in one sentence


@dataclass(frozen=True)
class Headline:
    """The answer, before anything else."""

    level: Level
    word: str  # "good", "usable", "do not use", "printable"
    sentence: str


@dataclass(frozen=True, eq=False)
class Page:
    """A whole page."""

    title: str  # of what: a target's or a folder's name
    kind: str  # "Calibration", "Target", "Tolerance study"
    headline: Headline | None
    sections: tuple[Section, ...]
    lead: tuple[Block, ...] = ()  # between headline and contents: the picture that says most, key facts
    made_by: str = ""  # the command line that wrote the folder
    program: str = ""  # name and version
    is_negative: bool = False  # the command that made it says no, though nothing is bad: exit code 1
    next_steps: tuple[Command, ...] = ()  # what to type now


def href(path: str) -> str:
    """The relative URL of a file, percent-encoded (RFC 3986, section 4.2).

    Colons become %3A, so no path can be read as a scheme.

    Raises:
        ValueError: absolute, with a scheme or drive, upwards, with a backslash (a separator to browsers) or a control
            character, or empty.
    """
    if not is_linkable(path):
        raise ValueError(f"{path!r}: is no path inside the page's folder")
    return quote(path, safe="/", errors="surrogateescape")


def is_linkable(path: str) -> bool:
    """Whether `href` has a URL for the path: a builder leaves the link off where it has none."""
    if not path or path.startswith("/") or "\\" in path or _SCHEME.match(path) or _CONTROL.search(path):
        return False
    return all(part not in {"", ".", ".."} for part in path.split("/"))
