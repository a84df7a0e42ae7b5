"""How long a nozzle takes along lines: trapezoids of speed, with a jump ("jerk") allowed at corners.

A line of length l is begun at speed u and ended at w; at acceleration a it reaches at most p² = (u² + w²) / 2 + a l,
and no more than the speed asked for. At a corner the speed is such that no axis jumps by more than the jerk (Marlin's
rule, which the slicers' time estimates follow).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Rows

_FREE = 1e7
"""A square of speed that no nozzle reaches, in mm²/s²."""


@dataclass(frozen=True)
class Pace:
    """How a kind of line is drawn."""

    speed_mm_s: float
    acceleration_mm_s2: float
    jerk_mm_s: float


def lines_time_s(length_mm: Array, pace: Pace, corner_mm_s: float) -> float:
    """Of straight lines that each begin and end at the speed of their corner."""
    corner = np.full(len(length_mm), min(corner_mm_s, pace.speed_mm_s) ** 2)
    return float(_time_s(length_mm, pace, corner, corner).sum())


def loops_time_s(loops: Sequence[Array], pace: Pace) -> float:
    """Of closed polylines, each begun and ended at the jerk.

    Args:
        loops: their points, the first not repeated.  # (N, 2)
        pace: how they are drawn.
    """
    if not loops:
        return 0.0
    points, following, first = _joined(loops)
    x, y = (points[following] - points).T
    length = np.maximum(np.hypot(x, y), 1e-9)
    x, y = x / length, y / length
    jump = np.maximum(np.abs(x - _before(x)), np.abs(y - _before(y)))
    begin = np.minimum(pace.speed_mm_s, pace.jerk_mm_s / np.maximum(jump, 1e-9)) ** 2
    begin[first] = min(pace.speed_mm_s, pace.jerk_mm_s) ** 2  # the next line begins with a loop of its own
    gain = 2 * pace.acceleration_mm_s2 * length
    last = np.append(first[1:], len(length)) - 1
    onward, backward = gain.copy(), gain.copy()
    onward[last] = backward[first] = _FREE  # each loop is begun and ended for itself
    forth = _reachable(begin, onward)
    ends = _reachable(np.append(begin[1:], begin[0])[::-1], backward[::-1])[::-1]
    starts = _before(ends)
    starts[first] = (ends + gain)[first]
    return float(_time_s(length, pace, np.minimum(forth, starts), np.minimum(ends, forth + gain)).sum())


def _before(values: Array) -> Array:
    """Of each the one before it, of the first the last: `np.roll` takes longer than what is done with it."""
    return np.concatenate([values[-1:], values[:-1]])


def _joined(loops: Sequence[Array]) -> tuple[Array, Rows, Rows]:
    """Points of all loops, of each point the row of the next one, and of each loop that of its first."""
    counts = np.array([len(loop) for loop in loops])
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    following = np.arange(1, counts.sum() + 1)
    following[last] = first
    return np.concatenate(loops), following, first


def _reachable(most: Array, gain: Array) -> Array:
    """Squares of speeds at the beginnings of lines: each at most its own, and what the one before allows.

    u(i + 1) = min(most(i + 1), u(i) + gain(i)) is a running minimum of most - G, where G sums the gains.
    """
    total = np.concatenate([[0.0], np.cumsum(gain)[:-1]])
    return total + np.minimum.accumulate(most - total)


def _time_s(length: Array, pace: Pace, begin: Array, end: Array) -> Array:
    """Of lines whose squares of speed at both ends are given."""
    rate = pace.acceleration_mm_s2
    peak = np.maximum(np.minimum(pace.speed_mm_s**2, (begin + end) / 2 + rate * length), np.maximum(begin, end))
    steady = np.maximum(length - (2 * peak - begin - end) / (2 * rate), 0.0)
    root = np.sqrt(peak)
    time: Array = (2 * root - np.sqrt(begin) - np.sqrt(end)) / rate + steady / root
    return time


def chords_mm(contours: Sequence[Array], spacing_mm: float, angle_rad: float) -> Array:
    """Lengths of the parallel lines that fill an area.

    Args:
        contours: closed, without the first point repeated.
        spacing_mm: between lines.
        angle_rad: of the lines, against x.
    """
    if not contours:
        return np.empty(0)
    turn = np.array([[np.cos(angle_rad), -np.sin(angle_rad)], [np.sin(angle_rad), np.cos(angle_rad)]])
    points, following, _ = _joined(contours)
    a = points @ turn  # lines run along the first axis
    b = a[following]
    low, high = (np.ceil(f(a[:, 1], b[:, 1]) / spacing_mm).astype(np.int64) for f in (np.minimum, np.maximum))
    count = high - low
    edge = np.repeat(np.arange(len(a)), count)
    line = low[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (line * spacing_mm - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
    at = a[edge, 0] + share * (b[edge, 0] - a[edge, 0])
    along = at[np.lexsort((at, line))]
    chords: Array = np.maximum(along[1::2] - along[: len(along) // 2 * 2 : 2], 0.0)
    return chords
