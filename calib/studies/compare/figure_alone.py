"""Which single error gives the paper's two numbers: one panel an object, one row a source."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calib.figures.style import BLUE, EMPTY, GREEN, GREY, INK, note, nothing
from calib.studies.compare.objects import OBJECTS, PaperObject
from calib.studies.compare.results import NEAR, REACH, Explanation, Results, short

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1}
ROOM = 1.85
"""To the right of the largest value, for words."""


def alone_height_px() -> int:
    """As high as two rows of panels need."""
    return 1150


def draw_alone(page: "Figure", results: Results) -> None:
    """Reconstruction error of each source where its intersection error is the paper's."""
    known = [one for one in OBJECTS if one.is_known]
    every = page.subplots(2, 2).ravel()
    for axes, one in zip(every, known, strict=True):
        found = [row for row in results.explanations if row.name == one.name and row.prints]
        _panel(axes, one, sorted(found, key=lambda row: -row.multiple))
    page.suptitle(
        "Each error scaled until it alone gives the paper's intersection error: what reconstruction error then?\n"
        f"Green: within {100 * NEAR:.0f} % of the paper's (band); pale: more than {REACH:g} times the template's. "
        "Beside: the amount it takes, and how many times the template's it is",
        fontsize=13, x=0.01, ha="left",
    )  # fmt: skip


def _panel(axes: "Axes", one: PaperObject, rows: Sequence[Explanation]) -> None:
    axes.set_title(f"{one.label} {one.name}")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    if not rows:
        nothing(axes, "no samples yet")
        return
    note(axes, f"paper: intersection {one.intersection_text} mm, reconstruction {one.reconstruction_mm:g} mm")
    axes.axvspan(
        (1 - NEAR) * one.reconstruction_mm, (1 + NEAR) * one.reconstruction_mm, color=EMPTY, linewidth=0, zorder=0
    )
    axes.axvline(one.reconstruction_mm, color=INK, linewidth=1.8, linestyle=(0, (3, 1.5)))
    for place, row in enumerate(rows):
        alpha = 0.85 if row.is_within_reach else 0.4
        axes.barh(
            place, row.reconstruction_mm, height=0.62, color=GREEN if row.fits else BLUE, alpha=alpha, zorder=2
        )  # fmt: skip
        times = f"{short(row.multiple)} x"
        axes.annotate(
            f"{row.amount}, {times}" if row.amount else times, (row.reconstruction_mm, place), (6, 0),
            textcoords="offset points", va="center", fontsize=10, color=INK if row.fits else GREY, zorder=3, bbox=PLATE,
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [row.source.replace("_", " ") for row in rows])
    axes.tick_params(axis="y", length=0)
    largest = max(one.reconstruction_mm, *(row.reconstruction_mm for row in rows))
    axes.set_xlim(0, largest * ROOM / 1.35)
    axes.set_xlabel("reconstruction error in mm")
