"""Quantities in text: `20mm`, `220x220mm`, `0.4%`, `0.1deg`. A bare number is in millimetres, percent or degrees."""

import math
import re

MM_PER_UNIT = {
    "": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "µm": 0.001, "μm": 0.001,
    "in": 25.4, "inch": 25.4, "inches": 25.4, '"': 25.4, "thou": 0.0254, "mil": 0.0254,
}  # fmt: skip
RAD_PER_UNIT = {"": math.pi / 180, "deg": math.pi / 180, "°": math.pi / 180, "rad": 1.0, "mrad": 1e-3}
MAX_LENGTH_MM = 10_000.0
MAX_ANGLE_RAD = math.tau
MAX_TEXT = 40
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_QUANTITY = re.compile(rf"\s*({_NUMBER}|[-+]?(?:nan|inf(?:inity)?))\s*([^\W\d_]{{0,12}}|[%\"°])\s*", re.IGNORECASE)


def parse_length_mm(text: str | float) -> float:
    """A length in millimetres.

    Raises:
        ValueError: no number with a unit of length, not finite, or longer than 10 m.
    """
    number, unit = _split(text, "a length such as 20mm, 2cm or 0.8in")
    return _to_mm(number, unit, text)


def parse_percent(text: str | float) -> float:
    """A percentage, with or without its sign.

    Raises:
        ValueError: not a finite number, or another unit.
    """
    number, unit = _split(text, "a percentage such as 0.4%")
    if unit not in ("", "%"):
        raise ValueError(f"unit {unit!r} is not a percentage; write 0.4% or 0.4")
    return number


def parse_angle_rad(text: str | float) -> float:
    """An angle in radians; a bare number is in degrees.

    Raises:
        ValueError: no number with a unit of angle, not finite, or more than a full turn.
    """
    expected = "an angle such as 0.1deg or 2mrad"
    number, unit = _split(text, expected)
    if unit not in RAD_PER_UNIT:
        raise ValueError(f"unit {unit!r} does not fit; expected {expected}")
    angle = number * RAD_PER_UNIT[unit]
    if abs(angle) > MAX_ANGLE_RAD:
        raise ValueError(f"too large; expected {expected}")
    return angle


def parse_lengths_mm(text: str, count: int) -> tuple[float, ...]:
    """`count` lengths such as 220x220mm; a unit at the end holds for the numbers before it that have none.

    Raises:
        ValueError: another count, or a part that is no length.
    """
    example = "x".join(["220"] * count) + "mm"
    parts = re.split(r"[x×]", text.strip(), flags=re.IGNORECASE) if isinstance(text, str) else []
    if len(parts) != count:
        raise ValueError(f"expected {count} lengths joined by x, such as {example}")
    pairs = [_split(part, f"{count} lengths such as {example}") for part in parts]
    last_unit = pairs[-1][1]
    return tuple(_to_mm(number, unit or last_unit, text) for number, unit in pairs)


def format_mm(*lengths: float) -> str:
    """Lengths as text that reads back exactly: `20mm`, `220x220mm`."""
    return "x".join(repr(length).removesuffix(".0") for length in lengths) + "mm"


def round_down(length: float) -> float:
    """Down to a hundredth of a millimetre, as a drawing would give it."""
    return math.floor(100 * length + 1e-6) / 100


def round_up(length: float) -> float:
    """Up to a hundredth of a millimetre."""
    return math.ceil(100 * length - 1e-6) / 100


def _split(text: str | float, expected: str) -> tuple[float, str]:
    """Number and unit of a quantity."""
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise ValueError(f"expected {expected}")
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) and len(text) <= MAX_TEXT else None
    if isinstance(text, str) and match is None:
        raise ValueError(f"expected {expected}")
    number, unit = (float(match[1]), match[2]) if match else (_as_float(text), "")
    if not math.isfinite(number):
        raise ValueError(f"not a finite number; expected {expected}")
    return number, unit


def _as_float(number: str | float) -> float:
    try:
        return float(number)
    except OverflowError:
        return math.inf


def _to_mm(number: float, unit: str, text: str | float) -> float:
    """The length in millimetres, within the limit."""
    # Capitals are taken for small letters, but not where they would mean mega.
    per_unit = MM_PER_UNIT.get(unit if unit.startswith("M") and unit != "MM" else unit.lower())
    if per_unit is None:
        raise ValueError(f"unknown unit of length {unit!r}; use mm, cm, m, um, in or thou")
    # 3.5 inches are 88.9mm, and not 88.89999999999999mm.
    length = number if per_unit == 1 else round(number * per_unit, 9)
    if abs(length) > MAX_LENGTH_MM:
        raise ValueError(f"{str(text).strip()} is more than {MAX_LENGTH_MM:g}mm")
    return length
