"""`observations.csv`, beside a `calibration.json`: one line a sighting, with what the camera left over of it.

Numbers are printed so that they read back bit for bit.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from calib.core.csv_table import ANY_NAME, COVARIANCE, MAX_FILE_BYTES, csv_cell, is_covariance, require_version
from calib.core.types import KnownPoints
from calib.observe.dataset import MAX_SIDE_PX
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

VERSION = 1
FIRST_LINE = f"# ringsolid observations, version {VERSION}"
COLUMNS = ("image", "point", "face", "X", "Y", "Z", "u", "v", "du", "dv", "outlier")
MAX_RESIDUAL_PX = 1e6
"""What a camera predicts farther from what was measured than any image is wide, it does not predict."""
EXPLAINED = (
    "# X Y Z in mm; u v as measured and du dv = predicted - measured in px, (0, 0) the centre of the first pixel"
)


@dataclass(frozen=True, eq=False)
class TableSightings:
    """What the table holds of M sightings."""

    view: Rows  # (M,) ascending
    point: Rows  # (M,)
    center_px: Array  # (M, 2)
    residual_px: Array  # (M, 2) nan where the camera has no pixel
    is_outlier: Flags  # (M,)
    cov_px2: Array | None  # (M, 2, 2)


def observations_to_csv(calibration: Calibration) -> bytes:
    """The content of `observations.csv`."""
    seen = calibration.observations
    columns = (*COLUMNS, *(COVARIANCE if seen.cov_px2 is not None else ()))
    stream = io.BytesIO()
    stream.write(f"{FIRST_LINE}\n{EXPLAINED}\n{','.join(columns)}\n".encode())
    points = seen.points
    places = [
        f"{point},{face},{x!r},{y!r},{z!r}"
        for point, (face, (x, y, z)) in enumerate(zip(points.face.tolist(), points.position_mm.tolist(), strict=True))
    ]
    ends = np.searchsorted(seen.view, np.arange(seen.view_count + 1)).tolist()
    for name, start, end in zip(seen.view_names, ends, ends[1:], strict=False):
        # A view at a time: the text of a large set is not held twice.
        image, numbers = csv_cell(name), _numbers(calibration, slice(start, end))
        rows = zip(seen.point[start:end].tolist(), numbers, strict=True)
        stream.write("".join(f"{image},{places[point]},{row}\n" for point, row in rows).encode("utf-8", ANY_NAME))
    return stream.getvalue()


def _numbers(calibration: Calibration, rows: slice) -> Iterator[str]:
    """The cells from u on."""
    seen = calibration.observations
    residual, is_outlier = calibration.residual_px[rows], calibration.is_outlier[rows]
    # A point that was left out may lie in the camera's own plane: it has no pixel.
    has_none = is_outlier & (np.abs(residual) > MAX_RESIDUAL_PX).any(axis=1)
    parts = [seen.center_px[rows], np.where(has_none[:, None], np.nan, residual)]
    covariance = [] if seen.cov_px2 is None else [seen.cov_px2[rows].reshape(-1, 4)[:, [0, 1, 3]]]
    before = np.concatenate(parts, axis=1).tolist()
    after = np.concatenate(covariance, axis=1).tolist() if covariance else [[]] * len(before)
    for first, flag, last in zip(before, is_outlier.tolist(), after, strict=True):
        yield ",".join([*map(repr, first), "1" if flag else "0", *map(repr, last)])


def read_sightings(path: Path, view_names: Sequence[str], points: KnownPoints) -> TableSightings:
    """Read `observations.csv`.

    Args:
        path: the file.
        view_names: the views of the calibration it belongs to.
        points: the points of the calibration it belongs to.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names file and line.
    """
    try:
        values, has_covariance = _read_values(path, view_names)
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text, so no observations; solve again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; a calibration.json needs it beside it") from None

    def require(ok: Flags, rule: str) -> None:
        if not ok.all():
            line, _, _ = next(islice(_rows(path), int(np.argmin(ok)), None))  # in which the row ends
            raise InputError(f"{path}: line {line}: {rule}")

    require(values[:, 0] >= 0, "its image is no view of the calibration")
    require(np.diff(values[:, 0], prepend=0) >= 0, "its image comes before that of the line above in the calibration")
    number, last = values[:, 1], len(points.face) - 1
    is_one = (number >= 0) & (number <= last) & (number == np.floor(number))
    require(is_one, f"point must be one of the calibration's, 0 to {last}")
    point = number.astype(np.int64)
    expected = np.column_stack([points.face, points.position_mm])[point]
    require(
        np.abs(values[:, 2:6] - expected).max(axis=1) == 0,
        "face or X, Y, Z are not those of the point in the calibration",
    )
    require(np.abs(values[:, 6:8]).max(axis=1) <= MAX_SIDE_PX, f"u and v must be within {MAX_SIDE_PX} px")
    require(
        np.nan_to_num(np.abs(values[:, 8:10]), nan=0.0, posinf=np.inf).max(axis=1) <= MAX_RESIDUAL_PX,
        f"du and dv must be finite, at most {MAX_RESIDUAL_PX:g} px, or nan where the camera has no pixel",
    )
    require(np.isin(values[:, 10], (0, 1)), "outlier must be 0 or 1")
    covariance = None
    if has_covariance:
        covariance = values[:, [11, 12, 12, 13]].reshape(-1, 2, 2)
        require(is_covariance(covariance), "suu, suv, svv must be a covariance, which is positive definite")
    return TableSightings(
        values[:, 0].astype(np.int64), point, values[:, 6:8], values[:, 8:10], values[:, 10] == 1, covariance
    )


@contextmanager
def _opened(path: Path) -> Iterator[tuple[TextIO, tuple[str, ...], int]]:
    """The text from the first row on, the names of its columns, and the number of their line."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; a calibration.json needs it beside it")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise InputError(f"{path}: {path.stat().st_size} bytes; at most {MAX_FILE_BYTES} are read")
    with path.open(encoding="utf-8", errors=ANY_NAME, newline="") as stream:
        require_version(path, stream.readline(200).strip(), FIRST_LINE, "line 1: no observations")
        number = 2
        while (line := stream.readline().strip()).startswith("#"):
            number += 1
        columns = tuple(line.split(","))
        if columns not in (COLUMNS, (*COLUMNS, *COVARIANCE)):
            wanted = f"{','.join(COLUMNS)}, and with covariances {','.join(COVARIANCE)}"
            raise InputError(f"{path}: line {number}: the columns must be {wanted}")
        yield stream, columns, number


