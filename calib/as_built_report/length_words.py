"""Lengths of a caliper, as the command line has them: `face-to-face:151.20mm+-0.02mm`."""

import math
import re
from dataclasses import dataclass

import numpy as np

from calib.as_built.lengths import FAR, NAMES, CaliperLength, length_in
from designer.base.errors import InputError
from designer.base.units import format_mm, parse_length_mm
from designer.base.words import shown, suggestion
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, perturb

CALIPER_SIGMA_MM = 0.02
"""What most makers of calipers state for 150 mm; an assumption where no sigma is given."""
EXAMPLE = "face-to-face:151.20mm+-0.02mm"
SAME_MM = 0.005
"""A length nearer to the design's is likely copied from it: calipers tell hundredths."""
DOUBTED = 4.0
"""Standard deviations of prints from which on a length is asked about."""
PRINTS = 100
"""That are simulated for them, which tells them to 7 %."""
MAX_TEXT = 120
_NAME = re.compile(r"face-to-face|edge|(ring|face) \d{1,6} to \1 \d{1,6}")
_EITHER = re.compile(r"±|\+/-|\+-")
_UNIT = re.compile(r"[^\d.\s]*\s*$")


@dataclass(frozen=True)
class AskedLength:
    """A length, and whether its sigma is the one that is taken where none is given."""

    length: CaliperLength
    is_usual_sigma: bool

    @property
    def text(self) -> str:
        """As it is echoed: name, value and sigma with their units."""
        value, sigma = format_mm(self.length.value_mm), format_mm(self.length.sigma_mm)
        why = ", the usual of a caliper; another with NAME:VALUE+-SIGMA" if self.is_usual_sigma else ""
        return f"{self.length.name} {value} +- {sigma}{why}"


def parse_length(option: str, text: str, target: TargetGeometry) -> AskedLength:
    """A length of a target from the words of an option.

    Args:
        option: what messages begin with.
        text: `NAME:VALUE`, `NAME:VALUE+-SIGMA`; a unit at one of the two holds for the other, without one it is mm.
        target: must have such a length.

    Raises:
        InputError: another form, an unknown name, another unit, a value or sigma that is not more than 0, or a length
            that the target does not have.
    """
    place = f"{option} {shown(text[:MAX_TEXT])}"
    name, colon, quantity = text.partition(":")
    if not colon or len(text) > MAX_TEXT:
        raise InputError(f"{place}: write NAME:VALUE+-SIGMA, as in {EXAMPLE}; NAME is {NAMES}")
    name = " ".join(name.lower().split())
    if _NAME.fullmatch(name) is None:
        # Numbers are taken out: they are no part of what may be misspelt.
        known = ["face-to-face", "edge", "ring N to ring N", "face N to face N"]
        hint = suggestion(re.sub(r"\d+", "N", name), known) or f"; give {NAMES}"
        raise InputError(f"{place}: no length is called {shown(name)}{hint}")
    value_mm, sigma_mm = _value_and_sigma(place, quantity)
    try:
        inside = length_in(target, name)
    except InputError as error:
        raise InputError(f"{option}: {error}") from None
    if abs(value_mm / inside - 1) > FAR:
        raise InputError(
            f"{place}: the target has {inside:.2f} mm there, and no print is off by more than {100 * FAR:g} %; check "
            "what was measured, and the unit"
        )
    is_usual = sigma_mm is None
    return AskedLength(CaliperLength(name, value_mm, CALIPER_SIGMA_MM if sigma_mm is None else sigma_mm), is_usual)


def doubt_about(asked: AskedLength, target: TargetGeometry, errors: ErrorModel | None) -> str:
    """Why a length hardly is what a caliper showed on a print of a target, in a line; "" if it may well be.

    Args:
        asked: the length.
        target: as designed.
        errors: how it was made, which tells how far prints are off; None: not known.
    """
    length = asked.length
    inside = length_in(target, length.name)
    if abs(length.value_mm - inside) <= SAME_MM:
        return f"length {asked.text} is the design's value to {SAME_MM:g} mm: is it a reading?"
    if errors is None:
        return ""
    rng = np.random.default_rng(0)
    prints = [length_in(perturb(target, errors, rng), length.name) for _ in range(PRINTS)]
    usual_mm, sigma_mm = float(np.mean(prints)), math.hypot(float(np.std(prints)), length.sigma_mm)
    if abs(length.value_mm - usual_mm) <= DOUBTED * sigma_mm:
        return ""
    return (
        f"length {length.name} {format_mm(length.value_mm)} is {length.value_mm - inside:+.2f} mm from the design's "
        f"{inside:.2f} mm; prints made as '{errors.name}' are within {DOUBTED * sigma_mm:.2f} mm: check the reading, "
        "the scale it was printed at, or say with --made how it was made"
    )


def _value_and_sigma(place: str, quantity: str) -> tuple[float, float | None]:
    """Value and sigma in mm, of the sigma None if there is none."""
    parts = _EITHER.split(quantity)
    if len(parts) > 2:
        raise InputError(f"{place}: more than one sigma; write it as in {EXAMPLE}")
    units = [_UNIT.search(part.strip()) for part in parts]
    words = [match[0] if match else "" for match in units]
    unit = next(filter(None, reversed(words)), "")
    numbers = []
    for what, part, own in zip(("the length", "its sigma"), parts, words, strict=False):
        try:
            number = parse_length_mm(part.strip() if own else f"{part.strip()}{unit}")
        except ValueError as error:
            is_word = part.strip() and not any(character.isdigit() for character in part)
            remedy = f"; put your reading in place of {shown(part.strip())}" if is_word else ""
            raise InputError(f"{place}: {what}: {error}{remedy}") from None
        if not number > 0:
            raise InputError(f"{place}: {what} is {format_mm(number)}; it must be more than 0")
        numbers.append(number)
    return numbers[0], numbers[1] if len(numbers) > 1 else None
