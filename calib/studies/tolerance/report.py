"""All that a tolerance study found: what its tables, files and figures are made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.budget import Allowed, Budget
from calib.studies.tolerance.crossover import Crossover, crossovers
from calib.studies.tolerance.draw import TOGETHER
from calib.studies.tolerance.quantities import QUANTITIES, Quantity, quantity_row
from calib.studies.tolerance.reach import LARGEST, Reach
from calib.studies.tolerance.result import Control, Cost, ToleranceTable
from calib.studies.tolerance.sweep import FACTORS, Sweep, sweep_of_draws
from designer.tolerance.registry import SOURCES

Array = NDArray[np.float64]

MAIN: tuple[str, ...] = (
    "reprojection", "intersection", "reconstruction", "intersection_true", "reconstruction_true", "pose",
    "focal_length", "distortion_map",
)  # fmt: skip
"""The quantities that tables and figures show; files have all."""
FEWEST_TO_CHECK = 10
"""Draws that a prediction is held against: the spread of fewer says nothing of chance."""
OFF = 0.1
"""A prediction that is off by more than this is told."""

NEVER = 100.0
"""A multiple above this is told as one that does not matter."""
NO_LIMIT = Allowed(np.inf, np.inf, np.inf)


def of_name(name: str) -> Quantity:
    """A quantity by its name."""
    return QUANTITIES[quantity_row(name)]


@dataclass(frozen=True)
class Requirement:
    """A limit that a person sets."""

    quantity: str
    limit: float  # in the quantity's unit


@dataclass(frozen=True, eq=False)
class CheckedBudget:
    """What a limit allows, and which of it was searched with draws because the square law no longer holds there."""

    budget: Budget
    by_draws: tuple[str, ...]  # sources, or "all"
    beyond: tuple[str, ...]  # sources, or "all": where the square law is not known to hold, and no draws were taken


@dataclass(frozen=True, eq=False)
class Against:
    """Another target, whose errors are what they are."""

    name: str
    table: ToleranceTable
    lines: tuple[str, ...]  # its setting in words
    vary: str  # source that is looked at more closely
    crossovers: tuple[tuple[str, tuple[Crossover, ...]], ...]  # of each source by name

    def of(self, source: str, quantity: str) -> Crossover:
        """Where the first target loses by one source."""
        return dict(self.crossovers)[source][quantity_row(quantity)]


@dataclass(frozen=True, eq=False)
class ToleranceReport:
    """All that was found."""

    name: str  # of the target
    lines: tuple[str, ...]  # the setting in words
    face_count: int
    table: ToleranceTable  # of draws, or the prediction
    linear: ToleranceTable
    by: str  # quantity that sources are ranked by
    sweeps: tuple[Sweep, ...] = ()
    reaches: tuple[Reach, ...] = ()
    budgets: tuple[CheckedBudget, ...] = ()
    against: Against | None = None

    @property
    def ranking(self) -> tuple[str, ...]:
        """Sources that cost anything, by their share of the chosen quantity, then by their largest cost over noise."""
        share = self.table.share[:, quantity_row(self.by)].round(6)
        base = np.maximum(self.linear.baseline.value, 1e-12)
        largest = (self.linear.cost.value / base).max(axis=1)
        order = np.lexsort((-largest, -share))
        return tuple(self.table.sources[place] for place in order if self.has_effect(self.table.sources[place]))

    def has_effect(self, source: str) -> bool:
        """Whether a source does anything to this target."""
        return bool((self.linear.cost.value[self.linear.sources.index(source)] > 0).any())

    def is_kept(self, budget: Budget) -> bool:
        """Whether all errors together, as they are assumed, keep a limit."""
        return bool(self.table.total[quantity_row(budget.quantity)] <= budget.limit)

    @property
    def idle(self) -> tuple[str, ...]:
        """Sources that do nothing to this target."""
        return tuple(name for name in self.table.sources if not self.has_effect(name))

    def reach(self, source: str, quantity: str | None = None) -> float:
        """The multiple of a source's amount up to which the prediction holds, of one quantity or of all main ones.

        Infinite: as far as was tried; nan: not tried.
        """
        for one in self.reaches:
            if one.source == source:
                rows = [quantity_row(name) for name in (MAIN if quantity is None else (quantity,))]
                return float(one.factor[rows].min())
        return float("nan")

    def first_off(self, source: str) -> str:
        """The main quantity whose prediction fails first; "" if none does as far as was tried."""
        for one in self.reaches:
            if one.source == source:
                name = min(MAIN, key=lambda name: float(one.factor[quantity_row(name)]))
                return name if np.isfinite(one.factor[quantity_row(name)]) else ""
        return ""

    @property
    def tried_to(self) -> float:
        """The largest multiple that was tried."""
        return LARGEST


@dataclass(frozen=True)
class Deviation:
    """Where draws and prediction differ."""

    source: str  # or "all"
    quantity: str
    linear: float
    drawn: float


def deviations(report: ToleranceReport) -> tuple[Deviation, ...]:
    """Main quantities whose prediction is off by more than 10 %, and by more than chance; none if draws are too few."""
    if report.table.kind == "linear" or report.table.draws < FEWEST_TO_CHECK:
        return ()
    table, linear = report.table, report.linear
    costs: list[tuple[str, Cost, Cost, tuple[int, ...]]] = [(TOGETHER, table.together, linear.together, ())]
    costs += [(name, table.cost, linear.cost, (place,)) for place, name in enumerate(table.sources)]
    found = []
    for name, drawn, predicted, place in costs:
        for quantity in MAIN:
            at = (*place, quantity_row(quantity))
            value, line = float(drawn.value[at]), float(predicted.value[at])
            chance = 2 * (float(drawn.high[at]) - value) / HALF_WIDTH
            small = 0.3 * float(linear.baseline.value[at[-1]])
            if max(value, line) > small and abs(value - line) > OFF * line + chance:
                found.append(Deviation(name, quantity, line, value))
    return tuple(found)


def sweeps_from(
    table: ToleranceTable,
    linear: ToleranceTable,
    draws: Mapping[float, Array],
    controls: Mapping[float, Control] | None = None,
) -> tuple[Sweep, ...]:
    """The sweep of each source that has an effect, from the draws (D, C, Q) of all errors at each multiple.

    A source's draws are the same alone and among others, so one run of all sources serves the sweeps of each.
    """
    errors, found = table.errors, []
    for place, name in enumerate(errors.sources):
        if (linear.cost.value[place] > 0).any():
            cases = [0, place + 1, place + 1]
            of_source = [draws[factor][:, cases] for factor in FACTORS]
            predicted = None if controls is None else [controls[factor].of_cases(cases) for factor in FACTORS]
            found.append(sweep_of_draws(errors, name, FACTORS, of_source, linear, predicted))
    return tuple(found)


def default_vary(table: ToleranceTable, by: str) -> str:
    """The source to vary against another target: the one of faces that costs most, else of all; "" if none does."""
    row = quantity_row(by)
    costly = [name for name in table.ranking(by) if table.cost.value[table.sources.index(name), row] > 0]
    of_faces = [name for name in costly if SOURCES[name].scope == "face"]
    return (of_faces or costly or [""])[0]


def all_crossovers(table: ToleranceTable, other: ToleranceTable) -> tuple[tuple[str, tuple[Crossover, ...]], ...]:
    """The crossovers of each source that has a size."""
    return tuple(
        (name, crossovers(table, name, other))
        for name, sigma in zip(table.sources, table.sigma, strict=True)
        if sigma > 0
    )


def with_drawn(checked: CheckedBudget, found: Sequence[tuple[str, Allowed]]) -> CheckedBudget:
    """The budget with what draws found in place of the square law."""
    by_name = dict(found)
    budget = checked.budget
    alone = tuple((name, by_name.get(name, allowed)) for name, allowed in budget.alone)
    budget = replace(budget, alone=alone, together=by_name.get(TOGETHER, budget.together))
    left = tuple(name for name in checked.beyond if name not in by_name)
    return CheckedBudget(budget, tuple(by_name), left)


def checked_budget(report: ToleranceReport, budget: Budget) -> CheckedBudget:
    """A budget, and where its square law is not known to hold: from the assumed amounts to the largest allowed ones.

    A source that costs nothing to first order does not matter, whatever rounding in the draws says.
    """
    row = quantity_row(budget.quantity)
    predicted = dict(zip(report.linear.sources, report.linear.cost.value[:, row].tolist(), strict=True))
    alone = tuple(
        (name, allowed if predicted[name] > 0 or allowed.factor == 0 else NO_LIMIT) for name, allowed in budget.alone
    )
    beyond = [
        name
        for name, allowed in alone
        if 0 < allowed.factor <= NEVER and max(allowed.factor, 1.0) > report.reach(name, budget.quantity)
    ]
    share = dict(zip(report.table.sources, report.table.share[:, row].tolist(), strict=True))
    limits = [report.reach(name, budget.quantity) for name in report.ranking if share[name] > OFF / 2]
    if 0 < budget.together.factor <= NEVER and max(budget.together.factor, 1.0) > min(limits, default=np.inf):
        beyond.append(TOGETHER)
    return CheckedBudget(replace(budget, alone=alone), (), tuple(beyond))
