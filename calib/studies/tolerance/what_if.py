"""What a calibration would be with errors of other sizes, at once: `study.what_if(skew="0.05deg").total("pose")`.

All comes from the coefficients of `designer.base.square_law`, which the page's sliders read too.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from calib.studies.tolerance.quantities import NAMES, quantity_named, quantity_row
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.base.square_law import Size, SquareLaw
from designer.base.words import shown, suggestion
from designer.tolerance.error_file import parse_amount
from designer.tolerance.source import Amount, format_quantity
from designer.tolerance.sources import SOURCES, source_named


@dataclass(frozen=True)
class SetError:
    """An error of a way of making."""

    error: str
    distribution: Literal["normal", "uniform", "fixed"]
    size: float  # in the source's unit
    gain: float  # what it is multiplied by: what the source needs to know of the print, 0 where that is not known

    @property
    def amount(self) -> Amount:
        """Its distribution."""
        return Amount(self.distribution, self.size)

    @property
    def in_law(self) -> Size:
        """As the law takes it."""
        is_fixed = self.distribution == "fixed"
        return Size(self.gain * (self.size if is_fixed else self.amount.sigma), is_fixed)

    def of_law(self, value: float) -> float:
        """The size that the law's value is of; infinite where the error does nothing."""
        by = self.gain if self.distribution == "fixed" else self.gain * Amount(self.distribution, 1.0).sigma
        return value / by if by else math.inf

    @property
    def text(self) -> str:
        """As `--set` takes it."""
        kind = "" if self.distribution == "normal" else f"{self.distribution} "
        return f"{self.error}={kind}{format_quantity(self.size, SOURCES[self.error].unit)}"


@dataclass(frozen=True)
class Way:
    """A way of making: an error template, or a file of one's own."""

    name: str  # as `--errors` takes it
    title: str
    errors: tuple[SetError, ...]  # all that do something to the target, in order
    suits: bool = True  # such targets are made so
    price_eur: Gap = math.nan  # of this target; nan: not known
    hours: Gap = math.nan  # of machine and hands, without delivery


@dataclass(frozen=True)
class WhatIfTable:
    """All that is needed to tell what errors of any size do to one target: `study.what_if` asks it."""

    law: SquareLaw  # of the quantities of `calib.studies.tolerance.quantities`, and the errors below
    ways: tuple[Way, ...]
    start: Way  # what the study assumed: one of the ways, with sizes that were set

    def way(self, name: str) -> Way:
        """A way of making."""
        found = {one.name: one for one in self.ways}
        if name not in found:
            hint = suggestion(name, list(found)) or f"; there are {', '.join(found)}"
            raise InputError(f"unknown way of making {shown(name)}{hint}")
        return found[name]

    def ranked(self, quantity: str) -> tuple["RankedWay", ...]:
        """The ways in which such a target is made, the one that is best for a quantity first."""
        found = [
            RankedWay(way, self.ask(way.name, {}), quantity_named(quantity).name) for way in self.ways if way.suits
        ]
        return tuple(sorted(found, key=lambda one: one.total(quantity)))

    def ask(self, errors: str | None, sizes: Mapping[str, str]) -> "WhatIf":
        """What would be.

        Args:
            errors: a way of making; None: as the study assumed.
            sizes: other sizes of single errors, `{"skew": "0.05deg"}`; a source that does nothing here is none.

        Raises:
            InputError: an unknown way, source or quantity, or a source that needs what the way does not tell.
        """
        way = self.start if errors is None else self.way(errors)
        found = {one.error: one for one in way.errors}
        for name, text in sizes.items():
            source = source_named(name)
            amount = parse_amount(text, source)
            if name not in found:
                continue
            if not found[name].gain and amount.size:
                raise InputError(f"{name} {shown(text)}: needs the {source.needs}, which {way.name} does not tell")
            found[name] = replace(found[name], distribution=amount.kind, size=amount.size)
        return WhatIf(self, way.name, tuple(found.values()))


