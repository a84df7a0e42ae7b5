"""A few of many candidates that stand in order, without a rhythm that would meet that of the order."""

import numpy as np
from numpy.typing import NDArray

GOLDEN = 0.6180339887498949
"""Its multiples, less their whole parts, fill a circle evenly whatever number of them is taken."""


def few_of_many(count: int, most: int) -> NDArray[np.int64]:
    """So many rows of `count` at most, ascending: every so many-th of nested loops would share the inner value."""
    return np.sort(np.argsort((np.arange(count) * GOLDEN) % 1.0, kind="stable")[:most])
