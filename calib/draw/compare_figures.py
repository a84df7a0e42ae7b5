"""The pictures of a comparison: boxes of each object's errors, and which single error gives the paper's numbers.

The tables of a comparison, for page, terminal and Markdown.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.study_tables import NOT_KNOWN, text_cell
from calib.draw.style import BLUE, EMPTY, GREEN, GREY, INK, ORANGE, VERMILION, log_axis, note, nothing, open_axes
from calib.studies.compare import cases as compared
from calib.studies.compare.prints import ALL_PHOTOS
from calib.studies.compare.scene import MODELS, OBJECTS, PaperObject
from designer.base.words import figure
from designer.page.blocks import Cell, Column, Level, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = dict(zip((*MODELS, ALL_PHOTOS), (BLUE, ORANGE, GREEN, VERMILION), strict=True))
WIDTH = 0.24
PAPER_LABEL, PAPER_LINE = "the paper's median", (0, (3, 1.5))
BOXES_PX, ALONE_PX = 860, 1150
PLATE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1}
ROOM = 1.37
"""To the right of the largest value, for words."""


def draw_boxes(page: "Figure", results: compared.Results) -> None:
    """A panel a metric: five objects, three models, all sets of all prints; the paper's medians beside."""
    every = page.subplots(1, 3)
    for axes, metric in zip(every, ("intersection", "reconstruction", "reprojection"), strict=True):
        groups = [
            (f"{one.label}\n{one.name}", [results.of(one.name, compared.FIGURE, model) for model in MODELS])
            for one in OBJECTS
        ]
        _panel(axes, metric, groups)
        axes.set_title(f"{metric.capitalize()} error against the drawing")
        for place, one in enumerate(OBJECTS):
            value = one.median(metric)
            if math.isfinite(value):
                text = one.intersection_text if metric == "intersection" else f"{value:g}"
                ends = [place - 0.42, place + 0.42]
                axes.plot(ends, [value, value], color=INK, linewidth=2.2, linestyle=PAPER_LINE)
                axes.annotate(
                    f"paper {text}", (place, value), (0, 6), textcoords="offset points", ha="center", fontsize=10,
                    color=INK,
                )  # fmt: skip
        if metric == "reprojection":
            text = "the paper's text gives no numbers"
            axes.text(0.98, 0.97, text, ha="right", transform=axes.transAxes, fontsize=11, color=GREY)
    plan = results.table.plan
    _head(
        page,
        f"Five objects, three models: {plan.prints} simulated prints of each, {plan.sets} sets of photos a print",
        f"Camera {plan.camera}. Boxes: quartiles of all sets of all prints; whiskers: 95 % of them. "
        f"virtual: {plan.slow_sets} of the sets a print.",
    )
    _legend(page, MODELS, paper=True)


def draw_lens(page: "Figure", results: compared.Results) -> None:
    """A lens that no Brown model fits: errors in photos solved and held out, of perfect and of made objects."""
    every = page.subplots(1, 3)
    titles = {
        "held_reprojection": "Reprojection error, photos held out",
        "intersection": "Intersection error, photos solved",
        "held_intersection": "Intersection error, photos held out",
    }
    errors = {one.name: one.errors for one in OBJECTS}
    parts = [(name, part) for name in compared.LENS_OBJECTS for part in (compared.LENS_DRAWN, compared.LENS_MADE)]
    for axes, (metric, title) in zip(every, titles.items(), strict=True):
        groups = []
        for name, part in parts:
            made = "as drawn" if part == compared.LENS_DRAWN else errors[name]
            groups.append((f"{name}\n{made}", [results.of(name, part, model) for model in COLOURS]))
        _panel(axes, metric, groups)
        axes.set_title(title)
    _head(
        page,
        "A smooth lens that no Brown polynomial fits (phase-one-spline)",
        "Boxes: quartiles of all sets of all prints; whiskers: 95 % of them. Left of each pair the object as drawn, "
        "right as made.",
    )
    _legend(page, tuple(COLOURS), paper=False)


def _panel(axes: "Axes", metric: str, groups: Sequence[tuple[str, Sequence[compared.CaseResult | None]]]) -> None:
    """Boxes side by side in groups, on a logarithmic scale."""
    drawn = False
    for place, (_, cases) in enumerate(groups):
        shown = [one for one in cases if one is not None and len(one.flat(metric))]
        width = min(WIDTH, 0.84 / max(len(shown), 1))
        for number, one in enumerate(shown):
            drawn = True
            where = place + (number - 0.5 * (len(shown) - 1)) * width
            _box(axes, one, metric, where, 0.8 * width)
    open_axes(axes, "", "" if not drawn else f"RMSE in {compared.METRICS[metric]}")
    if not drawn:
        nothing(axes, "no samples yet")
        return
    axes.set_yscale("log")
    axes.set_xticks(range(len(groups)), [label for label, _ in groups])
    axes.tick_params(axis="x", length=0, labelsize=10)
    axes.set_xlim(-0.6, len(groups) - 0.4)
    for place in range(1, len(groups)):
        axes.axvline(place - 0.5, color=EMPTY, linewidth=0.8)
    log_axis(axes.yaxis)
    axes.grid(visible=True, which="major", axis="y", color=EMPTY, linewidth=0.8)
    axes.set_axisbelow(True)


