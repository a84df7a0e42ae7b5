"""Quantities in text: `20mm`, `220x220mm`, `0.4%`, `0.1deg`, a page `A4`, a printer's skew `xy 0.02deg`.

A bare number is in millimetres, percent or degrees.
"""

import math
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from designer.base.errors import InputError

if TYPE_CHECKING:
    from designer.base.arrays import Array

MM_PER_UNIT = {
    "": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 0.001, "µm": 0.001, "μm": 0.001,
    "in": 25.4, "inch": 25.4, "inches": 25.4, '"': 25.4, "thou": 0.0254, "mil": 0.0254,
}  # fmt: skip
UNITS_MM = {name: MM_PER_UNIT[name] for name in ("mm", "cm", "m", "inch")}
"""What a mesh may be in, which names no unit itself."""
RAD_PER_UNIT = {"": math.pi / 180, "deg": math.pi / 180, "°": math.pi / 180, "rad": 1.0, "mrad": 1e-3}
MAX_LENGTH_MM = 10_000.0
MAX_ANGLE_RAD = math.tau
MAX_TEXT = 40
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_QUANTITY = re.compile(rf"\s*({_NUMBER}|[-+]?(?:nan|inf(?:inity)?))\s*([^\s\d.+-]\S{{0,11}})?\s*", re.IGNORECASE)
PAGE_SIZES_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}
MARGIN_MM = 10.0
"""What a printer may leave white along the paper's edges."""
SCALE_BAR_MM = 100.0
MIN_PAGE_MM = (SCALE_BAR_MM + 2 * MARGIN_MM, 60.0)
MAX_PAGE_MM = 5000.0
"""PDF readers stop at 14400 points, which is 5080 mm."""
Skew = tuple[float, float, float]
"""Radians by which y leans to x, z to x and z to y, in the order of `SKEW_NAMES`."""
SKEW_NAMES = ("xy", "xz", "yz")
NO_SKEW: Skew = (0.0, 0.0, 0.0)
MOST_SKEW_DEG = 2.0
"""A printer that leans more is to be mended, or the number was meant to be another."""
_SKEW_EXPECTED = "angles such as xy 0.02deg, xz -0.14deg, yz 0.02deg (left out: 0), or 0"


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
    return parse_quantity(text, RAD_PER_UNIT, "an angle such as 0.1deg or 2mrad", MAX_ANGLE_RAD)


def parse_quantity(text: str | float, per_unit: Mapping[str, float], expected: str, largest: float) -> float:
    """A number times its unit.

    Args:
        text: with one of the units, or a bare number.
        per_unit: the units; "" of a bare number.
        expected: what it should be, with an example.
        largest: its limit, to both sides of 0.

    Raises:
        ValueError: no such quantity, not finite, or beyond the limit.
    """
    number, unit = _split(text, expected)
    if unit not in per_unit:
        raise ValueError(f"unit {unit!r} does not fit; expected {expected}")
    value = number * per_unit[unit]
    if abs(value) > largest:
        raise ValueError(f"too large; expected {expected}")
    return value


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
    number, unit = (float(match[1]), match[2] or "") if match else (_as_float(text), "")
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


def page_size_mm(page: str) -> tuple[float, float] | None:
    """Width and height of a page: "A4", "A3", "Letter" or "WIDTHxHEIGHTmm"; None for "fit".

    Raises:
        InputError: another text, a size that is not finite, too small for the scale bar, or absurdly large.
    """
    if page.casefold() == "fit":
        return None
    for known, size in PAGE_SIZES_MM.items():
        if page.casefold() == known.casefold():
            return size
    try:
        width, height = parse_lengths_mm(page, 2)
    except ValueError as error:
        rule = f"use {', '.join(PAGE_SIZES_MM)}, fit or WIDTHxHEIGHTmm such as 400x600mm"
        raise InputError(f"page {page!r}: {error}; {rule}") from None
    wide, low = MIN_PAGE_MM
    if max(width, height) < wide or min(width, height) < low:
        raise InputError(f"page {page!r} is too small for the scale bar; use at least {wide:g}x{low:g}mm")
    if max(width, height) > MAX_PAGE_MM:
        raise InputError(f"page {page!r} is larger than {MAX_PAGE_MM:g}mm, the most that PDF allows; use a smaller one")
    return width, height


def parse_skew_rad(text: str | float) -> Skew:
    """Angles as `format_skew` writes them; `0` for none.

    Raises:
        ValueError: no such list, an angle twice, or one of more than 2 deg.
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool) and text == 0:
        return NO_SKEW
    if not isinstance(text, str):
        raise ValueError(f"expected {_SKEW_EXPECTED}")
    if text.strip() == "0":
        return NO_SKEW
    given: dict[str, float] = {}
    for part in text.split(",", len(SKEW_NAMES)):
        name, _, quantity = part.strip().partition(" ")
        name = name.lower()
        if name not in SKEW_NAMES or not quantity:
            raise ValueError(f"expected {_SKEW_EXPECTED}")
        if name in given:
            raise ValueError(f"{name} is given twice; give each angle once")
        given[name] = _lean_rad(name, quantity)
    xy, xz, yz = (given.get(name, 0.0) for name in SKEW_NAMES)
    return xy, xz, yz


def _lean_rad(name: str, quantity: str) -> float:
    """One angle within the limit."""
    try:
        angle = parse_angle_rad(quantity)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if abs(angle) > math.radians(MOST_SKEW_DEG):
        raise ValueError(
            f"{name} must be from -{MOST_SKEW_DEG:g}deg to {MOST_SKEW_DEG:g}deg; square the printer's axes first"
        )
    return angle + 0.0  # zero without a sign


def format_skew(skew_rad: Skew) -> str:
    """The angles as text that reads back exactly: `xy 0.02deg, yz -0.1deg`."""
    leans = [f"{name} {_angle_text(angle)}" for name, angle in zip(SKEW_NAMES, skew_rad, strict=True) if angle]
    return ", ".join(leans) or "0"


def _angle_text(angle_rad: float) -> str:
    """Degrees as they were typed; radians where degrees would round."""
    degrees = f"{math.degrees(angle_rad):.12g}deg"
    return degrees if parse_angle_rad(degrees) == angle_rad else f"{angle_rad!r}rad"


def skew_matrix(skew_rad: Skew) -> "Array":
    """What a printer with these angles makes of a place, along the bed's axes.  # (3, 3)

        x' = x + y tan(xy) + z tan(xz),    y' = y + z tan(yz),    z' = z

    which is what the skew correction of printers' firmware takes back (Marlin's M852, Klipper's SET_SKEW).
    """
    import numpy as np  # here: reading a command line needs none

    xy, xz, yz = np.tan(skew_rad)
    return np.array([[1.0, xy, xz], [0.0, 1.0, yz], [0.0, 0.0, 1.0]])
