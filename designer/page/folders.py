"""What the pages of folders have in common: cells of numbers, what was asked, warnings and notes, and files."""

import math
import stat
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from designer.base.words import capital, figure, printable, with_digits
from designer.page.blocks import Block, Cell, Column, FileList, FileRow, Finding, Findings, Table, is_linkable

Row = TypeVar("Row")

DEFAULT_NAME = "calibration"
"""How `calib run` calls its folder: it says nothing, so the folder around it is named too."""
MOST_LINES = 20
"""Of one kind, on a page."""


def title_of(folder: Path) -> str:
    """The folder's name."""
    place = folder.resolve()
    name = f"{place.parent.name}/{place.name}" if place.name == DEFAULT_NAME else place.name
    return printable(name) or DEFAULT_NAME


def number(value: float, digits: int = 3) -> Cell:
    """A number to some digits that sorts by its value; empty where it is not known."""
    if not math.isfinite(value):
        return Cell("", None)
    return Cell(figure(value, digits), value)


def with_sigma(value: float, sigma: float) -> Cell:
    """A value with its standard deviation; alone, where none is known."""
    if not math.isfinite(sigma) or sigma == 0:
        return number(value, 5)
    return Cell(f"{with_digits(value, sigma)} ± {figure(sigma, 2)}", value)


def whole(value: int) -> Cell:
    """A count."""
    return Cell(str(value), float(value))


def size_bytes(path: Path) -> int | None:
    """Of a regular file; None if it is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_size if stat.S_ISREG(found.st_mode) else None


def warnings(title: str, lines: Sequence[str]) -> tuple[Block, ...]:
    """Lines that call for care, each under the same title; nothing if there are none."""
    return (Findings(tuple(Finding("usable", title, line) for line in lines)),) if lines else ()


def some_of(lines: Sequence[str], most: int = MOST_LINES) -> list[str]:
    """The first of very many lines, and how many more there are."""
    return [*lines[:most], *([f"{len(lines) - most} more"] if len(lines) > most else [])]


def file_list(folder: Path, purposes: Sequence[tuple[str, str]]) -> FileList:
    """Those of the named files that are in the folder, in the order given: paths within it and what they are for."""
    known = [(name, why, size_bytes(folder / name)) for name, why in purposes if is_linkable(name)]
    return FileList(tuple(FileRow(name, why, size) for name, why, size in known if size is not None))


@dataclass(frozen=True)
class Shown(Generic[Row]):
    """A column of `table_of`: its title, what it shows of a row, and what that means."""

    title: str
    value: Callable[[Row], str | float | Cell]  # a number is set to its digits; nan: not known
    note: str = ""
    digits: int = 2
    unknown: str = ""  # what stands where a number is not known


def table_of(
    rows: Iterable[Row], *columns: Shown[Row], title: str = "", note: str = "", visible_rows: int = 12
) -> Table:
    """A table with a row for each thing: `table_of(parts, Shown("part", lambda one: one.part), ...)`."""
    cells = tuple(tuple(_cell(column.value(row), column) for column in columns) for row in rows)
    heads = tuple(
        Column(column.title, any(row[at].value is not None for row in cells), column.note)
        for at, column in enumerate(columns)
    )
    return Table(title, heads, cells, note, visible_rows)


def _cell(value: str | float | Cell, column: Shown[Row]) -> Cell:
    if isinstance(value, Cell):
        return value
    if isinstance(value, str):
        return Cell(printable(value))
    if isinstance(value, int):
        return whole(value)
    return number(value, column.digits) if math.isfinite(value) else Cell(column.unknown)


def notes(lines: Iterable[str]) -> tuple[Findings, ...]:
    """What a person must know of the numbers, a line each; nothing if there are none."""
    rows = tuple(Finding("note", "", capital(printable(line))) for line in lines)
    return (Findings(rows),) if rows else ()
