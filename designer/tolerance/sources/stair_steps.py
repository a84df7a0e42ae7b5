"""The stairs that layers make of an inclined face."""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape
from designer.tolerance.source import ErrorSource

LEAST_SLOPE_RAD = np.radians(10)
"""Flatter faces count as level: there a step, h / tan(slope), is wider than the stroke of a ring."""


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """Each face's rings shift up its slope by v h / sin(slope), for a value v in layers of height h.

    A layer carries the colours of one level of the drawing over its full height, so an edge of ink at the height z
    appears where a layer begins: up to half a layer off, which along the face is h / (2 sin(slope)). Over the many
    layers of a ring that averages out, but for what is common to all: the level a slicer cuts a layer at, and the
    round rim of a bead.
    """
    up = shape.nominal.target_from_face[:, :3, :3].transpose(0, 2, 1) @ shape.bed_axes[2]  # bed's z (F, 3)
    steepness = np.linalg.norm(up[:, :2], axis=1)  # sin(slope)
    is_stepped = steepness >= np.sin(LEAST_SLOPE_RAD)
    per_layer = np.zeros_like(up)
    per_layer[is_stepped, :2] = shape.layer_height_mm * up[is_stepped, :2] / steepness[is_stepped, None] ** 2
    return shape.with_rings_moved((values * per_layer)[shape.nominal.ring_face])


SOURCE = ErrorSource("stair_steps", "steps of layers", "1", "face", 1, _apply, needs="layer_height")
