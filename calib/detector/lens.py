"""Straightening: a map from pixels to an image in which straight lines stay straight, and its local form at a ring."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Protocol, TypeAlias

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.parameters import slopes
from calib.core import homography
from calib.core.homography import determines, equations, fit_entries
from calib.core.jit import jit
from calib.core.se3 import rotation_between
from calib.core.small_solve import cholesky_factor, substitute
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError

Floats: TypeAlias = Array
Integers: TypeAlias = Rows

STEPS = 5
DAMPING = 1e-10
FLOOR_PX = 0.05
"""Points nearer than this to where they belong are never left out."""
FAR_COSINE = 0.5
"""Of the angle off the axis from which on a plane across it is no place for rays."""
MIN_POINTS = 20
MAX_POINTS = 300
SIGNIFICANCE = 15.0
"""How much more a lens must explain than noise would (F statistic) before it is believed."""


@jit
def descend(plane: Floats, offset: Floats, first: Integers, floor: float) -> tuple[float, float, float, float]:
    """k1 and k2, and the sums of squares without and with them."""
    k1 = k2 = straight_cost = 0.0
    for turn in range(STEPS):
        n11, n12, n22, g1, g2, cost = _lens_equations(k1, k2, plane, offset, first, floor)
        if turn == 0:
            straight_cost = cost
        # Scaled to one, and hardly damped: grids near the middle tell k1 and k2 together only.
        s1, s2 = max(np.sqrt(n11), 1e-150), max(np.sqrt(n22), 1e-150)
        share = n12 / (s1 * s2)
        determinant = (1.0 + DAMPING) ** 2 - share * share
        step1 = ((1.0 + DAMPING) * g1 / s1 - share * g2 / s2) / (determinant * s1)
        step2 = ((1.0 + DAMPING) * g2 / s2 - share * g1 / s1) / (determinant * s2)
        k1, k2 = min(max(k1 + step1, -0.9), 0.9), min(max(k2 + step2, -0.9), 0.9)
        if max(abs(step1), abs(step2)) < 1e-6:
            break
    return k1, k2, straight_cost, _lens_equations(k1, k2, plane, offset, first, floor)[5]


@jit
def _lens_equations(
    k1: float, k2: float, plane: Floats, offset: Floats, first: Integers, floor: float
) -> tuple[float, float, float, float, float, float]:
    """Normal matrix and gradient of (k1, k2), every plane's homography eliminated; and the sum of squares, trimmed.

    Points of the plane g, at their mean, are rows `first[g]` to `first[g + 1]`; offsets of their pixels from the middle
    are in half diagonals, as is `floor`, a distance that is never too far.
    """
    n11 = n12 = n22 = g1 = g2 = cost = 0.0
    h, once = np.empty(9), np.int64(1)  # a bare 1 would be a type of its own
    normal, gradient = np.empty((8, 8)), np.empty(8)
    for g in range(len(first) - 1):
        x, pixel = plane[first[g] : first[g + 1]], offset[first[g] : first[g + 1]]
        straight, residual = np.empty(pixel.shape), np.empty(pixel.shape)
        size = np.empty(len(x))
        for n in range(len(x)):
            r2 = pixel[n, 0] ** 2 + pixel[n, 1] ** 2
            for c in range(2):
                straight[n, c] = pixel[n, c] * (1.0 + k1 * r2 + k2 * r2 * r2)
        weight = np.ones(len(x))
        if not fit_entries(x, straight, weight, once, h, normal, residual):
            continue
        for n in range(len(x)):
            size[n] = np.hypot(residual[n, 0], residual[n, 1])
        keep = size < 6.0 * np.median(size) + floor
        if not keep.all():
            x, straight, pixel = x[keep], straight[keep], pixel[keep]
            weight, residual = weight[keep], residual[keep]
            if len(x) < 6 or not determines(x):
                continue
            if not fit_entries(x, straight, weight, once, h, normal, residual):
                continue
        equations(x, straight, weight, h, normal, gradient, residual)
        if not cholesky_factor(normal):
            continue
        own, cross = _by_lens(x, straight, pixel, h, residual)
        solved = cross.copy()
        substitute(normal, solved[0])
        substitute(normal, solved[1])
        n11 += own[0] - np.sum(cross[0] * solved[0])
        n12 += own[1] - np.sum(cross[0] * solved[1])
        n22 += own[2] - np.sum(cross[1] * solved[1])
        g1 -= own[3] - np.sum(solved[0] * gradient)
        g2 -= own[4] - np.sum(solved[1] * gradient)
        cost += own[5]
    return max(n11, 0.0), n12, max(n22, 0.0), g1, g2, cost


@jit
def _by_lens(x: Floats, straight: Floats, pixel: Floats, h: Floats, residual: Floats) -> tuple[Floats, Floats]:
    """Of one group: sums over squares of the derivatives by k1 and k2, times residuals, and of residuals (6,).

    And those derivatives times those by the homography's entries (2, 8).
    """
    own, cross = np.zeros(6), np.zeros((2, 8))
    for n in range(len(x)):
        inverse = 1.0 / (h[6] * x[n, 0] + h[7] * x[n, 1] + h[8])
        r2 = pixel[n, 0] ** 2 + pixel[n, 1] ** 2
        for c in range(2):
            by1 = pixel[n, c] * r2
            by2 = by1 * r2
            own[0] += by1 * by1
            own[1] += by1 * by2
            own[2] += by2 * by2
            own[3] += by1 * residual[n, c]
            own[4] += by2 * residual[n, c]
            own[5] += residual[n, c] ** 2
            u = straight[n, c] - residual[n, c]
            for k, by in ((0, by1), (1, by2)):
                cross[k, 3 * c] += by * x[n, 0] * inverse
                cross[k, 3 * c + 1] += by * x[n, 1] * inverse
                cross[k, 3 * c + 2] += by * inverse
                cross[k, 6] -= by * u * x[n, 0] * inverse
                cross[k, 7] -= by * u * x[n, 1] * inverse
    return own, cross


class Lens(Protocol):
    """A straightening map and its inverse, on (..., 2) arrays."""

    def straighten(self, pixel: Floats) -> Floats:
        """From pixels to the straight image, which has about the same scale."""
        ...

    def distort(self, straight: Floats) -> Floats:
        """Back to pixels."""
        ...

    @property
    def is_turned(self) -> bool:
        """Whether the straight image looks aside, so that its scale is uneven."""
        ...

    def facing(self, pixel: Floats) -> "Lens":
        """The lens whose straight image shows what is seen at pixels (N, 2), also far off the axis."""
        ...


@dataclass(frozen=True)
class NoLens:
    """A pinhole image as it is."""

    is_turned: ClassVar[bool] = False

    def straighten(self, pixel: Floats) -> Floats:
        """The same points."""
        return pixel

    def distort(self, straight: Floats) -> Floats:
        """The same points."""
        return straight

    def facing(self, pixel: Floats) -> "NoLens":
        """The same: it shows all."""
        return self


@dataclass(frozen=True)
class RadialLens:
    """x = c + (u - c) (1 + k1 r^2 + k2 r^4), r in half diagonals of the image."""

    k1: float
    k2: float
    middle_px: tuple[float, float]
    half_diagonal_px: float
    is_turned: ClassVar[bool] = False

    def straighten(self, pixel: Floats) -> Floats:
        """Pixels to the straight image."""
        offset = pixel - np.array(self.middle_px)
        r2 = (offset**2).sum(axis=-1, keepdims=True) / self.half_diagonal_px**2
        return np.asarray(pixel + offset * (self.k1 * r2 + self.k2 * r2 * r2))

    def distort(self, straight: Floats) -> Floats:
        """Newton's method on the radius."""
        offset = straight - np.array(self.middle_px)
        target = np.linalg.norm(offset, axis=-1, keepdims=True) / self.half_diagonal_px
        radius = target.copy()
        with np.errstate(over="ignore", invalid="ignore"):  # far outside the image it may run away
            for _ in range(12):
                r2 = radius * radius
                slope = 1 + 3 * self.k1 * r2 + 5 * self.k2 * r2 * r2
                radius = radius - (radius * (1 + self.k1 * r2 + self.k2 * r2 * r2) - target) / np.maximum(slope, 0.1)
        return np.asarray(np.array(self.middle_px) + offset * radius / np.maximum(target, 1e-12))

    def facing(self, pixel: Floats) -> "RadialLens":
        """The same: it shows all."""
        return self


