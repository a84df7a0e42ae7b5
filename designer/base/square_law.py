"""Measures whose squares are sums over errors of any size: `law.squares([Size(0.01), Size(0.2, is_fixed=True)])`.

The square of a measure is that of the noise and what each error adds. An error whose numbers are drawn around zero adds
a² d for its root mean square a. An error whose numbers are known moves the measure's vector by a v, and such vectors
are added before they are squared: the sum over s, t of a_s a_t v_s · v_t.

That is the first order. What it misses was measured, an error at a time, and grows with the fourth power of a, and of
known numbers with the third too; what two errors miss together is left out. Where the sum of these, all taken as of one
sign, is more than `OFF` of a measure allows, the law is *beyond its reach*.

`designer/page/parts/what_if.js` is the same in a browser; `tests/calib/app/test_tolerance_browser.py` holds it to this.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from designer.base.marks import Gap, Length

OFF = 0.1
"""Share of a measure by which it may be wrong within the law's reach."""
MISSED = 1 - (1 - OFF) ** 2
"""The same of its square, on the side where that is less."""
FARTHEST = 1e9
STEPS = 64
Row = Annotated[tuple[Gap, ...], Length(1, 100)]
Rows = Annotated[tuple[Row, ...], Length(0, 5050)]


@dataclass(frozen=True)
class Size:
    """How large an error is, in its unit: root mean square of numbers that are drawn, or the one that is known."""

    value: float
    is_fixed: bool = False


@dataclass(frozen=True)
class SquareLaw:
    """Q measures by the sizes of S errors.

    Raises:
        ValueError: rows that do not fit together.
    """

    noise: Row  # (Q,) squares without an error
    drawn: Rows  # (S, Q) d_s
    fixed: Rows  # (S (S + 1) / 2, Q) v_s . v_t for t <= s: 00, 10, 11, 20 ...
    missed_drawn: Rows  # (S, Q) by the fourth power
    missed_third: Rows  # (S, Q) of known numbers, by the third power
    missed_fixed: Rows  # (S, Q) of known numbers, by the fourth power

    def __post_init__(self) -> None:
        count, width = len(self.drawn), len(self.noise)
        if len(self.fixed) != count * (count + 1) // 2:
            raise ValueError("fixed: must have a row for each pair of errors")
        of_errors = (self.drawn, self.missed_drawn, self.missed_third, self.missed_fixed)
        if any(len(rows) != count for rows in of_errors):
            raise ValueError("must have a row for each error")
        if any(len(row) != width for rows in (*of_errors, self.fixed) for row in rows):
            raise ValueError("must have a number for each measure")

    def product(self, one: int, other: int) -> Row:
        """Of the vectors of two errors whose numbers are known.  # (Q,)"""
        high, low = max(one, other), min(one, other)
        return self.fixed[high * (high + 1) // 2 + low]

    def squares(self, sizes: Sequence[Size]) -> tuple[float, ...]:
        """The squares of all measures."""
        return tuple(self.square(measure, sizes) for measure in range(len(self.noise)))

    def square(self, measure: int, sizes: Sequence[Size]) -> float:
        """The square of a measure."""
        total = self.noise[measure]
        known = []
        for error, size in enumerate(sizes):
            if not size.is_fixed:
                total += size.value**2 * self.drawn[error][measure]
            elif size.value:
                known.append((error, size.value))
        return total + sum(a * b * self.product(s, t)[measure] for s, a in known for t, b in known)

    def cost(self, error: int, measure: int, size: Size) -> float:
        """What an error alone adds to the square of a measure."""
        by = self.product(error, error) if size.is_fixed else self.drawn[error]
        return size.value**2 * by[measure]

    def missed(self, error: int, measure: int, size: Size) -> float:
        """How much of the square is missed of one error, up or down."""
        a = abs(size.value)
        if not size.is_fixed:
            return a**4 * abs(self.missed_drawn[error][measure])
        return a**3 * abs(self.missed_third[error][measure]) + a**4 * abs(self.missed_fixed[error][measure])

    def is_beyond(self, measure: int, sizes: Sequence[Size]) -> bool:
        """Whether a measure is beyond the law's reach."""
        missed = sum(self.missed(error, measure, size) for error, size in enumerate(sizes))
        return missed > MISSED * self.square(measure, sizes)

    def reach(self, error: int, measure: int, sizes: Sequence[Size]) -> float:
        """The size of an error at which what is missed of it alone is too much, the others as set; infinite if none."""

        def is_too_much(value: float) -> bool:
            size = Size(value, sizes[error].is_fixed)
            there = [*sizes[:error], size, *sizes[error + 1 :]]
            return self.missed(error, measure, size) > MISSED * self.square(measure, there)

        low, high = math.log(1 / FARTHEST), math.log(FARTHEST)
        if not is_too_much(FARTHEST):
            return math.inf
        for _ in range(STEPS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if is_too_much(math.exp(middle)) else (middle, high)
        return math.exp(high)

    def largest(self, error: int, measure: int, limit: float, sizes: Sequence[Size]) -> float:
        """The largest size of an error that keeps a measure within a limit, the others as set; 0 if none does.

        Infinite if it adds nothing, whatever the limit.

        With numbers that are drawn, a² d + rest = limit²; with known ones, a² |v|² + 2 a v · rest + rest² = limit².
        """
        alone, mixed, by = Size(0.0), 0.0, self.drawn[error][measure]
        if sizes[error].is_fixed:
            by = self.product(error, error)[measure]
            mixed = sum(
                one.value * self.product(error, other)[measure]
                for other, one in enumerate(sizes)
                if one.is_fixed and other != error
            )
        room = limit**2 - self.square(measure, [*sizes[:error], alone, *sizes[error + 1 :]])
        if not by > 0:
            return math.inf
        return (math.sqrt(mixed**2 + by * room) - mixed) / by if room > 0 else 0.0

    def together(self, measure: int, limit: float, sizes: Sequence[Size]) -> float:
        """By what factor all errors may be larger; infinite if they add nothing, 0 if noise alone is too much."""
        room, added = limit**2 - self.noise[measure], self.square(measure, sizes) - self.noise[measure]
        if not room > 0:
            return 0.0
        return math.sqrt(room / added) if added > 0 else math.inf
