"""Patterns that sit beside their place on the face, or pieces of a board beside theirs."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, shift_of_pieces
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each piece moves by (x, y) in its own plane."""
    return shape.with_pieces_moved(shift_of_pieces(np.pad(values, ((0, 0), (0, 1)))))


SOURCE = ErrorSource("face_shift", "shift of faces or pieces in their plane", "mm", "piece", 2, _apply)
