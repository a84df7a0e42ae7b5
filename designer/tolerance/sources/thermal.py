"""A target that is warmer or colder than it was when its size was right."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """A = (1 + alpha dT) I with the material's coefficient of linear expansion alpha."""
    return shape.in_bed_axes((1 + shape.expansion_per_kelvin * values[0, 0]) * np.eye(3))


SOURCE = ErrorSource("thermal", "difference of temperature", "K", "print", 1, _apply, needs="expansion")
