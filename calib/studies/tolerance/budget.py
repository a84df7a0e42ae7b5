"""The largest errors that keep a quantity below a limit, and those at which a target becomes worse than another.

A target's errors are `m^2 = m0^2 + rest^2 + (x / sigma)^2 cost^2` for an amount x of a source, with the rest of its
sources as they are. It loses where that reaches the other target's m, which stays what it is.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calib.studies.runner import Tell, after
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import TOGETHER, BareDraw, bare_draw, drawn_noise, drawn_values, with_errors
from calib.studies.tolerance.first_order import FirstOrder
from calib.studies.tolerance.predict import Cost, ToleranceTable, control_of, linear_table
from calib.studies.tolerance.quantities import NAMES, Requirement, quantity_named, quantity_row
from calib.studies.tolerance.record import NEVER, OFF, AllowedRow, BudgetRow, CrossoverRow, Together, nine_digits
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.sizes import Reach
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import SOURCES

ROUNDS = 8
CLOSE = 1e-3
BOLDEST = 16.0
SEARCH_DRAWS = 24


@dataclass(frozen=True)
class Allowed:
    """The largest multiple of an amount that keeps the limit, and the interval that holds it by 95 %.

    Infinite if the source does not matter; 0 if noise alone is more than the limit.
    """

    factor: float
    low: float
    high: float
    by: Literal["square law", "unchecked square law", "draws"] = "square law"


NO_LIMIT = Allowed(math.inf, math.inf, math.inf)


@dataclass(frozen=True)
class Allowance:
    """What a limit on one quantity allows."""

    required: Requirement
    is_met_without: bool  # noise alone is within the limit
    allowed: Mapping[str, Allowed]  # each source by name, as if it were the only one, and all, scaled alike

    @property
    def unchecked(self) -> tuple[str, ...]:
        """Where the square law is not known to hold: sources, or "all"."""
        return tuple(name for name, one in self.allowed.items() if one.by == "unchecked square law")


def largest_allowed(table: ToleranceTable, required: Requirement) -> Allowance:
    """The largest errors from a table, by m^2 = m0^2 + f^2 cost^2 for the multiple f of the amounts.

    The intervals are of the table's draws; those of a prediction tell nothing of where errors are no longer small, for
    which see `checked` and `allowed_by_draws`.
    """
    row = _row(required)
    rooms = [math.sqrt(max(required.limit**2 - bound**2, 0.0)) for bound in table.baseline[row].bounds]

    def allowed(cost: Cost) -> Allowed:
        value, low, high = cost.bounds
        return Allowed(_ratio(rooms[0], value), _ratio(rooms[2], high), _ratio(rooms[1], low))

    alone = {name: allowed(table.cost[place, row]) for place, name in enumerate(table.sources)}
    return Allowance(required, rooms[0] > 0, {**alone, TOGETHER: allowed(table.together[row])})


def checked(budget: Allowance, table: ToleranceTable, linear: ToleranceTable, reaches: Sequence[Reach]) -> Allowance:
    """The budget with what is unchecked: the square law may fail from the assumed amounts to the largest allowed ones.

    A source that costs nothing to first order does not matter, whatever rounding in the draws says.

    Args:
        budget: by the square law.
        table: it is of.
        linear: the prediction.
        reaches: of the sources, how far it holds; none: that was not tried.
    """
    row = quantity_row(budget.required.quantity)
    reach = {one.source: float(one.factor[row]) for one in reaches}
    share = dict(zip(table.sources, table.share[:, row].tolist(), strict=True))
    reach[TOGETHER] = min((held for name, held in reach.items() if share[name] > OFF / 2), default=math.inf)
    found = {}
    for name, one in budget.allowed.items():
        costs_nothing = name != TOGETHER and not linear.cost.value[linear.sources.index(name), row] > 0
        allowed = NO_LIMIT if costs_nothing and one.factor != 0 else one
        is_beyond = 0 < allowed.factor <= NEVER and max(allowed.factor, 1.0) > reach.get(name, math.inf)
        found[name] = replace(allowed, by="unchecked square law") if is_beyond else allowed
    return replace(budget, allowed=found)


def searched(budget: Allowance, first: FirstOrder, errors: ErrorModel, seed: int, count: int, tell: Tell) -> Allowance:
    """The budget with what is unchecked searched with draws, one by one; it stays where none is found."""
    found = dict(budget.allowed)
    for place, name in enumerate(budget.unchecked):
        model, guess = errors if name == TOGETHER else errors.only(name), budget.allowed[name].factor
        with suppress(InputError):
            found[name] = allowed_by_draws(
                first, model, budget.required, seed=seed, numbers=range(min(SEARCH_DRAWS, count)), guess=guess,
                tell=after(place, tell),
            )  # fmt: skip
    return replace(budget, allowed=found)


def budget_row(budget: Allowance, table: ToleranceTable) -> BudgetRow:
    """The budget as the study's file has it, in the units of the sources."""
    quantity, limit = budget.required.quantity, budget.required.limit
    alone = (
        AllowedRow(name, SOURCES[name].unit, *_amounts(budget.allowed[name], sigma), *_origin(budget.allowed[name]))
        for name, sigma in zip(table.sources, table.sigma.tolist(), strict=True)
    )
    together = Together(*_amounts(budget.allowed[TOGETHER], 1.0), *_origin(budget.allowed[TOGETHER]))
    is_kept = bool(table.total[quantity_row(quantity)] <= limit)
    unit = quantity_named(quantity).unit
    return BudgetRow(quantity, limit, unit, budget.is_met_without, is_kept, tuple(alone), together)


