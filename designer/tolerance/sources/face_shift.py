"""Patterns that sit beside their place on the face."""

import numpy as np

from designer.tolerance.shape import MadeShape, shift_of_faces
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face moves by (x, y) in its own plane."""
    return shape.with_faces_moved(shift_of_faces(np.pad(values, ((0, 0), (0, 1)))))


FACE_SHIFT = ErrorSource("face_shift", "shift of faces in their plane", "mm", "face", 2, _apply)
