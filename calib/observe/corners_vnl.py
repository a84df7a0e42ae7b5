"""mrcal's and mrgingham's `corners.vnl`: the corners of a planar grid, one line each, in the grid's order.

The legend is `# filename x y level`; `-` stands for a corner, or a whole grid, that was not found. Corners come row by
row from the top left one. One that was found in an image reduced `level` times by two is `2^level` times less sure
(mrcal's `compute_chessboard_corners`); a column `weight` holds `2^-level` instead. Names hold no spaces.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.core.csv_table import is_real
from calib.core.types import KnownPoints, Observations
from designer.base.errors import InputError

LEAST_COLUMNS = ("filename", "x", "y")
MAX_LEVEL = 20
MAX_PLACE_PX = 1e6
Corner: TypeAlias = tuple[float, float, float]
"""u, v in px, and the standard deviation as a multiple of the surest ones'."""
NOT_FOUND = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class PointGrid:
    """A planar grid of points."""

    columns: int
    rows: int
    pitch_mm: float

    @property
    def count(self) -> int:
        """How many points."""
        return self.columns * self.rows

    def points(self) -> KnownPoints:
        """The points row by row, x along the rows and y from row to row, in the plane z = 0."""
        place = np.arange(self.count)
        step = np.column_stack([place % self.columns, place // self.columns, 0 * place])
        return KnownPoints(self.pitch_mm * step.astype(np.float64), 0 * place, np.array([[0.0, 0.0, 1.0, 0.0]]))


def is_corners(path: Path, start: str) -> bool:
    """Whether a file is of this kind, by its name or its first lines."""
    return path.suffix.lower() == ".vnl" or _legend(start.splitlines()) is not None


def observations_from_corners(
    path: Path, text: str, *, grid: PointGrid | None, image_size: tuple[int, int] | None
) -> Observations:
    """The observations of a grid's points in a `corners.vnl`.

    Args:
        path: what messages name.
        text: the file's.
        grid: the grid.
        image_size: width and height of all images, px.

    Raises:
        InputError: grid or size are not given, or a line breaks a rule; the message names it.
    """
    corners, last_line = _read(path, text)
    if grid is None:
        most = max(map(len, corners.values()), default=0)
        raise InputError(
            f"{path}: corners of a grid, {most} in an image; give its columns, rows and pitch, such as "
            "--grid 10x7 --pitch 20mm"
        )
    if image_size is None:
        raise InputError(f"{path}: holds no image size; give --image-size, such as --image-size 2448x2048")
    for name, found in corners.items():
        if len(found) != grid.count and not (len(found) == 1 and math.isnan(found[0][0])):
            raise InputError(
                f"{path}: line {last_line[name]}: {name[:100]} has {len(found)} corners, but a grid of "
                f"{grid.columns} x {grid.rows} has {grid.count}; check --grid"
            )
    every = np.array([corner for found in corners.values() for corner in found])
    view = np.repeat(np.arange(len(corners)), [len(found) for found in corners.values()])
    point = np.concatenate([np.arange(len(found)) for found in corners.values()])
    is_found = np.isfinite(every[:, 0])
    sigma = every[is_found, 2]
    cov_px2 = None if (sigma == 1).all() else sigma[:, None, None] ** 2 * np.eye(2)
    return Observations(
        image_size, tuple(corners), view[is_found], point[is_found], every[is_found, :2], cov_px2, grid.points()
    )


def _legend(lines: list[str]) -> tuple[str, ...] | None:
    """The names of the columns: the first comment that is not marked as one, `##` or `#!`."""
    for line in lines:
        if line.startswith("#") and line[1:2] not in ("#", "!"):
            columns = tuple(line[1:].split())
            return columns if set(LEAST_COLUMNS) <= set(columns) and len(set(columns)) == len(columns) else None
        if line and not line.startswith("#"):
            return None
    return None


def _read(path: Path, text: str) -> tuple[dict[str, list[Corner]], dict[str, int]]:
    """The corners of each image, and its last line."""
    lines = text.split("\n")
    columns = _legend(lines) or (*LEAST_COLUMNS, "level")
    sure = next((name for name in ("level", "weight") if name in columns), None)
    needed = tuple(columns.index(name) for name in (*LEAST_COLUMNS, *([sure] if sure else [])))
    corners: dict[str, list[Corner]] = {}
    last_line: dict[str, int] = {}
    for number, line in enumerate(lines, 1):
        cells = line.split()
        if not cells or line.lstrip().startswith("#"):
            continue
        # A grid that was not found may be one short line.
        if len(cells) != len(columns) and not (len(cells) == len(LEAST_COLUMNS) and sure == columns[-1]):
            raise InputError(f"{path}: line {number}: {len(cells)} values; a line has {len(columns)}")
        name, u, v, *rest = (cells[place] for place in needed if place < len(cells))
        if name in corners and name != next(reversed(corners)):
            raise InputError(f"{path}: line {number}: the image {name[:100]!r} a second time; keep one")
        last_line[name] = number
        corners.setdefault(name, []).append(_corner(path, number, u, v, sure, rest[0] if rest else ""))
    if not corners:
        raise InputError(f"{path}: holds no corners; run mrgingham again")
    return corners, last_line


def _corner(path: Path, line: int, u: str, v: str, sure: str | None, level: str) -> Corner:
    """What a line says; as mrcal has it, negative numbers stand for a corner that was not found, too."""
    if "-" in (u, v, level):
        return NOT_FOUND
    for name, cell in (("x", u), ("y", v), (sure or "level", level or "0")):
        if not is_real(cell) or not abs(float(cell)) <= MAX_PLACE_PX:
            raise InputError(f"{path}: line {line}: {name} must be a number up to {MAX_PLACE_PX:g}, or -")
    place = float(u), float(v)
    if min(place) < 0:
        return NOT_FOUND
    if not level:
        return (*place, 1.0)
    value = float(level)
    if value < 0 or (sure == "weight" and value == 0):
        return NOT_FOUND
    if sure == "weight":
        if value < 2.0**-MAX_LEVEL:
            raise InputError(f"{path}: line {line}: weight {level} is too small; write - for a corner that is not seen")
        return (*place, 1 / value)
    if value > MAX_LEVEL:
        raise InputError(f"{path}: line {line}: level {level} is too high; at most {MAX_LEVEL} is read")
    return (*place, 2.0 ** int(value))
