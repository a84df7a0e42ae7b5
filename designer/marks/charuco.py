"""A ChArUco board: a chessboard with markers in its light squares, whose points are the corners between the squares."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from designer.base.arrays import Array
from designer.marks.chessboard import Checkered
from designer.marks.dictionaries import check_markers, family_of, marker_cells, marker_mm
from designer.marks.face_marks import check_marks


@dataclass(frozen=True)
class Charuco(Checkered):
    """Points row by row from the upper left, which are OpenCV's corner ids; markers likewise, from `first_id` on."""

    kind: ClassVar[str] = "charuco"

    marker_mm: float  # side of a marker, its black border included
    dictionary: str  # such as DICT_5X5_100
    first_id: int = 0
    legacy: bool = False  # as OpenCV before 4.6: with an even number of rows the upper left square is light

    def __post_init__(self) -> None:
        check_marks(self.squares, (3, 3), "squares", squares=self.square_mm, markers=self.marker_mm)
        if self.marker_mm >= self.square_mm:
            raise ValueError(f"markers of {self.marker_mm:g} mm must be smaller than squares of {self.square_mm:g} mm")
        check_markers(self.dictionary, self.first_id, len(self.marker_ids))

    @property
    def marker_ids(self) -> range:
        """Of the markers, in the light squares row by row from the upper left."""
        return range(self.first_id, self.first_id + self.squares[0] * self.squares[1] // 2)

    @property
    def family(self) -> str:
        """See `FaceMarks.family`."""
        return family_of(self.dictionary)

    @property
    def following(self) -> "Charuco":
        """See `FaceMarks.following`."""
        return replace(self, first_id=self.marker_ids.stop)

    @property
    def corners_mm(self) -> Array:
        """Of the outer squares, from which OpenCV counts."""
        half = np.array(self.size_mm) / 2
        return np.stack([-half, half])

    @property
    def light_first(self) -> bool:
        """Whether the upper left square is light, with a marker."""
        return self.legacy and self.squares[1] % 2 == 0

    @property
    def least_mm(self) -> float:
        """Of a marker's cell, and of the white around it."""
        cells = len(marker_cells(self.dictionary, self.first_id))
        return min(self.marker_mm / cells, (self.square_mm - self.marker_mm) / 2)

    @property
    def clear_mm(self) -> float:
        """To the marker in a light square."""
        return (self.square_mm - self.marker_mm) / 2

    @property
    def words(self) -> str:
        """With squares, markers and dictionary."""
        legacy = ", legacy" * self.legacy
        return (
            f"ChArUco board of {self.squares[0]} x {self.squares[1]} squares of {self.square_mm:g} mm, markers of "
            f"{self.marker_mm:g} mm from {self.dictionary}{legacy}"
        )

    @property
    def order(self) -> str:
        """As OpenCV's."""
        ids = self.marker_ids
        return f"row by row from the upper left, as OpenCV's ChArUco ids; markers {ids[0]} to {ids[-1]} likewise"

    @property
    def polygons_mm(self) -> tuple[Array, ...]:
        """The dark squares, and what is black of the markers in the light ones, upright as OpenCV draws them."""
        light = self.squares_mm(int(not self.light_first))
        inset = (self.square_mm - self.marker_mm) / 2
        markers = [
            polygon
            for number, square in zip(self.marker_ids, light, strict=True)
            for polygon in marker_mm(marker_cells(self.dictionary, number), square[0] + inset, self.marker_mm)
        ]
        return (*self.squares_mm(int(self.light_first)), *markers)


MARKS = Charuco
