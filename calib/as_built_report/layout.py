"""Where the faces of a target are drawn: side by side, each in its own frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from designer.target import TargetGeometry

Array = NDArray[np.float64]

GAP = 0.12
"""Between faces, of a face's size."""
KEY = 0.2
"""Room above the faces for a scale, of a face's height."""
WIDE = 1.6
"""The width of the whole over its height, about."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Faces in rows, x to the right and y up, in mm; the first row begins at y = 0 and goes down."""

    middle_mm: Array  # (F, 2) where the middle of a face's outline lies
    face_middle_mm: Array  # (F, 2) the same in the face's frame
    size_mm: tuple[float, float]
    face_mm: float  # size of the largest face
    key_mm: float  # room above them
    label_from_middle_mm: tuple[float, float]
    has_room_inside: bool  # for labels of two lines, left of a face's top

    def placed(self, face: int, point_mm: Array) -> Array:
        """Points (N, 2) of a face's frame in the picture."""
        placed: Array = point_mm - self.face_middle_mm[face] + self.middle_mm[face]
        return placed

    def label_mm(self, face: int) -> tuple[float, float]:
        """Where a face's name stands: left of its top, or above it."""
        x, y = self.middle_mm[face].tolist()
        return x + self.label_from_middle_mm[0], y + self.label_from_middle_mm[1]


def layout_of(target: TargetGeometry) -> Layout:
    """The faces in rows."""
    low, high = target.outline_mm.min(axis=1), target.outline_mm.max(axis=1)
    width, height = (high - low).max(axis=0).tolist()
    gap = GAP * max(width, height) if not target.is_planar else 0.0
    cell = np.array([width + gap, height + gap])
    count = target.face_count
    about = max(1, round(math.sqrt(count * WIDE * cell[1] / cell[0])))
    columns = min(range(max(1, about - 1), about + 2), key=lambda columns: (-count % columns, abs(columns - about)))
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    place = np.arange(count)
    middle = np.column_stack([(place % columns + 0.5) * cell[0], -(place // columns + 0.5) * cell[1]])
    face = max(width, height)
    upper_left = np.stack([low[:, 0], high[:, 1]], axis=1)
    has_room = bool((np.linalg.norm(target.outline_mm - upper_left[:, None], axis=2).min(axis=1) > 0.2 * face).all())
    return Layout(
        middle, (low + high) / 2, (columns * cell[0], rows * cell[1]), face,
        KEY * height if count > 1 else 0.1 * height,
        (-0.36 * face, 0.26 * face) if has_room else (0.0, (height + gap) / 2), has_room,
    )  # fmt: skip
