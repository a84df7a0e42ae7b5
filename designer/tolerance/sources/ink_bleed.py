"""Ink that runs, or lines of plastic that come out too wide."""

from dataclasses import replace

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Ink grows by b at every edge: R + b outside, r - b at a ring's hole. Centres stay where they are.

    Dots have no hole to lose, points no ink, light circles none inside. Where dark squares touch, the corner between
    them stays; that of a tag alone moves out with both its edges.
    """
    target, bleed = shape.nominal, float(values[0, 0])
    has_hole = target.radius_inner_mm > 0
    grown = bleed * (target.radius_outer_mm > 0)
    if target.marks is not None:
        grown *= np.array([-1.0 if marks.is_light else 1.0 for marks in target.marks])[target.ring_face]
        ends = np.array([not marks.is_crossing for marks in target.marks])[target.ring_face]
        out = (2.0 * (target.ring_index % 2) - 1.0) * ends[:, None]
        shape = shape.with_rings_moved(bleed * np.column_stack([out, np.zeros(len(out))]))
    return replace(
        shape,
        radius_outer_mm=shape.radius_outer_mm + grown,
        radius_inner_mm=np.where(has_hole, shape.radius_inner_mm - bleed, 0.0),
    )


SOURCE = ErrorSource("ink_bleed", "ink bleed at each edge", "mm", "print", 1, _apply)
