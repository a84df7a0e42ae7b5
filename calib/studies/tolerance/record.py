"""What a tolerance study found: all that its page, tables and figures are made from."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.quantities import MAIN, NAMES
from calib.studies.tolerance.what_if import RankedWay, WhatIf, WhatIfTable
from designer.base import square_law
from designer.base.marks import Gap, NullIs

FEWEST_TO_CHECK = 10
"""Draws that a prediction is held against: the spread of fewer says nothing of chance."""
OFF = square_law.OFF
"""A prediction that is off by more than this is told."""
NEVER = 100.0
"""A multiple of what is assumed above this is told as one that does not matter."""

ErrorUnit = Literal["mm", "rad", "1", "K", ""]
Largest = Annotated[float, NullIs(math.inf)]
"""A number; infinite: there is no limit."""
Row = tuple[Gap, ...]


@dataclass(frozen=True)
class PhotographedSetting:
    """A target before a camera, in words."""

    photos: str
    errors: str
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class CostRow:
    """What one error costs one quantity; `none`: what noise alone gives; `all`: all errors together."""

    error: str
    distribution: str
    size: Gap
    rms: Gap
    unit: ErrorUnit
    quantity: str
    quantity_unit: str
    cost: Gap
    cost_low: Gap
    cost_high: Gap
    predicted: Gap
    share: Gap
    by_unit: Gap
    by_unit_low: Gap
    by_unit_high: Gap
    prediction_holds_to_rms: Largest  # as far as it was tried, if it was

    @property
    def reach(self) -> float:
        """The multiple of the amount up to which the prediction holds."""
        return self.prediction_holds_to_rms / self.rms if self.rms else math.inf


@dataclass(frozen=True)
class AllowedRow:
    """The largest amount of one error alone; infinite: it does not matter."""

    error: str
    unit: ErrorUnit
    largest_rms: Largest
    largest_rms_low: Largest
    largest_rms_high: Largest
    by_draws: bool
    unchecked: bool  # where the square law is not known to hold, and no draws were taken


@dataclass(frozen=True)
class Together:
    """By what factor all errors may be larger; infinite: whatever they are."""

    factor: Largest
    factor_low: Largest
    factor_high: Largest
    by_draws: bool
    unchecked: bool


@dataclass(frozen=True)
class BudgetRow:
    """A limit, and what keeps it."""

    quantity: str
    limit: float
    unit: str
    met_by_noise_alone: bool
    met_as_assumed: bool
    alone: tuple[AllowedRow, ...]
    together: Together


@dataclass(frozen=True)
class SweepCosts:
    """What an error costs a quantity at each of its amounts."""

    quantity: str
    cost: Row
    cost_low: Row
    cost_high: Row
    predicted: Row


@dataclass(frozen=True)
class SweepRow:
    """An error at several amounts."""

    error: str
    rms: tuple[float, ...]
    quantities: tuple[SweepCosts, ...]

    def of(self, quantity: str) -> SweepCosts:
        """The costs of a quantity."""
        return next(one for one in self.quantities if one.quantity == quantity)


@dataclass(frozen=True)
class CrossoverRow:
    """From which amount of an error on a target loses to the other."""

    error: str
    unit: ErrorUnit
    quantity: str
    verdict: Literal["loses at zero", "crosses", "never loses"]
    rms: Largest
    rms_low: Largest
    rms_high: Largest
    own_without: Gap
    other: Gap
    other_low: Gap
    other_high: Gap
    noise_share: Gap


@dataclass(frozen=True)
class Crossovers:
    """The other target."""

    target: str
    setting: PhotographedSetting
    errors: str
    vary: str  # the error that is looked at more closely; "": none costs anything
    found: tuple[CrossoverRow, ...]
    what_ifs: WhatIfTable

    @cached_property
    def by_key(self) -> dict[tuple[str, str], CrossoverRow]:
        """Rows by error and quantity."""
        return {(one.error, one.quantity): one for one in self.found}

    @cached_property
    def totals(self) -> dict[str, float]:
        """The errors of the other target's calibration, by quantity."""
        return {one.quantity: one.other for one in self.found}


