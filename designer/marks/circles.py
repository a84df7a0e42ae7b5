"""A grid of circles, symmetric or asymmetric, as OpenCV has it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from designer.base.arrays import Array, Rows
from designer.marks.face_marks import FaceMarks, check_marks, lattice


@dataclass(frozen=True)
class Circles(FaceMarks):
    """Row by row from the upper left; in an asymmetric grid each second row is shifted to the right by half a step."""

    kind: ClassVar[str] = "circles"

    circles: tuple[int, int]  # in a row, rows
    pitch_mm: float  # from circle to circle in a row; rows of an asymmetric grid are half of it apart
    diameter_mm: float
    asymmetric: bool = False
    light: bool = False  # light circles on a dark ground

    def __post_init__(self) -> None:
        check_marks(self.circles, (2, 2), "circles", steps=self.pitch_mm, circles=self.diameter_mm)
        if self.diameter_mm >= (nearest := self.nearest_mm):
            raise ValueError(f"circles of {self.diameter_mm:g} mm must be smaller than their distance, {nearest:g} mm")

    @property
    def nearest_mm(self) -> float:
        """From circle to circle."""
        return self.pitch_mm / math.sqrt(2) if self.asymmetric else self.pitch_mm

    @property
    def index(self) -> Rows:
        """Column and row; columns of an asymmetric grid count half steps."""
        at = lattice(*self.circles)
        return np.column_stack([2 * at[:, 0] + at[:, 1] % 2, at[:, 1]]) if self.asymmetric else at

    @property
    def position_mm(self) -> Array:
        """Of the centres."""
        step = self.pitch_mm / 2 if self.asymmetric else self.pitch_mm
        at = self.index * np.array([step, -step])
        middle: Array = at - 0.5 * (at.min(axis=0) + at.max(axis=0))
        return middle

    @property
    def size_mm(self) -> tuple[float, float]:
        """To the circles' outer edges."""
        width, height = (np.ptp(self.position_mm, axis=0) + self.diameter_mm).tolist()
        return width, height

    @property
    def least_mm(self) -> float:
        """Of a circle, and of the white between two."""
        return min(self.diameter_mm, self.nearest_mm - self.diameter_mm)

    @property
    def words(self) -> str:
        """With its circles."""
        kind = "asymmetric circle grid" if self.asymmetric else "circle grid"
        return (
            f"{kind} of {self.circles[0]} x {self.circles[1]}, {self.diameter_mm:g} mm wide, {self.pitch_mm:g} mm apart"
        )

    @property
    def kalibr_fields(self) -> Mapping[str, str | int | float | bool]:
        """In metres; of an asymmetric grid the distance of rows."""
        counts = {"targetCols": self.circles[0], "targetRows": self.circles[1]}
        spacing = round(self.pitch_mm / (2000 if self.asymmetric else 1000), 12)
        return {"target_type": "circlegrid", **counts, "spacingMeters": spacing, "asymmetricGrid": self.asymmetric}

    @property
    def alike(self) -> int:
        """Ways to turn it that bring circles on circles: 1 of an asymmetric grid with an odd number of rows."""
        if self.asymmetric:
            return 2 - self.circles[1] % 2
        return 4 if self.circles[0] == self.circles[1] else 2

    @property
    def remedy(self) -> str:
        """See `FaceMarks.remedy`."""
        return "an asymmetric grid with an odd number of rows, such as 4 x 11"

    @property
    def radius_mm(self) -> float:
        """Of each circle."""
        return self.diameter_mm / 2

    @property
    def is_light(self) -> bool:
        """As asked for."""
        return self.light


MARKS = Circles
