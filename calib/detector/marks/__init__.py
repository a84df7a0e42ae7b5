"""Finding other makers' marks in photos: a file a kind, which names points; `calib.detector.boards` measures them.

A kind is a file of this folder, which holds its `FINDER`, under the name that it has in `designer.marks`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calib.core.registry import Registry
from designer.base.arrays import Array, Rows
from designer.marks.face_marks import MARKS, FaceMarks


@dataclass(frozen=True, eq=False)
class FoundFace:
    """Which points of a face a photo shows, and about where; or why none could be named."""

    face: int  # row of the faces that were asked for
    row: Rows  # (N,) rows of the face's points, ascending
    near_px: Array  # (N, 2) to a pixel or better
    remarks: tuple[str, ...] = ()
    cov_px2: Array | None = None  # (N, 2, 2) of a finder that measures itself; None: `near_px` is where to begin


class Finder(Protocol):
    """Names the points of all faces of a kind in one photo: equal faces, and several in view, are its business."""

    def __call__(self, pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
        """A record for each face of which something is to be told."""


FINDERS: Registry[Finder] = Registry("calib.detector.marks", "FINDER", MARKS)
