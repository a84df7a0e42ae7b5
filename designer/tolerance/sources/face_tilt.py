"""Faces, or pieces of a board, that are inclined against their plane."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, turn_of_pieces
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each piece tilts by the rotation vector (a, b, 0) in its frame, about its middle."""
    if (np.linalg.norm(values, axis=1) >= np.pi / 2).any():
        raise ValueError("faces tilt by less than 90deg")
    return shape.with_pieces_moved(turn_of_pieces(shape.nominal, np.pad(values, ((0, 0), (0, 1)))))


SOURCE = ErrorSource("face_tilt", "tilt of faces or pieces", "rad", "piece", 2, _apply)
