"""Small boards of other makers' marks, and their pictures drawn apart from the product."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks

BOARDS: Mapping[str, FaceMarks] = {
    "chessboard": Chessboard((7, 5), 20.0),
    "light-first": Chessboard((6, 6), 20.0, light_first=True),
    "square": Chessboard((5, 5), 20.0),
    "charuco": Charuco((6, 5), 20.0, 14.0, "DICT_5X5_50", first_id=3),
    "legacy": Charuco((5, 6), 16.0, 12.0, "DICT_4X4_50", legacy=True),
    "aprilgrid": AprilGrid((4, 3), 20.0),
    "upright": AprilGrid(
        (4, 3), 16.0, 0.25, first_id=7, border_bits=1, corner_squares=False, from_top=True, upright=True
    ),
    "circles": Circles((6, 5), 20.0, 10.0),
    "square-circles": Circles((5, 5), 20.0, 10.0, light=True),
    "asymmetric": Circles((4, 7), 40.0, 12.0, asymmetric=True),
    "asymmetric-even": Circles((4, 6), 40.0, 12.0, asymmetric=True),
}
"""Of each kind several that differ in all that can."""


def picture_of(marks: FaceMarks, px_per_mm: int) -> NDArray[np.uint8]:
    """The marks' polygons on white, whose sides have to fall between pixels; no pixel is drawn twice."""
    size = np.array([round(side * px_per_mm) for side in marks.size_mm])
    times = np.zeros(size[::-1], np.int64)
    for polygon in marks.polygons_mm:
        corner = polygon * px_per_mm * [1, -1] + size / 2
        assert np.allclose(corner, corner.round(), atol=1e-6)
        (left, top), (right, below) = corner.min(axis=0).round().astype(int), corner.max(axis=0).round().astype(int)
        times[top:below, left:right] += 1
    assert times.max() <= 1
    return np.where(times > 0, 0, 255).astype(np.uint8)
