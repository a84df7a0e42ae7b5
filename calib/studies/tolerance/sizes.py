"""What errors cost at other sizes than the assumed ones, and how far the straight line of the prediction holds.

The prediction's reach is the amount at which the exact cost of a source is 10 % off. Both are taken without noise and
of the same drawn numbers, scaled up and down, so that they differ by what is not linear and by nothing else.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.core.parallel import one_thread
from calib.studies.tolerance.draw import BareDraw, bare_draw, drawn_values, with_errors
from calib.studies.tolerance.first_order import FirstOrder
from calib.studies.tolerance.quantities import NAMES, QUANTITIES
from calib.studies.tolerance.record import OFF, SweepCosts, SweepRow, nine_digits
from calib.studies.tolerance.response import responses
from calib.studies.tolerance.result import ToleranceTable
from calib.studies.tolerance.setting import Setting
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import directions

Array = NDArray[np.float64]

FACTORS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Multiples of the assumed amounts at which draws are made."""
LARGEST, SMALLEST = 16.0, 1 / 64
DRAWS = 4


@dataclass(frozen=True, eq=False)
class Reach:
    """Of a source, how far the prediction holds, as multiples of its amount; inf: as far as was tried."""

    source: str
    factor: Array  # (Q,) at which the cost is 10 % off
    tried: Array  # (K,) multiples, ascending
    ratio: Array  # (K, Q) exact over linear; nan where there is no cost, or no solution


@one_thread
def reach_of(
    first: FirstOrder, errors: ErrorModel, source: str, baseline: Array, *, seed: int = 0, draws: int = DRAWS
) -> Reach:
    """How far the prediction of one source holds.

    Args:
        first: the derivatives of what is photographed.
        errors: of the target.
        source: the source's name.
        baseline: of the quantities (Q,): errors far below the noise are no errors.
        seed: of the study.
        draws: how many to compare.
    """
    setting, only = first.setting, errors.only(source)
    numbers = [drawn_values(setting, only, seed, number)[source] for number in range(draws)]
    columns = directions(setting.target, only, source)
    moves = np.stack([columns @ one.reshape(-1) for one in numbers], axis=2)
    linear: Array = np.sqrt(responses(first, moves).square.mean(axis=1))
    without = bare_draw(setting, np.zeros_like(setting.observations.center_px))
    tried: dict[float, Array] = {}

    def off(factor: float) -> NDArray[np.bool_]:
        """Which quantities are off at a multiple; all, where there is no solution."""
        exact = _exact(setting, only, source, numbers, factor, without)
        tried[factor] = exact / np.where(linear > 0, factor * linear, np.nan)
        allowed = OFF * np.maximum(factor * linear, baseline)
        return ~(np.abs(exact - factor * linear) <= allowed)

    is_off = off(1.0)
    limit = np.full(len(QUANTITIES), np.inf)
    factor, here = 1.0, is_off
    while here.any() and factor > SMALLEST:
        factor /= 2
        below = off(factor)
        limit = np.where(here & ~below, _between(factor, tried), limit)
        limit = np.where(here & below, factor, limit)
        here = below
    factor, here = 1.0, ~is_off
    while here.any() and factor < LARGEST:
        factor *= 2
        above = off(factor)
        limit = np.where(here & above, _between(factor / 2, tried), limit)
        here &= ~above
    order = sorted(tried)
    return Reach(source, limit, np.array(order), np.array([tried[one] for one in order]))


def _between(low: float, tried: dict[float, Array]) -> Array:
    """Where the deviation from 1 reaches the limit between a multiple and its double, straight in its logarithm."""
    before, after = np.abs(tried[low] - 1), np.abs(tried[2 * low] - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.log(OFF / before) / np.log(after / before)
    share = np.where(np.isfinite(share), np.clip(share, 0.0, 1.0), 1.0)
    between: Array = low * 2**share
    return between


def _exact(
    setting: Setting, only: ErrorModel, source: str, numbers: list[Array], factor: float, without: BareDraw
) -> Array:
    """Root mean square over the draws.  # (Q,)"""
    rows = [with_errors(setting, only, {source: factor * one}, without) for one in numbers]
    exact: Array = np.sqrt((np.array(rows) ** 2).mean(axis=0))
    return exact


def sweep_rows(tables: Mapping[float, ToleranceTable], linear: ToleranceTable) -> tuple[SweepRow, ...]:
    """The costs of each source that has an effect, from the tables of all errors at each multiple of their amounts.

    A source's draws are the same alone and among others, so one run of all sources serves each.
    """
    factor = np.array(list(tables))
    costs = np.array([(one.cost.value, one.cost.low, one.cost.high) for one in tables.values()])  # (K, 3, S, Q)
    rows = []
    for place, name in enumerate(linear.sources):
        line = linear.cost.value[place]
        if not (line > 0).any():
            continue
        told = np.concatenate([costs[:, :, place], (factor[:, None] * line)[:, None]], axis=1)  # (K, 4, Q)
        quantities = tuple(
            SweepCosts(quantity, *(tuple(map(nine_digits, told[:, end, row].tolist())) for end in range(4)))
            for row, quantity in enumerate(NAMES)
        )
        rows.append(SweepRow(name, tuple((factor * linear.sigma[place]).tolist()), quantities))
    return tuple(rows)
