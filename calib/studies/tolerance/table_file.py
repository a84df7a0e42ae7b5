"""`table.json` of a tolerance study, for its page and other programs."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.quantities import NAMES
from designer.base.file_kind import FileKind
from designer.base.marks import AGAIN, MOST_ROWS, Count, FewLines, Length, Line, Number, OneOf, Word

MOST_SOURCES = 100

QuantityName = Annotated[str, OneOf(NAMES)]
ErrorUnit = Literal["mm", "rad", "1", "K", ""]


@dataclass(frozen=True)
class CostRow:
    """What one error costs one quantity; `none`: what noise alone gives; `all`: all errors together."""

    error: Word
    distribution: Word
    size: Number | None
    rms: Number | None
    unit: ErrorUnit
    quantity: QuantityName
    quantity_unit: Word
    cost: Number | None
    cost_low: Number | None
    cost_high: Number | None
    predicted: Number | None
    share: Number | None
    by_unit: Number | None
    by_unit_low: Number | None
    by_unit_high: Number | None
    prediction_holds_to_rms: Number | None


@dataclass(frozen=True)
class AllowedRow:
    """The largest amount of one error alone; None: it does not matter."""

    error: Word
    unit: ErrorUnit
    largest_rms: Number | None
    largest_rms_low: Number | None
    largest_rms_high: Number | None
    by_draws: bool


@dataclass(frozen=True)
class Together:
    """By what factor all errors may be larger; None: whatever they are."""

    factor: Number | None
    factor_low: Number | None
    factor_high: Number | None
    by_draws: bool


@dataclass(frozen=True)
class BudgetRow:
    """A limit, and what keeps it."""

    quantity: QuantityName
    limit: Number
    unit: Word
    met_by_noise_alone: bool
    met_as_assumed: bool
    alone: Annotated[tuple[AllowedRow, ...], Length(0, MOST_SOURCES)]
    together: Together


@dataclass(frozen=True)
class SweepCosts:
    """What an error costs a quantity at each of its amounts."""

    quantity: QuantityName
    cost: Annotated[tuple[Number | None, ...], Length(0, 100)]
    cost_low: Annotated[tuple[Number | None, ...], Length(0, 100)]
    cost_high: Annotated[tuple[Number | None, ...], Length(0, 100)]
    predicted: Annotated[tuple[Number | None, ...], Length(0, 100)]


@dataclass(frozen=True)
class SweepRow:
    """An error at several amounts."""

    error: Word
    rms: Annotated[tuple[Number, ...], Length(0, 100)]
    quantities: Annotated[tuple[SweepCosts, ...], Length(0, 20)]

    def of(self, quantity: str) -> SweepCosts | None:
        """The costs of a quantity."""
        return next((one for one in self.quantities if one.quantity == quantity), None)


@dataclass(frozen=True)
class CrossoverRow:
    """From which amount of an error on a target loses to the other."""

    error: Word
    unit: ErrorUnit
    quantity: QuantityName
    verdict: Literal["loses at zero", "crosses", "never loses"]
    rms: Number | None
    rms_low: Number | None
    rms_high: Number | None
    own_without: Number | None
    other: Number | None
    noise_share: Number | None


@dataclass(frozen=True)
class Crossovers:
    """The other target."""

    target: Line
    setting: FewLines
    errors: Word
    found: Annotated[tuple[CrossoverRow, ...], Length(0, MOST_ROWS)]


@dataclass(frozen=True)
class ToleranceFile:
    """All of it."""

    target: Line
    setting: FewLines
    kind: Literal["draws", "linear"]
    draws: Count
    failed: Annotated[tuple[Count, ...], Length(0, 200)]  # of each case
    ranked_by: QuantityName
    costs: Annotated[tuple[CostRow, ...], Length(1, MOST_SOURCES * len(NAMES))]
    budgets: Annotated[tuple[BudgetRow, ...], Length(0, len(NAMES))]
    sweeps: Annotated[tuple[SweepRow, ...], Length(0, MOST_SOURCES)]
    crossovers: Crossovers | None
    sources_of_amounts: Annotated[dict[Word, Line], Length(0, MOST_SOURCES)]
    notes: FewLines

    @cached_property
    def by_key(self) -> dict[tuple[str, str], CostRow]:
        """Rows by error and quantity."""
        return {(one.error, one.quantity): one for one in self.costs}

    def cost(self, error: str, quantity: str) -> CostRow | None:
        """A row; None if there is none."""
        return self.by_key.get((error, quantity))

    def value(self, error: str, quantity: str) -> float:
        """A cost; 0 if it is not known."""
        found = self.cost(error, quantity)
        return 0.0 if found is None or found.cost is None else found.cost

    def noise(self, quantity: str) -> float:
        """What noise alone gives."""
        return self.value(BARE, quantity)

    def total(self, quantity: str) -> float:
        """With all errors as they are assumed: costs and noise add in squares."""
        return math.hypot(self.noise(quantity), self.value(TOGETHER, quantity))

    @cached_property
    def ranking(self) -> tuple[CostRow, ...]:
        """The errors that cost anything, as they are found in the chosen quantity, by their share of it."""
        largest: dict[str, float] = {}
        for one in self.costs:
            over_noise = (one.predicted or 0.0) / max(self.noise(one.quantity), 1e-12)
            largest[one.error] = max(largest.get(one.error, 0.0), over_noise)
        rows = [
            one
            for one in self.costs
            if one.quantity == self.ranked_by and one.error not in (BARE, TOGETHER) and largest[one.error] > 0
        ]
        return tuple(sorted(rows, key=lambda one: (-round(one.share or 0.0, 6), -largest[one.error])))


TOLERANCE_TABLE = FileKind(ToleranceFile, "tolerance_table", "the table of a tolerance study", AGAIN)
