"""The table of a tolerance study: what each error source costs each quantity."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from calib.core.types import frozen_array
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import case_names
from calib.studies.tolerance.quantities import quantity_row
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel


@dataclass(frozen=True, eq=False)
class Cost:
    """sqrt(m^2 - m0^2), the mean over errors and noise taken of the squares, with the interval that holds it by 95 %.

    Arrays of any shape. The interval is of the draws; that of a linear prediction has no width.
    """

    value: Array
    low: Array
    high: Array

    def __post_init__(self) -> None:
        for name in ("value", "low", "high"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))

    @staticmethod
    def exact(value: Array) -> "Cost":
        """Without an interval."""
        return Cost(value, value, value)

    def __getitem__(self, place: int | slice | tuple[int, ...]) -> "Cost":
        """Of a part."""
        return Cost(np.asarray(self.value[place]), np.asarray(self.low[place]), np.asarray(self.high[place]))

    @property
    def bounds(self) -> tuple[float, float, float]:
        """Value, low and high of a single cost."""
        return float(self.value), float(self.low), float(self.high)

    @property
    def error(self) -> Array:
        """Standard errors, from the width of the interval."""
        error: Array = (self.high - self.low) / (2 * HALF_WIDTH)
        return error


@dataclass(frozen=True, eq=False)
class Control:
    """What is predicted of D draws, and of all there could be: squares of case 0, excess over these of the others."""

    square: Array  # (D, C, Q)
    mean: Array  # (C, Q)


@dataclass(frozen=True, eq=False)
class ToleranceTable:
    """S sources and Q quantities, in the order of `errors.sources` and `QUANTITIES`."""

    kind: Literal["draws", "linear"]
    errors: ErrorModel
    baseline: Cost  # (Q,) m0, without errors
    cost: Cost  # (S, Q) of each source alone
    together: Cost  # (Q,) of all
    draws: int  # how many; 0: a prediction
    failed: tuple[int, ...]  # of each case, draws that have no solution and do not count

    @property
    def sources(self) -> tuple[str, ...]:
        """S names."""
        return self.errors.sources

    @cached_property
    def sigma(self) -> Array:
        """How large each source is, root mean square in its unit (`SOURCES[name].unit`).  # (S,)"""
        return np.array([self.errors.amount(name).sigma for name in self.sources])

    @cached_property
    def share(self) -> Array:
        """Of each source in the sum of the squared costs; 0 where there are none.  # (S, Q)"""
        square = np.nan_to_num(self.cost.value) ** 2
        total = square.sum(axis=0)
        share: Array = square / np.where(total > 0, total, 1.0)
        return share

    @property
    def total(self) -> Array:
        """What a calibration shows with all errors: sqrt(m0^2 + cost^2).  # (Q,)"""
        return np.hypot(self.baseline.value, self.together.value)

    def ranking(self, quantity: str) -> tuple[str, ...]:
        """The sources, the one that costs a quantity most first.

        Raises:
            ValueError: an unknown quantity.
        """
        cost = np.nan_to_num(self.cost.value[:, quantity_row(quantity)])
        return tuple(self.sources[row] for row in np.argsort(-cost, kind="stable"))


def table_of_draws(errors: ErrorModel, draws: Array, control: Control | None = None) -> ToleranceTable:
    """The table of draws (D, C, Q), as `run_draws` gives them.

    Args:
        errors: of the draws.
        draws: the quantities.
        control: what is predicted of them, which their means and intervals are then taken against.

    Raises:
        InputError: no draws, or of other errors, or none has a solution without errors.
    """
    if draws.ndim != 3 or draws.shape[1] != len(case_names(errors)) or not len(draws):
        raise InputError(
            f"draws of the shape {draws.shape}: they must be of {len(case_names(errors))} cases, one or more"
        )
    solved = np.isfinite(draws[:, :, 0])
    if not solved[:, 0].any():
        raise InputError("no draw has a camera even without errors; use more views, or other ones")
    square = draws**2
    square[:, 1:] -= square[:, :1]
    expected = np.zeros(square.shape[1:])
    if control is not None:
        square, expected = square - control.square, control.mean
    costs = _root_of_mean(square, expected)
    failed = tuple((~solved).sum(axis=0).tolist())
    return ToleranceTable("draws", errors, costs[0], costs[1:-1], costs[-1], len(draws), failed)


def _root_of_mean(square: Array, expected: Array) -> Cost:
    """The root of what is expected (C, Q) and the mean of what squares (D, C, Q) are beyond, which may be negative."""
    known = np.isfinite(square)
    count = known.sum(axis=0)
    kept = np.where(known, square, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        beyond = kept.sum(axis=0) / count
        variance = (np.where(known, square - beyond, 0.0) ** 2).sum(axis=0) / np.maximum(count - 1, 0)
        half = HALF_WIDTH * np.sqrt(variance / count)
    mean = expected + beyond
    half = np.where((mean == 0) & ~(half > 0), 0.0, half)
    return Cost(*(np.sqrt(np.maximum(bound, 0.0)) for bound in (mean, mean - half, mean + half)))
