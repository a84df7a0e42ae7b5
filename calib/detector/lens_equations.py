"""The radial lens of an image's grids: least squares on (k1, k2) with every grid's homography eliminated."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core.jit import jit
from calib.core.small_solve import cholesky_factor, substitute
from calib.detector.homography import determines, equations, fit_entries

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

STEPS = 5
DAMPING = 1e-10
FLOOR_PX = 0.05
"""Points nearer than this to where they belong are never left out."""


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

    Args:
        k1: of the lens.
        k2: see k1.
        plane: points of all groups, each group's at its mean.  # (N, 2)
        offset: their pixels, from the middle, in half diagonals.  # (N, 2)
        first: where each group begins, and where the last one ends.  # (G + 1,)
        floor: a distance that is never too far, in half diagonals.
    """
    n11 = n12 = n22 = g1 = g2 = cost = 0.0
    h = np.empty(9)
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
        if not fit_entries(x, straight, weight, 1, h, normal, residual):
            continue
        for n in range(len(x)):
            size[n] = np.hypot(residual[n, 0], residual[n, 1])
        keep = size < 6.0 * np.median(size) + floor
        if not keep.all():
            x, straight, pixel = x[keep], straight[keep], pixel[keep]
            weight, residual = weight[keep], residual[keep]
            if len(x) < 6 or not determines(x):
                continue
            if not fit_entries(x, straight, weight, 1, h, normal, residual):
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
