"""The tables of a study of costs, for page, terminal and Markdown.

The picture of a study of costs: each cost's errors over the image's, with intervals.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.study_tables import NOT_KNOWN, text_cell
from calib.draw.style import BLUE, EMPTY, GREEN, GREY, INK, ORANGE, VERMILION, log_axis, nothing, open_axes
from calib.solver.costs import COSTS
from calib.studies.cost.estimates import MEASURES
from calib.studies.cost.ratios import REAL, SHARE, CostRatio, CostTable, StartRow
from designer.base.words import figure
from designer.page.blocks import Cell, Column, Level, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLES = {
    "camera_px": "camera against truth, px", "pose_mm": "cameras' places, mm", "held_out_px": "held out, px",
    "held_out_mm": "held out, mm",
}  # fmt: skip
NORMAL = 2.576
"""Of the intervals of shares, which are Wilson's."""


def costs_table(table: CostTable) -> Table:
    """A row a cost: in how many comparisons it is better and worse than the image, and by how much."""
    columns = (
        Column("minimised", is_number=False), Column("what it is", is_number=False), Column("surely better"),
        Column("surely worse"), Column("of"), *(Column(title) for title in TITLES.values()),
    )  # fmt: skip
    rows = []
    for name in table.costs:
        found = table.compared(name)
        better, worse = sum(one.is_better for one in found), sum(one.is_worse for one in found)
        ratios = [[one.ratio for one in found if one.measure == measure] for measure in MEASURES]
        medians = [float(np.median(of_measure)) if of_measure else math.nan for of_measure in ratios]
        rows.append((
            Cell(name), Cell(COSTS[name].title if name in COSTS else "distances in the image, by their covariances"),
            Cell(str(better), better, level="good" if better else None),
            Cell(str(worse), worse, level="bad" if worse else None), Cell(str(len(found)), len(found)),
            *(text_cell(value, f"{value:.3f}") for value in medians),
        ))  # fmt: skip
    note = (
        "Errors over those of the distances in the image, on the same sightings: below 1 is better. Numbers: medians "
        f"over scenes and conditions. Surely: the {SHARE:.0%} interval of the mean ratio says so."
    )
    return Table("Costs against the distances in the image", columns, tuple(rows), note)


def ratios_table(table: CostTable) -> Table:
    """Each measure of each scene: the image's error, and the others' over it."""
    columns = (
        Column("scene", is_number=False), Column("condition", is_number=False), Column("error", is_number=False),
        Column("image"), *(Column(name) for name in table.costs), Column("sets"),
    )  # fmt: skip
    rows = []
    for scene, condition in table.keys:
        for measure, title in TITLES.items():
            image = table.of(scene, condition, "image", measure)
            if image is None:
                continue
            others = (table.of(scene, condition, name, measure) for name in table.costs)
            rows.append((
                Cell(scene), Cell(condition), Cell(title), Cell(figure(image.median, 3), image.median),
                *map(_ratio_cell, others), Cell(str(image.sets), image.sets),
            ))  # fmt: skip
    note = (
        f"Image: the median error. Others: the mean ratio to it in the same set with its {SHARE:.0%} interval. "
        f"{REAL.capitalize()}: a set is what one part of the photos says of the others' camera."
    )
    return Table("Errors over the image's", columns, tuple(rows), note, visible_rows=20)


def _ratio_cell(one: CostRatio | None) -> Cell:
    if one is None or not math.isfinite(one.ratio):
        return NOT_KNOWN
    level: Level | None = "good" if one.is_better else "bad" if one.is_worse else None
    lost = f"; {one.failed} without" if one.failed else ""
    return Cell(f"{one.ratio:.3f} [{one.low:.3f}, {one.high:.3f}]{lost}", one.ratio, level=level)


def starts_table(table: CostTable) -> Table:
    """How many bad starts each cost stands."""
    columns = (
        Column("scene", is_number=False), Column("minimised", is_number=False), Column("starts"),
        Column("reach the least value"), Column("this, not the image"), Column("the image, not this"),
        Column("steps"),
    )  # fmt: skip
    rows = tuple(
        (
            Cell(one.scene), Cell(one.cost), Cell(str(one.starts), one.starts),
            Cell(share_text(one), one.share), Cell(str(one.only_this), one.only_this),
            Cell(str(one.only_image), one.only_image), text_cell(one.steps, f"{one.steps:.0f}"),
        )
        for one in table.starts
    )  # fmt: skip
    note = (
        "Focal lengths off by up to 3 times either way, no lens, each pose turned by up to 60 degrees about any axis; "
        "one descent of Levenberg and Marquardt, as the solver has it, without its own starts."
    )
    return Table("Bad starts", columns, rows, note, visible_rows=18)


