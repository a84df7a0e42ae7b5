"""How each elementary number of an error source displaces the rings, to first order."""

import numpy as np
from numpy.typing import NDArray

from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.registry import SOURCES
from designer.tolerance.shape import centers_mm
from designer.tolerance.source import Unit

Array = NDArray[np.float64]

STEP: dict[Unit, float] = {"mm": 1e-3, "rad": 1e-4, "1": 1e-3, "K": 1.0}
"""Of the central differences."""


def displacements(
    target: TargetGeometry, errors: ErrorModel, name: str, bed_from_target: Array | None = None
) -> tuple[Array, NDArray[np.int64]]:
    """Displacement of each ring by a unit of each number of the instance it belongs to, (R, 3, components), and that.

    Without other errors a face or ring moves on its own, so one difference serves all instances at once.

    Args:
        target: the nominal geometry.
        errors: what else the source needs to know of the way of making; amounts do not matter.
        name: of the source.
        bed_from_target: how the target lay on the bed, see `designer.tolerance.shape.shape_of`.  # (4, 4)

    Returns:
        The displacements, and each ring's instance (R,).
    """
    source = SOURCES[name]
    size, step_length = (source.instances(target), source.components), STEP[source.unit]
    change = np.empty((target.ring_count, 3, source.components))
    for component in range(source.components):
        step = np.zeros(size)
        step[:, component] = step_length
        ahead, behind = (
            centers_mm(displaced_shape(target, {name: one}, model=errors, bed_from_target=bed_from_target))
            for one in (step, -step)
        )
        change[:, :, component] = (ahead - behind) / (2 * step_length)
    instance = {
        "print": np.zeros(target.ring_count, dtype=np.int64),
        "face": target.ring_face,
        "ring": np.arange(target.ring_count),
    }[source.scope]
    return change, instance


def directions(target: TargetGeometry, errors: ErrorModel, name: str, bed_from_target: Array | None = None) -> Array:
    """Displacements of the rings by a unit of each number of a source, (R, 3, instances x components)."""
    change, instance = displacements(target, errors, name, bed_from_target)
    source, rings = SOURCES[name], np.arange(target.ring_count)
    result = np.zeros((target.ring_count, 3, source.instances(target), source.components))
    result[rings, :, instance] = change
    return result.reshape(target.ring_count, 3, -1)
