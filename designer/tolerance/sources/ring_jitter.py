"""Rings that sit beside their place: backlash, droplets, single lines of plastic."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each ring moves by its own step (x, y) in its face."""
    return shape.with_rings_moved(np.pad(values, ((0, 0), (0, 1))))


SOURCE = ErrorSource("ring_jitter", "place of single rings", "mm", "ring", 2, _apply)
