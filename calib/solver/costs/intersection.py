"""The distance between a point and where the ray meets the plane of its face, along two axes in that plane.

With the plane's normal n the ray is met at `q = t d`, `t = n x / n d`. A displacement m of the ray's end at q, against
the plane, moves the intersection by `m - (n m / n d) d`; so does one of the target the other way. What a turn of the
target displaces is its place q, not the point.
"""

from dataclasses import dataclass

import numpy as np

from calib.cameras.camera import Camera
from calib.solver.distance import Distances, PixelRays, Range, SightedPoints

LEAST_SINE = 1e-6
"""Between ray and plane, as the metric has it."""


@dataclass(frozen=True)
class _Intersection:
    needs_planes: bool = True

    def measure(self, camera: Camera, seen: PixelRays, places: SightedPoints) -> Distances:
        """All distances; nan where the ray does not meet the plane."""
        del camera
        axes, ray = places.plane_axes, seen.direction
        if axes is None:
            raise ValueError("no planes to intersect with")
        normal = np.cross(axes[0], axes[1], axis=0)
        sine = np.einsum("in,in->n", normal, ray)
        sine = np.where(np.abs(sine) > LEAST_SINE, sine, np.nan)
        along = np.einsum("in,in->n", normal, places.point) / sine
        along = np.where(along > 0, along, np.nan)
        off = along * ray - places.point
        slide = axes - (np.einsum("ain,in->an", axes, ray) / sine)[:, None] * normal  # of a displacement at the end
        far = Range(along, normal / sine, -along * np.einsum("in,bin->bn", normal, seen.axes) / sine)
        by_ray = along * np.einsum("ain,bin->abn", slide, seen.axes)
        return Distances(np.einsum("ain,in->an", axes, off), -slide, by_ray, places.lever + off, far)


DISTANCE = _Intersection()
