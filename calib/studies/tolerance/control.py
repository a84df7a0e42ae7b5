"""What the prediction says of the very draws that were made, so that these need only tell what it misses.

A quantity's square y in a draw hardly differs from its prediction x for the same numbers and the same noise, whose mean
over all draws is known without any (`calib.studies.tolerance.linear`). So `mean(y - x) + E x` has the mean of y,
whatever the prediction misses, and only the spread of y - x for an error (control variates; Owen 2013, *Monte Carlo
theory, methods and examples*, 8.9).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from calib.core.threads import one_thread
from calib.studies.tolerance.draw import drawn_noise, drawn_values
from calib.studies.tolerance.first_order import FirstOrder
from calib.studies.tolerance.noise_response import noise_squares
from calib.studies.tolerance.response import responses
from calib.studies.tolerance.result import Control, ToleranceTable
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import displacements

Array = NDArray[np.float64]

COLUMNS_AT_ONCE = 128
"""Bounds the memory."""


@one_thread
def control_of(
    first: FirstOrder, linear: ToleranceTable, seed: int, numbers: range, *, factor: float = 1.0, has_noise: bool = True
) -> Control:
    """The prediction of draws.

    Args:
        first: the derivatives of what is photographed.
        linear: the prediction of the errors.
        seed: of the study.
        numbers: of the draws.
        factor: multiple of the errors that was drawn.
        has_noise: the draws have the noise of `drawn_noise`; else one of their own, which is not predicted.
    """
    errors = linear.errors.scaled(factor)
    cases = len(errors.amounts) + 2
    square = np.empty((len(numbers), cases, linear.cost.value.shape[1]))
    width = max(COLUMNS_AT_ONCE // cases, 1)
    for begin in range(0, len(numbers), width):
        some = numbers[begin : begin + width]
        moved = np.concatenate(list(_moved(first, errors, seed, some)), axis=2)
        noise = None
        if has_noise:
            noise = np.stack([drawn_noise(first.setting, seed, number) for number in some], axis=2)
            noise = np.repeat(noise, cases, axis=2)
        square[begin : begin + width] = responses(first, moved, noise).square.T.reshape(len(some), cases, -1)
    square[:, 1:] -= square[:, :1]
    bare = noise_squares(first) if has_noise else np.zeros(square.shape[2])
    costs = factor * np.vstack([linear.cost.value, linear.together.value])
    return Control(square, np.vstack([bare, costs**2]))


def _moved(first: FirstOrder, errors: ErrorModel, seed: int, numbers: range) -> Iterator[Array]:
    """How the rings of each draw are displaced without errors, by each source and by all.  # (R, 3, C) each"""
    setting = first.setting
    known = {name: displacements(setting.target, errors, name, setting.bed_from_target) for name in errors.sources}
    none = np.zeros((setting.target.ring_count, 3))
    for number in numbers:
        values = drawn_values(setting, errors, seed, number)
        moved = [
            np.einsum("rak,rk->ra", by_component, values[name][instance])
            for name, (by_component, instance) in known.items()
        ]
        yield np.stack([none, *moved, sum(moved, start=none)], axis=2)
