"""How to print in two filaments: the settings, the steps in the printer's own slicer, and what differs in others."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from designer.base.units import NO_SKEW, format_skew
from designer.builds.design import Design
from designer.formats.folder import OutputFile
from designer.make.bed import overhang, printed_size_mm
from designer.make.printability import count_words
from designer.page.blocks import Block, Fold, Paragraph, Steps, Table, text_table
from designer.spec.machine import BRIM_MM, Shells
from designer.spec.spec import PrinterProfile, PrintSpec

_COLOUR_NAMES = {"#ffffff": "white", "#000000": "black"}
BODY_SLOT, INK_SLOT = 1, 2


@dataclass(frozen=True)
class Slicer:
    """A slicer that reads one of the two packages, and what is special about it."""

    title: str
    package: str  # suffix of the file that it reads
    slot: str  # what it calls the place of a filament
    choose: str  # the printer
    mind: str  # said when the file is open, and of its object list
    purge: str
    preview: str  # by what to look at it
    project: str = ""  # suffix of the file of all plates that it reads; "": it reads none


SLICERS = (
    Slicer(
        "Bambu Studio, OrcaSlicer", "bambu.3mf", "filament",
        "the printer and its nozzle, two filaments in the list",
        "That only geometry is loaded is right. As a whole, not as two objects.",
        "Flushing volumes from the colours; flush into objects' infill off: dark infill shows through.",
        "filament", "bambu-orca.3mf",
    ),
    Slicer(
        "PrusaSlicer", "prusa.3mf", "extruder",
        "your own printer, MMU or XL: its start and changes are not in the file; with one filament all is of that, "
        "without a word",
        "Don't take the bambu.3mf, which falls into two objects.",
        "On an MMU check purging volumes: white after black needs most.",
        "tool",
    ),
    Slicer(
        "Cura", "bambu.3mf", "extruder", "two extruders",
        "The parts are one group: don't ungroup; Ctrl-click selects one.", "", "material colour",
    ),
)  # fmt: skip


def colour_words(colour: str) -> str:
    """`white (#ffffff)`; only the code where a colour has no plain name."""
    name = _COLOUR_NAMES.get(colour)
    return f"{name} ({colour})" if name else colour


def usual_slicer(printer: PrinterProfile) -> str:
    """The title of the slicer that comes with a printer."""
    name = printer.name.lower()
    if "prusa" in name:
        return "PrusaSlicer"
    return "Cura" if "ultimaker" in name else "Bambu Studio, OrcaSlicer"


def slicer_folds(design: Design, files: Sequence[OutputFile]) -> tuple[Block, ...]:
    """The steps in the printer's own slicer, and what differs in those others whose files are in the folder."""
    first, names = usual_slicer(design.job.printing.printer), {file.name for file in files}
    there = [
        (one, opened) for one in sorted(SLICERS, key=lambda one: one.title != first)
        if (opened := _file_of(design, one, names))
    ]  # fmt: skip
    if not there:
        return ()
    (own, opened), *others = there
    rows = tuple(
        Paragraph(
            f"{one.title}: {name}; {one.choose}. {one.mind} {one.purge} Slots: {one.slot}; preview by {one.preview}."
        )
        for one, name in others
    )
    steps = Fold(f"In {own.title}", (_steps(design, own, opened, names),), is_open=True)
    if not rows:
        return (steps,)
    return (steps, Fold(f"In {' and '.join(one.title for one, _ in others)}", rows))


def _file_of(design: Design, slicer: Slicer, names: set[str]) -> str:
    """The file to open first; "": there is none for it."""
    stem = f"{design.job.name}.plate-1" if design.job.printing.way.is_in_parts else design.job.name
    wanted = (f"{design.job.name}.{slicer.project}", f"{stem}.{slicer.package}")
    return next((name for name in wanted if name in names), "")


def _steps(design: Design, slicer: Slicer, opened: str, names: set[str]) -> Steps:
    """From the file to the preview."""
    printing, slot, is_plates = design.job.printing, slicer.slot, design.job.printing.way.is_in_parts
    is_project = bool(slicer.project) and printing.printer.presets is not None
    has_settings = is_project or slicer.package == "prusa.3mf"
    opening: tuple[str, ...] = (f"Open {opened}{', then the other plates, each alone' * is_plates}. {slicer.mind}",)
    if is_project:
        opening = _opening_project(design, slicer, opened, names)
    choosing = () if is_project else (f"Choose {slicer.choose}.",)
    objects = f"one object, body in {slot} {BODY_SLOT}, ink in {slot} {INK_SLOT}"
    if is_plates:
        there = "" if is_project else ", put it there"
        objects = f"what has ink has its body in {slot} {BODY_SLOT}, its ink in {slot} {INK_SLOT}"
        tower = (
            f"Don't arrange or turn pieces: the free corner or strip is the prime tower's{there}. "
            "Objects of equal height are not parts of one."
        )
    elif design.target.has_back:
        tower = "Prime tower on: it grows as high as the part, as the last layers change filament, too."
    elif design.target.is_plate:
        tower = "Prime tower on: only the first layers change filament."
    else:
        tower = "Prime tower on, with room: it grows as high as the part."
    if not is_plates and design.plates[0].tower_area is None:
        tower = "The bed has no room for a prime tower beside the part: a larger bed, or colours bleed at the changes."
    values = "The table's values are in the file." if has_settings else "Set the table's values."
    return Steps((
        *((*opening, *choosing) if has_settings else (*choosing, *opening)),
        f"Object list: {objects}; else set that on its parts.",
        tower if is_project else f"{values} {tower} {slicer.purge}".strip(),
        f"Slice; preview by {slicer.preview}: every mark whole, no ink elsewhere.",
    ))  # fmt: skip