@dataclass(frozen=True)
class ToleranceStudy:
    """All of it: `study.cost("scale", "pose").cost`, `study.total("pose")`, `study.ranking`."""

    target: str
    setting: PhotographedSetting
    kind: Literal["draws", "linear"]
    draws: int
    failed: tuple[int, ...]  # of each case: `none`, each error, `all`
    ranked_by: str
    costs: tuple[CostRow, ...]
    budgets: tuple[BudgetRow, ...]
    sweeps: tuple[SweepRow, ...]
    crossovers: Crossovers | None
    sources_of_amounts: dict[str, str]
    what_ifs: WhatIfTable

    @cached_property
    def _by_key(self) -> dict[tuple[str, str], CostRow]:
        return {(one.error, one.quantity): one for one in self.costs}

    @cached_property
    def errors(self) -> tuple[str, ...]:
        """All errors, in the order of the draws' cases."""
        return tuple(dict.fromkeys(one.error for one in self.costs if one.error not in (BARE, TOGETHER)))

    def cost(self, error: str, quantity: str) -> CostRow:
        """What an error costs a quantity.

        Raises:
            KeyError: there is no such error or quantity.
        """
        return self._by_key[error, quantity]

    def noise(self, quantity: str) -> float:
        """What noise alone gives."""
        return self.cost(BARE, quantity).cost

    def total(self, quantity: str) -> float:
        """With all errors as they are assumed: costs and noise add in squares."""
        return math.hypot(self.noise(quantity), self.cost(TOGETHER, quantity).cost)

    def without(self, one: CostRow) -> float:
        """What a quantity would be if one error were none."""
        return math.sqrt(max(self.total(one.quantity) ** 2 - _or_zero(one.cost) ** 2, 0.0))

    def excess(self, quantity: str) -> float:
        """Cost of all together over the root of the summed squares of each; 1 where errors add in squares, nan of 0."""
        alone = math.hypot(*(_or_zero(self.cost(error, quantity).cost) for error in self.errors))
        return self.cost(TOGETHER, quantity).cost / alone if alone > 0 else math.nan

    def what_if(self, errors: str | None = None, **sizes: str) -> WhatIf:
        """What the calibration would be with other sizes: `study.what_if(skew="0.05deg", scale="uniform 0.2%")`.

        Predicted, and in less than a millisecond; `beyond` of the answer names what the prediction may miss.

        Args:
            errors: another way of making, by the name of its error template; None: as the study assumed.
            sizes: other sizes of single errors.

        Raises:
            InputError: an unknown way or source, or a size that breaks a rule.
        """
        return self.what_ifs.ask(errors, sizes)

    def ways(self, by: str | None = None) -> tuple[RankedWay, ...]:
        """The ways in which such a target is made, best first: `[(one.way.name, one.total()) for one in study.ways()]`.

        Args:
            by: the quantity that they are ranked by; None: the one that errors are ranked by.

        Raises:
            InputError: an unknown quantity.
        """
        return self.what_ifs.ranked(by or self.ranked_by)

    @cached_property
    def _largest(self) -> dict[str, float]:
        """The largest predicted cost of each error, in units of the noise."""
        return {
            error: max(
                _or_zero(self.cost(error, name).predicted) / max(_or_zero(self.noise(name)), 1e-12) for name in NAMES
            )
            for error in self.errors
        }

    @cached_property
    def ranking(self) -> tuple[CostRow, ...]:
        """The errors that cost anything, by their share of the quantity that is ranked by."""
        return self.ranked(self.ranked_by)

    def ranked(self, quantity: str) -> tuple[CostRow, ...]:
        """The errors that cost anything, by their share of a quantity, then by their largest cost over noise."""
        rows = [self.cost(error, quantity) for error in self.errors if self._largest[error] > 0]
        return tuple(sorted(rows, key=lambda one: (-round(_or_zero(one.share), 6), -self._largest[one.error])))

    @property
    def idle(self) -> tuple[str, ...]:
        """Errors that do nothing to this target."""
        return tuple(error for error in self.errors if not self._largest[error] > 0)

    @property
    def is_checked(self) -> bool:
        """Whether the prediction was compared with exact costs at several amounts."""
        return bool(self.sweeps)

    def first_off(self, error: str) -> CostRow:
        """The main quantity whose prediction fails first."""
        return min((self.cost(error, name) for name in MAIN), key=lambda one: one.reach)

    @property
    def is_kept(self) -> bool:
        """Whether all limits are kept."""
        return all(one.met_as_assumed for one in self.budgets)

    def deviations(self) -> Iterator[CostRow]:
        """Costs whose prediction is off by more than 10 %, and by more than chance; none of few draws."""
        if self.kind == "linear" or self.draws < FEWEST_TO_CHECK:
            return
        for error in (TOGETHER, *self.errors):
            for name in MAIN:
                one = self.cost(error, name)
                chance = 2 * (one.cost_high - one.cost) / HALF_WIDTH
                small = 0.3 * self.cost(BARE, name).predicted
                if (
                    max(one.cost, one.predicted) > small
                    and abs(one.cost - one.predicted) > OFF * one.predicted + chance
                ):
                    yield one


def _or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def nine_digits(value: float) -> float:
    """A number as files have it."""
    return float(f"{value:.9g}")
