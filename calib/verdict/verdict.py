"""What a verdict is."""

import math
from dataclasses import dataclass
from typing import Literal

from calib.core.number_text import figure

Grade = Literal["good", "usable", "bad", "unknown"]
"""`bad`: do not use; `unknown`: could not be checked, which is said and worsens nothing but leaves no praise."""

MOST_DIGITS = 9


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

    name: str  # a key of `calib.verdict.checks.TITLES`
    title: str  # "Uncertainty of the camera over the image"
    grade: Grade
    value: float | None  # None: not known
    unit: str  # "px", "%", "sigma", "" for ratios
    good: float  # the limit within which it is good
    usable: float  # the limit within which it is usable
    is_at_least: bool  # the value must be at least the limits, not at most
    sentence: str  # what was found and what it means, in one sentence


@dataclass(frozen=True)
class Verdict:
    """Whether to use the camera of a run."""

    grade: Grade  # the worst of the checks that are known
    model: str  # of the camera it is about
    sentence: str  # the main reason of the grade
    checks: tuple[Check, ...]  # in order of reading
    advice: tuple[str, ...]  # what to do better next time, the most useful first
