"""What `Annotated` says of a value in a file: bounds, lengths, the shape of an array, what null stands for."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, cast


class Mark(ABC):
    """A rule of a value, beyond its type."""

    @abstractmethod
    def fault(self, value: object) -> str:
        """What it must be; "" if it is so."""


@dataclass(frozen=True)
class Bound(Mark):
    """Of a number, or each of an array."""

    bound: float


class AtLeast(Bound):
    """No less."""

    def fault(self, value: object) -> str:
        """As `Mark`."""
        return "" if _smallest(value) >= self.bound else f"must be {self.bound:g} or more"


class AtMost(Bound):
    """No more."""

    def fault(self, value: object) -> str:
        """As `Mark`."""
        return "" if -_smallest(value, -1) <= self.bound else f"must be {self.bound:g} or less"


class Above(Bound):
    """More."""

    def fault(self, value: object) -> str:
        """As `Mark`."""
        return "" if _smallest(value) > self.bound else f"must be more than {self.bound:g}"


@dataclass(frozen=True)
class Length(Mark):
    """Of a text, a tuple, a mapping, or an array's first axis."""

    least: int
    most: int

    def fault(self, value: object) -> str:
        """As `Mark`."""
        count = len(cast("Sequence[object]", value))
        if isinstance(value, str) and count < self.least == 1:
            return "must not be empty"
        what = "characters" if isinstance(value, str) else "items"
        return "" if self.least <= count <= self.most else f"has {count} {what}; it must be {self.least} to {self.most}"


@dataclass(frozen=True)
class OneOf(Mark):
    """A name of a registry."""

    names: tuple[str, ...]

    def fault(self, value: object) -> str:
        """As `Mark`."""
        return "" if value in self.names else f"must be one of {', '.join(self.names)}"


@dataclass(frozen=True)
class NullIs:
    """What null stands for; whatever is not finite is written so."""

    value: float


@dataclass(frozen=True)
class Shape:
    """Of an array: numbers, or names that stand for the same number in all arrays of an object; None: any."""

    sizes: tuple[int | str | None, ...]

    def __init__(self, *sizes: int | str | None) -> None:
        object.__setattr__(self, "sizes", sizes)


@dataclass(frozen=True)
class Reads:
    """How a value is read that people write, as `20mm`; ValueError: it is none."""

    read: Callable[[object], object]


@dataclass(frozen=True)
class Told:
    """What a field is, for who left it out: "nozzle diameter, such as 0.4mm"."""

    words: str


@dataclass(frozen=True)
class Key:
    """The name of a field in files, where that is another one."""

    name: str


@dataclass(frozen=True)
class From:
    """Where a type is that is named only, so that its module is loaded when a file is."""

    module: str


class Tagged:
    """Of a union of such classes, files say which it is: `{"is": "Table", ...}`."""


class Sign:
    """A mark without a number."""


OR_NULL: Final = NullIs(math.nan)
ONE_LINE: Final = Sign()
"""Text of which a page or a terminal shows one line, whatever a file holds."""
HEX: Final = Sign()
"""Hexadecimal digits, which mean the same in capitals, as some programs write them."""
LEFT_OUT: Final = Sign()
"""None, "" and () are not written."""
PACKED: Final = Sign()
"""A covariance; one of hundreds of parameters is written short, see `designer.base.packed`."""
NOT_IN_FILE: Final = Sign()
"""A field of a result that Python and the page have, and no file."""
INLINE: Final = Sign()
"""A dataclass whose fields stand among those of the one around it."""

Gap = Annotated[float, OR_NULL]
"""A number, or nan: not known."""
Count = Annotated[int, AtLeast(0)]
Word = Annotated[str, Length(0, 200), ONE_LINE]
"""A name."""
Hash = Annotated[str, Length(0, 200), ONE_LINE, HEX]
"""The id of a content."""
Line = Annotated[str, Length(0, 4000), ONE_LINE]
"""A sentence or two."""
MOST_ROWS = 20_000
Number = Annotated[float, AtLeast(-1e100), AtMost(1e100)]
FewLines = Annotated[tuple[Line, ...], Length(0, 1000)]


def _smallest(value: object, sign: int = 1) -> float:
    """Of a number or an array with gaps; of an empty one infinity."""
    if isinstance(value, int | float):
        return sign * value
    import numpy as np

    known = sign * np.asarray(value, dtype=np.float64)
    return float(np.min(known, initial=math.inf, where=~np.isnan(known)))
