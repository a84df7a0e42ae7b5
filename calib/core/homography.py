"""Homographies from points, with covariance, and the vanishing line they carry.

    matrix, covariance, residual = fit(plane, image, weight)     # (N, 2), (N, 2), (N,)
    term = vanishing_terms(matrix, image)

Inside, a homography has its plane's points moved to their mean and shrunk to one: its last entry is 1 then, since what
is seen has a positive depth there.
"""

from typing import TypeAlias

import numpy as np

from calib.core.jit import jit
from calib.core.small_solve import cholesky_invert, cholesky_solve, eigenvalues
from designer.base.arrays import Array, Flags

Floats: TypeAlias = Array

LEAST_DETERMINED = 1e-6
"""Least share of the second smallest eigenvalue: two rows of a hundred points have more, a bent row less."""
ENTRIES = 8
FAR = 5.0
"""Points so many times as far off as usual are left out."""


def apply(homography: Floats, point: Floats) -> Floats:
    """Map points of a plane, by one map or one each.  # (3, 3) or (N, 3, 3), (..., 2) -> (..., 2)"""
    if homography.ndim == 3:
        mapped = np.einsum("nij,nj->ni", homography[:, :, :2], point) + homography[:, :, 2]
    else:
        mapped = point @ homography[:, :2].T + homography[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[..., :2] / mapped[..., 2:])


def is_determined(plane: Floats) -> bool:
    """Whether images of these points fix a homography: four of them stand in general position.

    All points but one on a line leave it open, and what is solved from them is noise. The equations of the map that
    leaves the points where they are have rank eight then, as those of any other map.  # (N, 2)
    """
    return bool(determines(np.ascontiguousarray(plane, dtype=np.float64)))


@jit
def determines(plane: Floats) -> bool:
    """`is_determined`, compiled."""
    count = len(plane)
    if count < 4:
        return False
    mean0, mean1 = plane[:, 0].mean(), plane[:, 1].mean()
    size = 0.0
    for n in range(count):
        size += np.hypot(plane[n, 0] - mean0, plane[n, 1] - mean1)
    size = max(size / count, 1e-12) / np.sqrt(2.0)
    normal = np.zeros((9, 9))
    row = np.zeros((2, 9))
    for n in range(count):
        x, y = (plane[n, 0] - mean0) / size, (plane[n, 1] - mean1) / size
        row[0, 0] = row[1, 3] = x
        row[0, 1] = row[1, 4] = y
        row[0, 2] = row[1, 5] = 1.0
        row[0, 6], row[0, 7], row[0, 8] = -x * x, -x * y, -x
        row[1, 6], row[1, 7], row[1, 8] = -y * x, -y * y, -y
        for a in range(9):
            for b in range(9):
                normal[a, b] += row[0, a] * row[0, b] + row[1, a] * row[1, b]
    value = eigenvalues(normal)
    return bool(value[1] > LEAST_DETERMINED * value[8])


@jit
def moved_to_mean(plane: Floats) -> tuple[Floats, float, float, float]:
    """Points moved to their mean and shrunk to one; that mean, and their size.  # (N, 2)"""
    mean0, mean1 = plane[:, 0].mean(), plane[:, 1].mean()
    size = 1e-12
    for n in range(len(plane)):
        size = max(size, abs(plane[n, 0] - mean0), abs(plane[n, 1] - mean1))
    x = np.empty((len(plane), 2))
    for n in range(len(plane)):
        x[n, 0], x[n, 1] = (plane[n, 0] - mean0) / size, (plane[n, 1] - mean1) / size
    return x, mean0, mean1, size


@jit
def solve_direct(x: Floats, image: Floats, h: Floats) -> bool:
    """Direct linear transform (Hartley) of points at their mean into the nine entries `h`; false if singular."""
    u, mean0, mean1, size = moved_to_mean(image)
    normal, right = np.zeros((ENTRIES, ENTRIES)), np.zeros(ENTRIES)
    row = np.zeros((2, ENTRIES))
    for n in range(len(x)):
        row[0, 0] = row[1, 3] = x[n, 0]
        row[0, 1] = row[1, 4] = x[n, 1]
        row[0, 2] = row[1, 5] = 1.0
        for c in range(2):
            row[c, 6], row[c, 7] = -u[n, c] * x[n, 0], -u[n, c] * x[n, 1]
            for a in range(ENTRIES):
                right[a] += row[c, a] * u[n, c]
                for b in range(a + 1):
                    normal[a, b] += row[c, a] * row[c, b]
    if not cholesky_solve(normal, right, h[:ENTRIES]):
        return False
    h[8] = 1.0
    for k in range(3):
        h[k] = size * h[k] + mean0 * h[6 + k]
        h[3 + k] = size * h[3 + k] + mean1 * h[6 + k]
    return True


