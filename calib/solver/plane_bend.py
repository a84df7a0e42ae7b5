"""A flat target that is bent: how, and where its points are then.

With x and y from -1 to 1 over its sides, and z along the normal of its plane, its points stand at
`z = a (1 - x^2) + b (1 - y^2)`: two curvatures, as mrcal's deformed calibration object. The edges' corners stay.
"""

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.core.types import KnownPoints, Observations, freeze
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import AtLeast, AtMost, Gap, Shape

FLAT, THIN = 0.05, 1e-3
"""Of the points' extent: what is off their plane by less is a flat target, bent or not; thinner points are a line."""
LEAST_POINTS = 4
LARGEST_MM = 1e7
_Length = Annotated[float, AtLeast(-LARGEST_MM), AtMost(LARGEST_MM)]


@dataclass(frozen=True, eq=False)
class PlaneBend:
    """Of a target whose points lie in a plane: `calibration.target_bend.height_mm`."""

    axes: Annotated[Array, Shape(3, 3)]  # rows: along x, along y, normal, in the target's frame
    middle_mm: tuple[_Length, _Length, _Length]
    half_mm: tuple[_Length, _Length]  # of the sides
    height_mm: tuple[_Length, _Length] = (0.0, 0.0)  # a, b
    covariance_mm2: tuple[Gap, Gap, Gap] = (0.0, 0.0, 0.0)  # of a, of a with b, of b

    def __post_init__(self) -> None:
        freeze(self, "axes")

    def modes_mm(self, position_mm: Array) -> Array:
        """What heights of 1 mm do to points (K, 3).  # (2, K, 3)"""
        place = ((position_mm - self.middle_mm) @ self.axes[:2].T) / self.half_mm
        modes: Array = (1 - place.T**2)[:, :, None] * self.axes[2]
        return modes

    def bent(self, seen: Observations) -> Observations:
        """Sightings of the flat target as those of the bent one."""
        return _moved(seen, np.tensordot(self.height_mm, self.modes_mm(seen.points.position_mm), 1))

    def flattened(self, seen: Observations) -> Observations:
        """Sightings of the bent target as those of the flat one; the modes do not depend on z."""
        return _moved(seen, -np.tensordot(self.height_mm, self.modes_mm(seen.points.position_mm), 1))

    @property
    def sigma_mm(self) -> tuple[float, float]:
        """Standard deviations of the heights."""
        first, _, second = np.sqrt(np.maximum(self.covariance_mm2, 0.0)).tolist()
        return first, second


def _moved(seen: Observations, step_mm: Array) -> Observations:
    return replace(seen, points=replace(seen.points, position_mm=seen.points.position_mm + step_mm))


def is_flat(points: KnownPoints) -> bool:
    """Whether points lie in a plane, nearly, and not on a line."""
    position = points.position_mm
    if len(position) < LEAST_POINTS:
        return False
    longest, across, off = np.linalg.svd(position - position.mean(axis=0), compute_uv=False).tolist()
    return bool(off <= FLAT * longest and across > THIN * longest)


def plane_bend(points: KnownPoints) -> PlaneBend:
    """The bend, still zero, of points in a plane; x lies along the first of the target's axes that does not cross it.

    Raises:
        InputError: they are in no plane, or on a line.
    """
    position = points.position_mm
    if not is_flat(points):
        raise InputError(
            "--free-bend: the target's points lie in no plane; it is for boards, so leave it out "
            "(calib measure tells the shape of other targets)"
        )
    directions = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)[2]
    normal = directions[2] * np.sign(directions[2][np.argmax(np.abs(directions[2]))])
    if len(points.plane) == 1 and points.plane[0, :3] @ normal < 0:
        normal = -normal
    first = np.eye(3)[int(np.argmax(np.abs(normal) < np.sqrt(0.5)))]
    along = first - (first @ normal) * normal
    along /= np.linalg.norm(along)
    axes = np.stack([along, np.cross(normal, along), normal])
    place = position @ axes.T
    low, high = place.min(axis=0), place.max(axis=0)
    x, y, z = (0.5 * (low + high) @ axes).tolist()
    return PlaneBend(axes, (x, y, z), (float(0.5 * (high - low)[0]), float(0.5 * (high - low)[1])))
