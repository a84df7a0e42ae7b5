"""The tables of the page of a comparison."""

from calib.core.number_text import figure
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, PLAIN_DRAWN
from calib.studies.compare.comparison_file import AloneRow, CaseRow, ComparisonFile
from calib.studies.compare.objects import OBJECTS
from calib.studies.compare.results import NEAR, REACH, short
from designer.page.blocks import Cell, Column, Level, Table

NOT_KNOWN = Cell("-")
MOST_ROWS = 600
LENSES = {
    LENS_DRAWN: "smooth lens, target as drawn", LENS_MADE: "smooth lens, target as made",
    PLAIN_DRAWN: "no distortion, target as drawn",
}  # fmt: skip
MADE_AS = {one.name: one.errors for one in OBJECTS}
PAPER_WORDS = {one.name: one.intersection_text for one in OBJECTS}


def median_cell(found: CaseRow | None, factor: float = 1.0, digits: int = 3) -> Cell:
    """A median and between what 95 % of the prints lie."""
    if found is None or found.median is None:
        return NOT_KNOWN
    text = figure(factor * found.median, digits)
    if found.prints > 1 and found.low is not None and found.high is not None:
        text += f" [{figure(factor * found.low, digits)}, {figure(factor * found.high, digits)}]"
    return Cell(text, factor * found.median)


def objects_table(table: ComparisonFile) -> Table:
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
        bad = 0 if inter is None else inter.without_camera + inter.not_converged
        rows.append((
            Cell(name), Cell(MADE_AS.get(name, "-")), Cell(model), median_cell(inter), _paper(inter, is_text=True),
            median_cell(recon), _paper(recon), median_cell(repro),
            NOT_KNOWN if inter is None else Cell(str(inter.samples), inter.samples),
            Cell(str(bad), bad, level="usable" if bad else None),
        ))  # fmt: skip
    note = (
        "Median over prints of the median of a print's sets of photos; in brackets what 95 % of the prints lie between."
    )
    return Table("The paper's objects, simulated", columns, tuple(rows[:MOST_ROWS]), note, visible_rows=16)


def _paper(found: CaseRow | None, *, is_text: bool = False) -> Cell:
    if found is None or found.paper is None:
        return NOT_KNOWN
    text = PAPER_WORDS.get(found.object, "") if is_text else ""
    return Cell(text or f"{found.paper:g}", found.paper)


def lens_table(table: ComparisonFile) -> Table:
    """Camera models behind a lens that no Brown model fits, in photos held out too."""
    columns = (
        Column("lens and target", is_number=False), Column("object", is_number=False),
        Column("camera model", is_number=False), Column("intersection [mm]"), Column("held out [mm]"),
        Column("reprojection [px]"), Column("held out [px]"), Column("image with rays [%]"),
    )  # fmt: skip
    rows = [
        (
            Cell(LENSES.get(part, part)), Cell(name), Cell(model),
            *(median_cell(table.of(name, part, model, metric))
              for metric in ("intersection", "held_intersection", "reprojection", "held_reprojection")),
            median_cell(table.of(name, part, model, "image_share"), 100.0, 2),
        )
        for name, part, model in table.keys(LENS_DRAWN, LENS_MADE, PLAIN_DRAWN)
    ]  # fmt: skip
    note = "Held out: photos that the camera was not solved from."
    return Table("A lens that no Brown model fits", columns, tuple(rows[:MOST_ROWS]), note, visible_rows=22)


def alone_table(table: ComparisonFile) -> Table:
    """Single errors scaled until the intersection error is the paper's."""
    columns = (
        Column("object", is_number=False), Column("error", is_number=False), Column("amount it takes"),
        Column("times the template's"), Column("reconstruction [mm]"), Column("paper [mm]"),
        Column("reprojection [px]"), Column("explains both", is_number=False),
    )  # fmt: skip
    rows = tuple(_alone_row(one) for one in table.alone)
    note = (
        f"Yes: the reconstruction error is within {100 * NEAR:.0f} % of the paper's too, at no more than {REACH:g} "
        "times what is assumed of such prints."
    )
    return Table(
        "Single errors that give the paper's intersection error", columns, rows[:MOST_ROWS], note, visible_rows=20
    )


def _alone_row(one: AloneRow) -> tuple[Cell, ...]:
    names = Cell(one.object), Cell(one.source.replace("_", " "))
    paper = one.paper_reconstruction_mm
    theirs = NOT_KNOWN if paper is None else Cell(f"{paper:g}", paper)
    if not one.prints or one.multiple is None or one.reconstruction_mm is None:
        return (*names, *[NOT_KNOWN] * 3, theirs, NOT_KNOWN, Cell(one.why or "-"))
    ends = ", ".join(short(end) for end in (one.multiple_low, one.multiple_high) if end is not None)
    times = Cell(f"{short(one.multiple)}" + (f" [{ends}]" if ends else ""), one.multiple)
    word, level = explains(one)
    reprojection = one.reprojection_px
    return (
        *names, Cell(one.amount or "-", one.multiple), times,
        Cell(figure(one.reconstruction_mm, 2), one.reconstruction_mm), theirs,
        NOT_KNOWN if reprojection is None else Cell(figure(reprojection, 2), reprojection), Cell(word, level=level),
    )  # fmt: skip


def explains(one: AloneRow) -> tuple[str, Level]:
    """Whether an error gives both of the paper's numbers."""
    paper = one.paper_reconstruction_mm
    if not paper or one.reconstruction_mm is None or abs(one.reconstruction_mm / paper - 1) > NEAR:
        return "no", "bad"
    if one.multiple is None or one.multiple > REACH:
        return "beyond reach", "usable"
    return "yes", "good"
