"""At which error of one source a target becomes worse than another, such as an icosahedron than a board.

A target's errors are `m^2 = m0^2 + rest^2 + (x / sigma)^2 cost^2` for an amount x of the source, with the rest of its
sources as they are. It loses where that reaches the other target's m, which stays what it is.
"""

import numpy as np
from numpy.typing import NDArray

from calib.studies.tolerance.quantities import NAMES, quantity_row
from calib.studies.tolerance.record import CrossoverRow, nine_digits
from calib.studies.tolerance.result import ToleranceTable
from designer.tolerance.sources import SOURCES

Array = NDArray[np.float64]
ENDS = ("value", "high", "low")
"""Of a target's costs, where the other's are at `OTHER_ENDS`: the amount and the interval that holds it by 95 %."""
OTHER_ENDS = ("value", "low", "high")


def crossovers(table: ToleranceTable, other: ToleranceTable) -> tuple[CrossoverRow, ...]:
    """Of each source that has a size and each quantity, at which amount a target loses to another.

    Args:
        table: of the target whose sources are varied, one at a time.
        other: of the other target, with all its errors.
    """
    return tuple(
        row
        for place, name in enumerate(table.sources)
        if table.sigma[place] > 0
        for row in _of_source(table, place, name, other)
    )


def _of_source(table: ToleranceTable, place: int, name: str, other: ToleranceTable) -> list[CrossoverRow]:
    goals = [_square(getattr(other.baseline, end), getattr(other.together, end)) for end in OTHER_ENDS]
    rest = np.arange(len(table.sources)) != place
    own = [_square(getattr(table.baseline, end), getattr(table.cost, end)[rest]) for end in ENDS]
    with np.errstate(invalid="ignore", divide="ignore"):
        noise_share = table.baseline.value**2 / np.where(own[0] > 0, own[0], np.nan)
        amounts = [
            _amount(goal - without, table.sigma[place], getattr(table.cost, end)[place])
            for goal, without, end in zip(goals, own, ENDS, strict=True)
        ]
    numbers = np.array([*amounts, np.sqrt(own[0]), *np.sqrt(goals), noise_share])
    return [
        CrossoverRow(
            name, SOURCES[name].unit, quantity,
            "loses at zero" if amount == 0 else "never loses" if np.isinf(amount) else "crosses",
            *map(nine_digits, column),
        )
        for quantity, amount, column in zip(NAMES, amounts[0], numbers.T.tolist(), strict=True)
    ]  # fmt: skip


def _square(base: Array, costs: Array) -> Array:
    """The squared quantities (Q,) of what noise and some sources give."""
    square: Array = base**2 + (np.nan_to_num(costs) ** 2).reshape(-1, len(base)).sum(axis=0)
    return square


def _amount(room: Array, sigma: float, cost: Array) -> Array:
    """The amounts (Q,) that fill a room of squares; 0 where there is none, infinite where the source costs nothing."""
    filling = np.where(cost > 0, sigma * np.sqrt(np.maximum(room, 0.0)) / cost, np.inf)
    return np.where(room <= 0, 0.0, filling)


def default_vary(table: ToleranceTable, by: str) -> str:
    """The source to vary against another target: the one of faces that costs most, else of all; "" if none does."""
    row = quantity_row(by)
    costly = [name for name in table.ranking(by) if table.cost.value[table.sources.index(name), row] > 0]
    of_faces = [name for name in costly if SOURCES[name].scope in ("face", "piece")]
    return (of_faces or costly or [""])[0]