@jit
def equations(
    x: Floats, image: Floats, weight: Floats, h: Floats, normal: Floats, gradient: Floats, residual: Floats
) -> None:
    """Normal equations (lower triangle) of the image distances at the entries h (9,), and residuals."""
    normal[:] = 0.0
    gradient[:] = 0.0
    row = np.zeros((2, ENTRIES))
    for n in range(len(x)):
        inverse = 1.0 / (h[6] * x[n, 0] + h[7] * x[n, 1] + h[8])
        row[0, 0] = row[1, 3] = x[n, 0] * inverse
        row[0, 1] = row[1, 4] = x[n, 1] * inverse
        row[0, 2] = row[1, 5] = inverse
        for c in range(2):
            u = (h[3 * c] * x[n, 0] + h[3 * c + 1] * x[n, 1] + h[3 * c + 2]) * inverse
            row[c, 6], row[c, 7] = -u * row[c, 3 * c], -u * row[c, 3 * c + 1]
            residual[n, c] = image[n, c] - u
            for a in range(ENTRIES):
                weighted = weight[n] * row[c, a]
                gradient[a] += weighted * residual[n, c]
                for b in range(a + 1):
                    normal[a, b] += weighted * row[c, b]


@jit
def fit_entries(
    x: Floats, image: Floats, weight: Floats, rounds: int | np.int64, h: Floats, normal: Floats, residual: Floats
) -> bool:
    """Gauss-Newton from the direct solution, points at their mean; `normal` is the last step's; false if singular."""
    gradient, step, damped = np.empty(ENTRIES), np.empty(ENTRIES), np.empty((ENTRIES, ENTRIES))
    if not solve_direct(x, image, h):
        return False
    for _ in range(rounds):
        equations(x, image, weight, h, normal, gradient, residual)
        damped[:] = normal
        if not cholesky_solve(damped, gradient, step):
            return False
        h[:ENTRIES] += step
    residuals_of(x, image, h, residual)
    return bool(np.isfinite(residual).all())


@jit
def residuals_of(x: Floats, image: Floats, h: Floats, residual: Floats) -> None:
    """Images less mapped points.  # (N, 2), (N, 2), (9,) -> (N, 2)"""
    for n in range(len(x)):
        inverse = 1.0 / (h[6] * x[n, 0] + h[7] * x[n, 1] + h[8])
        residual[n, 0] = image[n, 0] - (h[0] * x[n, 0] + h[1] * x[n, 1] + h[2]) * inverse
        residual[n, 1] = image[n, 1] - (h[3] * x[n, 0] + h[4] * x[n, 1] + h[5]) * inverse


@jit
def _from_mean(h: Floats, mean0: float, mean1: float, size: float) -> Floats:
    """The matrix for points where they are, from the entries for points moved to their mean.  # (9,) -> (3, 3)"""
    matrix = np.empty((3, 3))
    for i in range(3):
        matrix[i, 0], matrix[i, 1] = h[3 * i] / size, h[3 * i + 1] / size
        matrix[i, 2] = h[3 * i + 2] - (h[3 * i] * mean0 + h[3 * i + 1] * mean1) / size
    return matrix


@jit
def _direct(plane: Floats, image: Floats) -> Floats:
    x, mean0, mean1, size = moved_to_mean(plane)
    h = np.empty(9)
    if not solve_direct(x, image, h):
        h[:] = np.nan
    return _from_mean(h, mean0, mean1, size)


def direct(plane: Floats, image: Floats) -> Floats:
    """Direct linear transform of points which must be `is_determined`, its denominator 1 at their mean."""
    return _direct(_as_kernels_want(plane), _as_kernels_want(image))


@jit
def _fit(plane: Floats, image: Floats, weight: Floats, rounds: int | np.int64) -> tuple[Floats, Floats, Floats]:
    count = len(plane)
    residual = np.full((count, 2), np.nan)
    covariance = np.full((ENTRIES, ENTRIES), np.nan)
    if not determines(plane):
        return np.full((3, 3), np.nan), covariance, residual
    x, mean0, mean1, size = moved_to_mean(plane)
    h, normal, work = np.empty(9), np.zeros((ENTRIES, ENTRIES)), np.empty((ENTRIES, ENTRIES))
    if not (fit_entries(x, image, weight, rounds, h, normal, residual) and cholesky_invert(normal, work, covariance)):
        residual[:], covariance[:] = np.nan, np.nan
        return np.full((3, 3), np.nan), covariance, residual
    return _from_mean(h, mean0, mean1, size), covariance, residual


