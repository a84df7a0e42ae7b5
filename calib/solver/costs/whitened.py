"""The distance between a ray and a point in units of what a pixel's noise does to it: in pixels, then.

A pixel's covariance S gives the point's distance across the ray, r = (d x) angle, the covariance r^2 J S J' with
J = d ray / d pixel. Whitened by it a distance is `G (x / d x)`, G = d pixel / d ray at the measured pixel, times what
whitens S: to first order the distance in the image. Measured in the face's plane it is the same, as the plane comes in
on both sides.

G times a step is taken as a central difference over pixels, whose derivatives the model tells:
`G e = (u(d + h e) - u(d - h e)) / 2 h`. With h = 1 it is right to the third order of the angle e.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise
from calib.cameras.camera import Camera
from calib.solver.distance import Distances, PixelRays, SightedPoints, along_rays

WIDEST = 1e-3
"""Of a step (rad); larger angles are taken in part."""


@dataclass(frozen=True)
class _Whitened:
    needs_planes: bool = False

    def measure(self, camera: Camera, seen: PixelRays, places: SightedPoints) -> Distances:
        """All distances; nan of points behind the camera as the ray has it, and where the lens ends."""
        along, ray = along_rays(seen, places), seen.direction
        ahead = places.point / along.value
        angle = ahead - ray
        part = np.minimum(1.0, WIDEST / np.maximum(np.linalg.norm(angle, axis=0), 1e-300))
        after, before = (linearise(camera, np.ascontiguousarray(ray + side * part * angle)) for side in (1, -1))
        # What moves d + h e and d - h e: the ray itself, and e = x / (d x) - d by the point and by the ray.
        middle = 0.5 * (after.by_point + before.by_point)
        bend = (after.by_point - before.by_point) / (2 * part)
        along_ahead = np.einsum("kin,in->kn", middle, ahead)
        by_point = (middle - along_ahead[:, None] * ray) / along.value
        by_axes = np.einsum("kin,ain->kan", bend - middle, seen.axes)
        by_ray = by_axes - along_ahead[:, None] * (along.by_ray / along.value)
        by_params = (after.by_params - before.by_params) / (2 * part)
        return Distances((after.pixel - before.pixel) / (2 * part), by_point, by_ray, places.lever, by_params=by_params)


DISTANCE = _Whitened()
