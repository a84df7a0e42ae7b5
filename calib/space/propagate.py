"""From errors of pixels and of the rig to errors of points: the first-order law of error propagation.

A point X is where `sum |L_c (u_c(X) - m_c)|^2` is least, with `L'L` the inverse covariance of the sighting by camera c.
With `J_c = L_c du_c/dX`, `B_c = L_c du_c/d(unknowns of c)` and `H = sum J_c' J_c` its noise is `H^-1`, and errors d of
the unknowns move it by `-H^-1 sum J_c' B_c d_c`. The errors of a rig are written as independent ones of size one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.cameras.rig import Rig
from calib.space.linear import LinearSight, linear_sight
from designer.base.arrays import Array, Rows

SINGULAR = 1e-13
"""Determinant of a matrix, its diagonal scaled to one, that is rounding."""
_TRIANGLE = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True, eq=False)
class Rays:
    """M sightings of N points: by which camera, of which point, and what whitens their errors."""

    count: int  # N
    camera: Rows  # (M,)
    place: Rows  # (M,)
    whiten: Array  # (M, 2, 2) L, with L'L the inverse covariance

    def of_cameras(self) -> Iterator[tuple[int, Rows]]:
        """Each camera that sees something, and the rows of what it sees."""
        for camera in np.unique(self.camera).tolist():
            yield camera, np.flatnonzero(self.camera == camera)


@dataclass(frozen=True, eq=False)
class Propagated:
    """How N points scatter."""

    noise_mm2: Array  # (N, 3, 3) by the pixels
    by_calibration: Array | None  # (N, 3, R) by each of R independent errors of the rig, of size one; None: not known
    misclosure: Array  # (N,) what the rig's errors add to the sum of squared whitened residuals, on average

    @property
    def calibration_mm2(self) -> Array | None:
        """By the rig's own errors.  # (N, 3, 3)"""
        if self.by_calibration is None:
            return None
        return self.by_calibration @ self.by_calibration.transpose(0, 2, 1)


def whitening(cov_px2: Array) -> Array:
    """Lower triangles L (M, 2, 2) with `L'L` the inverse of covariances (M, 2, 2); nan of what is none."""
    with np.errstate(invalid="ignore", divide="ignore"):
        first = 1 / np.sqrt(cov_px2[:, 0, 0])
        slope = cov_px2[:, 0, 1] / cov_px2[:, 0, 0]
        second = 1 / np.sqrt(cov_px2[:, 1, 1] - slope * cov_px2[:, 0, 1])
    lower = np.zeros_like(cov_px2)
    lower[:, 0, 0], lower[:, 1, 0], lower[:, 1, 1] = first, -slope * second, second
    return lower


def sums_at(place: Rows, rows: Array, count: int) -> Array:
    """Sums (count,) of numbers (M,) point by point."""
    return np.asarray(np.bincount(place, rows, count), dtype=np.float64)


def normal_matrices(place: Rows, jacobian: Array, count: int) -> Array:
    """`sum J'J` (N, 3, 3) of whitened derivatives (M, 2, 3)."""
    normal = np.empty((count, 3, 3))
    for i, j in _TRIANGLE:
        product = jacobian[:, 0, i] * jacobian[:, 0, j] + jacobian[:, 1, i] * jacobian[:, 1, j]
        normal[:, i, j] = normal[:, j, i] = sums_at(place, product, count)
    return normal


def inverse_3x3(matrix: Array) -> Array:
    """The inverses of symmetric positive definite matrices (N, 3, 3) by their cofactors, nan of singular ones.

    A hundred times as fast as a factorisation of each, for the millions of points that there may be.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        scale = 1 / np.sqrt(np.diagonal(matrix, axis1=1, axis2=2))
        a, b, c = ((matrix[:, i, j] * scale[:, i] * scale[:, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        determinant = 1 + 2 * a * b * c - a * a - b * b - c * c
        determinant = np.where(determinant > SINGULAR, determinant, np.nan)
        cofactor = {
            (0, 0): 1 - c * c, (1, 1): 1 - b * b, (2, 2): 1 - a * a,
            (0, 1): b * c - a, (0, 2): a * c - b, (1, 2): a * b - c,
        }  # fmt: skip
        inverse = np.empty_like(matrix)
        for (i, j), value in cofactor.items():
            inverse[:, i, j] = inverse[:, j, i] = value / determinant * scale[:, i] * scale[:, j]
    return inverse


def propagate(rig: Rig, factor: Array | None, position_mm: Array, rays: Rays) -> Propagated:
    """How points (N, 3) of the rig's frame scatter that are triangulated from some rays.

    Args:
        rig: that sees them.
        factor: of its covariance (K, R), see `calibration_factor`; None: not known.
        position_mm: the points.  # (N, 3)
        rays: that they are triangulated from.
    """
    jacobian = np.full((len(rays.place), 2, 3), np.nan)
    sights: list[tuple[int, Rows, LinearSight]] = []
    for camera, rows in rays.of_cameras():
        sight = linear_sight(rig, camera, position_mm[rays.place[rows]])
        jacobian[rows] = rays.whiten[rows] @ sight.by_point
        sights.append((camera, rows, sight))
    normal = normal_matrices(rays.place, jacobian, rays.count)
    noise = inverse_3x3(normal)
    if factor is None:
        return Propagated(noise, None, np.zeros(rays.count))
    pulled = np.zeros((rays.count, 3, factor.shape[1]))
    squares = np.zeros(rays.count)
    for camera, rows, sight in sights:
        first, last = rig.first_row[camera], rig.first_row[camera + 1]
        white = rays.whiten[rows] @ sight.by_unknowns
        # One product for all: point by point it takes ten times as long.
        shift = (white.reshape(-1, last - first) @ factor[first:last]).reshape(len(rows), 2, -1)
        place = rays.place[rows]  # of a camera each another
        pulled[place] += jacobian[rows].transpose(0, 2, 1) @ shift
        squares[place] += np.einsum("mir,mir->m", shift, shift)
    moved = -noise @ pulled
    # What is left of the shifts when the points have followed them, by Pythagoras.
    return Propagated(noise, moved, squares + np.einsum("nir,nir->n", pulled, moved))
