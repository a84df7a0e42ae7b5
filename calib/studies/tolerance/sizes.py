"""What errors cost at other sizes than the assumed ones, and how far the straight line of the prediction holds.

The prediction's reach is the amount at which the exact cost of a source is 10 % off. Both are taken without noise and
of the same drawn numbers, scaled up and down, so that they differ by what is not linear and by nothing else.

The coefficients of `designer.base.square_law` for a target in front of a camera, and how far they hold.

A quantity is the length of a vector that is linear in all errors (`calib.studies.tolerance.response`), so its square is
known for all sizes at once. What that misses is measured: exact calibrations of drawn numbers and of the same with the
other sign, without noise, against the prediction for the same numbers. By the sign all odd powers cancel, as they do in
the mean over draws, and the fourth power of the size is what is left. Numbers that are known have one sign, so their
third power counts too.

The length of N drawn numbers in standard deviations says nothing of its mean over draws but chance, so all are given
the length whose fourth power is the mean of all, N (N + 2); what is left to chance is their direction.
"""

import math
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from calib.core.parallel import one_thread
from calib.studies.tolerance.draw import BareDraw, bare_draw, drawn_values, with_errors
from calib.studies.tolerance.first_order import FirstOrder, first_order
from calib.studies.tolerance.predict import ToleranceTable, baseline, square_of
from calib.studies.tolerance.quantities import NAMES, QUANTITIES
from calib.studies.tolerance.record import OFF, SweepCosts, SweepRow, nine_digits
from calib.studies.tolerance.response import responses
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.what_if import SetError, Way, WhatIfTable
from designer.base.arrays import Array, Flags
from designer.base.square_law import Row, Rows, SquareLaw
from designer.tolerance.effort import size_of
from designer.tolerance.model import ErrorModel
from designer.tolerance.prior import directions
from designer.tolerance.source import Amount, Unit
from designer.tolerance.sources import SOURCES

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
    """How far the prediction of one source holds."""
    setting, only = first.setting, errors.only(source)
    numbers = [drawn_values(setting, only, seed, number)[source] for number in range(draws)]
    columns = directions(setting.target, only, source)
    moves = np.stack([columns @ one.reshape(-1) for one in numbers], axis=2)
    linear: Array = np.sqrt(responses(first, moves).square.mean(axis=1))
    without = bare_draw(setting, np.zeros_like(setting.observations.center_px))
    tried: dict[float, Array] = {}

    def off(factor: float) -> Flags:
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


REFERENCE = ErrorModel("reference", "", (), expansion_per_kelvin=1e-4, layer_height_mm=1.0)
"""Sizes in the law are of this: those of another are in proportion to what it tells of itself."""
LAW_DRAWS = 6
"""And as many with the other sign."""
HALVINGS = 8
USUAL: dict[Unit, float] = {"mm": 0.1, "rad": np.radians(0.1), "1": 1e-3, "K": 3.0}
"""Sizes (assumptions) at which errors are tried that no way of making has."""


@dataclass(frozen=True, eq=False)
class _Source:
    """An error that does something to the target."""

    name: str
    columns: Array  # (R, 3, N) displacements by a unit of each number
    drawn: Array  # (Q,) squares by a unit
    tried: float  # the size at which the law is held against exact calibrations

    @property
    def known(self) -> Array:
        """Displacements by numbers that are all one.  # (R, 3)"""
        total: Array = self.columns.sum(axis=2)
        return total


@one_thread
def what_if_table(
    setting: Setting, assumed: ErrorModel, way: str, ways: Mapping[str, ErrorModel], *, seed: int
) -> WhatIfTable:
    """The coefficients of a target, and ways of making to choose from."""
    first, models = first_order(setting), (assumed, *ways.values())
    found = [
        _Source(name, columns, square, _largest(name, models))
        for name in SOURCES
        if (square := square_of(first, columns := directions(setting.target, REFERENCE, name))).any()
    ]
    names = [one.name for one in found]
    given = (way, assumed), *({way: assumed} | dict(ways)).items()
    start, *others = (_way(setting, name, model, names) for name, model in given)
    return WhatIfTable(_law(first, found, seed), tuple(others), start)


