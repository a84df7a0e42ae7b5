"""The largest errors that keep a quantity below a limit."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.studies.progress import Tell
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.control import control_of
from calib.studies.tolerance.draw import BareDraw, bare_draw, drawn_values, with_errors
from calib.studies.tolerance.first_order import FirstOrder
from calib.studies.tolerance.linear import linear_table
from calib.studies.tolerance.quantities import NAMES, QUANTITIES, quantity_row
from calib.studies.tolerance.result import ToleranceTable
from calib.studies.tolerance.setting import Setting
from designer.base.errors import InputError
from designer.base.words import suggestion
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
    first: FirstOrder,
    errors: ErrorModel,
    quantity: str,
    limit: float,
    *,
    seed: int,
    numbers: range,
    guess: float = 1.0,
    tell: Tell = lambda done: None,
) -> Allowed:
    """The largest multiple of all amounts of a model by draws, which holds where the table's square law does not.

    The same draws are taken at each multiple, each against its prediction (`calib.studies.tolerance.control`), and the
    multiple is bracketed, so a larger limit allows no less.

    Args:
        first: the derivatives of what is photographed.
        errors: all are scaled alike; for one source, `errors.only(name)`.
        quantity: that is limited.
        limit: in its unit.
        seed: of the study.
        numbers: of the draws.
        guess: such as that of a table.
        tell: told the share of the rounds that is done.

    Raises:
        InputError: an unknown quantity, a limit that is not above 0, or no solutions.
    """
    _check(limit, quantity)
    if not math.isfinite(guess):
        return Allowed(math.inf, math.inf, math.inf)
    draws = _Draws.of(first, errors, quantity_row(checked_quantity(quantity)), seed, numbers)
    room = limit**2 - draws.noise
    if room <= 0:
        return Allowed(0.0, 0.0, 0.0)
    factor, bracket = (guess if guess > 0 else 1.0), (0.0, math.inf)
    cost, spread = math.nan, math.nan
    for done in range(ROUNDS):
        found = draws.cost(factor)
        tell((done + 1) / ROUNDS)
        if found is None:
            bracket = (bracket[0], factor)
            factor = 0.5 * (bracket[0] + factor)
            continue
        cost, spread = found
        if cost <= 0:
            return Allowed(math.inf, 0.0, math.inf)
        bracket = (factor, bracket[1]) if cost <= room else (bracket[0], factor)
        step = min(math.sqrt(room / cost), BOLDEST)
        if abs(step - 1) < CLOSE:
            break
        factor = _within(factor * step, bracket)
    tell(1.0)
    if not math.isfinite(cost):
        raise InputError("no draw has a camera; use smaller errors, or more views")
    half = 0.5 * HALF_WIDTH * spread / cost
    return Allowed(factor, factor * max(1 - half, 0.0), factor * (1 + half))


@dataclass(frozen=True, eq=False)
class _Draws:
    """D draws of one quantity, at any multiple of their errors."""

    setting: Setting
    errors: ErrorModel
    row: int  # of the quantity
    values: list[dict[str, Array]]
    bare: list[BareDraw]
    noise: float  # mean square without errors
    square: Array  # (D,) predicted of the errors alone, at their amounts
    cross: Array  # (D,) predicted of errors and noise together beyond the squares of each
    mean: float  # of `square`, over all draws there could be

    @classmethod
    def of(cls, first: FirstOrder, errors: ErrorModel, row: int, seed: int, numbers: range) -> "_Draws":
        """The draws, and what is predicted of them."""
        linear = linear_table(first.setting, errors)
        alone = control_of(first, linear, seed, numbers, has_noise=False).square[:, -1, row]
        with_noise = control_of(first, linear, seed, numbers)
        bare = [bare_draw(first.setting, seed, number) for number in numbers]
        squares = np.array([one.quantities[row] ** 2 for one in bare])
        noise = with_noise.mean[0, row] + float(np.nanmean(squares - with_noise.square[:, 0, row]))
        values = [drawn_values(first.setting, errors, seed, number) for number in numbers]
        return cls(
            first.setting, errors, row, values, bare, noise, alone, with_noise.square[:, -1, row] - alone,
            float(linear.together.value[row]) ** 2,
        )  # fmt: skip

    def cost(self, factor: float) -> tuple[float, float] | None:
        """The squared cost at a multiple, and its standard error; None if fewer than two draws have a camera."""
        off = np.empty(len(self.bare))
        for place, (bare, values) in enumerate(zip(self.bare, self.values, strict=True)):
            scaled = {name: factor * value for name, value in values.items()}
            drawn = with_errors(self.setting, self.errors, scaled, bare)[self.row]
            off[place] = drawn**2 - bare.quantities[self.row] ** 2
        off -= factor**2 * self.square + factor * self.cross
        off = off[np.isfinite(off)]
        if len(off) < 2:
            return None
        return factor**2 * self.mean + float(off.mean()), float(off.std(ddof=1)) / math.sqrt(len(off))


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
