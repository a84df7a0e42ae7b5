"""Means of many sightings in cells of the image."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_CELLS = 600
SHRINK = 0.95


@dataclass(frozen=True, eq=False)
class Cells:
    """The image in N cells: which of them M sightings lie in, and where on average."""

    of_sighting: NDArray[np.int64]  # (M,)
    share: Array  # (M,) of a sighting in its cell's mean
    pixel: Array  # (N, 2)
    variance: Array  # (N,) of the mean, in units of the sightings' variances
    measurements: NDArray[np.int64]  # (N,) how many sightings it holds

    def mean(self, values: Array, used: NDArray[np.bool_] | None = None) -> Array:
        """Means (N, 2) of the values (M, 2) of the sightings used; 0 in cells without any."""
        count = len(self.pixel)
        share = self.share if used is None else self.share * used
        total = np.bincount(self.of_sighting, share, count)
        columns = [np.bincount(self.of_sighting, share * column, count) for column in values.T]
        return np.stack(columns, axis=1) / np.where(total > 0, total, 1.0)[:, None]


def cells_of(pixel: Array, variance: Array, most: int = MAX_CELLS) -> Cells:
    """Square cells, as small as they may be for at most so many to hold a sighting.

    Args:
        pixel: of the sightings (M, 2).
        variance: of the sightings (M,), which count inversely to it.
        most: at most so many cells.
    """
    offset = pixel - pixel.min(axis=0)
    extent = np.ptp(pixel, axis=0)
    # Cells of this size are too few by far, unless all lie in a row.
    side = max(2 * float(np.sqrt(extent.prod() / most)), 2 * float(extent.max()) / most) + 1.0
    of_sighting = _cell_numbers(offset, side)
    while side > 1e-3 and (finer := _cell_numbers(offset, SHRINK * side)).max() < most:
        side, of_sighting = SHRINK * side, finer
    total = np.bincount(of_sighting, 1 / variance)
    share = 1 / (variance * total[of_sighting])
    mean: Array = np.stack([np.bincount(of_sighting, share * column) for column in pixel.T], axis=1, dtype=np.float64)
    return Cells(of_sighting, share, mean, 1 / total, np.bincount(of_sighting))


def _cell_numbers(offset: Array, side: float) -> NDArray[np.int64]:
    """Number of the cell of each offset (M, 2), without gaps."""
    column, row = np.floor(offset / side).astype(np.int64).T
    numbers: NDArray[np.int64] = np.unique(row * (column.max() + 1) + column, return_inverse=True)[1]
    return numbers