@dataclass(frozen=True, eq=False)
class CameraLens:
    """The straight image of a known camera: its rays cut with a plane, at the scale of its middle.

    The plane lies across the camera's axis. A wide lens sees what no such plane shows, or shows far too large: of a
    target that lies there, the plane lies across the way to it.
    """

    camera: Camera
    straight_from_cam: Floats = field(default_factory=lambda: np.eye(3))  # (3, 3) rotation

    def __post_init__(self) -> None:
        if not 1e-3 < self._scale < 1e9:
            raise InputError("the camera has no usable rays in the middle of the image; check its parameters")

    @cached_property
    def is_turned(self) -> bool:
        """Whether the plane lies across another way than the axis."""
        return not np.array_equal(self.straight_from_cam, np.eye(3))

    @cached_property
    def _scale(self) -> float:
        width, height = self.camera.image_size
        middle = np.array([[0.5 * width, 0.5 * height], [0.5 * width + 1, 0.5 * height]])
        step = float(np.linalg.norm(np.diff(slopes(rays(self.camera, middle)), axis=0)))
        return 1 / step if step > 0 else np.inf

    def straighten(self, pixel: Floats) -> Floats:
        """Pixels to the straight image."""
        ray = rays(self.camera, pixel)
        return np.asarray(self._scale * slopes(ray @ self.straight_from_cam.T if self.is_turned else ray))

    def distort(self, straight: Floats) -> Floats:
        """Back to pixels."""
        point = np.concatenate([straight / self._scale, np.ones((*straight.shape[:-1], 1))], axis=-1)
        return project(self.camera, point @ self.straight_from_cam)

    def directions(self, straight_from_plane: Floats) -> Floats:
        """The map to directions in the camera's frame of a map to the straight image.  # (3, 3) -> (3, 3)"""
        return np.asarray(self.straight_from_cam.T @ np.diag([1, 1, self._scale]) @ straight_from_plane / self._scale)

    def facing(self, pixel: Floats) -> "CameraLens":
        """The plane turned to where pixels (N, 2) look, if any of them looks far off the axis."""
        ray = rays(self.camera, pixel)
        ray = ray[np.isfinite(ray).all(axis=1)]
        middle = ray.sum(axis=0)
        length = float(np.linalg.norm(middle))
        if not length > 0 or ray[:, 2].min() > FAR_COSINE:
            return replace(self, straight_from_cam=np.eye(3))
        return replace(self, straight_from_cam=rotation_between(middle / length, np.array([0.0, 0.0, 1.0])))


