"""Inverses of matrices that data may leave singular: on what is determined, and saying what is not.

    sure = symmetric_inverse(normal)            # (..., N, N)
    step = -sure.inverse @ gradient             # nothing along what is not determined
    sigma = np.sqrt(np.diagonal(sure.covariance))   # nan where it is not

Numpy's `inv` and `solve` raise, or return rounding errors divided by rounding errors, whichever the processor makes of
it. These never raise: a matrix that is not finite determines nothing. Whether something is determined is asked with
the diagonal scaled to one, so that it does not depend on units (van der Sluis 1969).
"""

import math
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Flags, Rows

ROUNDING = 1e-13
"""Part of the largest eigenvalue, the diagonal scaled to one, that sums of products are uncertain by."""
LITTLE_TOLD = 3e5
"""Of information on unknowns of unit covariance: what of it is rounding is nothing beside that."""
SHARE = 1e-6
"""Length of the part of an unknown, a unit vector, that may lie along what is not determined."""


@dataclass(frozen=True, eq=False)
class SymmetricInverse:
    """The inverse of positive semidefinite matrices on what they determine."""

    inverse: Array  # (..., N, N) zero along what is not determined
    rank: Rows  # (...) how many directions are determined
    is_determined: Flags  # (..., N) unknowns without a part in what is not

    @property
    def covariance(self) -> Array:
        """The inverse as a statement of accuracy (..., N, N): nan for unknowns that are not determined."""
        known = self.is_determined
        return np.where(known[..., :, None] & known[..., None, :], self.inverse, np.nan)


def symmetric_inverse(matrix: Array, rounding: float = ROUNDING) -> SymmetricInverse:
    """The inverse of symmetric positive semidefinite matrices (..., N, N) on what they determine.

    With `D` that scales the diagonal to one and `D A D = V diag(w) V'`, it is `D V diag(1 / w) V' D` over the
    eigenvalues that are more than `rounding` of the largest. Unknowns whose diagonal is not positive, and all of a
    matrix with a number that is not finite, are not determined.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    scaled, scale = _unit_diagonal(matrix)
    value, vector = np.linalg.eigh(scaled)
    keeps = value > rounding * value[..., -1:].clip(min=0.0) if matrix.shape[-1] else value > 0
    part = vector * np.sqrt(1 / np.where(keeps, value, np.inf))[..., None, :] * scale[..., None]
    lost = np.sqrt((np.where(keeps[..., None, :], 0.0, vector) ** 2).sum(axis=-1))
    return SymmetricInverse(part @ np.swapaxes(part, -1, -2), keeps.sum(axis=-1), np.asarray(lost < SHARE))


def covariance_with_prior(information: Array) -> Array:
    """`(1 + X)^-1` of information X (..., N, N) on unknowns that a unit covariance is known of beforehand.

    However much X tells of some directions, it can take nothing from what is known of the others: its eigenvalues that
    are rounding, also negative ones, count as nothing told. Information that is not finite tells nothing.
    """
    information = np.asarray(information, dtype=np.float64)
    if np.abs(information).max(initial=0.0) < LITTLE_TOLD:  # in a fifth of the time
        return np.asarray(np.linalg.inv(np.eye(information.shape[-1]) + information))
    finite = np.isfinite(information).all(axis=(-2, -1), keepdims=True)
    value, vector = np.linalg.eigh(np.where(finite, information, 0.0))
    told = np.where(value > ROUNDING * value[..., -1:], value, 0.0).clip(min=0.0)
    part = vector / np.sqrt(1 + told)[..., None, :]
    covariance: Array = part @ np.swapaxes(part, -1, -2)
    return covariance


def moved_covariance(derivative: Array, covariance: Array) -> Array:
    """`J S J'` of derivatives J (N, K, P) by parameters with a covariance S (P, P).  # (N, K, K)

    One product for all: hundreds of parameters take a hundred times as long point by point.
    """
    half = (derivative.reshape(-1, len(covariance)) @ covariance).reshape(derivative.shape)
    moved: Array = half @ derivative.transpose(0, 2, 1)
    return moved


def solve_square(matrix: Array, right: Array) -> Array:
    """`A^-1 B` of general matrices (..., N, N) and columns (..., N, K); nan where A is singular or not finite.

    For Jacobians of maps, of which some of many may be degenerate: the others are solved as without them.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    row = np.abs(matrix).max(axis=-1, keepdims=True)
    finite = np.isfinite(matrix).all(axis=(-2, -1)) & (row > 0).all(axis=(-2, -1))
    row = np.where(finite[..., None, None], row, 1.0)
    scaled = np.where(finite[..., None, None], matrix, np.eye(matrix.shape[-1])) / row
    left, extent, across = np.linalg.svd(scaled)
    able = finite & (extent[..., -1] > ROUNDING * extent[..., 0])
    inverse = np.swapaxes(across, -1, -2) / np.where(able[..., None], extent, 1.0)[..., None, :]
    solved = inverse @ (np.swapaxes(left, -1, -2) @ (right / row))
    return np.where(able[..., None, None], solved, np.nan)


def least_squares(design: Array, right: Array) -> Array:
    """The shortest x of least `|A x - b|` (N,) or (N, K), the columns of A scaled to one; nan if A or b is not finite.

    Of columns that tell the same, or nothing, each takes its part.
    """
    design, right = np.asarray(design, dtype=np.float64), np.asarray(right, dtype=np.float64)
    shape = (design.shape[1], *right.shape[1:])
    if not (np.isfinite(design).all() and np.isfinite(right).all()):
        return np.full(shape, np.nan)
    length = np.linalg.norm(design, axis=0)
    unit = np.where(length > 0, length, 1.0)
    solved = np.linalg.lstsq(design / unit, right, rcond=ROUNDING)[0]
    return np.asarray(solved / unit.reshape(-1, *(1,) * (right.ndim - 1)))


def pseudo_inverse(design: Array) -> Array:
    """What takes b to the x of `least_squares` (K, N), of a matrix A (N, K); nan if A is not finite."""
    design = np.asarray(design, dtype=np.float64)
    if not np.isfinite(design).all():
        return np.full(design.shape[::-1], np.nan)
    length = np.linalg.norm(design, axis=0)
    unit = np.where(length > 0, length, 1.0)
    inverse: Array = np.linalg.pinv(design / unit, rcond=ROUNDING) / unit[:, None]
    return inverse


def sums_by(group: Rows, rows: Array, count: int) -> Array:
    """Sums (count, D) of the rows (N, D) of each group (N,)."""
    return np.stack([np.bincount(group, column, count) for column in rows.T], axis=1)


def worse_sigma(covariance: Array) -> Array:
    """Standard deviations (N,) along the worse axes of covariances (N, 2, 2)."""
    sigma: Array = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0))
    return sigma


def _unit_diagonal(matrix: Array) -> tuple[Array, Array]:
    """`D A D` with a diagonal of ones, and D's diagonal (..., N); zero where A's is not positive."""
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    finite = np.isfinite(matrix)
    able = np.asarray(finite.all(axis=(-2, -1)))[..., None] & (diagonal > 0)
    scale = 1 / np.sqrt(np.where(able, diagonal, np.inf))
    whole = np.where(finite, matrix, 0.0)
    return whole * scale[..., :, None] * scale[..., None, :], scale


def rms_length(vector: Array) -> float:
    """Root mean square length of vectors (N, D); nan of none."""
    return math.sqrt(float((vector**2).sum(axis=1).mean())) if len(vector) else math.nan