def _box(axes: "Axes", one: compared.CaseResult, metric: str, where: float, width: float) -> None:
    colour = COLOURS[one.model]
    axes.boxplot(
        one.flat(metric), positions=[where], widths=width, whis=(2.5, 97.5), showfliers=False, patch_artist=True,
        manage_ticks=False, boxprops={"facecolor": colour, "alpha": 0.75, "edgecolor": INK, "linewidth": 0.8},
        medianprops={"color": INK, "linewidth": 1.8}, whiskerprops={"color": INK, "linewidth": 1.0},
        capprops={"color": INK, "linewidth": 1.0},
    )  # fmt: skip
    # The median again: boxes may be too flat to show their colour.
    axes.plot(
        where, np.median(one.flat(metric)), marker="o", markersize=6, markerfacecolor=colour,
        markeredgecolor=INK, markeredgewidth=0.8, zorder=5,
    )  # fmt: skip


def _head(page: "Figure", title: str, under: str) -> None:
    page.suptitle(f"{title}\n{under}", fontsize=13, x=0.01, ha="left")


def _legend(page: "Figure", models: Sequence[str], *, paper: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Patch | Line2D] = [
        Patch(facecolor=COLOURS[name], alpha=0.75, edgecolor=INK, label=name) for name in models
    ]
    if paper:
        handles.append(Line2D([], [], color=INK, linewidth=2.2, linestyle=PAPER_LINE, label=PAPER_LABEL))
    page.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)


def draw_alone(page: "Figure", results: compared.Results) -> None:
    """Reconstruction error of each source where its intersection error is the paper's."""
    known = [one for one in OBJECTS if one.is_known]
    every = page.subplots(2, 2).ravel()
    for axes, one in zip(every, known, strict=True):
        found = [row for row in results.table.alone if row.object == one.name and row.prints]
        _alone_panel(axes, one, sorted(found, key=lambda row: -row.multiple))
    page.suptitle(
        "Each error scaled until it alone gives the paper's intersection error: what reconstruction error then?\n"
        f"Green: within {100 * compared.NEAR:.0f} % of the paper's (band); pale: more than {compared.REACH:g} times "
        "the template's. Beside: the amount it takes, and how many times the template's it is",
        fontsize=13, x=0.01, ha="left",
    )  # fmt: skip


def _alone_panel(axes: "Axes", one: PaperObject, rows: Sequence[compared.Explanation]) -> None:
    axes.set_title(f"{one.label} {one.name}")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    if not rows:
        nothing(axes, "no samples yet")
        return
    note(axes, f"paper: intersection {one.intersection_text} mm, reconstruction {one.reconstruction_mm:g} mm")
    low, high = ((1 + sign * compared.NEAR) * one.reconstruction_mm for sign in (-1, 1))
    axes.axvspan(low, high, color=EMPTY, linewidth=0, zorder=0)
    axes.axvline(one.reconstruction_mm, color=INK, linewidth=1.8, linestyle=(0, (3, 1.5)))
    for place, row in enumerate(rows):
        alpha = 0.85 if row.is_within_reach else 0.4
        axes.barh(place, row.reconstruction_mm, height=0.62, color=GREEN if row.fits else BLUE, alpha=alpha, zorder=2)
        times = f"{compared.short(row.multiple)} x"
        axes.annotate(
            f"{row.amount}, {times}" if row.amount else times, (row.reconstruction_mm, place), (6, 0),
            textcoords="offset points", va="center", fontsize=10, color=INK if row.fits else GREY, zorder=3, bbox=PLATE,
        )  # fmt: skip
    axes.set_yticks(range(len(rows)), [row.source.replace("_", " ") for row in rows])
    axes.tick_params(axis="y", length=0)
    largest = max(one.reconstruction_mm, *(row.reconstruction_mm for row in rows))
    axes.set_xlim(0, largest * ROOM)
    axes.set_xlabel("reconstruction error in mm")


LENSES = {
    compared.LENS_DRAWN: "smooth lens, target as drawn",
    compared.LENS_MADE: "smooth lens, target as made",
    compared.PLAIN_DRAWN: "no distortion, target as drawn",
}
OBJECT_OF = {one.name: one for one in OBJECTS}


def median_cell(found: compared.CaseRow | None, factor: float = 1.0, digits: int = 3) -> Cell:
    """A median and between what 95 % of the prints lie."""
    if found is None:
        return NOT_KNOWN
    text = figure(factor * found.median, digits)
    if found.prints > 1:
        text += f" [{figure(factor * found.low, digits)}, {figure(factor * found.high, digits)}]"
    return Cell(text, factor * found.median)


