"""Ink that runs, or lines of plastic that come out too wide."""

from dataclasses import replace

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Ink grows by b at every edge: R + b outside, r - b at a ring's hole. Centres stay where they are.

    Dots have no hole to lose, points no ink.
    """
    bleed = values[0, 0] * shape.nominal.has_marks
    has_hole = shape.nominal.radius_inner_mm > 0
    return replace(
        shape,
        radius_outer_mm=shape.radius_outer_mm + bleed,
        radius_inner_mm=np.where(has_hole, shape.radius_inner_mm - bleed, 0.0),
    )


INK_BLEED = ErrorSource("ink_bleed", "ink bleed at each edge", "mm", "print", 1, _apply)
