"""What the solver's Jacobians predict: the table of a study at once, and what is to be expected of the draws made.

The square of a quantity is a sum over the errors, each independent of the others: with `e_j` its response to a unit of
the number j (`calib.studies.tolerance.response`), cost^2 = sum sigma_j^2 |e_j|^2. Numbers that a source has fixed are
no draws; their responses are added before they are squared. What noise costs is known without draws, too
(`calib.studies.tolerance.response`).

A quantity's square y in a draw hardly differs from its prediction x for the same numbers and the same noise, whose mean
over all draws is known without any. So `mean(y - x) + E x` has the mean of y, whatever the prediction misses, and only
the spread of y - x for an error: draws need only tell what the prediction misses (control variates; Owen 2013, *Monte
Carlo theory, methods and examples*, 8.9).

The table of a tolerance study: what each error source costs each quantity.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from calib.core.parallel import one_thread
from calib.core.types import frozen_array
from calib.studies.statistics import HALF_WIDTH
from calib.studies.tolerance.draw import bare_draw, case_names, drawn_noise, drawn_values
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.quantities import QUANTITIES, quantity_row
from calib.studies.tolerance.response import noise_squares, responses
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import directions, displacements


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
        """The sources, the one that costs a quantity most first."""
        cost = np.nan_to_num(self.cost.value[:, quantity_row(quantity)])
        return tuple(self.sources[row] for row in np.argsort(-cost, kind="stable"))


def table_of_draws(errors: ErrorModel, draws: Array, control: Control | None = None) -> ToleranceTable:
    """The table of draws (D, C, Q), as `run_draws` gives them."""
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


NEGLIGIBLE = 1e-6
"""Of the largest response a unit can have, which differences and sums leave where there is none."""
COLUMNS_AT_ONCE = 128
"""Bounds the memory."""


@one_thread
def linear_table(setting: Setting, errors: ErrorModel) -> ToleranceTable:
    """The costs of all sources where errors are small; see `calib.studies.tolerance.sizes` for where they are."""
    first = first_order(setting)
    square = np.zeros((len(errors.amounts), len(QUANTITIES)))
    fixed = np.zeros((setting.target.ring_count, 3, 1))
    drawn_square = np.zeros(len(QUANTITIES))
    for row, (name, amount) in enumerate(errors.amounts):
        columns = directions(setting.target, errors, name)
        if amount.kind == "fixed":
            columns = amount.size * columns.sum(axis=2, keepdims=True)
            fixed += columns
            square[row] = square_of(first, columns)
        else:
            square[row] = amount.sigma**2 * square_of(first, columns)
            drawn_square += square[row]
    together = np.sqrt(drawn_square + square_of(first, fixed))
    base, cost = Cost.exact(baseline(first)), Cost.exact(np.sqrt(square))
    return ToleranceTable("linear", errors, base, cost, Cost.exact(together), 0, ())


def square_of(first: FirstOrder, columns: Array) -> Array:
    """The sum of the squares of all quantities over displacements (R, 3, N).  # (Q,)"""
    total: Array = responses(first, columns).square.sum(axis=1)
    return np.where(total < _rounding(first.setting, columns), 0.0, total)


def _rounding(setting: Setting, columns: Array) -> Array:
    """Squares that are nothing but rounding: of a scale of the whole print, no residual is left.  # (Q,)"""
    length_mm = np.sqrt((columns**2).sum() / setting.target.ring_count)
    focal = setting.camera.params[0]
    distance = np.linalg.norm(setting.cam_from_target[:, :3, 3], axis=1).mean()
    pixel, degree = focal / distance, np.degrees(1 / distance)
    per_mm = {"px": pixel, "mm": 1.0, "deg": degree}
    return np.array([(NEGLIGIBLE * length_mm * per_mm[quantity.unit]) ** 2 for quantity in QUANTITIES])


def baseline(first: FirstOrder) -> Array:
    """What the noise costs, and a lens that the solved model does not fit.  # (Q,)"""
    base: Array = np.sqrt(noise_squares(first) + _misfit(first.setting) ** 2)
    return base


def _misfit(setting: Setting) -> Array:
    """The quantities without noise and errors: zero where the solved model is the true one.  # (Q,)"""
    if setting.reference is setting.camera:
        return np.zeros(len(QUANTITIES))
    return np.nan_to_num(bare_draw(setting, np.zeros_like(setting.observations.center_px)).quantities)


@one_thread
def control_of(
    first: FirstOrder, linear: ToleranceTable, seed: int, numbers: range, *, factor: float = 1.0, has_noise: bool = True
) -> Control:
    """The prediction of draws.

    Args:
        first: the derivatives of what is photographed.
        linear: the prediction of the errors.
        seed: of the study.
        numbers: of the draws.
        factor: multiple of the errors that was drawn.
        has_noise: the draws have the noise of `drawn_noise`; else one of their own, which is not predicted.
    """
    errors = linear.errors.scaled(factor)
    cases = len(errors.amounts) + 2
    square = np.empty((len(numbers), cases, linear.cost.value.shape[1]))
    width = max(COLUMNS_AT_ONCE // cases, 1)
    for begin in range(0, len(numbers), width):
        some = numbers[begin : begin + width]
        moved = np.concatenate(list(_moved(first, errors, seed, some)), axis=2)
        noise = None
        if has_noise:
            noise = np.stack([drawn_noise(first.setting, seed, number) for number in some], axis=2)
            noise = np.repeat(noise, cases, axis=2)
        square[begin : begin + width] = responses(first, moved, noise).square.T.reshape(len(some), cases, -1)
    square[:, 1:] -= square[:, :1]
    bare = noise_squares(first) if has_noise else np.zeros(square.shape[2])
    costs = factor * np.vstack([linear.cost.value, linear.together.value])
    return Control(square, np.vstack([bare, costs**2]))


def _moved(first: FirstOrder, errors: ErrorModel, seed: int, numbers: range) -> Iterator[Array]:
    """How the rings of each draw are displaced without errors, by each source and by all.  # (R, 3, C) each"""
    setting = first.setting
    known = {name: displacements(setting.target, errors, name) for name in errors.sources}
    none = np.zeros((setting.target.ring_count, 3))
    for number in numbers:
        values = drawn_values(setting, errors, seed, number)
        moved = [
            np.einsum("rak,rk->ra", by_component, values[name][instance])
            for name, (by_component, instance) in known.items()
        ]
        yield np.stack([none, *moved, sum(moved, start=none)], axis=2)
