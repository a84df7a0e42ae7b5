"""What one source costs over a range of amounts: draws with error bars, and the straight line of the prediction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.result import Control, Cost, ToleranceTable, table_of_draws
from calib.studies.tolerance.setting import Setting
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True, eq=False)
class Sweep:
    """K amounts of one source."""

    source: str
    factor: Array  # (K,) multiples of the model's amount
    amount: Array  # (K,) root mean square, in the source's unit
    cost: Cost  # (K, Q)
    linear: Array  # (K, Q)
    failed: tuple[int, ...]  # (K,) draws without a solution


def swept(errors: ErrorModel, source: str, factor: float) -> ErrorModel:
    """The errors of one point of a sweep: the source alone, at a multiple of its amount."""
    return errors.only(source).scaled(factor)


def sweep(
    setting: Setting,
    errors: ErrorModel,
    source: str,
    table: ToleranceTable,
    *,
    seed: int,
    numbers: range,
    factors: Sequence[float] = FACTORS,
) -> Sweep:
    """A sweep, all in this process; the same draws at each amount.

    Args:
        setting: what is photographed.
        errors: of the target.
        source: the one that is swept.
        table: a linear one, for the line.
        seed: of the study.
        numbers: of the draws.
        factors: multiples of the source's amount.
    """
    draws = [run_draws(setting, swept(errors, source, factor), seed, numbers) for factor in factors]
    return sweep_of_draws(errors, source, factors, draws, table)


def sweep_of_draws(
    errors: ErrorModel,
    source: str,
    factors: Sequence[float],
    draws: Sequence[Array],
    table: ToleranceTable,
    controls: Sequence[Control | None] | None = None,
) -> Sweep:
    """The sweep of draws (D, 3, Q) that were run elsewhere, one array a factor, of the errors of `swept`.

    Args:
        errors: of all sources.
        source: the one that was swept.
        factors: multiples of its amount.
        draws: of each factor.
        table: a linear one, for the line.
        controls: what is predicted of the draws of each factor.
    """
    tables = [
        table_of_draws(swept(errors, source, factor), one, control)
        for factor, one, control in zip(factors, draws, controls or [None] * len(factors), strict=True)
    ]
    factor = np.array(factors, dtype=np.float64)
    linear = table.cost.value[table.sources.index(source)]
    return Sweep(
        source,
        factor,
        factor * errors.amount(source).sigma,
        Cost(*(np.array([getattr(one.cost, name)[0] for one in tables]) for name in ("value", "low", "high"))),
        factor[:, None] * linear,
        tuple(one.failed[1] for one in tables),
    )