def local_form(lens: Lens, pixel: Floats, step_px: float = 2.0) -> tuple[Floats, Floats]:
    """The straightening near each pixel: straight(u + v) = straight(u) + J (v + q(v)), to second order.

    Returns:
        J (N, 2, 2) and the six coefficients of q, as `ring_fit.fit_rings` takes them (N, 6).
    """
    if isinstance(lens, NoLens):
        return np.tile(np.eye(2), (len(pixel), 1, 1)), np.zeros((len(pixel), 6))
    ways = step_px * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    # Far outside the image a lens may run away, and what it says there is no number.
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        middle, east, west, south, north, *corner = lens.straighten(pixel + ways[:, None])
        corners = corner[0] + corner[1] - corner[2] - corner[3]
        jacobian = np.stack([east - west, south - north], axis=-1) / (2 * step_px)
        second = np.stack(
            [0.5 * (east - 2 * middle + west), 0.25 * corners, 0.5 * (south - 2 * middle + north)], axis=-1
        )
        (a, b), (c, d) = np.moveaxis(jacobian, 0, -1)
        adjugate = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
        bend = adjugate @ second / ((a * d - b * c)[:, None, None] * step_px**2)
    return jacobian, np.asarray(bend.reshape(-1, 6), dtype=np.float64)


