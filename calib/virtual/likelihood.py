"""A Gaussian process given samples, and how likely these are (Rasmussen and Williams 2006, eq. 2.25, 5.8 and 5.9).

With `K = variance exp(-d^2 / (2 length^2)) + diag(noise)` over the samples' distances d, and y a column of their
values, `log p = -y' K^-1 y / 2 - log |K| / 2 - n log(2 pi) / 2`, and its derivative by what K depends on is
`tr((w w' - K^-1) dK) / 2` with the weights `w = K^-1 y`. Columns are independent: their likelihoods add up.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.cameras.learned import correlation

Array = NDArray[np.float64]

SMALL_CHANGE = 1e-6
"""Ends the search for the greatest likelihood, as a part of its logarithm."""


def weights_of(values: Array, gram: Array) -> Array:
    """`K^-1 y` of columns of values (N, 2) and K (N, N), which is overwritten.

    Raises:
        np.linalg.LinAlgError: K is not positive definite.
    """
    from scipy.linalg.lapack import dpotrs

    solved: Array = dpotrs(_factor(gram), values, lower=1)[0]
    return solved


def likeliest(
    square_px2: Array, values: Array, noise: Array, start: Sequence[float], bounds: Sequence[tuple[float, float]]
) -> tuple[Array, Array]:
    """Variance, length and, if there is a third, even noise of the greatest likelihood within bounds; weights there.

    Args:
        square_px2: squared distances of the samples (N, N).
        values: of the samples (N, 2).
        noise: variances that are known beforehand (N,).
        start: of the search.
        bounds: least and greatest.
    """
    from scipy.optimize import minimize

    def objective(logarithm: Array) -> tuple[float, Array]:
        likelihood, slope, _ = log_likelihood(square_px2, values, noise, np.exp(logarithm))
        return -likelihood, -slope

    found = minimize(
        objective, np.log(start), method="L-BFGS-B", jac=True, bounds=np.log(bounds), options={"ftol": SMALL_CHANGE}
    )
    process = np.exp(found.x)
    return process, log_likelihood(square_px2, values, noise, process)[2]


def log_likelihood(square_px2: Array, values: Array, noise: Array, process: Array) -> tuple[float, Array, Array]:
    """The logarithm of the likelihood, its derivatives by those of the process's numbers, and the weights (N, 2).

    Minus infinity where K is not positive definite in floating point.

    Args:
        square_px2: squared distances of the samples (N, N).
        values: of the samples (N, 2).
        noise: variances that are known beforehand (N,).
        process: variance, length and, if there is a third, the variance of noise that all samples have besides.
    """
    from scipy.linalg.lapack import dpotri, dpotrs

    variance, length, *even = process.tolist()
    count, columns = values.shape
    noise = noise + sum(even)
    signal = variance * correlation(square_px2, length)
    gram = signal.copy()
    gram[np.diag_indices(count)] += noise
    try:
        factor = _factor(gram)
    except np.linalg.LinAlgError:
        return -np.inf, np.zeros(len(process)), np.zeros_like(values)
    log_root = float(np.log(np.diagonal(factor)).sum())
    weight = dpotrs(factor, values, lower=1)[0]
    below = dpotri(factor, lower=1, overwrite_c=1)[0].T  # the inverse's triangle, the other one zero
    inverse_diagonal = np.diagonal(below)
    signal *= square_px2
    slope = [
        (weight * values).sum() - (noise @ weight**2).sum() - columns * (count - inverse_diagonal @ noise),
        ((weight * (signal @ weight)).sum() - 2 * columns * np.vdot(below, signal)) / length**2,
        *(one * ((weight**2).sum() - columns * inverse_diagonal.sum()) for one in even),
    ]
    likelihood = -0.5 * float((weight * values).sum()) - columns * (log_root + 0.5 * count * np.log(2 * np.pi))
    return likelihood, 0.5 * np.array(slope), weight


def _factor(gram: Array) -> Array:
    """The lower Cholesky factor of a symmetric matrix, in its place and in Fortran's order, zero above the diagonal."""
    from scipy.linalg.lapack import dpotrf

    factor, failed = dpotrf(gram.T, lower=1, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError("not positive definite")
    return np.asarray(factor)
