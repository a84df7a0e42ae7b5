"""Numbers of a measured print with their standard deviations."""

import math

from calib.as_built.deviations import Estimate
from designer.base.number_text import figure, with_digits

FINEST = 1.5e-4
"""Standard deviation to whose digits numbers are told at the most."""


FINEST_DEG = 1.5e-2
"""The same of skews, so that they read as the option that takes them back, to 0.001 deg: 2 um on 100 mm."""


def told(one: Estimate, unit: str = "", scale: float = 1.0, *, signed: bool = True, finest: float = FINEST) -> str:
    """`+0.312 ± 0.004 %`."""
    value, sigma = scale * one.value, scale * one.sigma
    if not math.isfinite(value):
        return "-"
    text = with_digits(value, max(sigma, finest))
    sign = "+" if signed and not text.startswith("-") else ""
    return f"{sign}{text} ± {figure(sigma, 2)}{unit}"


def percent(one: Estimate, *, signed: bool = True) -> str:
    """`+0.312 ± 0.004 %`."""
    return told(one, " %", 100, signed=signed)


def degrees(one: Estimate) -> str:
    """`+0.031 ± 0.002 deg`."""
    return told(one, " deg", math.degrees(1), finest=FINEST_DEG)
