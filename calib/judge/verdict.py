"""What a verdict, its checks and their limits are; of several cameras or a robot also what to take next."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from calib.core.se3 import rigid_fault
from calib.core.types import freeze
from designer.base.arrays import Array
from designer.base.marks import ONE_LINE, AtLeast, AtMost, Gap, Length, Line, Shape, Word
from designer.base.words import figure

Grade = Literal["good", "usable", "bad", "unknown"]
"""`bad`: do not use; `unknown`: could not be checked, which is said and worsens nothing but leaves no praise."""

COUNTED = "frames"
"""The unit of what is a whole number."""
MOST_DIGITS = 9
Number = Annotated[float, AtLeast(-1e15), AtMost(1e15)]


@dataclass(frozen=True)
class Limits:
    """Within which value a check is good, and within which usable."""

    good: Annotated[float, AtLeast(0)]
    usable: Annotated[float, AtLeast(0)]
    source: Line = ""  # where the numbers come from


@dataclass(frozen=True)
class Criteria:
    """The limits of all checks: `criteria["uncertainty"].good`."""

    name: Word  # of the template, or of the file
    title: Word
    limits: Mapping[str, Limits]  # of each check by its name, in its unit

    def __getitem__(self, check: str) -> Limits:
        return self.limits[check]


@dataclass(frozen=True)
class Check:
    """One thing that was checked of a calibration."""

    name: Word  # a key of `calib.judge.checks.CHECKS`
    title: Word  # "Uncertainty of the camera over the image"
    grade: Grade
    value: Number | None  # None: not known
    unit: Word  # "px", "%", "sigma", "" for ratios
    good: Number  # the limit within which it is good
    usable: Number  # the limit within which it is usable
    is_at_least: bool  # the value must be at least the limits, not at most
    sentence: Line  # what was found and what it means, in one sentence

    @property
    def measured(self) -> str:
        """The value with its unit; "" if it is not known."""
        if self.value is None:
            return ""
        return f"{measured_text(self.value, self.unit, (self.good, self.usable))} {self.unit}".rstrip()

    @property
    def times_beyond(self) -> float:
        """How many times the value is worse than the limit of the grade that it misses; without a value, no bound."""
        limit = self.usable if self.grade == "bad" else self.good
        if self.value is None:
            return math.inf
        worse, better = (limit, self.value) if self.is_at_least else (self.value, limit)
        return worse / better if better > 0 else math.inf


@dataclass(frozen=True)
class Verdict:
    """Whether to use the camera of a run."""

    grade: Grade  # the worst of the checks that are known
    model: Word  # of the camera it is about
    sentence: Line  # the main reason of the grade
    checks: Annotated[tuple[Check, ...], Length(0, 50)]  # in order of reading
    advice: Annotated[tuple[Line, ...], Length(0, 50)]  # what to do better next time, the most useful first
    leads_with: Word = ""  # the check whose sentence is the main reason; "": it is none's


MOST_CAMERAS = 16
"""For which frames are proposed: of larger rigs the candidates would take long."""
MOST_POSES = 5
"""A robot takes a few more in a minute; what is known after them is to be solved before more are chosen by it."""
_SigmaMm = Annotated[float, AtLeast(0), AtMost(1e9)]


@dataclass(frozen=True, eq=False)
class NextFrame:
    """A frame to take, and what it would do."""

    rig_from_target: Annotated[Array, Shape(4, 4)]
    cameras: Annotated[tuple[Word, ...], Length(2, MOST_CAMERAS)]  # that would see the target
    sentence: Annotated[str, Length(1, 1000), ONE_LINE]
    pair: tuple[Word, Word]  # that is known worst before it
    sigma_mm_before: _SigmaMm  # of the place of one of them against the other, along the least known direction
    sigma_mm_after: _SigmaMm  # with this frame and those proposed before it

    def __post_init__(self) -> None:
        freeze(self, "rig_from_target")
        if fault := rigid_fault(self.rig_from_target[None]):
            raise ValueError(f"rig_from_target {fault[1]}")


@dataclass(frozen=True, eq=False)
class NextPose:
    """A pose for the robot to take a photo from, and what it would do: `found.next_poses[0].base_from_flange`."""

    base_from_flange: Annotated[Array, Shape(4, 4)]
    sentence: Annotated[str, Length(1, 1000), ONE_LINE]
    turn_sigma_rad_before: Gap  # of the camera's direction, the least known of its axes; nan: not determined
    turn_sigma_rad_after: Gap  # with this pose and those proposed before it
    place_sigma_mm_before: Gap  # of the camera's place, along the least known axis of the frame that it is in
    place_sigma_mm_after: Gap

    def __post_init__(self) -> None:
        freeze(self, "base_from_flange")
        if fault := rigid_fault(self.base_from_flange[None]):
            raise ValueError(f"base_from_flange {fault[1]}")


def measured_text(value: float, unit: str, limits: tuple[float, ...]) -> str:
    """A measured number, as short as is useful: rounded, it must not stand on another side of a limit."""
    if not math.isfinite(value):
        return figure(value)
    texts = [f"{value:.0f}"] if unit == COUNTED or (unit == "%" and value >= 10) else []
    texts += [figure(value, digits) for digits in range(2, MOST_DIGITS)]
    beside = [[(value > limit) - (value < limit) for limit in limits] for value in (value, *map(float, texts))]
    return next((text for text, sides in zip(texts, beside[1:], strict=True) if sides == beside[0]), texts[-1])


LEAST_PX = 0.001
"""Nobody needs to know a camera better."""


@dataclass(frozen=True)
class Found:
    """What a check found."""

    grade: Grade
    value: float | None  # in the check's unit; None: not known
    sentence: str  # what was found and what it means
    usable: float | None = None  # the limit that applies here, where it is not that of the criteria


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