def fit(plane: Floats, image: Floats, weight: Floats, rounds: int = 4) -> tuple[Floats, Floats, Floats]:
    """Least squares on the image distances, by Gauss-Newton from the direct solution; weights are inverse variances.

    Returns:
        The homography (3, 3), the inverse of its normal matrix in its first eight entries with the points moved to
        their mean (8, 8), and the residuals (N, 2); nan where the points are not `is_determined`.
    """
    return _fit(_as_kernels_want(plane), _as_kernels_want(image), _as_kernels_want(weight), rounds)


@jit
def _fit_near(
    plane: Floats, image: Floats, weight: Floats, slack: float, least: int
) -> tuple[Floats, Floats, Floats, Flags]:
    keep = np.ones(len(plane), dtype=np.bool_)
    rounds = np.int64(4)  # a bare 4 would be a type of its own, and all of this compiled for it
    matrix, covariance, residual = _fit(plane, image, weight, rounds)
    size = np.empty(len(plane))
    for _ in range(3):
        for n in range(len(plane)):
            size[n] = np.sqrt(weight[n] * (residual[n, 0] ** 2 + residual[n, 1] ** 2))
        new = size <= FAR * np.median(size[keep]) + slack
        if new.sum() < least or (new == keep).all() or not determines(plane[new]):
            break
        better, its_covariance, _ = _fit(plane[new], image[new], weight[new], rounds)
        if not np.isfinite(better).all():
            break
        keep, matrix, covariance = new, better, its_covariance
        residuals_of(plane, image, matrix.reshape(9), residual)
    return matrix, covariance, residual, keep


def fit_near(
    plane: Floats, image: Floats, weight: Floats, *, slack: float, least: int
) -> tuple[Floats, Floats, Floats, Flags]:
    """`fit`, and again without what lies far off, by more than `slack` sigmas, as long as `least` points stay.

    Returns:
        The homography (3, 3), its covariance (8, 8) as `fit` has it, the residuals of all points (N, 2), and which
        were kept (N,).
    """
    return _fit_near(_as_kernels_want(plane), _as_kernels_want(image), _as_kernels_want(weight), slack, least)


@jit
def _vanishing(homography: Floats, covariance: Floats, image: Floats) -> tuple[Floats, Floats]:
    """The terms m at image points, and their covariance, from that of the first eight entries."""
    h = homography
    # The last row of the adjugate is the vanishing line, up to a factor that m does not have; and by each entry.
    line = np.empty(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        line[k] = h[i, 0] * h[j, 1] - h[j, 0] * h[i, 1]
    by = np.zeros((3, ENTRIES))
    by[0, 3], by[0, 4], by[0, 6], by[0, 7] = h[2, 1], -h[2, 0], -h[1, 1], h[1, 0]
    by[1, 0], by[1, 1], by[1, 6], by[1, 7] = -h[2, 1], h[2, 0], h[0, 1], -h[0, 0]
    by[2, 0], by[2, 1], by[2, 3], by[2, 4] = h[1, 1], -h[1, 0], -h[0, 1], h[0, 0]
    count = len(image)
    term, spread = np.empty((count, 2)), np.zeros((count, 2, 2))
    derivative = np.empty((2, ENTRIES))
    for n in range(count):
        depth = line[0] * image[n, 0] + line[1] * image[n, 1] + line[2]
        term[n, 0], term[n, 1] = -line[0] / depth, -line[1] / depth
        for a in range(ENTRIES):
            by_depth = by[0, a] * image[n, 0] + by[1, a] * image[n, 1] + by[2, a]
            for c in range(2):
                derivative[c, a] = -(by[c, a] + term[n, c] * by_depth) / depth
        for i in range(2):
            for j in range(2):
                for a in range(ENTRIES):
                    for b in range(ENTRIES):
                        spread[n, i, j] += derivative[i, a] * covariance[a, b] * derivative[j, b]
    return term, spread


def vanishing_terms(homography: Floats, image: Floats) -> Floats:
    """The line term m at image points: the vanishing line is `m . (u - point) = 1`.  # (3, 3), (N, 2) -> (N, 2)"""
    return _vanishing(_as_kernels_want(homography), np.zeros((ENTRIES, ENTRIES)), _as_kernels_want(image))[0]


def vanishing_covariance(homography: Floats, plane: Floats, covariance: Floats, image: Floats) -> Floats:
    """Covariance of m at image points, from that of the homography as `fit` returns it.  # -> (N, 2, 2)"""
    _, mean0, mean1, size = moved_to_mean(_as_kernels_want(plane))
    back = np.array([[size, 0, mean0], [0, size, mean1], [0, 0, 1]])
    return _vanishing(homography @ back, _as_kernels_want(covariance), _as_kernels_want(image))[1]


def _as_kernels_want(numbers: Floats) -> Floats:
    return np.require(numbers, dtype=np.float64, requirements=["C", "W"])
