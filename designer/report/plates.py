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
    folds = ((one.title, _steps(design, one, files)) for one in sorted(SLICERS, key=lambda one: one.title != first))
    return tuple(Fold(title, (steps,)) for title, steps in folds if steps is not None)


def _steps(design: Design, slicer: Slicer, files: Sequence[str]) -> Steps | None:
    """From the files to the printer; None: there are none for it."""
    printing, slot = design.job.printing, slicer.slot
    project, first = f"{design.job.name}.{slicer.project}", f"{design.job.name}.plate-1.{slicer.package}"
    is_project = project in files
    if not is_project and first not in files:
        return None
    one_by_one = f"open {first}, later the other plates, each as a project of its own"
    opening = (slicer.choose, f"{capital(one_by_one)}. {slicer.opened}")
    if is_project:
        opening = _opening_project(design, project, one_by_one if first in files else "write --formats 3mf and open it")
    tower = "it stands there" if is_project else "put it there"
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    return Steps((
        *opening,
        f"{capital(slot)} 1 is {body}, {slot} 2 is {ink}, of one material.",
        "If it asks whether objects of equal height are parts of one object: no. What has ink is an object with two "
        "parts, body and ink; what has none, an object with one.",
        f"Look at the object list: body in {slot} 1 and ink in {slot} 2 in every object with ink. If a number differs, "
        "set it on the part, not on the object.",
        f"Don't arrange: the plate is full, and the free corner or strip is the prime tower's: {tower}. A piece "
        "may be moved; don't turn any: the axes of calib measure are then not the printer's.",
        f"Set the values of the table above. {slicer.purge}".strip(),
        f"Slice, and look at the preview by {slicer.preview}: on plates with ink every ring whole, and one filament "
        "only above the ink; all others in one filament.",
    ))  # fmt: skip


def _opening_project(design: Design, project: str, instead: str) -> tuple[str, str]:
    """One file for all of them, and what to do if it is not taken for one."""
    presets = design.job.printing.printer.presets
    assert presets is not None  # noqa: S101 - else there is no project
    return (
        f"Open {project} as a project (File, Open Project): it holds the {len(design.plates)} plates, named and "
        f"locked, with the pieces in place. It asks for the presets {presets.printer}, {presets.process} and "
        f"{presets.filament}, unchanged, and for the plate type {presets.plate_type}: put your own filaments and plate "
        "in their place.",
        "This file keeps to the rules in the published sources of both programs; it was not opened in the programs "
        "themselves. Compare with the pictures of the plates before you slice. If there is but one plate, or a notice "
        f"says that only geometry is loaded, {instead}.",
    )
