"""Sizes of errors as people write them: `parse_amount("uniform 0.1deg", SOURCES["face_tilt"])`."""

from collections.abc import Callable, Mapping

from designer.base.errors import InputError
from designer.base.units import parse_angle_rad, parse_length_mm, parse_percent, parse_quantity
from designer.base.words import shown, suggestion
from designer.tolerance.source import KINDS, Amount, ErrorSource, Unit

MAX_KELVIN = 1000.0
_KELVIN_PER_UNIT = {"": 1.0, "K": 1.0, "°C": 1.0, "degC": 1.0}
_PER_KELVIN_PER_UNIT = {"": 1.0, "/K": 1.0, "ppm/K": 1e-6, "um/m/K": 1e-6}


def parse_kelvin(text: str) -> float:
    """A difference of temperature in kelvin.

    Raises:
        ValueError: no number with a unit of temperature, not finite, or more than 1000 K.
    """
    return parse_quantity(text, _KELVIN_PER_UNIT, "a difference of temperature such as 5K", MAX_KELVIN)


def parse_expansion(text: str) -> float:
    """A coefficient of linear expansion per kelvin.

    Raises:
        ValueError: no such quantity, or more than 0.001/K.
    """
    return parse_quantity(text, _PER_KELVIN_PER_UNIT, "an expansion such as 68e-6/K or 68ppm/K", 1e-3)


_PARSERS: Mapping[Unit, Callable[[str], float]] = {
    "mm": parse_length_mm,
    "rad": parse_angle_rad,
    "1": lambda text: parse_percent(text) / 100,
    "K": parse_kelvin,
}


def parse_amount(text: str, source: ErrorSource) -> Amount:
    """The amount of a source: a quantity, and before it `normal` (or nothing), `uniform` or `fixed`.

    Raises:
        InputError: an unknown distribution, a unit of another dimension, not finite, or a spread below zero.
    """
    word, _, rest = text.strip().partition(" ")
    has_kind = bool(rest) and word.isalpha() and word.lower() not in ("nan", "inf", "infinity")
    kind, quantity = (word.lower(), rest) if has_kind else ("normal", text)
    for known in KINDS:
        if kind == known:
            try:
                return Amount(known, _PARSERS[source.unit](quantity))
            except ValueError as error:
                raise InputError(f"{source.name} {shown(text)}: {error}") from None
    hint = suggestion(kind, list(KINDS)) or f"; use {', '.join(KINDS)}"
    raise InputError(f"{source.name} {shown(text)}: unknown distribution {shown(word)}{hint}")
