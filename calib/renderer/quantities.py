"""Quantities of a photo in text: angles, pixels, ranges of length."""

import math
import os
import re
from collections.abc import Callable
from numbers import Integral, Real
from typing import TypeVar

from designer.base.errors import InputError
from designer.base.units import parse_length_mm
from designer.base.words import shown

T = TypeVar("T")
MOST_JOBS = 1024
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"


def parsed(option: str, text: str, parse: Callable[[str], T]) -> T:
    """What a text means that a person gave for an option."""
    try:
        return parse(text)
    except ValueError as error:
        raise InputError(f"{option} {shown(text)}: {error}") from None


def bounded(option: str, text: str, parse: Callable[[str], float], low: float, high: float, unit: str) -> float:
    """A quantity within its limits, whose unit messages name."""
    value = parsed(option, text, parse)
    if not low <= value <= high:
        raise InputError(f"{option} {shown(text)}: must be from {low:g}{unit} to {high:g}{unit}")
    return value


def length(option: str, text: str, low: float, high: float) -> float:
    """A length in millimetres."""
    return bounded(option, text, parse_length_mm, low, high, "mm")


def whole(option: str, value: object, low: int, high: int) -> int:
    """A whole number within its limits."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not low <= int(value) <= high:
        what = "" if isinstance(value, Integral) else "a whole number "
        raise InputError(f"{option} {shown(value) if what else value}: must be {what}from {low} to {high}")
    return int(value)


def processes_of(jobs: int | None) -> int:
    """How many things are done at a time; None: one per core."""
    return (os.cpu_count() or 1) if jobs is None else whole("--jobs", jobs, 1, MOST_JOBS)


def number(option: str, value: object) -> float:
    """A number, whose limits another rule has."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise InputError(f"{option} {shown(value)}: must be a number")
    return float(value)


def parse_degrees(text: str) -> float:
    """An angle in degrees, `60deg` or `60`."""
    return _with_unit(text, ("deg", "°", ""), "an angle such as 60deg")


def parse_pixels(text: str) -> float:
    """A length in the image, `0.7px` or `0.7`."""
    return _with_unit(text, ("px", ""), "pixels such as 0.7px")


def length_range(option: str, text: str, low: float, high: float) -> tuple[float, float]:
    """`400mm`, or `250mm..800mm`, in millimetres and in order."""
    parts = text.split("..")
    if len(parts) > 2:
        raise InputError(f"{option} {shown(text)}: give one length, or two such as 250mm..800mm")
    unit = re.sub(rf"^\s*{_NUMBER}\s*", "", parts[-1])
    first = f"{parts[0]}{unit}" if len(parts) == 2 and re.fullmatch(rf"\s*{_NUMBER}\s*", parts[0]) else parts[0]
    values = [bounded(option, part, parse_length_mm, low, high, "mm") for part in (first, parts[-1])]
    if values[0] > values[1]:
        raise InputError(f"{option} {shown(text)}: the smaller length comes first")
    return values[0], values[1]


def _with_unit(text: str, units: tuple[str, ...], expected: str) -> float:
    match = re.fullmatch(rf"\s*({_NUMBER})\s*(\S*)\s*", text)
    if match is None or match[2] not in units or not math.isfinite(float(match[1])):
        raise ValueError(f"expected {expected}")
    return float(match[1])
