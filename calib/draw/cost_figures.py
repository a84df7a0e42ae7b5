"""The picture of a study of costs: each cost's errors over the image's, with intervals."""

from typing import TYPE_CHECKING

from calib.draw.cost_tables import TITLES
from calib.draw.style import BLUE, EMPTY, GREEN, GREY, INK, ORANGE, VERMILION, nothing
from calib.studies.cost.results import CostTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

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
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
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
    axes.xaxis.set_major_locator(FixedLocator(shown))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("times the image's error")
