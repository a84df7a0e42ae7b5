"""Who shares how many frames: cameras on a circle, and a line between two that saw the target together."""

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib.draw.style import BLUE, GREY, INK, PALE, svg_panel
from designer.base.words import cut, printable
from designer.page.blocks import Figure
from designer.page.pictures import drawing_of_svg

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Counts = NDArray[np.int64]

MOST_NUMBERED = 5
"""Cameras, of more of which the lines have no numbers: they would cover each other."""
LONGEST_NAME = 14
WIDEST, THINNEST = 7.0, 0.8
"""Of lines, in points."""
HEIGHT_IN = 4.7


def sharing_figure(names: tuple[str, ...], shared: Counts) -> Figure:
    """The graph of a rig, and what it shows in words.

    Args:
        names: of the cameras (C,).
        shared: in how many frames two see the target together, on the diagonal at all (C, C).
    """
    image = drawing_of_svg(svg_panel(lambda axes: _draw(axes, names, shared), height_in=HEIGHT_IN))
    return Figure("Frames that two cameras share", image, sharing_words(names, shared), _caption(len(names)))


def sharing_words(names: tuple[str, ...], shared: Counts) -> str:
    """Who shares most and who least, as a sentence."""
    pairs = [(int(shared[a, b]), a, b) for a, b in combinations(range(len(names)), 2)]
    joined = [pair for pair in pairs if pair[0]]
    if not joined:
        return "No two cameras see the target in one frame."
    (least, a, b), (most, c, d) = min(joined), max(joined)
    none = len(pairs) - len(joined)
    apart = f"; {none} of {len(pairs)} pairs share none" if none else ""
    if least == most:
        return f"Each pair that shares frames shares {most}{apart}."
    few, many = (f"{printable(names[x])} and {printable(names[y])}" for x, y in ((a, b), (c, d)))
    return f"{many} share most frames, {most}; {few} fewest, {least}{apart}."


def _caption(count: int) -> str:
    numbers = "the number beside it" if count <= MOST_NUMBERED else "the table of pairs has the numbers"
    return f"A line is as thick as the frames that both see: {numbers}. Under a name: the frames that this camera sees."


def _draw(axes: "Axes", names: tuple[str, ...], shared: Counts) -> None:
    """Nodes, lines and numbers."""
    start = np.pi if len(names) == 2 else np.pi / 2
    angle = start - 2 * np.pi * np.arange(len(names)) / len(names)
    place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pairs = list(combinations(range(len(names)), 2))
    most = max((int(shared[a, b]) for a, b in pairs), default=1) or 1
    for number, (a, b) in enumerate(pairs):
        count = int(shared[a, b])
        if not count:
            continue
        width = THINNEST + (WIDEST - THINNEST) * count / most
        axes.plot(*place[[a, b]].T, color=BLUE, linewidth=width, alpha=0.45, solid_capstyle="round", zorder=1)
        if len(names) <= MOST_NUMBERED:
            share = 0.5 if len(names) < 4 else 0.35 + 0.05 * (number % 2)  # where lines cross, numbers would, too
            x, y = ((1 - share) * place[a] + share * place[b]).tolist()
            box = {"boxstyle": "round,pad=0.15", "facecolor": PALE, "edgecolor": "none"}
            axes.text(x, y, str(count), ha="center", va="center", fontsize=11, color=INK, bbox=box, zorder=2)
    axes.scatter(place[:, 0], place[:, 1], s=420, color=BLUE, zorder=3)
    for row, (x, y) in enumerate(place.tolist()):
        axes.text(x, y, str(row + 1), ha="center", va="center", color=PALE, fontsize=11, zorder=4)
        side = "center" if abs(x) < 0.3 else "left" if x > 0 else "right"
        text = f"{cut(printable(names[row]), LONGEST_NAME)}\n{int(shared[row, row])}"
        axes.text(1.14 * x, 1.25 * y, text, ha=side, va="center", fontsize=11, color=GREY, zorder=4)
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.45, 1.45)
    axes.set_aspect("equal")
    axes.set_axis_off()
