"""Numbers as people read them."""

import math


def figure(number: float, digits: int = 4) -> str:
    """A number to some significant digits, without an exponent where that is readable; "-" for nan."""
    if not math.isfinite(number):
        return "-"
    if number == 0:
        return "0"
    exponent = math.floor(math.log10(abs(number)))
    if -7 < exponent < 7:
        return f"{number:.{max(0, digits - 1 - exponent)}f}"
    return f"{number:.{digits - 1}e}"


def with_digits(value: float, sigma: float) -> str:
    """A value to the second digit of its standard deviation."""
    if not sigma > 0 or not math.isfinite(sigma):
        return figure(value, 7)
    # The z: what is rounded to zero has no sign.
    return f"{value:z.{min(max(0, 1 - math.floor(math.log10(sigma))), 15)}f}"
