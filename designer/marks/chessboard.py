"""A chessboard, whose points are the corners between its squares."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from designer.base.arrays import Array, Rows
from designer.marks.face_marks import FaceMarks, check_marks, lattice, rectangle_mm


@dataclass(frozen=True)
class Checkered(FaceMarks):
    """Squares of two colours; points row by row from the upper left, as OpenCV counts them."""

    squares: tuple[int, int]  # columns, rows
    square_mm: float

    @property
    def index(self) -> Rows:
        """Inner corners, from the upper left."""
        return lattice(self.squares[0] - 1, self.squares[1] - 1)

    @property
    def position_mm(self) -> Array:
        """Of the inner corners."""
        corners: Array = (self.index - (np.array(self.squares) - 2) / 2) * np.array([self.square_mm, -self.square_mm])
        return corners

    @property
    def size_mm(self) -> tuple[float, float]:
        """Of all squares."""
        return self.squares[0] * self.square_mm, self.squares[1] * self.square_mm

    @property
    def reach_mm(self) -> float:
        """Half of a square."""
        return self.square_mm / 2

    def squares_mm(self, parity: int) -> tuple[Array, ...]:
        """Those whose column and row from the upper left sum to an even number, or to an odd one for a parity of 1."""
        (width, height), side = self.size_mm, self.square_mm
        return tuple(
            rectangle_mm(i * side - width / 2, height / 2 - (j + 1) * side, side, side)
            for i, j in lattice(*self.squares).tolist()
            if (i + j) % 2 == parity
        )


@dataclass(frozen=True)
class Chessboard(Checkered):
    """Without markers."""

    kind: ClassVar[str] = "chessboard"

    light_first: bool = False  # the upper left square is the light one

    def __post_init__(self) -> None:
        check_marks(self.squares, (3, 3), "squares", squares=self.square_mm)

    @property
    def least_mm(self) -> float:
        """Of a square."""
        return self.square_mm

    @property
    def words(self) -> str:
        """With its squares."""
        columns, rows = self.squares
        inner = f"{columns - 1} x {rows - 1} inner corners"
        return f"chessboard of {columns} x {rows} squares of {self.square_mm:g} mm ({inner})"

    @property
    def remedy(self) -> str:
        """See `FaceMarks.remedy`."""
        return "one whose columns and rows sum to an odd number, such as 9 x 6 squares"

    @property
    def kalibr_fields(self) -> Mapping[str, str | int | float | bool]:
        """Its inner corners, and metres."""
        columns, rows, side = self.squares[0] - 1, self.squares[1] - 1, round(self.square_mm / 1000, 12)
        counts = {"targetCols": columns, "targetRows": rows}
        return {"target_type": "checkerboard", **counts, "rowSpacingMeters": side, "colSpacingMeters": side}

    @property
    def alike(self) -> int:
        """Ways to turn it that bring dark squares on dark ones."""
        columns, rows = self.squares
        return 1 if (columns + rows) % 2 else 4 if columns == rows and columns % 2 else 2

    @property
    def polygons_mm(self) -> tuple[Array, ...]:
        """The dark squares."""
        return self.squares_mm(int(self.light_first))


MARKS = Chessboard
