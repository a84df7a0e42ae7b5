"""Covariances of hundreds of parameters in files: a tenth of their size, and close enough.

Of `D R D` with the standard deviations D and the correlations R = L L' stand D, and the rows of the lower triangle L in
whole parts of `PARTS`: what is read is a covariance whatever was rounded, and correlations are right to some 1e-5.
"""

from typing import Final

import numpy as np

from designer.base.arrays import Array
from designer.base.files import JsonValue

LARGE = 100
"""Parameters; of fewer every number is written."""
PARTS = 100_000
SIGMA, ROOT = "sigma", "root_1e5"
MOST: Final = 5000
"""Parameters at most."""


def pack_covariance(matrix: Array) -> JsonValue:
    """The short form of a covariance (P, P); without numbers where it is not known."""
    if not np.isfinite(matrix).all():
        return {SIGMA: [None] * len(matrix), ROOT: []}
    sigma = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
    unit = np.where(sigma > 0, sigma, 1.0)
    root = np.rint(PARTS * _root(matrix / unit[:, None] / unit)).astype(np.int64).tolist()
    return {SIGMA: sigma.tolist(), ROOT: [row[: n + 1] for n, row in enumerate(root)]}


def _root(matrix: Array) -> Array:
    """A lower triangle L of a matrix L L' that may be singular."""
    try:
        return np.asarray(np.linalg.cholesky(matrix))
    except np.linalg.LinAlgError:
        value, vector = np.linalg.eigh(matrix)
        upper: Array = np.asarray(np.linalg.qr((vector * np.sqrt(np.maximum(value, 0.0))).T, mode="r"))
        return np.asarray(upper.T * np.where(np.diagonal(upper) < 0, -1.0, 1.0))


def unpack_covariance(value: dict[str, JsonValue]) -> Array:
    """The covariance of a short form.

    Raises:
        ValueError: it is none; the message says what it must be.
    """
    sigma, root = value.get(SIGMA), value.get(ROOT)
    if value.keys() != {SIGMA, ROOT} or not isinstance(sigma, list) or not isinstance(root, list):
        raise ValueError(f"must hold {SIGMA} and {ROOT}")
    if not LARGE < len(sigma) <= MOST:
        raise ValueError(f"has {len(sigma)} standard deviations; so written are {LARGE + 1} to {MOST}")
    if not root and all(one is None for one in sigma):
        return np.full((len(sigma), len(sigma)), np.nan)
    if not all(type(one) in (int, float) and 0 <= one < 1e50 for one in sigma):  # type: ignore[operator]
        raise ValueError(f"{SIGMA} must be numbers of 0 or more")
    if len(root) != len(sigma) or not all(_is_row(row, n + 1) for n, row in enumerate(root)):
        raise ValueError(f"{ROOT} must be a triangle of {len(sigma)} rows, of whole numbers up to {PARTS}")
    lower = np.zeros((len(sigma), len(sigma)))
    for n, row in enumerate(root):
        lower[n, : n + 1] = np.array(row, dtype=np.float64)
    scaled = lower * (np.array(sigma, dtype=np.float64)[:, None] / PARTS)
    return np.asarray(scaled @ scaled.T)


def _is_row(row: JsonValue, count: int) -> bool:
    """Whether these are the numbers of a row of the triangle."""
    if not isinstance(row, list) or len(row) != count:
        return False
    return all(isinstance(one, int) and abs(one) <= 2 * PARTS for one in row)
