"""What lies on which plate, and how plates are opened in each slicer: of builds that are put together."""

from collections.abc import Sequence

from designer.base.words import capital
from designer.page.blocks import Fold, Steps, Table, text_table
from designer.produce import Design
from designer.report.costs import grams
from designer.report.making import SLICERS, Slicer, colour_words, usual_slicer


def plate_table(design: Design) -> Table:
    """What is on which plate, and its weight; hours and changes are told once, with the costs."""
    rows = []
    for plate, takes in zip(design.plates, design.estimate.plates, strict=True):
        filaments = "1 and 2" if plate.is_two_filament else "1"
        weight = grams(takes.body_g * (1 + takes.ink_mm3 / takes.body_mm3))
        rows.append((plate.name.replace("-", " "), plate.words, filaments, weight))
    heads = ("plate", "holds", "filaments", "weight")
    return text_table("Plates, in this order", heads, rows, visible_rows=20)


def plate_folds(design: Design, files: Sequence[str]) -> tuple[Fold, ...]:
    """A fold for each slicer, that of the printer first."""
    first = usual_slicer(design.job.printing.printer)
    there = [one for one in SLICERS if f"{design.job.name}.{design.plates[0].name}.{one.package}" in files]
    return tuple(Fold(one.title, (_steps(design, one),)) for one in sorted(there, key=lambda one: one.title != first))


def _steps(design: Design, slicer: Slicer) -> Steps:
    """From the files to the printer."""
    printing, slot = design.job.printing, slicer.slot
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    return Steps((
        slicer.choose,
        f"{capital(slot)} 1 is {body}, {slot} 2 is {ink}, of one material.",
        f"Open {design.job.name}.plate-1.{slicer.package}, later the other plates, each as a project of its own. "
        f"{slicer.opened}",
        "If it asks whether objects of equal height are parts of one object: no. What has ink is an object with two "
        "parts, body and ink; what has none, an object with one.",
        f"Look at the object list: body in {slot} 1 and ink in {slot} 2 in every object with ink. If a number differs, "
        "set it on the part, not on the object.",
        "Don't arrange: the plate is full, and the free corner or strip is the prime tower's: put it there. A piece "
        "may be moved; don't turn any: the axes of calib measure are then not the printer's.",
        f"Set the values of the table above. {slicer.purge}".strip(),
        f"Slice, and look at the preview by {slicer.preview}: every ring whole; above the ink one filament only.",
    ))  # fmt: skip
