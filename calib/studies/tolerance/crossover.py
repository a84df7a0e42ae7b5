"""At which error of one source a target becomes worse than another, such as an icosahedron than a board.

A target's errors are `m^2 = m0^2 + rest^2 + (x / sigma)^2 cost^2` for an amount x of the source, with the rest of its
sources as they are. It loses where that reaches the other target's m, which stays what it is.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.result import ToleranceTable
from designer.base.errors import InputError

Array = NDArray[np.float64]
Verdict = Literal["loses at zero", "crosses", "never loses"]


@dataclass(frozen=True)
class Crossover:
    """Of one quantity, at which amount a target loses to another."""

    quantity: str
    verdict: Verdict
    amount: float  # root mean square in the source's unit; 0: it loses already without, inf: it never does
    low: float  # interval that holds the amount by 95 %
    high: float
    own: float  # the quantity without this source
    other: float  # of the other target
    noise_share: float  # of the squared quantity without this source, what is noise


def crossovers(table: ToleranceTable, source: str, other: ToleranceTable) -> tuple[Crossover, ...]:
    """The crossover of each quantity.

    Args:
        table: of the target that the source is varied of, with the source in it.
        source: the varied source.
        other: of the other target, with all its errors.

    Raises:
        InputError: the source is not in the table, or has no size.
    """
    if source not in table.sources:
        raise InputError(f"{source} is not among the errors; there are {', '.join(table.sources)}")
    place = table.sources.index(source)
    sigma = float(table.sigma[place])
    if sigma == 0:
        raise InputError(f"{source} is 0: give it an amount, such as the preset's, to be scaled")
    return tuple(_crossover(table, place, sigma, other, row) for row in range(len(QUANTITIES)))


def _crossover(table: ToleranceTable, place: int, sigma: float, other: ToleranceTable, row: int) -> Crossover:
    rest = np.arange(len(table.sources)) != place

    def amount(own_base: Array, costs: Array, cost: float, goal: float) -> float:
        room = goal - _square(own_base, costs, rest, row)
        if room <= 0:
            return 0.0
        return sigma * math.sqrt(room) / cost if cost > 0 else math.inf

    base, cost = table.baseline, table.cost
    goals = [float(one[row]) ** 2 + float(two[row]) ** 2 for one, two in _bounds(other)]
    value = amount(base.value, cost.value, float(cost.value[place, row]), goals[0])
    low = amount(base.high, cost.high, float(cost.high[place, row]), goals[1])
    high = amount(base.low, cost.low, float(cost.low[place, row]), goals[2])
    own = _square(base.value, cost.value, rest, row)
    verdict: Verdict = "loses at zero" if value == 0 else "never loses" if math.isinf(value) else "crosses"
    share = float(base.value[row]) ** 2 / own if own > 0 else math.nan
    return Crossover(QUANTITIES[row].name, verdict, value, low, high, math.sqrt(own), math.sqrt(goals[0]), share)


def _bounds(table: ToleranceTable) -> list[tuple[Array, Array]]:
    base, together = table.baseline, table.together
    return [(base.value, together.value), (base.low, together.low), (base.high, together.high)]


def _square(base: Array, costs: Array, rest: NDArray[np.bool_], row: int) -> float:
    """The squared quantity without the varied source."""
    return float(base[row]) ** 2 + float((np.nan_to_num(costs[rest, row]) ** 2).sum())
