"""The distance between a ray and a point: the part of the point across the ray, `x - (d x) d`.

With the axes e1, e2 across the ray its coordinates are `e_k x`. A ray that is turned by a step s along the axes takes
these with it, `de_k = -s_k d`, and turns them about itself by `(y s_x - x s_y) / (1 + z)`: they are those that the axis
z takes along.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.solver.distance import BACKWARDS, Distances, PixelRays, SightedPoints, along_rays


@dataclass(frozen=True)
class _Ray:
    needs_planes: bool = False

    def measure(self, camera: Camera, seen: PixelRays, places: SightedPoints) -> Distances:
        """All distances; nan of points behind the camera as the ray has it."""
        del camera
        along, (x, y, z) = along_rays(seen, places), seen.direction
        across = along.by_ray + 0 * along.value
        turn = (y * seen.axes[:, 0] - x * seen.axes[:, 1]) / np.maximum(1 + z, BACKWARDS)  # by a step along each axis
        by_ray = np.stack([across[1] * turn, -across[0] * turn])
        by_ray[0, 0] -= along.value
        by_ray[1, 1] -= along.value
        return Distances(across, seen.axes, by_ray, places.lever, along)


DISTANCE = _Ray()