def _way(setting: Setting, name: str, model: ErrorModel, errors: Iterable[str]) -> Way:
    """A way of making, with what it takes for this target."""
    size = size_of(setting.target)
    price, hours = (math.nan if one is None else nine_digits(one.of(size)) for one in (model.price, model.hours))
    amounts = ((error, model.amount(error)) for error in errors)
    found = tuple(
        SetError(error, amount.kind, nine_digits(amount.size), nine_digits(_gain(model, error)))
        for error, amount in amounts
    )
    return Way(name, model.title, found, model.suits_target(setting.target), price, hours)


def _gain(model: ErrorModel, error: str) -> float:
    return model.gain(error) / REFERENCE.gain(error)


def _largest(name: str, models: Iterable[ErrorModel]) -> float:
    """The largest size of an error that any way of making has."""
    sizes = (_gain(model, name) * model.amount(name).sigma for model in models)
    return max(sizes) or USUAL[SOURCES[name].unit]


def _law(first: FirstOrder, sources: Sequence[_Source], seed: int) -> SquareLaw:
    noise = np.square(baseline(first))
    if not sources:
        return SquareLaw(_row(noise), (), (), (), (), ())
    without = bare_draw(first.setting, np.zeros_like(first.setting.observations.center_px))
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # most of it is in kernels, which run side by side
        missed = list(pool.map(lambda one: _missed(first, one, without, seed), sources))
    fixed = _products(first, np.stack([one.known for one in sources], axis=2))
    drawn, third, fourth = (_rows(np.array(rows)) for rows in zip(*missed, strict=True))
    return SquareLaw(_row(noise), _rows(np.array([one.drawn for one in sources])), fixed, drawn, third, fourth)


def _products(first: FirstOrder, known: Array) -> Rows:
    """`v_s . v_t` of all pairs t <= s from displacements (R, 3, S): a quarter of |v_s + v_t|^2 - |v_s - v_t|^2.

    What is rounding in one of the two is no response.
    """
    high, low = np.tril_indices(known.shape[2])
    sums = responses(first, known[:, :, high] + known[:, :, low]).square
    differences = responses(first, known[:, :, high] - known[:, :, low]).square
    own = np.array([square_of(first, known[:, :, s : s + 1]) for s in range(known.shape[2])])  # (S, Q)
    is_there = (own[high] > 0) & (own[low] > 0)
    return _rows(np.where(is_there, 0.25 * (sums - differences).T, 0.0))


def _missed(first: FirstOrder, source: _Source, without: BareDraw, seed: int) -> tuple[Array, Array, Array]:
    """What squares have beyond the law, by the fourth power, and of known numbers by the third and fourth.  # (Q,) each

    At the size that is tried, or at the largest of its halves at which there is a target and a camera.
    """
    size = source.tried
    for _ in range(HALVINGS):
        values = [size * _direction(first.setting, source.name, seed, number) for number in range(LAW_DRAWS)]
        beyond = _beyond_law(first, source, [*values, np.full_like(values[0], size)], without)
        if np.isfinite(beyond[:, :, 0]).all():
            break
        size /= 2
    up, down = beyond[-1]
    return beyond[:-1].mean(axis=(0, 1)) / size**4, 0.5 * np.abs(up - down) / size**3, 0.5 * (up + down) / size**4


def _direction(setting: Setting, name: str, seed: int, number: int) -> Array:
    """Standard normal numbers of a source, of the length whose fourth power is the mean.  # (instances, components)"""
    drawn = drawn_values(setting, REFERENCE.with_amount(name, Amount("normal", 1.0)), seed, number)[name]
    count = drawn.size
    turned: Array = drawn * (count * (count + 2)) ** 0.25 / np.linalg.norm(drawn)
    return turned


def _beyond_law(first: FirstOrder, source: _Source, values: Sequence[Array], without: BareDraw) -> Array:
    """Exact squares of D sets of numbers and of the same with the other sign, less the law's.  # (D, 2, Q)"""
    moved = source.columns @ np.stack([one.reshape(-1) for one in values], axis=1)
    linear = responses(first, moved).square.T
    known: dict[bytes, Array] = {}  # of an error that is one number, all draws are that or its opposite

    def exact(numbers: Array) -> Array:
        key = numbers.tobytes()
        if key not in known:
            known[key] = with_errors(first.setting, REFERENCE, {source.name: numbers}, without)
        return known[key]

    squares = np.array([[exact(one), exact(-one)] for one in values]) ** 2
    beyond: Array = squares - linear[:, None]
    return beyond


def _row(values: Array) -> Row:
    return tuple(map(nine_digits, values.tolist()))


def _rows(values: Array) -> Rows:
    return tuple(map(_row, values))
