"""What each error costs, as bars: a panel for each main quantity, a row for each source."""

from typing import TYPE_CHECKING

import numpy as np

from calib.core.number_text import figure
from calib.figures.style import BLUE, INK, VERMILION, note
from calib.studies.tolerance.figure_parts import heading, open_sides, source_title
from calib.studies.tolerance.quantities import quantity_row
from calib.studies.tolerance.report import MAIN, ToleranceReport, of_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
HEAD_PX, PANEL_PX, ROW_PX = 120, 125, 28
ROOM = 1.28
TITLES = {
    "reprojection": "Reprojection",
    "intersection": "Intersection, drawing",
    "reconstruction": "Reconstruction, drawing",
    "intersection_true": "Intersection, true shape",
    "reconstruction_true": "Reconstruction, true shape",
    "pose": "Camera's centre",
    "focal_length": "Focal length",
    "distortion_map": "Camera where seen",
}


def ranking_height_px(report: ToleranceReport) -> int:
    """As high as a row a source needs."""
    return HEAD_PX + 2 * (PANEL_PX + ROW_PX * (len(report.ranking) + 1))


def draw_ranking(page: "Figure", report: ToleranceReport) -> None:
    """Bars of the costs with 95 % intervals, all together, and what noise alone gives.

    Args:
        page: an empty figure.
        report: with one source that has an effect, or more.
    """
    axes = page.subplots(-(-len(MAIN) // COLUMNS), COLUMNS, sharey=True)
    for place, name in zip(axes.ravel(), MAIN, strict=True):
        _draw_panel(place, report, name)
    names = [*(source_title(report.table.errors, name) for name in report.ranking), "all together"]
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].invert_yaxis()
    kind = "predicted" if report.table.kind == "linear" else f"{report.table.draws} draws, whiskers 95 %"
    heading(page, f"What each error adds to the errors of a calibration: {report.name}, {kind}")
    page.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)


def _draw_panel(axes: "Axes", report: ToleranceReport, name: str) -> None:
    table, one, row = report.table, of_name(name), quantity_row(name)
    places = [table.sources.index(source) for source in report.ranking]
    ends = [
        np.append(getattr(table.cost, end)[places, row], getattr(table.together, end)[row])
        for end in ("low", "value", "high")
    ]
    low, value, high = (np.nan_to_num(end) for end in ends)
    at = np.arange(len(value))
    noise = float(table.baseline.value[row])
    axes.barh(at[:-1], value[:-1], color=BLUE, height=0.66, label="one error alone")
    axes.barh(at[-1:], value[-1:], color=INK, height=0.66, label="all together")
    axes.axvline(noise, color=VERMILION, linewidth=1.8, linestyle="--", label="noise alone")
    if table.kind == "draws":
        spread = np.stack([value - np.minimum(low, value), np.maximum(high, value) - value])
        axes.errorbar(value, at, xerr=spread, linestyle="", color="#7f7f7f", capsize=3, linewidth=1.4)
    for y, (bar, end) in enumerate(zip(value, high, strict=True)):
        text = f"< {figure(max(float(end), 0.1 * noise), 2)}" if bar < 0.1 * noise else figure(float(bar), 2)
        axes.annotate(
            "0" if end == 0 else text, (max(bar, end, noise), y), (5, 0), textcoords="offset points", fontsize=10,
            va="center",
        )  # fmt: skip
    axes.set_xlim(0, ROOM * max(float(high.max()), noise))
    axes.locator_params(axis="x", nbins=4)
    axes.tick_params(axis="y", length=0)
    axes.set_title(TITLES[name])
    axes.set_xlabel(one.unit)
    note(axes, f"noise alone {figure(noise, 2)} {one.unit}")
    open_sides(axes)
