"""Wrong steps per millimetre: each axis of the printer off by its own factor."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """A = diag(1 + s_x, 1 + s_y, 1 + s_z) along the bed's axes.

    The mean of the three acts as `scale`, which a caliper takes back; the rest, without a trace, is what no rescaling
    mends. Three equal spreads sigma put sigma / sqrt(3) into the mean.
    """
    return shape.in_bed_axes(np.diag(1 + values[0]))


SOURCE = ErrorSource("axis_scale", "scale of single axes", "1", "print", 3, _apply)
