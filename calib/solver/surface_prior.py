"""What is believed of a surface before photos are seen: it is smooth; how smooth, the photos say.

The displacements are a Gaussian field with Matern's covariance (nu = 2), whose precision is
`tau^2 integral |(kappa^2 - Laplace)^(3/2) d|^2` (Lindgren, Rue and Lindstroem 2011): with binomial factors, the squares
of the surface's derivatives up to the third, which are exact sums over its control points. `kappa` is four over the
distance at which displacements are hardly alike any more, and `tau^2 = 1 / (8 pi kappa^4 amplitude^2)`.
"""

from dataclasses import dataclass
from math import comb, pi

import numpy as np

from calib.cameras.surface import DEGREE
from designer.base.arrays import Array

ORDER = 3
"""Of the highest derivatives: a cubic spline has no more."""


@dataclass(frozen=True)
class Smoothness:
    """Two numbers that say how smooth a surface is."""

    length: float  # at which displacements are hardly alike, in half diagonals of the image
    amplitude: float  # standard deviation of a displacement, in standard deviations of a whitened residual


def roughness(scale: Array, counts: tuple[int, int], half_diagonal_px: float) -> Array:
    """Integrals of the squared derivatives of orders 0 to 3 over the domain, of one coordinate's K points (4, K, K).

    Args:
        scale: see `SurfaceModel.scale`.
        counts: rows and columns of control points.
        half_diagonal_px: the unit of length.
    """
    down = _along(counts[0], half_diagonal_px * scale[1, 1])
    across = _along(counts[1], half_diagonal_px * scale[0, 1])
    return np.stack([
        sum(comb(order, k) * np.kron(down[order - k], across[k]) for k in range(order + 1))
        for order in range(ORDER + 1)
    ])  # fmt: skip


def _along(count: int, per_unit: float) -> Array:
    """Integrals of products of derivatives of B-splines along one axis, orders 0 to 3 (4, count, count)."""
    node, share = np.polynomial.legendre.leggauss(4)
    t, share = 0.5 * (node + 1), 0.5 * share
    s = 1 - t
    zero = np.ones_like(t)
    pieces = np.array(
        [
            (s**3 / 6, (3 * t**3 - 6 * t**2 + 4) / 6, (3 * s**3 - 6 * s**2 + 4) / 6, t**3 / 6),
            (-(s**2) / 2, 1.5 * t**2 - 2 * t, 2 * s - 1.5 * s**2, t**2 / 2),
            (s, 3 * t - 2, 3 * s - 2, t),
            (-zero, 3 * zero, -3 * zero, zero),
        ]
    )  # (order, piece, node)
    gram = np.zeros((ORDER + 1, count, count))
    for order in range(ORDER + 1):
        one = (pieces[order] * share) @ pieces[order].T * per_unit ** (2 * order - 1)
        for first in range(count - DEGREE):
            gram[order, first : first + 4, first : first + 4] += one
    return gram


def precision(parts: Array, smoothness: Smoothness) -> Array:
    """Of one coordinate's control points, in units of the residuals' variance."""
    kappa = 4 / smoothness.length
    total = sum(comb(ORDER, k) * kappa ** (2 * (ORDER - k)) * parts[k] for k in range(ORDER + 1))
    result: Array = total / (8 * pi * kappa**4 * smoothness.amplitude**2)
    return result


PIN = 1e3
"""Precision of what is left to others, times the largest of the normal matrix."""


@dataclass(frozen=True, eq=False)
class SurfaceProblem:
    """Squares of residuals as a function of the control points, all else eliminated: `s + 2 g'd + d'N d`."""

    normal: Array  # (2 K, 2 K)
    gradient: Array  # (2 K,)
    square: float
    freedom: int  # residuals less the unknowns that were eliminated
    pinned: Array  # (2 K, B) directions that are left to others
    parts: Array  # see `roughness`

    def prior(self, one: Array) -> Array:
        """The precision (2 K, 2 K) with that of one coordinate's points (K, K), what is left to others held at zero."""
        total: Array = PIN * float(np.diagonal(self.normal).max()) * (self.pinned @ self.pinned.T)
        half = len(one)
        total[:half, :half] += one
        total[half:, half:] += one
        return total


START = Smoothness(0.5, 30.0)
BOUNDS = (0.05, 20.0), (1e-3, 1e7)
FIRST_TRIALS, MORE_TRIALS = 30, 8
CLOSE, ALIKE = 0.2, 1.0
"""Of the logarithms of the two numbers, and of the likelihood: held-out photos do not tell apart what is closer."""


def likeliest(found: SurfaceProblem, start: Smoothness | None = None) -> Smoothness:
    """The smoothness of the greatest marginal likelihood (Rasmussen and Williams 2006, section 5.4)."""
    from scipy.optimize import minimize

    first = np.log([getattr(start or START, name) for name in ("length", "amplitude")])
    simplex = first + (1.0 if start is None else 0.3) * np.array([[0, 0], [0.7, 0], [0, 1.5]])
    best = minimize(
        lambda x: misfit(found, Smoothness(*np.exp(x).tolist())),
        first, method="Nelder-Mead", bounds=np.log(BOUNDS),
        options={
            "initial_simplex": simplex, "maxfev": FIRST_TRIALS if start is None else MORE_TRIALS,
            "xatol": CLOSE, "fatol": ALIKE,
        },
    )  # fmt: skip
    return Smoothness(*np.exp(best.x).tolist())


def misfit(found: SurfaceProblem, smoothness: Smoothness) -> float:
    """Minus twice the logarithm of the likelihood of the residuals, control points and noise integrated out.

    The control points are `Z y`, Z being orthogonal to the directions U that are left to others: with a precision Q,
    `log |Z'QZ| = log |Q| + log |U'Q^-1 U|`.
    """
    from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

    one = precision(found.parts, smoothness)
    belief, failed = dpotrf(one, lower=1)
    total, failed_too = dpotrf((found.normal + found.prior(one)).T, lower=1, overwrite_a=1)
    if failed or failed_too:
        return np.inf
    told = dtrtrs(total, found.gradient, lower=1)[0]
    left = found.square - float(told @ told)
    if not left > 0:
        return np.inf
    columns = found.pinned.reshape(2, len(one), -1)
    across = sum(column.T @ dpotrs(belief, column, lower=1)[0] for column in columns)
    logs = float(np.log(np.diagonal(total)).sum() - 2 * np.log(np.diagonal(belief)).sum())
    return found.freedom * float(np.log(left / found.freedom)) + 2 * logs - float(np.linalg.slogdet(across)[1])
