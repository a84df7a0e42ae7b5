"""Faces that a printer with unequal or leaning axes drew flat, one by one."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, face_middle_mm
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face's rings move from its middle by the stretch (a, b) that leaves areas as they are.

        (x, y)' = (x, y) + (a x + b y, b x - a y)

    Axes whose scales differ by d have a = d / 2, axes that lean by s have b = s / 2; a pure size is `scale`.
    """
    nominal = shape.nominal
    x, y = (nominal.center_in_face_mm[:, :2] - face_middle_mm(nominal)[nominal.ring_face]).T
    a, b = values[nominal.ring_face].T
    return shape.with_rings_moved(np.stack([a * x + b * y, b * x - a * y, np.zeros_like(x)], axis=1))


SOURCE = ErrorSource("face_stretch", "stretch of faces in their plane", "1", "face", 2, _apply)
