"""`table.json` of a tolerance study, as its page reads it."""

import math
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from calib.report.stored_table import MOST_ROWS, Count, FewLines, Flag, Line, Number, Stored, Word, read_table
from calib.studies.table_files import JSON_FILE
from calib.studies.tolerance.draw import BARE, TOGETHER
from calib.studies.tolerance.files import FORMAT, VERSION
from calib.studies.tolerance.quantities import NAMES

MOST_SOURCES = 100

QuantityName = Literal[
    "reprojection", "intersection", "reconstruction", "intersection_true", "reconstruction_true", "pose", "rotation",
    "focal_length", "principal_point", "distortion_map",
]  # fmt: skip
ErrorUnit = Literal["mm", "rad", "1", "K", ""]


class CostRow(Stored):
    """What one error costs one quantity; `none`: what noise alone gives; `all`: all errors together."""

    error: Word
    distribution: Word
    size: Number | None
    rms: Number | None
    unit: ErrorUnit
    quantity: QuantityName
    cost: Number | None
    cost_low: Number | None
    cost_high: Number | None
    predicted: Number | None
    share: Number | None
    by_unit: Number | None
    by_unit_low: Number | None
    by_unit_high: Number | None
    prediction_holds_to_rms: Number | None


class AllowedRow(Stored):
    """The largest amount of one error alone; None: it does not matter."""

    error: Word
    unit: ErrorUnit
    largest_rms: Number | None
    largest_rms_low: Number | None
    largest_rms_high: Number | None
    by_draws: Flag


class Together(Stored):
    """By what factor all errors may be larger; None: whatever they are."""

    factor: Number | None
    factor_low: Number | None
    factor_high: Number | None


class BudgetRow(Stored):
    """A limit, and what keeps it."""

    quantity: QuantityName
    limit: Number
    unit: Word
    met_by_noise_alone: Flag
    met_as_assumed: Flag
    alone: Annotated[tuple[AllowedRow, ...], Field(max_length=MOST_SOURCES)]
    together: Together


class SweepCosts(Stored):
    """What an error costs a quantity at each of its amounts."""

    quantity: QuantityName
    cost: Annotated[tuple[Number | None, ...], Field(max_length=100)]
    predicted: Annotated[tuple[Number | None, ...], Field(max_length=100)]


class SweepRow(Stored):
    """An error at several amounts."""

    error: Word
    rms: Annotated[tuple[Number, ...], Field(max_length=100)]
    quantities: Annotated[tuple[SweepCosts, ...], Field(max_length=20)]

    def of(self, quantity: str) -> SweepCosts | None:
        """The costs of a quantity."""
        return next((one for one in self.quantities if one.quantity == quantity), None)


class CrossoverRow(Stored):
    """From which amount of an error on a target loses to the other."""

    error: Word
    unit: ErrorUnit
    quantity: QuantityName
    verdict: Literal["loses at zero", "crosses", "never loses"]
    rms: Number | None
    other: Number | None


class Crossovers(Stored):
    """The other target."""

    target: Line
    setting: FewLines
    errors: Word
    found: Annotated[tuple[CrossoverRow, ...], Field(max_length=MOST_ROWS)]


class ToleranceFile(Stored):
    """All of it."""

    target: Line
    setting: FewLines
    kind: Literal["draws", "linear"]
    draws: Count
    ranked_by: QuantityName
    costs: Annotated[tuple[CostRow, ...], Field(min_length=1, max_length=MOST_SOURCES * len(NAMES))]
    budgets: Annotated[tuple[BudgetRow, ...], Field(max_length=len(NAMES))]
    sweeps: Annotated[tuple[SweepRow, ...], Field(max_length=MOST_SOURCES)]
    crossovers: Crossovers | None
    sources_of_amounts: Annotated[dict[Word, Line], Field(max_length=MOST_SOURCES)]
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


def read_tolerance_table(folder: Path) -> ToleranceFile | None:
    """The table of a folder; None if it has none.

    Raises:
        InputError: as `read_table`.
    """
    return read_table(folder / JSON_FILE, ToleranceFile, FORMAT, VERSION)
