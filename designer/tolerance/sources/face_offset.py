"""Faces, or pieces of a board, that stand out or lie deep: layers, glue, thickness of a sticker."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, shift_of_pieces
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each piece moves along its outward normal."""
    return shape.with_pieces_moved(shift_of_pieces(np.pad(values, ((0, 0), (2, 0)))))


SOURCE = ErrorSource("face_offset", "offset of faces or pieces along their normal", "mm", "piece", 1, _apply)
