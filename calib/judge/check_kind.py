"""What a check is: what is measured against its limits, and what came of it in one sentence."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from calib.judge.verdict import Check, Criteria, Grade, Limits
from designer.base.number_text import figure

Evidence = TypeVar("Evidence")

LEAST_PX = 0.001
"""Nobody needs to know a camera better."""

NO_LIMITS = Limits(0.0, 0.0)


@dataclass(frozen=True)
class Found:
    """What a check found."""

    grade: Grade
    value: float | None  # in the check's unit; None: not known
    sentence: str  # what was found and what it means
    usable: float | None = None  # the limit that applies here, where it is not that of the criteria


@dataclass(frozen=True)
class CheckKind(Generic[Evidence]):
    """Something that is checked of a camera or a rig: what it is called, and how it is judged by given limits."""

    name: str  # a key of a criteria file
    title: str
    unit: str  # of the value and of its limits
    judge: Callable[[Evidence, Criteria], Found | None]  # None: there is nothing to say
    limits: Limits = NO_LIMITS  # where neither the criteria nor the template `standard` have some
    most: float = 1000.0  # that a limit may be
    is_at_least: bool = False  # the value must be at least the limits, not at most
    is_needed: bool = False  # without it nothing is called good

    @property
    def has_limits(self) -> bool:
        """Whether there is something to measure."""
        return bool(self.unit)

    def check(self, evidence: Evidence, criteria: Criteria) -> Check | None:
        """What came of it for one camera or rig."""
        found = self.judge(evidence, criteria)
        if found is None:
            return None
        limits = criteria[self.name] if self.has_limits else self.limits
        usable = limits.usable if found.usable is None else found.usable
        return Check(
            self.name, self.title, found.grade, found.value, self.unit, limits.good, usable, self.is_at_least,
            found.sentence,
        )  # fmt: skip


def at_most(value: float, limits: Limits) -> Grade:
    """The grade of a value that is better if it is less."""
    return "good" if value <= limits.good else "usable" if value <= limits.usable else "bad"


def at_least(value: float, limits: Limits) -> Grade:
    """The grade of a value that is better if it is more."""
    return "good" if value >= limits.good else "usable" if value >= limits.usable else "bad"


def px(value: float) -> str:
    """A length in the image, to two digits but to no more than a thousandth."""
    if 0 <= value < LEAST_PX:
        return f"less than {LEAST_PX:g} px"
    return f"{figure(value, 2)} px"
