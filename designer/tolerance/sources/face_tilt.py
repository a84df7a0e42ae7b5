"""Faces that are inclined against their plane."""

import numpy as np

from designer.tolerance.shape import MadeShape, turn_of_faces
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face tilts by the rotation vector (a, b, 0) in its frame, about the middle of its outline."""
    if (np.linalg.norm(values, axis=1) >= np.pi / 2).any():
        raise ValueError("faces tilt by less than 90deg")
    return shape.with_faces_moved(turn_of_faces(shape.nominal, np.pad(values, ((0, 0), (0, 1)))))


FACE_TILT = ErrorSource("face_tilt", "tilt of faces", "rad", "face", 2, _apply)