def _read_values(path: Path, view_names: Sequence[str]) -> tuple[Array, bool]:
    """All cells as numbers, the image as the number of its view or -1, and whether covariances are among them."""
    row_of = {name: float(number) for number, name in enumerate(view_names)}
    with _opened(path) as (stream, columns, _):
        place = stream.tell()
        if not any(line.strip() for line in stream):
            raise InputError(f"{path}: holds no line of observations; solve again")
        stream.seek(place)
        try:
            # numpy's own reader: ten times as fast as Python's, and as exact.
            values = np.loadtxt(
                stream, delimiter=",", quotechar='"', comments=None, ndmin=2,
                converters={0: lambda cell: row_of.get(cell, -1.0)},
            )  # fmt: skip
        except UnicodeDecodeError:
            raise
        except (ValueError, OverflowError) as error:
            raise InputError(_first_fault(path) or f"{path}: {error}; not valid CSV") from None
    if values.shape[1] != len(columns):
        raise InputError(_first_fault(path) or f"{path}: {values.shape[1]} columns; there must be {len(columns)}")
    return values, len(columns) > len(COLUMNS)


def _rows(path: Path) -> Iterator[tuple[int, list[str], int]]:
    """Line number, cells and expected number of cells of every row, slowly."""
    with _opened(path) as (stream, columns, number):
        reader = csv.reader(stream)
        for row in reader:
            if row:
                yield number + reader.line_num, row, len(columns)


def _first_fault(path: Path) -> str:
    """What is wrong with the first row that is not a name and numbers; "" if none is."""
    try:
        for line, row, expected in _rows(path):
            if len(row) != expected:
                return f"{path}: line {line}: {len(row)} values; a line has {expected}"
            for cell in row[1:]:
                if not _is_number(cell):
                    return f"{path}: line {line}: {cell[:40]!r} must be a number"
    except csv.Error as error:
        return f"{path}: {error}; not valid CSV"
    return ""


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return cell.isascii() and "_" not in cell
