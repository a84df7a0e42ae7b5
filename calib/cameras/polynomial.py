"""Where polynomials cease to be positive: how far lenses that are made of them reach."""

import numpy as np

from calib.core.jit import jit
from designer.base.arrays import Array

FARTHEST = 1e30
"""A change of sign beyond is none."""
LINEAR = 2
"""Coefficients."""


@jit
def value_at(coefficients: Array, x: float) -> float:
    """`c0 + c1 x + c2 x^2 + ...`."""
    value = 0.0
    for k in range(len(coefficients) - 1, -1, -1):
        value = value * x + coefficients[k]
    return value


@jit
def first_change(coefficients: Array) -> float:
    """The smallest positive x at which a polynomial, positive at zero, ceases to be positive; or infinity.

    Between two neighbouring turns of a polynomial there is one change of sign at most, which bisection finds; the turns
    are the changes of sign of its derivative, and so on down to a constant.
    """
    degree = len(coefficients) - 1
    change, count = np.empty(degree + 1), 0
    for order in range(degree - 1, -1, -1):
        part = _derivative(coefficients, order)
        turn, turns, count = change.copy(), count, 0
        if (part >= 0).all() or (part <= 0).all():
            continue
        if len(part) == LINEAR:
            change[0], count = -part[0] / part[1], 1
            continue
        low, is_above = 0.0, part[0] > 0
        for k in range(turns + 1):
            high = turn[k] if k < turns else _beyond(part, low, is_above)
            if (value_at(part, high) > 0) != is_above:
                change[count] = _bisected(part, low, high, is_above)
                count += 1
                is_above = not is_above
            low = high
    return float(change[0]) if count else np.inf


@jit
def _derivative(coefficients: Array, order: int) -> Array:
    """The coefficients of the derivative of this order."""
    part = coefficients[order:].copy()
    for j in range(len(part)):
        for k in range(order):
            part[j] *= j + order - k
    return part


@jit
def _beyond(coefficients: Array, low: float, is_above: bool) -> float:
    """A place beyond the last turn where the sign is the last one."""
    high = 2 * low + 1e-6
    while (value_at(coefficients, high) > 0) == is_above and high < FARTHEST:
        high *= 2
    return high


@jit
def _bisected(coefficients: Array, low: float, high: float, is_above: bool) -> float:
    """The first number at which the sign is no longer what it is at `low`."""
    while True:
        middle = 0.5 * (low + high)
        if middle <= low or middle >= high:
            return high
        if (value_at(coefficients, middle) > 0) == is_above:
            low = middle
        else:
            high = middle
