"""A sketch of where to hold the target next: its outlines in the image, over what was seen so far."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.figures.style import BLUE, GREEN, ORANGE, PALE, VERMILION, image_axes, note
from calib.verdict.next_views import NextView

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_DOTS, MANY_DOTS = 3000, 1500
COLOURS = (VERMILION, BLUE, GREEN, ORANGE)
SEEN = "#b4b4b4"
LABEL_APART = 0.05
"""Between numbers, of the image's width."""


def draw_next_views(
    axes: "Axes", image_size: tuple[int, int], views: Sequence[NextView], covered_pixels: NDArray[np.float64]
) -> None:
    """The outlines of the proposed views, numbered from 1, over the sightings so far.

    Args:
        axes: to draw in.
        image_size: width, height in px.
        views: the proposed ones, in their order.
        covered_pixels: where rings were seen (N, 2).
    """
    image_axes(axes, image_size, "Where to hold the target next")
    axes.set_facecolor("white")
    count = len(covered_pixels)
    rows = np.arange(count) if count <= MOST_DOTS else np.linspace(0, count - 1, MOST_DOTS).astype(np.int64)
    axes.plot(
        *covered_pixels[rows].T, "o", color=SEEN, markersize=4 if count < MANY_DOTS else 2.5, markeredgewidth=0,
        zorder=1, rasterized=True,
    )  # fmt: skip
    labels: list[NDArray[np.float64]] = []
    for number, view in enumerate(views, start=1):
        _draw_one(axes, number, view, labels, LABEL_APART * image_size[0])
    note(axes, "grey: rings seen so far; numbered: the next photos" if views else "nothing to propose")


def _draw_one(axes: "Axes", number: int, view: NextView, labels: list[NDArray[np.float64]], apart_px: float) -> None:
    """One target's faces in one colour, and its number in their middle, beside the numbers that are there already."""
    colour = COLOURS[(number - 1) % len(COLOURS)]
    for line in view.outline_px:
        axes.fill(*line.T, facecolor=colour, alpha=0.08, linewidth=0, zorder=2)
        axes.plot(*line.T, color=colour, linewidth=2.2 if len(view.outline_px) == 1 else 1.4, zorder=3)
    if not view.outline_px:
        return
    points = np.concatenate(view.outline_px)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    while any(np.hypot(*(middle - other)) < apart_px for other in labels):
        middle = middle + np.array([0.0, apart_px])
    labels.append(middle)
    axes.annotate(
        str(number), middle, ha="center", va="center", fontsize=14, fontweight="bold", color=PALE, zorder=4,
        bbox={"boxstyle": "circle,pad=0.3", "facecolor": colour, "edgecolor": PALE, "linewidth": 1.5},
    )  # fmt: skip
