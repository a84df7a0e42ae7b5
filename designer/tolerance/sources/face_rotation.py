"""Patterns that are turned on the face."""

import numpy as np

from designer.tolerance.shape import MadeShape, turn_of_faces
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face turns about its normal through the middle of its outline."""
    return shape.with_faces_moved(turn_of_faces(shape.nominal, np.pad(values, ((0, 0), (2, 0)))))


FACE_ROTATION = ErrorSource("face_rotation", "rotation of faces in their plane", "rad", "face", 1, _apply)
