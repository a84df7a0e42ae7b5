"""The largest errors that keep a quantity below a limit."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.quantities import NAMES, QUANTITIES, quantity_row
from calib.studies.tolerance.result import ToleranceTable
from calib.studies.tolerance.setting import Setting
from designer.errors import InputError
from designer.spec_file import suggestion
from designer.tolerance.model import ErrorModel

Array = NDArray[np.float64]

ROUNDS = 8
CLOSE = 1e-3
BOLDEST = 16.0


@dataclass(frozen=True)
class Allowed:
    """The largest multiple of an amount that keeps the limit, and the interval that holds it by 95 %.

    Infinite if the source does not matter; 0 if noise alone is more than the limit.
    """

    factor: float
    low: float
    high: float


@dataclass(frozen=True)
class Budget:
    """What a limit on one quantity allows."""

    quantity: str
    limit: float  # in the quantity's unit
    is_met_without: bool  # noise alone is within the limit
    alone: tuple[tuple[str, Allowed], ...]  # each source by name, as if it were the only one
    together: Allowed  # all sources scaled alike

    def amount(self, table: ToleranceTable, source: str) -> Allowed:
        """The largest amount of a source alone, root mean square in its unit."""
        sigma = table.errors.amount(source).sigma
        found = dict(self.alone)[source]
        return Allowed(*(sigma * bound if sigma > 0 else math.nan for bound in (found.factor, found.low, found.high)))


def checked_quantity(name: str) -> str:
    """A quantity's name.

    Raises:
        InputError: there is none; the message suggests the nearest.
    """
    if name not in NAMES:
        hint = suggestion(name, list(NAMES)) or f"; there are {', '.join(NAMES)}"
        raise InputError(f"unknown quantity {name!r}{hint}")
    return name


def largest_allowed(table: ToleranceTable, quantity: str, limit: float) -> Budget:
    """The largest errors from a table, by m^2 = m0^2 + f^2 cost^2 for the multiple f of the amounts.

    The intervals are of the table's draws; those of a prediction tell nothing of where errors are no longer small, for
    which see `calib.studies.tolerance.reach` and `allowed_by_draws`.

    Raises:
        InputError: an unknown quantity, or a limit that is not above 0.
    """
    row = quantity_row(checked_quantity(quantity))
    _check(limit, quantity)
    base = table.baseline
    rooms = tuple(math.sqrt(max(limit**2 - float(bound[row]) ** 2, 0.0)) for bound in (base.value, base.high, base.low))

    def allowed(value: float, low: float, high: float) -> Allowed:
        return Allowed(_ratio(rooms[0], value), _ratio(rooms[1], high), _ratio(rooms[2], low))

    alone = tuple(
        (name, allowed(*(float(bound[place, row]) for bound in (table.cost.value, table.cost.low, table.cost.high))))
        for place, name in enumerate(table.sources)
    )
    all_of = table.together
    together = allowed(float(all_of.value[row]), float(all_of.low[row]), float(all_of.high[row]))
    return Budget(quantity, limit, rooms[0] > 0, alone, together)


def allowed_by_draws(
    setting: Setting,
    errors: ErrorModel,
    quantity: str,
    limit: float,
    *,
    seed: int,
    numbers: range,
    first: float = 1.0,
    run: Callable[[ErrorModel], Array] | None = None,
) -> Allowed:
    """The largest multiple of all amounts of a model by draws, which holds where the table's square law does not.

    The same draws are taken at each multiple, and the multiple is bracketed, so a larger limit allows no less.

    Args:
        setting: what is photographed.
        errors: all are scaled alike; for one source, `errors.only(name)`.
        quantity: that is limited.
        limit: in its unit.
        seed: of the study.
        numbers: of the draws.
        first: a guess, such as that of a table.
        run: the draws of a model (D, C, Q), if not those of `run_draws` in this process.

    Raises:
        InputError: an unknown quantity, a limit that is not above 0, or no solutions.
    """
    row = quantity_row(checked_quantity(quantity))
    _check(limit, quantity)
    draws_of = run or (lambda model: run_draws(setting, model, seed, numbers))
    if not math.isfinite(first):
        return Allowed(math.inf, math.inf, math.inf)
    factor, bracket = (first if first > 0 else 1.0), (0.0, math.inf)
    noise, cost, spread = math.nan, math.nan, math.nan
    for _ in range(ROUNDS):
        square = draws_of(errors.scaled(factor))[:, [0, -1], row] ** 2
        square = square[np.isfinite(square).all(axis=1)]
        if len(square) < 2:
            bracket = (bracket[0], factor)
            factor = 0.5 * (bracket[0] + factor)
            continue
        noise = float(square[:, 0].mean())
        extra = square[:, 1] - square[:, 0]
        cost, spread = float(extra.mean()), float(extra.std(ddof=1)) / math.sqrt(len(extra))
        room = limit**2 - noise
        if room <= 0:
            return Allowed(0.0, 0.0, 0.0)
        if cost <= 0:
            return Allowed(math.inf, 0.0, math.inf)
        bracket = (factor, bracket[1]) if cost <= room else (bracket[0], factor)
        step = min(math.sqrt(room / cost), BOLDEST)
        if abs(step - 1) < CLOSE:
            break
        factor = _within(factor * step, bracket)
    if not math.isfinite(cost):
        raise InputError("no draw has a camera; use smaller errors, or more views")
    half = 0.5 * HALF_WIDTH * spread / cost
    return Allowed(factor, factor * max(1 - half, 0.0), factor * (1 + half))


def _within(factor: float, bracket: tuple[float, float]) -> float:
    """A multiple inside a bracket: the guess, or the middle where it falls outside."""
    low, high = bracket
    if low < factor < high:
        return factor
    return 0.5 * (low + high) if math.isfinite(high) else 2 * low


def _ratio(room: float, cost: float) -> float:
    """The multiple of a cost that fills a room."""
    if room <= 0:
        return 0.0
    return room / cost if cost > 0 else math.inf


def _check(limit: float, quantity: str) -> None:
    unit = QUANTITIES[quantity_row(quantity)].unit
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(f"{quantity} {limit:g}{unit}: a limit must be more than 0")
