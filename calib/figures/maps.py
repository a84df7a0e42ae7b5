"""Values over the image, as bands of colour with contours of round values."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.figures.sigma_map import scale_end
from calib.figures.style import DEEP, EMPTY, PALE, SEQUENTIAL, bar_beside, image_axes, note

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

ROUND = tuple(round(step * 10.0**power, 9) for power in range(-6, 5) for step in (1, 2, 5))
BANDS = 25
"""Flat bands of colour make small files."""
FLAT, WIDE = 1.2, 20.0
"""Values that differ by less than the first factor need no contours, by more than the second a scale of powers."""
MOST_CONTOURS = 6
LEAST_SHARE = 0.15
"""Of the largest value: smaller contours crowd around the point of no difference."""


def draw_map(axes: "Axes", pixel: Array, values: Array, unit: str, *, may_be_wide: bool = False) -> None:
    """Draw values that are known at one place at least; where they are not, it stays grey.

    Args:
        axes: that are the image.
        pixel: (R, C, 2) an even grid.
        values: (R, C) not negative, nan where they are not known.
        unit: of the values, "" for none.
        may_be_wide: colours may go by powers of ten, for values that are small in one place and large in another.
    """
    from matplotlib.colors import LogNorm

    axes.set_facecolor(EMPTY)
    known = values[np.isfinite(values)]
    least, most = float(known.min()), float(known.max())
    by_powers = may_be_wide and most > WIDE * least > 0
    end, is_cut = (most, False) if by_powers else scale_end(known)
    bands = np.geomspace(least, most, BANDS + 1) if by_powers else np.linspace(0, end or 1.0, BANDS + 1)
    u, v = pixel[..., 0], pixel[..., 1]
    shown = axes.contourf(
        u, v, np.ma.masked_invalid(np.clip(values, bands[0], None if is_cut else bands[-1])), levels=bands.tolist(),
        cmap=SEQUENTIAL, norm=LogNorm(least, most) if by_powers else None, extend="max" if is_cut else "neither",
    )  # fmt: skip
    shown.set_rasterized(True)  # as shapes, bands that touch would show seams
    levels = _thinned([level for level in ROUND if max(least, 0 if by_powers else LEAST_SHARE * most) < level < most])
    bar_beside(axes, shown, unit, ticks=levels if by_powers else 5)
    if most > FLAT * least:
        lines = axes.contour(u, v, values, levels=levels or [float(np.median(known))], colors=PALE, linewidths=1.3)
        for text in axes.clabel(lines, fontsize=11, fmt=f"%g {unit}".rstrip()):
            text.set_bbox({"facecolor": DEEP, "edgecolor": "none", "pad": 1.5, "alpha": 0.75})


def _thinned(levels: list[float]) -> list[float]:
    """At most so many contours that their labels have room: if need be powers of ten alone, or some of these."""
    if len(levels) > MOST_CONTOURS:
        levels = [level for level in levels if f"{level:e}".startswith("1")]
    return levels[:: -(-len(levels) // MOST_CONTOURS) or 1]


def draw_coverage(axes: "Axes", image_size: tuple[int, int], views: NDArray[np.int64]) -> None:
    """How many photos cover each cell (R, C) of the image; what none covers is hatched."""
    image_axes(axes, image_size, "Coverage of the sensor")
    width, height = image_size
    axes.fill_between([-0.5, width - 0.5], -0.5, height - 0.5, facecolor=EMPTY, hatch="///", linewidth=0)
    note(axes, f"{100 * float((views > 0).mean()):.0f} % of the image is covered by sightings")
    if (views > 0).any():
        rows, columns = views.shape
        edge_u, edge_v = np.linspace(-0.5, width - 0.5, columns + 1), np.linspace(-0.5, height - 0.5, rows + 1)
        count = np.where(views > 0, views.astype(np.float64), np.nan)
        shown = axes.pcolormesh(edge_u, edge_v, count, cmap=SEQUENTIAL, vmin=0, rasterized=True)
        bar_beside(
            axes,
            shown,
            "photos that cover it",
            ticks=sorted({float(x) for x in np.linspace(0, views.max(), 6).round()}),
        )