@dataclass(frozen=True, eq=False)
class WhatIf:
    """What a calibration would be, predicted: `asked.total("pose")`, `asked.ranking("pose")`, `asked.beyond`."""

    table: WhatIfTable
    way: str
    errors: tuple[SetError, ...]

    @cached_property
    def sizes(self) -> Sequence[Size]:
        """As the law takes them."""
        return tuple(one.in_law for one in self.errors)

    def total(self, quantity: str) -> float:
        """A quantity with all errors and noise, in its unit."""
        return math.sqrt(max(self.table.law.square(_row(quantity), self.sizes), 0.0))

    @property
    def totals(self) -> Mapping[str, float]:
        """All quantities by name."""
        return {name: self.total(name) for name in NAMES}

    @property
    def beyond(self) -> tuple[str, ...]:
        """The quantities of which the prediction may be more than 10 % off."""
        return tuple(name for row, name in enumerate(NAMES) if self.table.law.is_beyond(row, self.sizes))

    def cost(self, error: str, quantity: str) -> float:
        """What an error alone adds to a quantity, in squares."""
        place = self._place(error)
        return math.sqrt(max(self.table.law.cost(place, _row(quantity), self.sizes[place]), 0.0))

    def share(self, error: str, quantity: str) -> float:
        """Of an error in the sum of the squared costs; 0 where there are none."""
        total = sum(self.cost(one.error, quantity) ** 2 for one in self.errors)
        return self.cost(error, quantity) ** 2 / total if total > 0 else 0.0

    def ranking(self, quantity: str) -> tuple[str, ...]:
        """The errors, the one that costs a quantity most first."""
        return tuple(sorted((one.error for one in self.errors), key=lambda error: -self.cost(error, quantity)))

    def reach(self, error: str, quantity: str) -> float:
        """The size of an error at which what is missed of it puts a quantity 10 % off, all others as they are."""
        place = self._place(error)
        return self.errors[place].of_law(self.table.law.reach(place, _row(quantity), self.sizes))

    def largest(self, error: str, quantity: str, limit: float, *, alone: bool = False) -> float:
        """The largest size of an error that keeps a quantity within a limit, the others as they are or none at all."""
        place = self._place(error)
        others = tuple(Size(0.0, one.is_fixed) for one in self.sizes) if alone else self.sizes
        return self.errors[place].of_law(self.table.law.largest(place, _row(quantity), limit, others))

    def together(self, quantity: str, limit: float) -> float:
        """By what factor all errors may be larger within a limit."""
        return self.table.law.together(_row(quantity), limit, self.sizes)

    @property
    def arguments(self) -> tuple[str, ...]:
        """What `design tolerance` is given for the same: `--errors`, and `--set` for what is not as in the template."""
        plain = {one.error: one for one in self.table.way(self.way).errors}
        other = [one for one in self.errors if one.text != plain[one.error].text]
        return ("--errors", self.way, *(word for one in other for word in ("--set", one.text)))

    def _place(self, error: str) -> int:
        names = [one.error for one in self.errors]
        if error not in names:
            raise InputError(f"{shown(error)}: does nothing to this target, or is no error source")
        return names.index(error)


@dataclass(frozen=True, eq=False)
class RankedWay:
    """A way of making this target, and what the calibration would be."""

    way: Way
    asked: WhatIf
    ranked_by: str

    def total(self, quantity: str | None = None) -> float:
        """A quantity with all errors and noise, in its unit; None: the one that ways are ranked by."""
        return self.asked.total(quantity or self.ranked_by)

    @property
    def worst(self) -> str:
        """The error that costs most of the quantity that ways are ranked by; "" if there is none."""
        ranking = self.asked.ranking(self.ranked_by)
        return ranking[0] if ranking and self.asked.cost(ranking[0], self.ranked_by) > 0 else ""

    def is_beyond(self, quantity: str) -> bool:
        """Whether the prediction of a quantity may be more than 10 % off."""
        return quantity in self.asked.beyond

    def is_beaten_by(self, other: "RankedWay") -> bool:
        """Whether another way is better and costs no more money; what is not known beats nothing."""
        return other.total() < self.total() and other.way.price_eur <= self.way.price_eur


def _row(quantity: str) -> int:
    return quantity_row(quantity_named(quantity).name)
