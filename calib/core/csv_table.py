"""Tables in text files: read whole, column by column, with the line named where a value breaks a rule.

Names that are the time of a photo, or of a robot's pose: as ROS and cameras write them.
"""

import csv
import io
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np

from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.files import read_small_text
from designer.base.words import shown, suggestion

MAX_FILE_BYTES = 512 * 2**20
MAX_SIGMA_PX = 1e4
COVARIANCE = ("suu", "suv", "svv")
ANY_NAME = "surrogatepass"
"""Python's way with file names that are no text: they are read back as they were."""

_WHOLE = re.compile(r"-?[0-9]{1,9}")
_REAL = re.compile(r"[-+]?(?:[0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20})(?:[eE][-+]?[0-9]{1,3})?")
_COLUMNS = {cell: re.compile(rf"(?:{cell.pattern}\n)*+") for cell in (_WHOLE, _REAL)}


@dataclass(frozen=True)
class CsvTable:
    """The cells below the column names, column by column, and the line each row ends in."""

    path: Path
    lines: list[int]
    cells: dict[str, tuple[str, ...]]

    def require(self, ok: Flags, rule: str) -> None:
        """Refuse the first row that is not ok, by its line."""
        if not ok.all():
            raise InputError(f"{self.path}: line {self.lines[int(np.argmin(ok))]}: {rule}")

    def whole_numbers(self, name: str) -> Rows:
        """A column of whole numbers."""
        self._require_pattern(name, _WHOLE, "a whole number")
        return np.array(list(map(int, self.cells[name])), dtype=np.int64)

    def reals(self, name: str) -> Array:
        """A column of finite numbers."""
        self._require_pattern(name, _REAL, "a finite number")
        numbers = np.array(list(map(float, self.cells[name])), dtype=np.float64)
        self.require(np.abs(numbers) < np.inf, f"{name} must be a finite number")
        return numbers

    def columns(self, names: Iterable[str]) -> Array:
        """Columns of finite numbers side by side.  # (M, N)"""
        return np.stack([self.reals(name) for name in names], axis=1) + 0.0  # no negative zeros

    def require_filled(self, *names: str) -> None:
        """Refuse an empty cell in these columns."""
        for name in names:
            self.require(np.array(list(map(bool, self.cells[name])), dtype=bool), f"{name} must not be empty")

    def variances(self, sigma: str) -> Array:
        """A column of standard deviations in px as matrices.  # (M, 2, 2)"""
        sigma_px, least = self.reals(sigma), 1 / MAX_SIGMA_PX**2
        ok = (sigma_px >= least) & (sigma_px <= MAX_SIGMA_PX)
        self.require(ok, f"{sigma} must be from {least:g} to {MAX_SIGMA_PX:g} px")
        return np.asarray(sigma_px[:, None, None] ** 2 * np.eye(2))

    def covariances(self) -> Array:
        """The columns suu, suv, svv as matrices.  # (M, 2, 2)"""
        suu, suv, svv = (self.reals(name) for name in COVARIANCE)
        matrices = np.stack([suu, suv, suv, svv], axis=1).reshape(-1, 2, 2)
        self.require(is_covariance(matrices), "suu, suv, svv must be a covariance, which is positive definite")
        return matrices

    def sorted_once(self, first: Rows, then: Rows, rule: str) -> Rows:
        """The order (M,) of the rows by two numbers, which no two rows share."""
        order = np.lexsort((then, first))
        again = np.zeros(len(order), dtype=bool)
        again[order[1:]] = (np.diff(first[order]) == 0) & (np.diff(then[order]) == 0)
        self.require(~again, rule)
        return order

    def unused(self, used: Iterable[str]) -> tuple[str, ...]:
        """A remark on columns beside those that are used, if there are any."""
        more = [name for name in self.cells if name not in set(used)]
        return (f"columns that are not used: {', '.join(map(shown, more[:10]))}",) if more else ()

    def _require_pattern(self, name: str, pattern: re.Pattern[str], what: str) -> None:
        column = "\n".join((*self.cells[name], ""))
        if _COLUMNS[pattern].fullmatch(column) and column.count("\n") == len(self.lines):
            return  # at once in a third of the time; a line's end in a cell is in quotes, and no number
        ok = np.array([pattern.fullmatch(cell) is not None for cell in self.cells[name]], dtype=bool)
        self.require(ok, f"{name} must be {what}")


def is_covariance(cov: Array) -> Flags:
    """Which matrices are positive definite.  # (N, 2, 2) -> (N,)"""
    with np.errstate(over="ignore", invalid="ignore"):
        determinant = cov[:, 0, 0] * cov[:, 1, 1] - cov[:, 0, 1] ** 2
    ok: Flags = (cov[:, 0, 0] > 0) & (determinant > 0) & np.isfinite(determinant)
    return ok


def column_fault(columns: tuple[str, ...], required: Sequence[str], wanted: str) -> str:
    """What is wrong with the names of columns: one is missing, or stands there twice; "" if nothing."""
    if len(columns) == 1 and re.search(r"[;\t]", columns[0]):
        return "values must be separated by commas"
    missing = [name for name in required if name not in columns]
    if missing:
        return f"column {missing[0]!r} is missing{suggestion(missing[0], list(columns))}; {wanted}"
    again = next((name for name in columns if columns.count(name) > 1), None)
    return "" if again is None else f"column {shown(again)} a second time; keep one"