def _opening_project(design: Design, slicer: Slicer, project: str, names: set[str]) -> tuple[str, ...]:
    """A file with its settings, of all plates where there are several, and what to do if it is not taken for one."""
    presets, first = design.job.printing.printer.presets, f"{design.job.name}.plate-1.{slicer.package}"
    assert presets is not None  # noqa: S101 - else there is no project
    plates, instead = "", "set the table's values"
    if project.endswith(slicer.project):
        plates = f"{len(design.plates)} plates, "
        instead = f"open {first} and the others one by one" if first in names else "write --formats 3mf and open it"
    return (
        f"Open {project} as a project: {plates}{presets.printer}, {presets.process}, {presets.filament}, "
        f"{presets.plate_type}, and the table's values: put your own filaments and plate in.",
        "Tried in neither program: compare with the "
        f"{'pictures' if plates else 'table'}; if there is {'but one plate, or ' if plates else ''}only geometry, "
        f"{instead}.",
    )


def print_settings(design: Design, shells: Shells, how_it_lies: str, outline: str = "") -> Table:
    """What holds in every slicer.

    Args:
        design: in two filaments.
        shells: walls and infill.
        how_it_lies: on the bed, and why.
        outline: what more to know of the outline's compensation.
    """
    printing, printer = design.job.printing, design.job.printing.printer
    ink_layers = printing.inlay_mm / printer.layer_height_mm
    supports, over = "off", None
    brim = "only if it comes loose; cut it off flush"
    if printing.way.is_in_parts:
        brim = "off, if pieces hold: it is in the neighbour's way"
    else:
        over = overhang(design.target, printing)
        if design.target.is_plate:
            brim = "worth it if corners lift; cut it off flush"
        if printer.place_mm(printed_size_mm(design.target, printing)[:2], BRIM_MM) is None:
            brim = f"off: one of {BRIM_MM:g} mm has no room on this bed"
    if over is not None:
        supports = (
            f"off: overhangs of {math.degrees(over[1]):.1f} deg print without; they scar the "
            f"{count_words(over[0])} faces beside the lowest"
        )
    said = f"{ink_layers:.3g} layer{'s' * (ink_layers != 1)}"
    two = f"1 body, {colour_words(printing.body_colour)}; 2 ink, {colour_words(printing.ink_colour)}"
    if printing.way.ink == "raised":
        two = f"first {colour_words(printing.body_colour)}, then {colour_words(printing.ink_colour)}"
    if printing.way.ink == "recessed":
        two = f"{colour_words(printing.body_colour)} alone"
    offset = f"{printing.ink_offset_mm:+g} mm" if printing.ink_offset_mm else "none"
    rows = {
        "printer": f"{printer.name}, nozzle {printer.nozzle_mm:g} mm, lines {printer.line_width_mm:g} mm",
        "how it lies": how_it_lies,
        "filaments": f"{two}; one material, dry, matt: glare hides marks",
        "layer height": f"{printer.layer_height_mm:g} mm, the first too; ink {said}",
        "walls, infill": shells.words(layers_of(design)),
        "supports": supports,
        "brim": brim,
        "ironing": "off: it drags ink over white",
        "outline": f"XY and elephant-foot compensation 0; against bleed --ink-offset (here {offset}){outline}",
        "size": f"{scale_words(printing)}; {turn_words(printing)}",
    }
    return text_table("Settings", ("setting", "value"), rows.items(), visible_rows=len(rows))


def layers_of(design: Design) -> float:
    """How many layers a plate has; a solid has more than its shells."""
    printer = design.job.printing.printer
    return round(design.job.target.depth_mm * design.scale / printer.layer_height_mm, 3)


def scale_words(printing: PrintSpec) -> str:
    """What is done about shrinkage, and where."""
    percent = printing.shrink_compensation_percent
    if percent:
        return f"100 %: files are {percent:+g} % against the design already"
    return "100 %"


def turn_words(printing: PrintSpec) -> str:
    """Why a part lies as it lies."""
    if printing.skew_compensation_rad != NO_SKEW:
        skew = format_skew(printing.skew_compensation_rad)
        return f"don't turn or mirror it: files are sheared against {skew} as they lie"
    return "don't turn it, or tell calib measure by --bed-turn"