def objects_table(table: compared.ComparisonTable) -> Table:
    """The paper's figure: objects, camera models and errors."""
    columns = (
        Column("object", is_number=False), Column("made as", is_number=False), Column("camera model", is_number=False),
        Column("intersection [mm]"), Column("paper [mm]"), Column("reconstruction [mm]"), Column("paper [mm]"),
        Column("reprojection [px]"), Column("sets"), Column("not converged"),
    )  # fmt: skip
    rows = []
    for name, part, model in table.keys(compared.FIGURE):
        inter, recon, repro = (
            table.of(name, part, model, metric) for metric in ("intersection", "reconstruction", "reprojection")
        )
        one, bad = OBJECT_OF.get(name), 0 if inter is None else inter.without_camera + inter.not_converged
        rows.append((
            Cell(name), Cell("-" if one is None else one.errors), Cell(model), median_cell(inter),
            _paper(inter, "" if one is None else one.intersection_text), median_cell(recon), _paper(recon),
            median_cell(repro), NOT_KNOWN if inter is None else Cell(str(inter.samples), inter.samples),
            Cell(str(bad), bad, level="usable" if bad else None),
        ))  # fmt: skip
    note = (
        "Median over prints of the median of a print's sets of photos; in brackets what 95 % of the prints lie between."
    )
    return Table("The paper's objects, simulated", columns, tuple(rows), note, visible_rows=16)


def _paper(found: compared.CaseRow | None, text: str = "") -> Cell:
    """The paper's median, as it prints it."""
    return NOT_KNOWN if found is None else text_cell(found.paper, text or f"{found.paper:g}")


def lens_table(table: compared.ComparisonTable) -> Table:
    """Camera models behind a lens that no Brown model fits, in photos held out too."""
    columns = (
        Column("lens and target", is_number=False), Column("object", is_number=False),
        Column("camera model", is_number=False), Column("intersection [mm]"), Column("held out [mm]"),
        Column("reprojection [px]"), Column("held out [px]"), Column("held-out rings with rays [%]"),
        Column("image with rays [%]"),
    )  # fmt: skip
    metrics = ("intersection", "held_intersection", "reprojection", "held_reprojection")
    rows = tuple(
        (
            Cell(LENSES.get(part, part)), Cell(name), Cell(model),
            *(median_cell(table.of(name, part, model, metric)) for metric in metrics),
            *(median_cell(table.of(name, part, model, share), 100.0, 2) for share in ("held_share", "image_share")),
        )
        for name, part, model in table.keys(compared.LENS_DRAWN, compared.LENS_MADE, compared.PLAIN_DRAWN)
    )  # fmt: skip
    note = "Held out: photos that the camera was not solved from."
    return Table("A lens that no Brown model fits", columns, rows, note, visible_rows=22)


def alone_table(table: compared.ComparisonTable) -> Table:
    """Single errors scaled until the intersection error is the paper's."""
    columns = (
        Column("object", is_number=False), Column("error", is_number=False), Column("amount it takes"),
        Column("times the template's"), Column("reconstruction [mm]"), Column("paper [mm]"),
        Column("reprojection [px]"), Column("explains both", is_number=False),
    )  # fmt: skip
    rows = tuple(map(_alone_row, table.alone))
    note = (
        f"Yes: the reconstruction error is within {100 * compared.NEAR:.0f} % of the paper's too, at no more than "
        f"{compared.REACH:g} times what is assumed of such prints."
    )
    return Table("Single errors that give the paper's intersection error", columns, rows, note, visible_rows=20)


def _alone_row(one: compared.Explanation) -> tuple[Cell, ...]:
    names = Cell(one.object), Cell(one.source.replace("_", " "))
    theirs = text_cell(one.paper_reconstruction_mm, f"{one.paper_reconstruction_mm:g}")
    if not one.prints or math.isnan(one.multiple):
        return (*names, *[NOT_KNOWN] * 3, theirs, NOT_KNOWN, Cell(one.why or "-"))
    times = f"{compared.short(one.multiple)} [{compared.short(one.multiple_low)}, {compared.short(one.multiple_high)}]"
    word, level = explains(one)
    return (
        *names, Cell(one.amount or "-", one.multiple), Cell(times, one.multiple),
        Cell(figure(one.reconstruction_mm, 2), one.reconstruction_mm), theirs,
        Cell(figure(one.reprojection_px, 2), one.reprojection_px), Cell(word, level=level),
    )  # fmt: skip


def explains(one: compared.Explanation) -> tuple[str, Level]:
    """Whether an error gives both of the paper's numbers."""
    if not one.fits:
        return "no", "bad"
    return ("yes", "good") if one.is_within_reach else ("beyond reach", "usable")