def csv_cell(text: str) -> str:
    """A cell of CSV; Python's own writer leaves a carriage return bare before 3.13."""
    return '"' + text.replace('"', '""') + '"' if re.search(r'[\s,"#]', text) or not text else text


def csv_bytes(head: Iterable[str], columns: Iterable[str], rows: Iterable[Iterable[str]]) -> bytes:
    """A table: some lines, the names of its columns, and its rows of cells as they are to stand there."""
    lines = [*head, ",".join(columns), *(",".join(row) for row in rows)]
    return ("\n".join(lines) + "\n").encode("utf-8", ANY_NAME)


def require_version(path: Path, first_line: str, wanted: str, otherwise: str) -> None:
    """Refuse a file whose first line is of another version than the one wanted, or of something else."""
    kind, _, version = wanted.rpartition(" ")
    if first_line != wanted:
        if first_line.startswith(f"{kind} "):
            given = first_line.removeprefix(f"{kind} ")[:20]
            raise InputError(f"{path}: version {given}; this program reads version {version}")
        raise InputError(f"{path}: {otherwise}: it must begin with {wanted!r}")


def read_text(path: Path, kind: str, max_bytes: int = MAX_FILE_BYTES) -> str:
    """The text of a table's file (`read_small_text`), in which files may have any name."""
    return read_small_text(path, max_bytes, kind, ANY_NAME)


def is_real(cell: str) -> bool:
    """Whether a text is a number, which may still be too large to be finite."""
    return _REAL.fullmatch(cell) is not None


def column_names(path: Path, kind: str) -> set[str]:
    """The names of a table's columns, without a look at anything else in it."""
    stream = io.StringIO(read_text(path, kind), newline="")
    _skip_comments(stream, lambda _number, _line: None)
    return {name.strip() for name in stream.readline().split(",")}


def _skip_comments(stream: io.StringIO, comment: Callable[[int, str], None]) -> int:
    """Leave the stream at the line of column names, and return its number, from 1; the lines above go to `comment`."""
    number, at = 1, stream.tell()
    while (line := stream.readline()) and (not line.strip() or line.lstrip().startswith("#")):
        comment(number, line.strip())
        number, at = number + 1, stream.tell()
    stream.seek(at)
    return number


def read_table(
    path: Path,
    text: str,
    fault: Callable[[tuple[str, ...]], str],
    *,
    comment: Callable[[int, str], None] = lambda _number, _line: None,
    holds: str = "",
) -> CsvTable:
    """The rows of comma-separated values below comments and a line of column names; spaces after commas do not count.

    Args:
        path: what messages name.
        text: of the file, with its own line ends.
        fault: what is wrong with the names of the columns, "" if nothing (`column_fault`).
        comment: is called with the number and the text of each line above the column names.
        holds: what there must be one row of, such as "points"; "": none is fine, too.

    Raises:
        InputError: not CSV, columns that are not accepted, or a row of another length; the message names the line.
    """
    stream = io.StringIO(text, newline="")
    first_line = _skip_comments(stream, comment)
    reader = csv.reader(stream, strict=True, skipinitialspace=True)
    rows: list[list[str]] = []
    lines: list[int] = []
    try:
        columns = tuple(next(reader, ()))
        if said := fault(columns):
            raise InputError(f"{path}: line {first_line}: {said}")
        for row in reader:
            if row and len(row) != len(columns):
                line = first_line - 1 + reader.line_num
                raise InputError(f"{path}: line {line}: {len(row)} values; a line has {len(columns)}")
            if row:
                rows.append(row)
                lines.append(first_line - 1 + reader.line_num)
    except csv.Error as error:
        raise InputError(f"{path}: line {first_line - 1 + reader.line_num}: {error}; not valid CSV") from None
    if holds and not rows:
        raise InputError(f"{path}: holds no {holds}")
    values = zip(*rows, strict=True) if rows else ((),) * len(columns)
    return CsvTable(path, lines, dict(zip(columns, values, strict=True)))


LAST_DIGITS = 19
"""Of the seconds since 1970, from 2001 to 2286; and of nanoseconds."""
_STAMP = re.compile(r"([0-9]{10})[._]?([0-9]{6,9})")


def stamps_s(*names: Sequence[str]) -> list[Array] | None:
    """The times of some rows of names, in seconds from the first of all; None if a name is no time.

    A time has 16 to 19 digits: seconds since 1970 of ten, and a fraction.
    """
    found = [[_nanoseconds(name) for name in row] for row in names]
    known = [stamp for row in found for stamp in row if stamp is not None]
    if not known or len(known) < sum(map(len, found)):
        return None
    first = min(known)
    return [np.array([1e-9 * (stamp - first) for stamp in row if stamp is not None]) for row in found]


def _nanoseconds(name: str) -> int | None:
    """Of a name with or without a file's ending."""
    match = _STAMP.fullmatch(name) or _STAMP.fullmatch(PurePath(name).stem)
    return None if match is None else int((match[1] + match[2]).ljust(LAST_DIGITS, "0"))
