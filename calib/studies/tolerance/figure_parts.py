"""What the figures of a tolerance study share."""

from typing import TYPE_CHECKING

import numpy as np

from calib.studies.tolerance.tables import HUMAN, size_in_words
from designer.base.words import printable
from designer.tolerance.model import ErrorModel
from designer.tolerance.registry import SOURCES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KIND = {"normal": "standard deviation", "uniform": "half width", "fixed": "value"}

MANY_DECADES, MOST_TICKS = 3.0, 9


def heading(page: "Figure", text: str) -> None:
    """The title of a figure."""
    page.suptitle(printable(text), fontsize=15, fontweight="bold", x=0.01, ha="left")


def open_sides(axes: "Axes") -> None:
    """No frame where there is no scale."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def amount_label(errors: ErrorModel, source: str) -> str:
    """What an axis of a source's amounts is."""
    return f"{KIND[errors.amount(source).kind]} in {HUMAN[SOURCES[source].unit][0]}"


def human_size(errors: ErrorModel, source: str) -> float:
    """The size of a source in the unit that a person calls it by, without its sign."""
    return abs(errors.amount(source).size) * HUMAN[SOURCES[source].unit][1]


def source_title(errors: ErrorModel, source: str) -> str:
    """A source and its amount."""
    return f"{source} {size_in_words(errors, source)}"


def plain_log_axis(axes: "Axes", which: str, low: float, high: float) -> None:
    """A logarithmic axis with plain numbers: 1, 2, 5 where few decades are shown, else powers of ten."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    decades = np.log10(high / low)
    steps = (1, 2, 5) if decades < MANY_DECADES else (1,)
    powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    ticks = [step * 10.0**power for power in powers for step in steps]
    inside = [tick for tick in ticks if low <= tick <= high]
    axis.set_major_locator(FixedLocator(inside[:: max(1, len(inside) // MOST_TICKS)]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())
