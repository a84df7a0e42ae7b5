"""Shrinkage or swelling: the whole print off by one factor."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """A = (1 + s) I."""
    return shape.in_bed_axes((1 + values[0, 0]) * np.eye(3))


SOURCE = ErrorSource("scale", "scale of the print", "1", "print", 1, _apply)
