"""Patterns that are turned on the face."""

import numpy as np

from designer.tolerance.shape import Shape, turn_of_faces
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: Shape, values: Array) -> Shape:
    """Each face turns about its normal through the middle of its outline."""
    return shape.with_faces_moved(turn_of_faces(shape.nominal, np.pad(values, ((0, 0), (2, 0)))))


FACE_ROTATION = ErrorSource("face_rotation", "rotation of faces in their plane", "rad", "face", 1, _apply)
