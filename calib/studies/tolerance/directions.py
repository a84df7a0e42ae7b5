"""How each elementary number of an error source displaces the rings, to first order."""

import numpy as np
from numpy.typing import NDArray

from calib.studies.tolerance.setting import Setting
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.registry import SOURCES
from designer.tolerance.shape import centers_mm
from designer.tolerance.source import Unit

Array = NDArray[np.float64]

STEP: dict[Unit, float] = {"mm": 1e-3, "rad": 1e-4, "1": 1e-3, "K": 1.0}
"""Of the central differences."""


def directions(setting: Setting, errors: ErrorModel, name: str) -> Array:
    """Displacements of the rings by a unit of each number of a source, (R, 3, instances x components).

    Without other errors a face or ring moves on its own, so one difference serves all instances at once.
    """
    source = SOURCES[name]
    instances = source.instances(setting.target)
    owner = {
        "print": np.zeros(setting.target.ring_count, dtype=np.int64),
        "face": setting.target.ring_face,
        "ring": np.arange(setting.target.ring_count),
    }[source.scope]
    result = np.zeros((setting.target.ring_count, 3, instances, source.components))
    rings = np.arange(setting.target.ring_count)
    for component in range(source.components):
        step = np.zeros((instances, source.components))
        step[:, component] = STEP[source.unit]
        change = _centers(setting, errors, name, step) - _centers(setting, errors, name, -step)
        result[rings, :, owner, component] = change / (2 * STEP[source.unit])
    return result.reshape(setting.target.ring_count, 3, -1)


def _centers(setting: Setting, errors: ErrorModel, name: str, values: Array) -> Array:
    return centers_mm(
        displaced_shape(setting.target, {name: values}, model=errors, bed_from_target=setting.bed_from_target)
    )
