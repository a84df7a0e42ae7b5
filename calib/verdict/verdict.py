"""What a verdict is."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from calib.core.number_text import figure
from designer.base.marks import AtLeast, AtMost, Length, Line, Word

Grade = Literal["good", "usable", "bad", "unknown"]
"""`bad`: do not use; `unknown`: could not be checked, which is said and worsens nothing but leaves no praise."""

MOST_DIGITS = 9
Number = Annotated[float, AtLeast(-1e15), AtMost(1e15)]


def measured_text(value: float, unit: str, limits: tuple[float, ...]) -> str:
    """A measured number, as short as is useful: rounded, it must not stand on another side of a limit."""
    if not math.isfinite(value):
        return figure(value)
    texts = [f"{value:.0f}"] if unit == "%" and value >= 10 else []
    texts += [figure(value, digits) for digits in range(2, MOST_DIGITS)]
    beside = [[(value > limit) - (value < limit) for limit in limits] for value in (value, *map(float, texts))]
    return next((text for text, sides in zip(texts, beside[1:], strict=True) if sides == beside[0]), texts[-1])


@dataclass(frozen=True)
class Check:
    """One thing that was checked of a calibration."""

    name: Word  # a key of `calib.verdict.checks.TITLES`
    title: Word  # "Uncertainty of the camera over the image"
    grade: Grade
    value: Number | None  # None: not known
    unit: Word  # "px", "%", "sigma", "" for ratios
    good: Number  # the limit within which it is good
    usable: Number  # the limit within which it is usable
    is_at_least: bool  # the value must be at least the limits, not at most
    sentence: Line  # what was found and what it means, in one sentence


@dataclass(frozen=True)
class Verdict:
    """Whether to use the camera of a run."""

    grade: Grade  # the worst of the checks that are known
    model: Word  # of the camera it is about
    sentence: Line  # the main reason of the grade
    checks: Annotated[tuple[Check, ...], Length(0, 50)]  # in order of reading
    advice: Annotated[tuple[Line, ...], Length(0, 50)]  # what to do better next time, the most useful first
