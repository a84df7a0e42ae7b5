"""Everything a tolerance study computes, step by step, with its draws kept in a folder.

At which error of one source a target becomes worse than another, such as an icosahedron than a board.

A target's errors are `m^2 = m0^2 + rest^2 + (x / sigma)^2 cost^2` for an amount x of the source, with the rest of its
sources as they are. It loses where that reaches the other target's m, which stays what it is.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from calib.studies.runner import DrawCount, Tell, after
from calib.studies.tolerance.budget import Allowance, budget_row, checked, largest_allowed, searched
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.predict import control_of, linear_table
from calib.studies.tolerance.quantities import NAMES, QUANTITIES, Quantity, Requirement, quantity_row
from calib.studies.tolerance.record import (
    CostRow,
    CrossoverRow,
    Crossovers,
    PhotographedSetting,
    ToleranceStudy,
    nine_digits,
)
from calib.studies.tolerance.result import Cost, ToleranceTable, table_of_draws
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.sizes import FACTORS, Reach, reach_of, sweep_rows, what_if_table
from calib.studies.tolerance.stored import AGAINST_FILE, STUDY_FILE, SWEEPS_FOLDER, DrawPool, Keeping
from calib.studies.tolerance.what_if import WhatIfTable
from designer.base.arrays import Array
from designer.tolerance.model import ErrorModel
from designer.tolerance.sources import SOURCES

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


SWEEP_DRAWS = 12


@dataclass(frozen=True)
class TolerancePlan:
    """What is computed."""

    draws: int
    seed: int
    requirements: tuple[Requirement, ...]
    by: str  # quantity that errors are ranked by
    full: bool  # with images
    linear: bool  # without draws
    keeping: Keeping
    progress: Callable[[str, float, int], None] = field(repr=False)

    def tell(self, what: str, total: int) -> Tell:
        """Tells of one kind of work."""
        self.progress(what, 0, total)
        return lambda done: self.progress(what, done, total)


@dataclass(frozen=True, eq=False)
class PhotographedTarget:
    """A target with its errors in front of a camera."""

    name: str
    file: Path
    setting: Setting
    errors: ErrorModel
    words: PhotographedSetting
    way: str = ""  # what the errors are called without sizes that were set; "": by their name
    ways: Mapping[str, ErrorModel] = field(default_factory=dict)  # others to choose from, by what they are called

    def what_ifs(self, plan: TolerancePlan) -> WhatIfTable:
        """What other sizes of errors would do."""
        plan.progress(f"what if {self.name} were made otherwise", 0, 0)
        return what_if_table(self.setting, self.errors, self.way or self.errors.name, self.ways, seed=plan.seed)

    def draws(self, plan: TolerancePlan, file: str, count: int, tell: Tell, factor: float = 1.0) -> Array:
        """Draws of all errors, times a factor, kept in a file of the folder; the missing ones computed.  # (D, C, Q)

        Raises:
            InputError: as `Keeping.draws`.
            StudyStoppedError: interrupted, or no workers are left.
        """
        errors = self.errors if factor == 1 else self.errors.scaled(factor)
        pool = DrawPool(self.setting, errors, plan.full)
        return plan.keeping.draws(pool, file, {"target": self.file}, plan.seed, count, tell)


def explore(scene: PhotographedTarget, plan: TolerancePlan) -> tuple[ToleranceStudy, ToleranceTable, DrawCount]:
    """Costs, sweeps, how far the prediction holds, and budgets; their table; and what was drawn for them."""
    plan.progress("predicting", 0, 0)
    linear = linear_table(scene.setting, scene.errors)
    if plan.linear:
        return _told(scene, plan, linear, linear), linear, DrawCount()
    first, start, there = first_order(scene.setting), time.perf_counter(), list[float]()
    tell = plan.tell("drawing", plan.draws)

    def noted(done: float) -> None:
        there.append(done)  # the first time as many as the folder had
        tell(done)

    drawn = scene.draws(plan, STUDY_FILE, plan.draws, noted)
    before = int(there[0]) if there else plan.draws
    count = DrawCount(plan.draws - before, before, time.perf_counter() - start)
    plan.progress("comparing with the prediction", 0, 0)
    table = _table(scene, plan, first, linear, drawn)
    if plan.full:
        return _told(scene, plan, table, linear), table, count
    sweeps = _swept(scene, plan, first, linear, drawn)
    reaches = _reaches(scene, plan, first, linear)
    return _told(scene, plan, table, linear, sweeps, reaches, first), table, count


def compared(
    study: ToleranceStudy, table: ToleranceTable, other: PhotographedTarget, plan: TolerancePlan, vary: str | None
) -> ToleranceStudy:
    """The study with the other target's costs, and where the first loses to it.

    Args:
        study: of the first target.
        table: it is of.
        other: the other target.
        plan: of both.
        vary: the error that is looked at more closely; None: the worst one of faces.
    """
    plan.progress("predicting the other", 0, 0)
    theirs = linear_table(other.setting, other.errors)
    if not plan.linear:
        drawn = other.draws(plan, AGAINST_FILE, plan.draws, plan.tell("drawing the other", plan.draws))
        theirs = _table(other, plan, first_order(other.setting), theirs, drawn)
    chosen, found = vary or default_vary(table, plan.by), crossovers(table, theirs)
    them = Crossovers(other.name, other.words, other.errors.name, chosen, found, other.what_ifs(plan))
    return replace(study, crossovers=them)


def _told(
    scene: PhotographedTarget,
    plan: TolerancePlan,
    table: ToleranceTable,
    linear: ToleranceTable,
    sweeps: Mapping[float, ToleranceTable] = MappingProxyType({}),
    reaches: Sequence[Reach] = (),
    first: FirstOrder | None = None,
) -> ToleranceStudy:
    """The study that tables tell.

    Args:
        scene: what is photographed.
        plan: what is computed.
        table: of draws, or the prediction.
        linear: the prediction.
        sweeps: tables at other multiples of the errors.
        reaches: how far the prediction holds.
        first: the derivatives; with them, limits are searched with draws where it does not.
    """
    budgets = [checked(largest_allowed(table, one), table, linear, reaches) for one in plan.requirements]
    if first is not None:
        budgets = _searched(budgets, scene, plan, first)
    return ToleranceStudy(
        scene.name, scene.words, table.kind, table.draws, table.failed, plan.by,
        tuple(_cost_rows(table, linear, reaches)), tuple(budget_row(one, table) for one in budgets),
        sweep_rows(sweeps, linear) if sweeps else (), None, dict(scene.errors.notes), scene.what_ifs(plan),
    )  # fmt: skip


def _table(
    scene: PhotographedTarget,
    plan: TolerancePlan,
    first: FirstOrder,
    linear: ToleranceTable,
    drawn: Array,
    factor: float = 1.0,
) -> ToleranceTable:
    """The table of draws (D, C, Q) of the errors times a factor, held against what is predicted of them."""
    numbers = range(len(drawn))
    control = control_of(first, linear, plan.seed, numbers, factor=factor, has_noise=not plan.full)
    return table_of_draws(scene.errors.scaled(factor), drawn, control)


def _swept(
    scene: PhotographedTarget, plan: TolerancePlan, first: FirstOrder, linear: ToleranceTable, main: Array
) -> dict[float, ToleranceTable]:
    """The table of all errors at each multiple; the draws of the amounts themselves are the study's own."""
    count, drawn, done = min(SWEEP_DRAWS, len(main)), {1.0: main}, 0
    tell = plan.tell("sweeping", (len(FACTORS) - 1) * count)
    for factor in FACTORS:
        if factor != 1:
            file = f"{SWEEPS_FOLDER}/{factor:g}x.sqlite"
            drawn[factor] = scene.draws(plan, file, count, after(done, tell), factor)
            done += count
    plan.progress("comparing with the prediction", 0, 0)
    return {factor: _table(scene, plan, first, linear, drawn[factor], factor) for factor in FACTORS}


