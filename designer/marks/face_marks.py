"""What a face of another maker's board carries, and the kinds of it: a file of this folder and a name here for each."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import ClassVar, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from designer.base.arrays import Array, Rows
from designer.base.codec import decode, encode
from designer.base.files import JsonValue
from designer.marks import MARKS as MARKS  # noqa: PLC0414  # with the kinds

MOST_ACROSS, MOST_MM = 200, 1e5
"""Marks along a side, and their lengths."""
Origin = Literal["center", "opencv", "kalibr"]
ORIGINS: tuple[Origin, ...] = get_args(Origin)


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
    def quiet_mm(self) -> float:
        """The white around the marks without which they are not found: half a step of the points."""
        return 0.5 * float(np.abs(self.step_mm).max())

    @property
    def step_mm(self) -> Array:
        """From a column to the next, and from a row to the next; of tags, which have two steps in turn, the mean."""
        index, at = self.index, self.position_mm
        last = at[[index[:, 0].argmax(), index[:, 1].argmax()], [0, 1]]
        first = at[[index[:, 0].argmin(), index[:, 1].argmin()], [0, 1]]
        step: Array = (last - first) / np.ptp(index, axis=0).clip(min=1)
        return step

    @property
    @abstractmethod
    def least_mm(self) -> float:
        """The least width of what is black, and of the white in it."""

    @property
    @abstractmethod
    def words(self) -> str:
        """Such as `chessboard of 9 x 6 squares of 25 mm`."""

    @property
    def order(self) -> str:
        """How points and markers are numbered: as OpenCV's."""
        return "row by row from the upper left"

    @property
    def remedy(self) -> str:
        """What looks like it and tells which way up it is, if `is_ambiguous`."""
        return ""

    @property
    def radius_mm(self) -> float:
        """Of circles; 0: the points are corners."""
        return 0.0

    @property
    def reach_mm(self) -> float:
        """How far from a point its own edges reach: of circles the radius, else half of the shortest line there."""
        return self.radius_mm

    @property
    def clear_mm(self) -> float:
        """How far across the edges at a point nothing else begins."""
        return self.reach_mm

    @property
    def is_crossing(self) -> bool:
        """Whether lines cross at the corners, or end there."""
        return True

    @property
    def is_light(self) -> bool:
        """Whether its circles are white on black."""
        return False

    @property
    def kalibr_fields(self) -> Mapping[str, str | int | float | bool]:
        """Kalibr's target file of it; empty: Kalibr does not find it."""
        return {}

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

    @property
    def family(self) -> str:
        """Of its markers, such as `DICT_5X5`: dictionaries of a family begin with the same ones. "": it has none."""
        return ""

    @property
    def following(self) -> "FaceMarks | None":
        """The same with the ids after its own; None: it has none."""
        return None

    @property
    def corners_mm(self) -> Array:
        """The lower left and the upper right corner from which other makers' object points count.  # (2, 2)"""
        return np.stack([self.position_mm.min(axis=0), self.position_mm.max(axis=0)])

    def target_from_face(self, origin: Origin) -> Array:
        """The face's frame in that of object points. Origin and axes, of which x always is to the right:

        center: the middle, y up, z towards who looks;    opencv: the upper left corner, y down, z away;
        kalibr: the lower left corner, y up, z towards who looks.  # (4, 4)
        """
        frame, (low, high) = np.eye(4), self.corners_mm
        if origin != "center":
            down = origin == "opencv"
            frame[:3, :3] = np.diag([1.0, -1.0, -1.0]) if down else np.eye(3)
            frame[:2, 3] = [-low[0], high[1] if down else -low[1]]
        return frame


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


def are_alike(one: FaceMarks, other: FaceMarks) -> bool:
    """Whether nothing in a photo tells which of two it shows: they share markers, or have equally many points."""
    if one.family and other.family:
        ids, others = one.marker_ids, other.marker_ids
        return one.family == other.family and max(ids.start, others.start) < min(ids.stop, others.stop)
    sides = (sorted(np.ptp(each.index, axis=0).tolist()) for each in (one, other))
    return one.kind == other.kind and next(sides) == next(sides) and len(one.index) == len(other.index)


def check_marks(counts: tuple[int, int], least: tuple[int, int], what: str, **lengths_mm: float) -> None:
    """Refuse too few marks, more than anyone has, and lengths that are none.

    Args:
        counts: along the two sides.
        least: likewise; the sides may change places.
        what: is counted, such as `squares of a chessboard`.
        lengths_mm: by what they are of.

    Raises:
        ValueError: which rule is broken.
    """
    if min(counts) < min(least) or max(counts) < max(least) or max(counts) > MOST_ACROSS:
        rule = f"must be at least {least[0]} x {least[1]}, and at most {MOST_ACROSS} a side"
        raise ValueError(f"{counts[0]} x {counts[1]} {what}: {rule}")
    for of, length in lengths_mm.items():
        if not 0 < length <= MOST_MM:
            raise ValueError(f"{of} of {length:g} mm: must be above 0, and at most {MOST_MM:g} mm")


def rectangle_mm(x: float, y: float, width: float, height: float) -> Array:
    """The corners of a rectangle from its lower left one, counter-clockwise.  # (4, 2)"""
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def black_cells_mm(black: NDArray[np.bool_], x: Array, y: Array) -> list[Array]:
    """The black cells of a lattice, in few rectangles.

    Args:
        black: from the upper left cell on, row by row.  # (H, W)
        x: of the lines between columns, ascending.  # (W + 1,)
        y: of the lines between rows, ascending.  # (H + 1,)
    """
    open_runs, found = dict[tuple[int, int], int](), list[tuple[int, int, int, int]]()
    for row in range(len(black) + 1):
        edges = np.flatnonzero(np.diff(black[row], prepend=False, append=False)) if row < len(black) else np.empty(0)
        runs = {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
        found += [(*run, top, row) for run, top in open_runs.items() if run not in runs]
        open_runs = {run: open_runs.get(run, row) for run in runs}
    return [
        rectangle_mm(x[left], y[-1 - below], x[right] - x[left], y[-1 - top] - y[-1 - below])
        for left, right, top, below in sorted(found)
    ]


def lattice(columns: int, rows: int) -> Rows:
    """Column and row of each place of a lattice, row by row.  # (columns * rows, 2)"""
    row, column = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([column, row])
