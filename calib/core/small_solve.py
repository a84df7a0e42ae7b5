"""Cholesky for the small normal equations inside kernels: no allocation, no library call."""

import math

import numpy as np

from calib.core.jit import jit
from designer.base.arrays import Array


@jit
def cholesky_factor(a: Array) -> bool:
    """Replace the lower triangle of a symmetric matrix by its factor L; false if it is not positive definite."""
    n = a.shape[0]
    for j in range(n):
        d = a[j, j]
        for k in range(j):
            d -= a[j, k] * a[j, k]
        if not d > 1e-14 * abs(a[j, j]) or not math.isfinite(d):
            return False
        root = math.sqrt(d)
        a[j, j] = root
        for i in range(j + 1, n):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = s / root
    return True


@jit
def substitute(lower: Array, x: Array) -> None:
    """Solve L L' x = b in place, b in `x`, with the factor L in the lower triangle."""
    n = lower.shape[0]
    for i in range(n):
        s = x[i]
        for k in range(i):
            s -= lower[i, k] * x[k]
        x[i] = s / lower[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for k in range(i + 1, n):
            s -= lower[k, i] * x[k]
        x[i] = s / lower[i, i]


@jit
def cholesky_solve(a: Array, b: Array, x: Array) -> bool:
    """Solve a x = b for symmetric positive definite `a` (its lower triangle is used and destroyed)."""
    if not cholesky_factor(a):
        return False
    x[:] = b
    substitute(a, x)
    return True


@jit
def cholesky_invert(a: Array, work: Array, inverse: Array) -> bool:
    """The inverse of a symmetric positive definite matrix, from its lower triangle; `a` is kept."""
    work[:] = a
    if not cholesky_factor(work):
        return False
    n = a.shape[0]
    for column in range(n):
        for row in range(n):
            inverse[row, column] = 1.0 if row == column else 0.0
        substitute(work, inverse[:, column])
    return True


@jit
def eigenvalues(a: Array) -> Array:
    """Of a symmetric matrix, which is destroyed, the smallest first.  # (N,)"""
    diagonalise(a, np.empty((0, a.shape[0])))
    return np.sort(np.diag(a))


@jit
def diagonalise(a: Array, rows: Array) -> None:
    """Turn a symmetric matrix until it is diagonal, and rows (K, N) with it: Jacobi's method, sweep by sweep.

    Rows of the unit matrix become those of the matrix whose columns are the eigenvectors.
    """
    n = a.shape[0]
    for _ in range(30):
        beside, along = 0.0, 0.0
        for i in range(n):
            along += a[i, i] * a[i, i]
            for j in range(i):
                beside += a[i, j] * a[i, j]
        if not beside > 1e-26 * along:
            break
        for p in range(n - 1):
            for q in range(p + 1, n):
                if a[p, q] == 0.0:
                    continue
                theta = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                t = -t if theta < 0.0 else t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for k in range(n):
                    x, y = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * x - s * y, s * x + c * y
                for k in range(rows.shape[0]):
                    x, y = rows[k, p], rows[k, q]
                    rows[k, p], rows[k, q] = c * x - s * y, s * x + c * y