def share_text(one: StartRow) -> str:
    """A share with the interval of Wilson 1927."""
    if not one.starts:
        return "-"
    n, z = one.starts, NORMAL
    middle = (one.share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(one.share * (1 - one.share) / n + z * z / (4 * n * n))
    return f"{100 * one.share:.0f} % [{100 * (middle - half):.0f}, {100 * (middle + half):.0f}]"


FIGURE = "costs"
COLOURS = (GREY, BLUE, GREEN, VERMILION, ORANGE, INK)
MARKS = ("o", "s", "D", "^", "v", "x")
ROW_PX, ABOVE_PX = 52, 260
SPREAD = 0.72
"""Of a row's height, what its marks take."""
FAR, NEAR = (0.5, 4.0), (0.8, 1.25)
LIMITS = {"camera_px": FAR, "pose_mm": FAR, "held_out_px": NEAR, "held_out_mm": NEAR}
"""Of the ratios that are drawn in full; those beyond lie at the edge."""
TICKS, FINE = (0.5, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.5, 2, 3, 4), (0.8, 0.9, 1.1, 1.2)


def height_px(table: CostTable) -> int:
    """A row a scene and condition."""
    return ABOVE_PX + ROW_PX * max(len(table.keys), 4)


def draw_costs(page: "Figure", table: CostTable) -> None:
    """A panel a measure: a row a scene and condition, a mark a cost."""
    every = page.subplots(1, len(TITLES), sharey=True)
    for axes, measure in zip(every, TITLES, strict=True):
        _panel(axes, table, measure)
    if not table.keys:
        return
    every[0].set_yticks(range(len(table.keys)), [f"{scene}\n{condition}" for scene, condition in table.keys])
    every[0].set_ylim(len(table.keys) - 0.5, -0.5)
    handles, labels = every[0].get_legend_handles_labels()
    for axes in every[1:]:
        more = axes.get_legend_handles_labels()
        if len(more[1]) > len(labels):
            handles, labels = more
    page.legend(handles, labels, loc="outside upper left", ncols=len(labels) or 1, frameon=False)


def _panel(axes: "Axes", table: CostTable, measure: str) -> None:
    """Ratios on a logarithmic scale, left of the line better than the image."""
    drawn, (least, most) = False, LIMITS[measure]
    names = table.costs
    for number, name in enumerate(names):
        rows = [(place, table.of(*key, name, measure)) for place, key in enumerate(table.keys)]
        known = [(place, one) for place, one in rows if one is not None and one.ratio > 0]
        if not known:
            continue
        drawn = True
        shift = SPREAD * ((number + 0.5) / len(names) - 0.5)
        x = [min(max(one.ratio, least), most) for _, one in known]
        low = [at - min(max(one.low, least), at) for at, (_, one) in zip(x, known, strict=True)]
        high = [max(min(one.high, most), at) - at for at, (_, one) in zip(x, known, strict=True)]
        axes.errorbar(
            x, [place + shift for place, _ in known], xerr=[low, high], fmt=MARKS[number % len(MARKS)],
            color=COLOURS[number % len(COLOURS)], markersize=5, linewidth=1.2, label=name,
        )  # fmt: skip
    open_axes(axes, "times the image's error" if drawn else "", "")
    axes.set_title(TITLES[measure])
    if not drawn:
        nothing(axes, "nothing to compare")
        return
    axes.axvline(1.0, color=INK, linewidth=1.0)
    for place in range(1, len(table.keys)):
        axes.axhline(place - 0.5, color=EMPTY, linewidth=0.8)
    axes.set_xscale("log")
    margin = (most / least) ** 0.03
    axes.set_xlim(least / margin, most * margin)
    shown = [tick for tick in TICKS if LIMITS[measure] == NEAR or tick not in FINE]
    log_axis(axes.xaxis, shown)
