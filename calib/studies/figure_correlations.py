"""Which parameters of a camera a target leaves tied to each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.figures.style import BLUE, DEEP, EMPTY, PALE, VERMILION, WIDTH_PX, bar_beside, note
from calib.studies.statistics import Array, Case, Correlations
from calib.studies.table import case_in_words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

HEAD_PX = 160
DARK = 0.6
"""Correlations beyond this have white numbers."""


@dataclass(frozen=True, eq=False)
class Pair:
    """The correlations of the samples of a case, and those that the solution of all its views predicts."""

    case: Case
    found: Correlations
    predicted: Correlations | None = None


def correlations_height_px(pairs: Sequence[Pair]) -> int:
    """As high as square matrices need."""
    return round(HEAD_PX + (WIDTH_PX - 180) / max(len(pairs), 2))


def draw_correlations(page: "Figure", pairs: Sequence[Pair]) -> None:
    """A matrix a target.

    Args:
        page: an empty figure.
        pairs: one or more.
    """
    axes = page.subplots(1, len(pairs), squeeze=False)[0]
    for place, pair in zip(axes, pairs, strict=True):
        shown = _draw_matrix(place, pair)
    bar_beside(axes[-1], shown, "correlation")
    page.suptitle("Correlations of the camera's parameters", fontsize=15, fontweight="bold", x=0.01, ha="left")


def _draw_matrix(axes: "Axes", pair: Pair) -> "ScalarMappable":
    from matplotlib.colors import LinearSegmentedColormap

    colours = LinearSegmentedColormap.from_list("signed", [BLUE, "white", VERMILION]).with_extremes(bad=EMPTY)
    matrix = merged(pair)
    names = [name.removesuffix("_px") for name in pair.found.names]
    count = len(names)
    shown = axes.imshow(matrix, cmap=colours, vmin=-1, vmax=1)
    axes.set_xticks(range(count), names)
    axes.set_yticks(range(count), names)
    axes.tick_params(length=0)
    axes.set_title(case_in_words(pair.case))
    for row in range(count):
        for column in range(count):
            value = matrix[row, column]
            if np.isfinite(value):
                colour = PALE if abs(value) > DARK else DEEP
                axes.text(
                    column, row, f"{round(value, 2) + 0.0:.2f}", ha="center", va="center", color=colour, fontsize=11
                )
    strongest = pair.found.strongest
    samples = f"{pair.found.count} converged samples"
    axes.set_xlabel(f"of {samples}" if pair.predicted is None else f"below the diagonal: {samples}; above: predicted")
    ties = "no two parameters vary" if strongest is None else f"strongest {_tie(strongest)}"
    note(axes, f"root mean square {pair.found.root_mean_square:.2f}; {ties}")
    return shown


def _tie(strongest: tuple[str, str, float]) -> str:
    first, second, value = strongest
    return f"{first.removesuffix('_px')} with {second.removesuffix('_px')}: {value:.3f}"


def merged(pair: Pair) -> Array:
    """The correlations found below the diagonal, above it those predicted, or else found too.  # (P, P)"""
    above = pair.found.matrix if pair.predicted is None else pair.predicted.matrix
    matrix = np.where(np.tri(len(above), dtype=np.bool_), pair.found.matrix, above)
    # A parameter is always tied to itself: full colour there would outshine what matters.
    np.fill_diagonal(matrix, np.nan)
    return matrix
