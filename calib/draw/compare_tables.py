"""The tables of a comparison, for page, terminal and Markdown."""

import math

from calib.draw.study_tables import NOT_KNOWN, text_cell
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN
from calib.studies.compare.objects import OBJECTS
from calib.studies.compare.results import NEAR, REACH, CaseRow, ComparisonTable, Explanation, short
from designer.base.number_text import figure
from designer.page.blocks import Cell, Column, Level, Table

LENSES = {
    LENS_DRAWN: "smooth lens, target as drawn", LENS_MADE: "smooth lens, target as made",
    PLAIN_DRAWN: "no distortion, target as drawn",
}  # fmt: skip
OBJECT_OF = {one.name: one for one in OBJECTS}


def median_cell(found: CaseRow | None, factor: float = 1.0, digits: int = 3) -> Cell:
    """A median and between what 95 % of the prints lie."""
    if found is None:
        return NOT_KNOWN
    text = figure(factor * found.median, digits)
    if found.prints > 1:
        text += f" [{figure(factor * found.low, digits)}, {figure(factor * found.high, digits)}]"
    return Cell(text, factor * found.median)


def objects_table(table: ComparisonTable) -> Table:
    """The paper's figure: objects, camera models and errors."""
    columns = (
        Column("object", is_number=False), Column("made as", is_number=False), Column("camera model", is_number=False),
        Column("intersection [mm]"), Column("paper [mm]"), Column("reconstruction [mm]"), Column("paper [mm]"),
        Column("reprojection [px]"), Column("sets"), Column("not converged"),
    )  # fmt: skip
    rows = []
    for name, part, model in table.keys(FIGURE):
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


def _paper(found: CaseRow | None, text: str = "") -> Cell:
    """The paper's median, as it prints it."""
    return NOT_KNOWN if found is None else text_cell(found.paper, text or f"{found.paper:g}")


def lens_table(table: ComparisonTable) -> Table:
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
        for name, part, model in table.keys(LENS_DRAWN, LENS_MADE, PLAIN_DRAWN)
    )  # fmt: skip
    note = "Held out: photos that the camera was not solved from."
    return Table("A lens that no Brown model fits", columns, rows, note, visible_rows=22)


def alone_table(table: ComparisonTable) -> Table:
    """Single errors scaled until the intersection error is the paper's."""
    columns = (
        Column("object", is_number=False), Column("error", is_number=False), Column("amount it takes"),
        Column("times the template's"), Column("reconstruction [mm]"), Column("paper [mm]"),
        Column("reprojection [px]"), Column("explains both", is_number=False),
    )  # fmt: skip
    rows = tuple(map(_alone_row, table.alone))
    note = (
        f"Yes: the reconstruction error is within {100 * NEAR:.0f} % of the paper's too, at no more than {REACH:g} "
        "times what is assumed of such prints."
    )
    return Table("Single errors that give the paper's intersection error", columns, rows, note, visible_rows=20)


def _alone_row(one: Explanation) -> tuple[Cell, ...]:
    names = Cell(one.object), Cell(one.source.replace("_", " "))
    theirs = text_cell(one.paper_reconstruction_mm, f"{one.paper_reconstruction_mm:g}")
    if not one.prints or math.isnan(one.multiple):
        return (*names, *[NOT_KNOWN] * 3, theirs, NOT_KNOWN, Cell(one.why or "-"))
    times = f"{short(one.multiple)} [{short(one.multiple_low)}, {short(one.multiple_high)}]"
    word, level = explains(one)
    return (
        *names, Cell(one.amount or "-", one.multiple), Cell(times, one.multiple),
        Cell(figure(one.reconstruction_mm, 2), one.reconstruction_mm), theirs,
        Cell(figure(one.reprojection_px, 2), one.reprojection_px), Cell(word, level=level),
    )  # fmt: skip


def explains(one: Explanation) -> tuple[str, Level]:
    """Whether an error gives both of the paper's numbers."""
    if not one.fits:
        return "no", "bad"
    return ("yes", "good") if one.is_within_reach else ("beyond reach", "usable")
