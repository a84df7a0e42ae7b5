"""How large the errors of one metric are."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.figures.style import BLUE, ORANGE, VERMILION, nothing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

FEWEST_BINS, MOST_BINS = 10, 40
SHOWN_PERCENT = 99.5
"""The largest errors are counted in the last bin, so that one of thousands does not set the scale."""
ROOM = 1.45
"""Height over the highest bar, for the legend, which no line may cross."""


def draw_sizes(axes: "Axes", sizes: Array, unit: str) -> None:
    """A histogram of the lengths (N,) of error vectors, with their root mean square and 95 % marked.

    Args:
        axes: to draw in.
        sizes: in `unit`; what is not finite is left away.
        unit: of the sizes.
    """
    sizes = sizes[np.isfinite(sizes)]
    axes.set_title("Sizes of the errors")
    axes.set_xlabel(f"length of an error in {unit}")
    axes.set_ylabel("how many")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if not len(sizes):
        nothing(axes, "no error counts")
        return
    most = float(np.percentile(sizes, SHOWN_PERCENT)) or float(sizes.max()) or 1.0
    bins = min(max(round(2 * len(sizes) ** (1 / 3)), FEWEST_BINS), MOST_BINS)
    edges = np.linspace(0, most, bins + 1)
    count = np.histogram(np.minimum(sizes, most), edges)[0]
    axes.stairs(count, edges, fill=True, color=BLUE, alpha=0.6)
    rmse, percentile_95 = float(np.sqrt(np.mean(sizes**2))), float(np.percentile(sizes, 95))
    axes.axvline(rmse, ymax=1 / ROOM, color=VERMILION, linewidth=2.2, label="root mean square")
    axes.axvline(percentile_95, ymax=1 / ROOM, color=ORANGE, linewidth=2.2, linestyle="--", label="95 % are below")
    axes.set_xlim(0, most)
    axes.set_ylim(0, ROOM * count.max())
    axes.locator_params(axis="x", nbins=5)
    axes.legend(loc="upper right", frameon=False)
