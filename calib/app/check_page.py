"""How a check of cameras is told: the verdict with its numbers, residuals by the file, and earlier checks."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calib.app.check_history import history_figures
from designer.base.words import capital, figure, printable
from designer.page.blocks import Block, Facts, Figure, Finding, Findings, Headline, Level, Page, Section
from designer.page.folders import Shown, notes, table_of

if TYPE_CHECKING:
    from calib.app.check import CameraCheck, Change

MOST_FIGURES, MOST_NAMED = 4, 6


def check_page(found: "CameraCheck", *, is_drawn: bool) -> Page:
    """The verdict first."""
    level: Level = {"yes": "good", "no": "bad", "cannot say": "usable"}[found.verdict]  # type: ignore[assignment]
    chance = f"p {'< 1e-6' if found.p < 1e-6 else f'= {figure(found.p, 2)}'}, an alarm below {found.false_alarms:g}"
    chance = f" ({chance})" if math.isfinite(found.p) else ""
    headline = Headline(level, found.verdict, f"{capital(found.reason)}{chance}.")
    named = f": {', '.join(map(printable, found.photos[:MOST_NAMED]))}" if found.photos else ""
    more = len(found.photos) - MOST_NAMED
    facts = Facts((
        ("checked", printable(found.checked)),
        ("photos", f"{len(found.photos)} counted{named}{f' and {more} more' if more > 0 else ''}"),
    ))  # fmt: skip
    blocks = list[Block]()
    of = {(one.camera, one.what): one for one in found.changes}
    if found.changes:
        columns = [Shown[str]("camera", printable)]
        for what in dict.fromkeys(one.what for one in found.changes):
            columns.append(Shown[str](what, partial(_cell, of, what, is_least=False)))
            columns.append(Shown[str]("seen from", partial(_cell, of, what, is_least=True)))
        note = "Each change as if it were the only one; seen from: found with 95 %."
        blocks.append(table_of(dict.fromkeys(one.camera for one in found.changes), *columns, note=note))
    if found.left_out:
        rows = [Finding("note", printable(one.frame), f"left out: {printable(one.reason)}") for one in found.left_out]
        blocks.append(Findings(tuple(rows)))
    figures = _figures(found) if is_drawn else []
    return Page(
        "", "", headline, (Section("What the photos say", (*blocks, *notes(found.remarks), *figures)),), lead=(facts,)
    )  # fmt: skip


def _cell(of: "Mapping[tuple[str, str], Change]", what: str, camera: str, *, is_least: bool) -> str:
    one = of.get((camera, what))
    if one is None or not math.isfinite(one.visible if is_least else one.size_sigma):
        return "not told"
    return f"{figure(one.visible, 2)} {one.unit}" if is_least else one.text


def _figures(found: "CameraCheck") -> list[Figure]:
    """Residuals by the cameras of the file, and earlier checks."""
    from calib.draw.fields import residuals_drawing
    from calib.draw.style import figure_of
    from calib.solver.metrics.residual_cells import Residuals

    figures = list[Figure]()
    names = list(dict.fromkeys(one.camera for one in found.changes))
    if found.test is not None:
        each = zip(found.image_sizes, found.test.center_px, found.test.residual_px, strict=True)
        for name, (size, place, off) in zip(names, [one for one in each if len(one[1])][:MOST_FIGURES], strict=False):
            residuals = Residuals(size, place, off, np.zeros((0, 2)))
            drawing = residuals_drawing(residuals, float(np.sqrt((off**2).sum(axis=1).mean())))
            title = f"{printable(name)}: residuals by the file" if len(names) > 1 else "Residuals by the file"
            figures.append(figure_of(replace(drawing, title=title)))
    return [*figures, *history_figures(found.history)]
