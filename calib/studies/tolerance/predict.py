"""What the solver's Jacobians predict: the table of a study at once, and what is to be expected of the draws made.

The square of a quantity is a sum over the errors, each independent of the others: with `e_j` its response to a unit of
the number j (`calib.studies.tolerance.response`), cost^2 = sum sigma_j^2 |e_j|^2. Numbers that a source has fixed are
no draws; their responses are added before they are squared. What noise costs is known without draws, too
(`calib.studies.tolerance.response`).

A quantity's square y in a draw hardly differs from its prediction x for the same numbers and the same noise, whose mean
over all draws is known without any. So `mean(y - x) + E x` has the mean of y, whatever the prediction misses, and only
the spread of y - x for an error: draws need only tell what the prediction misses (control variates; Owen 2013, *Monte
Carlo theory, methods and examples*, 8.9).
"""

from collections.abc import Iterator

import numpy as np

from calib.core.parallel import one_thread
from calib.studies.tolerance.draw import bare_draw, drawn_noise, drawn_values
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.response import noise_squares, responses
from calib.studies.tolerance.result import Control, Cost, ToleranceTable
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import directions, displacements

NEGLIGIBLE = 1e-6
"""Of the largest response a unit can have, which differences and sums leave where there is none."""
COLUMNS_AT_ONCE = 128
"""Bounds the memory."""


@one_thread
def linear_table(setting: Setting, errors: ErrorModel) -> ToleranceTable:
    """The costs of all sources where errors are small; see `calib.studies.tolerance.sizes` for where they are.

    Args:
        setting: what is photographed.
        errors: of the target.
    """
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
