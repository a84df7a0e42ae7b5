"""A board that is not flat."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource
from designer.tolerance.sources.face_bow import bent


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """The board bends as `face_bow` bends a face; a body of several faces is stiff and stays as it is.

    A back follows its front: seen from behind, in x that runs the other way, the dome and the saddle along x and y are
    hollows of the same depth, and the twist is the same.
    """
    if not shape.nominal.is_plate:
        return shape
    return bent(shape, values * np.array([[1, 1, 1], [-1, -1, 1]])[: shape.nominal.face_count])


SOURCE = ErrorSource("warp", "warp of a board", "mm", "print", 3, _apply)
