"""Numbers in tables of a page."""

import math

from calib.core.number_text import figure
from designer.page.blocks import Cell, Level


def number(value: float, digits: int = 3, *, level: Level | None = None) -> Cell:
    """A number to some digits that sorts by its value; empty where it is not known."""
    if not math.isfinite(value):
        return Cell("", None, level=level)
    return Cell(figure(value, digits), value, level=level)


def whole(value: int) -> Cell:
    """A count."""
    return Cell(str(value), float(value))
