"""A board that is bent in proportion to its size, as makers of boards promise it."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, face_middle_mm
from designer.tolerance.source import ErrorSource
from designer.tolerance.sources.warp import SOURCE as WARP


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """As `warp`, a value being the sagitta from the middle to the corner over the length of the diagonal.

    Bow and twist of printed boards are limited by such shares (IPC-TM-650 2.4.22): a board that rests on its rim is
    as high in the middle as its bow says.
    """
    outline = shape.nominal.outline_mm[0] - face_middle_mm(shape.nominal)[0]
    diagonal_mm = 2 * float(np.linalg.norm(outline, axis=1).max())
    return WARP.apply(shape, values * diagonal_mm)


SOURCE = ErrorSource("bow_twist", "bow and twist of a board, of its diagonal", "1", "print", 3, _apply)