def _amounts(allowed: Allowed, sigma: float) -> tuple[float, float, float]:
    """The largest amount of a source of this size, and its interval; infinite where none is too large."""
    value, low, high = (
        nine_digits(sigma * end) if sigma > 0 or end == 0 else math.inf
        for end in (allowed.factor, allowed.low, allowed.high)
    )
    return value, low, high


def _origin(allowed: Allowed) -> tuple[bool, bool]:
    return allowed.by == "draws", allowed.by == "unchecked square law"


def allowed_by_draws(
    first: FirstOrder,
    errors: ErrorModel,
    required: Requirement,
    *,
    seed: int,
    numbers: range,
    guess: float = 1.0,
    tell: Tell = lambda done: None,
) -> Allowed:
    """The largest multiple of all amounts of a model by draws, which holds where the table's square law does not.

    The same draws are taken at each multiple, each against its prediction (`calib.studies.tolerance.predict`), and the
    multiple is bracketed, so a larger limit allows no less.

    Args:
        first: the derivatives of what is photographed.
        errors: all are scaled alike; for one source, `errors.only(name)`.
        required: the limit.
        seed: of the study.
        numbers: of the draws.
        guess: such as that of a table.
        tell: told the share of the rounds that is done.
    """
    row, limit = _row(required), required.limit
    if not math.isfinite(guess):
        return NO_LIMIT
    draws = _Draws.of(first, errors, row, seed, numbers)
    room = limit**2 - draws.noise
    if room <= 0:
        return Allowed(0.0, 0.0, 0.0, "draws")
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
            return Allowed(math.inf, 0.0, math.inf, "draws")
        bracket = (factor, bracket[1]) if cost <= room else (bracket[0], factor)
        step = min(math.sqrt(room / cost), BOLDEST)
        if abs(step - 1) < CLOSE:
            break
        factor = _within(factor * step, bracket)
    tell(1.0)
    if not math.isfinite(cost):
        raise InputError("no draw has a camera; use smaller errors, or more views")
    half = 0.5 * HALF_WIDTH * spread / cost
    return Allowed(factor, factor * max(1 - half, 0.0), factor * (1 + half), "draws")


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
        bare = [bare_draw(first.setting, drawn_noise(first.setting, seed, number)) for number in numbers]
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


def _row(required: Requirement) -> int:
    """The row of a limited quantity."""
    quantity, limit = quantity_named(required.quantity), required.limit
    if not (math.isfinite(limit) and limit > 0):
        raise InputError(f"{quantity.name} {limit:g}{quantity.unit}: a limit must be more than 0")
    return quantity_row(quantity.name)


ENDS = ("value", "high", "low")
"""Of a target's costs, where the other's are at `OTHER_ENDS`: the amount and the interval that holds it by 95 %."""
OTHER_ENDS = ("value", "low", "high")


def crossovers(table: ToleranceTable, other: ToleranceTable) -> tuple[CrossoverRow, ...]:
    """Of each source that has a size and each quantity, at which amount a target loses to another."""
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