def local_scale(lens: Lens, pixel: Floats) -> Floats:
    """Straight pixels over pixels at each pixel, as areas tell it.  # (N, 2) -> (N,)"""
    (a, b), (c, d) = np.moveaxis(local_form(lens, pixel)[0], 0, -1)
    return np.asarray(np.sqrt(np.abs(a * d - b * c)))


def scale_to_weigh_with(lens: Lens, pixel: Floats) -> Floats:
    """`local_scale`, and one where that is nearly even all over the target.  # (N, 2) -> (N,)"""
    return local_scale(lens, pixel) if lens.is_turned else np.ones(len(pixel))


def usable_groups(groups: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Those that fix a homography, and of large ones an even share."""
    return [_thinned(*group) for group in groups if len(group[0]) >= 6 and homography.is_determined(group[0])]


def radial_lens(groups: list[tuple[Floats, Floats]], image_size: tuple[int, int]) -> tuple[Lens, float]:
    """The radial lens that best turns planes' grids into homographies, if it explains more than chance would.

    And the root mean square in px that is left, without what lies far off. Each group is the points in a plane (N, 2)
    and their pixels (N, 2), one of `usable_groups`.

    Nothing is left of points that are too few to tell a lens.
    """
    middle = (0.5 * (image_size[0] - 1), 0.5 * (image_size[1] - 1))
    half_diagonal = 0.5 * float(np.hypot(*image_size))
    count = sum(len(plane) for plane, _ in groups)
    freedom = 2 * count - 8 * len(groups) - 2
    if count < MIN_POINTS or freedom < 10:
        return NoLens(), 0.0
    first = np.cumsum([0] + [len(plane) for plane, _ in groups])
    # The pixels in half diagonals from the middle, so that each group's homography leads there.
    offset = (np.concatenate([pixel for _, pixel in groups]) - np.array(middle)) / half_diagonal
    plane = np.concatenate([homography.moved_to_mean(np.ascontiguousarray(plane))[0] for plane, _ in groups])
    k1, k2, straight_cost, cost = descend(plane, offset, first, FLOOR_PX / half_diagonal)
    # Without a fold: the radius must grow to the corner of the image.
    r2 = np.linspace(0, 1, 21)
    folds = (1 + 3 * k1 * r2 + 5 * k2 * r2**2).min() <= 0.1
    explained = (straight_cost - cost) / 2 / max(cost / freedom, 1e-12 / half_diagonal**2)
    is_sure = np.isfinite(k1 + k2) and not folds and explained >= SIGNIFICANCE
    left_px = half_diagonal * float(np.sqrt((cost if is_sure else straight_cost) / count))
    return RadialLens(k1, k2, middle, half_diagonal) if is_sure else NoLens(), left_px


def misfit_px(lens: Lens, groups: list[tuple[Floats, Floats]]) -> float:
    """How far, in the median, a lens leaves planes' grids from homographies; infinite where it has no rays for them.

    Groups are as for `radial_lens`; small ones do not count.
    """
    off = [np.zeros(0)]
    for plane, pixel in groups:
        if len(plane) < MIN_POINTS or not homography.is_determined(plane):
            continue
        facing = lens.facing(pixel)
        straight = facing.straighten(pixel)
        if not np.isfinite(straight).all():
            return np.inf
        scale = scale_to_weigh_with(facing, pixel)
        off.append(np.linalg.norm(homography.fit(plane, straight, 1 / scale**2)[2], axis=1) / scale)
    every = np.concatenate(off)
    return float(np.median(every)) if len(every) else 0.0


def _thinned(plane: Floats, pixel: Floats) -> tuple[Floats, Floats]:
    """An even share of a large grid: its lens is plain from fewer points."""
    if len(plane) <= MAX_POINTS:
        return plane, pixel
    # Drawn, not every so many: a step through a grid row by row may keep to one column.
    rows = np.random.default_rng(0).choice(len(plane), MAX_POINTS, replace=False)
    return plane[rows], pixel[rows]