def _reaches(scene: PhotographedTarget, plan: TolerancePlan, first: FirstOrder, linear: ToleranceTable) -> list[Reach]:
    """How far the prediction holds of each source that has an effect."""
    names = [name for name, cost in zip(linear.sources, linear.cost.value, strict=True) if (cost > 0).any()]
    tell, found = plan.tell("checking the prediction", len(names)), []
    for place, name in enumerate(names):
        found.append(reach_of(first, scene.errors, name, linear.baseline.value, seed=plan.seed))
        tell(place + 1)
    return found


def _searched(
    budgets: list[Allowance], scene: PhotographedTarget, plan: TolerancePlan, first: FirstOrder
) -> list[Allowance]:
    """The budgets, searched with draws where errors are no longer small."""
    total, done, found = sum(len(one.unchecked) for one in budgets), 0, []
    if not total:
        return budgets
    tell = plan.tell("searching limits", total)
    for one in budgets:
        found.append(searched(one, first, scene.errors, plan.seed, plan.draws, after(done, tell)))
        done += len(one.unchecked)
    return found


def _cost_rows(table: ToleranceTable, linear: ToleranceTable, reaches: Sequence[Reach]) -> Iterator[CostRow]:
    """For each quantity a row without errors, one for each source, and one for all together."""
    reach = {one.source: one.factor for one in reaches}
    unknown = math.nan

    def of_no_source(error: str, cost: Cost, predicted: Cost, quantity: Quantity) -> CostRow:
        return CostRow(
            error, "", unknown, unknown, "", quantity.name, quantity.unit, *_numbers(cost, predicted), unknown,
            unknown, unknown, unknown, math.inf,
        )  # fmt: skip

    for row, quantity in enumerate(QUANTITIES):
        yield of_no_source(BARE, table.baseline[row], linear.baseline[row], quantity)
        for place, name in enumerate(table.sources):
            amount, sigma, cost = table.errors.amount(name), float(table.sigma[place]), table.cost[place, row]
            by_unit, low, high = (nine_digits(end / sigma) if sigma > 0 else unknown for end in cost.bounds)
            holds_to = sigma * float(reach[name][row]) if name in reach else math.inf
            yield CostRow(
                name, amount.kind, nine_digits(amount.size), nine_digits(sigma), SOURCES[name].unit, quantity.name,
                quantity.unit, *_numbers(cost, linear.cost[place, row]), nine_digits(table.share[place, row]),
                by_unit, low, high, nine_digits(holds_to),
            )  # fmt: skip
        yield of_no_source(TOGETHER, table.together[row], linear.together[row], quantity)


def _numbers(cost: Cost, predicted: Cost) -> tuple[float, float, float, float]:
    value, low, high = map(nine_digits, cost.bounds)
    return value, low, high, nine_digits(float(predicted.value))
