"""Axes of the printer that are not square to each other."""

import numpy as np

from designer.tolerance.shape import Shape
from designer.tolerance.source import Array, ErrorSource


def _apply(shape: Shape, values: Array) -> Shape:
    """The y axis leans to x by the angle xy, the z axis to x by xz and to y by yz.

        x' = x + y tan(xy) + z tan(xz),    y' = y + z tan(yz),    z' = z

    which is what the skew correction of printers' firmware takes back (Marlin's M852, Klipper's SET_SKEW). Half of it
    is a rotation, which moves no ring against another.
    """
    if (np.abs(values) >= np.pi / 4).any():
        raise ValueError("axes lean by less than 45deg")
    xy, xz, yz = np.tan(values[0])
    return shape.in_bed_axes(np.array([[1.0, xy, xz], [0.0, 1.0, yz], [0.0, 0.0, 1.0]]))


SKEW = ErrorSource("skew", "skew of the printer's axes", "rad", "print", 3, _apply)
