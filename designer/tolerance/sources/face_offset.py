"""Faces that stand out or lie deep: layers, glue, thickness of a sticker."""

import numpy as np

from designer.tolerance.shape import MadeShape, shift_of_faces
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face moves along its outward normal."""
    return shape.with_faces_moved(shift_of_faces(np.pad(values, ((0, 0), (2, 0)))))


FACE_OFFSET = ErrorSource("face_offset", "offset of faces along their normal", "mm", "face", 1, _apply)
