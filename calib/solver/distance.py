"""Distances in space between the rays of measured pixels and the points that they show, with all derivatives.

A camera model tells the pixels of points, and the derivatives of that. At a measured pixel u with the unit ray d these
say the rest, as u stays the image of its ray: with G = du/dx at x = d, axes E (3, 2) across the ray and P = du/dc,

    G E dd + P dc = du,   dd = (G E)^-1 (du - P dc)   along the axes,

for every model (the implicit function theorem). A model that only knows rays would give them at once.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.cameras import linearise, rays
from calib.cameras.camera import Camera
from designer.base.arrays import Array, Rows

BACKWARDS = 1e-12
"""Of 1 + z: the axes are not defined across the ray straight back, which no lens has."""


@dataclass(frozen=True, eq=False)
class PixelRays:
    """The rays of N pixels, and what moves them; nan where the camera has none."""

    direction: Array  # (3, N) unit vectors d
    axes: Array  # (2, 3, N) unit vectors across: where the axes x and y go when z is turned into d the short way
    by_params: Array  # (2, P, N) steps along the axes


@dataclass(frozen=True, eq=False)
class SightedPoints:
    """The points that these pixels show, in the camera's frame."""

    point: Array  # (3, N) mm
    lever: Array  # (3, N) mm from the target's origin: what a turn of the target moves the point by
    plane_axes: Array | None  # (2, 3, N) unit vectors in the point's face; None: not needed


@dataclass(frozen=True, eq=False)
class Range:
    """How far along its ray a distance is measured."""

    value: Array  # (N,) mm
    by_point: Array  # (3, N)
    by_ray: Array  # (2, N)


@dataclass(frozen=True, eq=False)
class Distances:
    """N distances of two coordinates each, and what moves them."""

    value: Array  # (2, N)
    by_point: Array  # (2, 3, N)
    by_ray: Array  # (2, 2, N) by steps of the ray along its axes
    lever: Array  # (3, N) from the target's origin to what moves when the target is moved
    range: Range | None = None  # None: they are in pixels
    by_params: Array | None = None  # (2, P, N) beside what the ray does with them; None: nothing

    def over_range(self) -> "Distances":
        """The same over the range."""
        far = self.range
        if far is None:
            raise ValueError("these distances have no range")
        angle = self.value / far.value
        return Distances(
            angle,
            (self.by_point - angle[:, None] * far.by_point) / far.value,
            (self.by_ray - angle[:, None] * far.by_ray) / far.value,
            self.lever,
        )

    def rows(self, seen: PixelRays) -> Array:
        """As the rows of `calib.cameras.parameters.Linearised`.  # (8 + 2 P, N)"""
        by_params = np.einsum("ijn,jpn->ipn", self.by_ray, seen.by_params)
        if self.by_params is not None:
            by_params += self.by_params
        count = self.value.shape[1]
        return np.concatenate([part.reshape(-1, count) for part in (self.value, self.by_point, by_params)])


class Distance(Protocol):
    """A way to measure."""

    @property
    def needs_planes(self) -> bool:
        """Whether the points' faces have to be known."""
        ...

    def measure(self, camera: Camera, seen: PixelRays, places: SightedPoints) -> Distances:
        """All distances; nan where the ray does not lead to the point."""
        ...


def pixel_rays(camera: Camera, pixel: Array) -> PixelRays:
    """The rays of pixels (2, N)."""
    direction = np.ascontiguousarray(rays(camera, pixel.T).T)
    lost = ~np.isfinite(direction).all(axis=0)
    direction[:, lost] = np.array([[0.0], [0.0], [1.0]])
    linear = linearise(camera, direction)
    x, y, z = direction
    k = 1 / np.maximum(1 + z, BACKWARDS)
    axes = np.stack([[1 - k * x * x, -k * x * y, -x], [-k * x * y, 1 - k * y * y, -y]])
    (a, b), (c, d) = np.einsum("ikn,jkn->ijn", linear.by_point, axes)
    with np.errstate(divide="ignore", invalid="ignore"):
        by_pixel = np.stack([[d, -b], [-c, a]]) / (a * d - b * c)
    direction[:, lost] = np.nan
    return PixelRays(direction, axes, -np.einsum("ijn,jpn->ipn", by_pixel, linear.by_params))


def along_rays(seen: PixelRays, places: SightedPoints) -> Range:
    """How far along the rays the points are; nan of those behind the camera as the rays have it."""
    along = np.einsum("in,in->n", seen.direction, places.point)
    by_ray = np.einsum("ain,in->an", seen.axes, places.point)
    return Range(np.where(along > 0, along, np.nan), seen.direction, by_ray)


@dataclass(frozen=True, eq=False)
class InSpace:
    """What M distances are measured with."""

    distance: Distance
    is_over_range: bool
    pixel: Array  # (2, M) measured
    plane_axes: Array | None  # (2, 3, M) in the target's frame

    def take(self, rows: Rows) -> "InSpace":
        """Of some observations."""
        axes = None if self.plane_axes is None else self.plane_axes[:, :, rows]
        return InSpace(self.distance, self.is_over_range, np.ascontiguousarray(self.pixel[:, rows]), axes)

    def linearise(
        self, camera: Camera, span: slice, rotation: Array, lever: Array, point: Array
    ) -> tuple[Array, Array]:
        """The distances of some observations with their derivatives (8 + 2 P, N), and their levers (3, N).

        Args:
            camera: where.
            span: which.
            rotation: of the target in the view of each (N, 3, 3).
            lever: to the points from the target's origin, in the camera's frame (3, N).
            point: in the camera's frame (3, N).
        """
        axes = None
        if self.plane_axes is not None:
            axes = np.einsum("nij,ajn->ain", rotation, self.plane_axes[:, :, span])
        seen = pixel_rays(camera, self.pixel[:, span])
        found = self.distance.measure(camera, seen, SightedPoints(point, lever, axes))
        rows = (found.over_range() if self.is_over_range else found).rows(seen)
        return rows, np.ascontiguousarray(found.lever)
