"""Patterns that are turned on the face, or pieces of a board."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, turn_of_pieces
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each piece turns about its normal through its middle."""
    return shape.with_pieces_moved(turn_of_pieces(shape.nominal, np.pad(values, ((0, 0), (2, 0)))))


SOURCE = ErrorSource("face_rotation", "rotation of faces or pieces in their plane", "rad", "piece", 1, _apply)
