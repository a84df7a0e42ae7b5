"""Axes of the printer that are not square to each other."""

import numpy as np

from designer.base.arrays import Array
from designer.base.units import skew_matrix
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """The y axis leans to x by the angle xy, the z axis to x by xz and to y by yz, see `designer.make.bed`.

    Half of it is a rotation, which moves no ring against another.
    """
    if (np.abs(values) >= np.pi / 4).any():
        raise ValueError("axes lean by less than 45deg")
    xy, xz, yz = values[0].tolist()
    return shape.in_bed_axes(skew_matrix((xy, xz, yz)))


SOURCE = ErrorSource("skew", "skew of the printer's axes", "rad", "print", 3, _apply)
