"""Skew of a printer's axes: three angles in the bed's frame, in text, and the shear that they make."""

import math
from typing import TYPE_CHECKING

from designer.base.units import parse_angle_rad

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Skew = tuple[float, float, float]
"""Radians by which y leans to x, z to x and z to y, in the order of `SKEW_NAMES`."""

SKEW_NAMES = ("xy", "xz", "yz")
NO_SKEW: Skew = (0.0, 0.0, 0.0)
MOST_SKEW_DEG = 2.0
"""A printer that leans more is to be mended, or the number was meant to be another."""
_EXPECTED = "angles such as xy 0.02deg, xz -0.14deg, yz 0.02deg (left out: 0), or 0"


def parse_skew_rad(text: str | float) -> Skew:
    """Angles as `format_skew` writes them; `0` for none.

    Raises:
        ValueError: no such list, an angle twice, or one of more than 2 deg.
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool) and text == 0:
        return NO_SKEW
    if not isinstance(text, str):
        raise ValueError(f"expected {_EXPECTED}")
    if text.strip() == "0":
        return NO_SKEW
    given: dict[str, float] = {}
    for part in text.split(",", len(SKEW_NAMES)):
        name, _, quantity = part.strip().partition(" ")
        name = name.lower()
        if name not in SKEW_NAMES or not quantity:
            raise ValueError(f"expected {_EXPECTED}")
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


def skew_matrix(skew_rad: Skew) -> "NDArray[np.float64]":
    """What a printer with these angles makes of a place, along the bed's axes.  # (3, 3)

        x' = x + y tan(xy) + z tan(xz),    y' = y + z tan(yz),    z' = z

    which is what the skew correction of printers' firmware takes back (Marlin's M852, Klipper's SET_SKEW).
    """
    import numpy as np  # here: reading a command line needs none

    xy, xz, yz = np.tan(skew_rad)
    return np.array([[1.0, xy, xz], [0.0, 1.0, yz], [0.0, 0.0, 1.0]])
