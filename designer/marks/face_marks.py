"""What a face of another maker's board carries, and the kinds of it: a file of this folder and a name here for each."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Rows
from designer.base.codec import decode, encode
from designer.base.files import JsonValue

MARKS = ("chessboard", "charuco", "aprilgrid", "circles")
"""Names of the kinds, and of their modules, each of which holds its class as `MARKS`."""


@dataclass(frozen=True)
class FaceMarks(ABC):
    """The marks of one face: R points in the face's frame, x right, y up, z towards who looks at it."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def index(self) -> Rows:
        """Column and row of each point, in the order of the kind's own numbers.  # (R, 2)"""

    @property
    @abstractmethod
    def position_mm(self) -> Array:
        """Where the points are; (0, 0) is the middle of the marks.  # (R, 2)"""

    @property
    @abstractmethod
    def size_mm(self) -> tuple[float, float]:
        """Width and height of all that is marked."""

    @property
    @abstractmethod
    def words(self) -> str:
        """Such as `chessboard of 9 x 6 squares of 25 mm`."""

    @property
    def radius_mm(self) -> float:
        """Of circles; 0: the points are corners."""
        return 0.0

    @property
    def reach_mm(self) -> float:
        """How far from a point its own edges reach: of circles the radius, else half of the shortest line there."""
        return self.radius_mm

    @property
    def is_crossing(self) -> bool:
        """Whether lines cross at the corners, or end there."""
        return True

    @property
    def is_light(self) -> bool:
        """Whether its circles are white on black."""
        return False

    @property
    def alike(self) -> int:
        """Turned by so many parts of a full turn it looks the same: 1, 2 or 4."""
        return 1

    @property
    def is_ambiguous(self) -> bool:
        """Whether it looks the same turned by half a turn."""
        return self.alike > 1

    @property
    def polygons_mm(self) -> tuple[Array, ...]:
        """What is black, but for circles: convex, counter-clockwise, may touch, do not overlap.  # (K, 2)"""
        return ()

    @property
    def marker_ids(self) -> range:
        """Of the markers of a dictionary on it."""
        return range(0)


@cache
def marks_named(name: str) -> type[FaceMarks]:
    """The kind of a name in `MARKS`."""
    kind = import_module(f"designer.marks.{name}").MARKS
    assert issubclass(kind, FaceMarks)  # noqa: S101 - what a module of `designer.marks` is for
    return cast("type[FaceMarks]", kind)


def marks_to_mapping(marks: FaceMarks) -> Mapping[str, JsonValue]:
    """The marks as JSON values, their `kind` first."""
    return {"kind": marks.kind, **cast("dict[str, JsonValue]", encode(type(marks), marks))}


def marks_from_mapping(values: Mapping[str, object], place: str = "marks") -> FaceMarks:
    """The inverse of `marks_to_mapping`.

    Raises:
        ValueError: unknown kind, or a field that is missing, unknown, of the wrong type or against a rule.
    """
    kind = values.get("kind")
    if not isinstance(kind, str) or kind not in MARKS:
        raise ValueError(f"{place}: kind {kind!r} is unknown; it must be one of {', '.join(MARKS)}")
    own = cast("dict[str, JsonValue]", {key: value for key, value in values.items() if key != "kind"})
    return decode(marks_named(kind), own, place)


def rectangle_mm(x: float, y: float, width: float, height: float) -> Array:
    """The corners of a rectangle from its lower left one, counter-clockwise.  # (4, 2)"""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def black_cells_mm(black: NDArray[np.bool_], corner: Sequence[float], side: float) -> list[Array]:
    """The black cells of a square whose lower left corner and side are given, in few rectangles.

    Args:
        black: from the upper left cell on, row by row.  # (N, N)
        corner: its lower left one, x and y.
        side: of the square.
    """
    x, y = corner
    cell, open_runs, found = side / len(black), dict[tuple[int, int], int](), list[tuple[int, int, int, int]]()
    for row in range(len(black) + 1):
        edges = np.flatnonzero(np.diff(black[row], prepend=False, append=False)) if row < len(black) else np.empty(0)
        runs = {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
        found += [(*run, top, row) for run, top in open_runs.items() if run not in runs]
        open_runs = {run: open_runs.get(run, row) for run in runs}
    return [
        rectangle_mm(x + cell * left, y + side - cell * below, cell * (right - left), cell * (below - top))
        for left, right, top, below in sorted(found)
    ]


def lattice(columns: int, rows: int) -> Rows:
    """Column and row of each place of a lattice, row by row.  # (columns * rows, 2)"""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column, row])
