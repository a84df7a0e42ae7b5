"""How to print a two-filament target in each slicer, and how to make the others."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from designer.base.units import NO_SKEW, SCALE_BAR_MM, format_skew
from designer.base.words import capital
from designer.kinds.layout import adjacent_faces
from designer.make.bed import overhang, printed_size_mm
from designer.make.printability import COUNT
from designer.page.blocks import Block, Fold, Leaf, Paragraph, Steps, text_table
from designer.produce import Design
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
    opened: str  # said when the file is open
    trap: str  # of its object list
    purge: str
    preview: str  # by what to look at it
    project: str = ""  # suffix of the file of all plates that it reads; "": it reads none


SLICERS = (
    Slicer(
        "Bambu Studio, OrcaSlicer",
        "bambu.3mf",
        "filament",
        "Choose the printer and its nozzle, and put two filaments in the list.",
        "A notice that the file is not from Bambu Lab and only geometry is loaded is right: the settings are yours. If "
        "Bambu Studio asks for colours, give each colour its filament.",
        "Don't print two separate objects: open the file as a whole.",
        "Flushing volumes: let them be computed from the two colours; white after black needs several times as much as "
        "black after white. Leave 'flush into objects' infill' off: dark infill shows through a white wall.",
        "filament",
        "bambu-orca.3mf",
    ),
    Slicer(
        "PrusaSlicer",
        "prusa.3mf",
        "extruder",
        "Choose a printer with two filaments or more: an MMU or XL profile. With a profile of one filament PrusaSlicer "
        "prints everything in that one, without a word.",
        "It holds no settings, only the part; a notice about that is right.",
        "The bambu.3mf falls into two objects in PrusaSlicer: don't take that one.",
        "On an MMU, check the purging volumes: white after black needs the most.",
        "tool",
    ),
    Slicer(
        "Cura",
        "bambu.3mf",
        "extruder",
        "Choose a printer with two extruders.",
        "It carries Cura's extruder numbers too.",
        "The two parts come as one group: don't ungroup them; Ctrl-click selects one alone.",
        "",
        "material colour",
    ),
)


def colour_words(colour: str) -> str:
    """`white (#ffffff)`; only the code where a colour has no plain name."""
    name = _COLOUR_NAMES.get(colour)
    return f"{name} ({colour})" if name else colour


def slicer_folds(design: Design, files: Sequence[str]) -> tuple[Fold, ...]:
    """One fold for each slicer whose file is in the folder, that of the printer open and first."""
    first = usual_slicer(design.job.printing.printer)
    there = [one for one in SLICERS if f"{design.job.name}.{one.package}" in files]
    ordered = sorted(there, key=lambda one: one.title != first)
    return tuple(Fold(one.title, (_slicer_steps(design, one),), is_open=n == 0) for n, one in enumerate(ordered))


def usual_slicer(printer: PrinterProfile) -> str:
    """The title of the slicer that comes with a printer."""
    name = printer.name.lower()
    if "prusa" in name:
        return "PrusaSlicer"
    return "Cura" if "ultimaker" in name else "Bambu Studio, OrcaSlicer"


def _slicer_steps(design: Design, slicer: Slicer) -> Steps:
    """From the file to the preview."""
    printing, slot = design.job.printing, slicer.slot
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    tower = "Prime tower on: only the first layers change the filament."
    if design.target.has_back:
        tower = (
            "Prime tower on: only the first and the last layers change the filament, so it grows as high as the part."
        )
    elif not design.target.is_plate:
        tower = "Prime tower on. It grows as high as the part, since every layer changes the filament: leave it room."
    return Steps((
        slicer.choose,
        f"{capital(slot)} {BODY_SLOT} is {body}, {slot} {INK_SLOT} is {ink}, of one material.",
        f"Open {design.job.name}.{slicer.package}. {slicer.opened}",
        f"Look at the object list: one object with two parts, body in {slot} {BODY_SLOT} and ink in {slot} {INK_SLOT}; "
        f"if they differ, set the numbers there. {slicer.trap}",
        "Set layer height, the first one's too, line width, walls and infill as in the table above; supports and "
        "ironing off.",
        f"{tower} {slicer.purge}".strip(),
        f"Slice, and look at the preview by {slicer.preview}: every ring whole, no ink elsewhere.",
    ))  # fmt: skip


def print_settings(design: Design, shells: Shells) -> tuple[Leaf, ...]:
    """What holds in every slicer."""
    printing, printer = design.job.printing, design.job.printing.printer
    ink_layers = printing.inlay_mm / printer.layer_height_mm
    lying = f"as the file has it: face {design.target.face_count - 1} down"
    brim = "if the part comes loose: it stands on one face; cut it off flush, or it adds to the caliper's lengths"
    if design.target.is_plate:
        lying = (
            "as the file has it: the printed side down, so that ink is in the first layers and the bed makes it flat"
        )
        if not design.target.is_planar:
            lying = (
                "as the file has it: the back (face 1) down, its ink in the first layers, and the front's in the last "
                "ones; the back comes out as flat and as glossy as the bed, the front shows the lines of the top layer"
            )
        brim = "worth it if corners lift and bend the plate; cut it off flush"
    if printer.place_mm(printed_size_mm(design.target, printing)[:2], BRIM_MM) is None:
        brim = f"off: one of {BRIM_MM:g} mm has no room around the part on this bed"
    supports, over = "off: nothing overhangs", overhang(design.target, printing)
    if over is not None:
        supports = (
            f"off: the steepest overhang rises at {math.degrees(over[1]):.1f} deg from the bed. Put them on if your "
            f"printer cannot do that; they scar the {COUNT[over[0]]} faces beside the lowest"
        )
    offset = f"this design has {printing.ink_offset_mm:+g} mm" if printing.ink_offset_mm else "this design has none"
    rows = {
        "printer": f"{printer.name}, nozzle {printer.nozzle_mm:g} mm",
        "how it lies": lying,
        "filament 1": f"body, {colour_words(printing.body_colour)}",
        "filament 2": f"ink, {colour_words(printing.ink_colour)}",
        "surface": "matt for both: on glossy plastic lamps are mirrored, and glare hides the edges of rings",
        "layer height": f"{printer.layer_height_mm:g} mm, the first layer too: the ink is {printing.inlay_mm:g} mm "
        f"deep, {ink_layers:.3g} layer{'s' * (ink_layers != 1)} of a flat face",
        "line width": f"{printer.line_width_mm:g} mm: the design rules above were held to it",
        "walls, infill": f"{shells.words(layers_of(design))}; not critical, the filament above is for these",
        "supports": supports,
        "brim": brim,
        "ironing": "off: it drags ink over white",
        "outline": "elephant-foot and XY compensation of the slicer move the outline, not the ink; leave XY at 0. Ink "
        f"that bleeds is corrected with --ink-offset ({offset})",
        "size": _scale_words(printing),
        "turning": _turn_words(printing),
    }
    return (text_table("Settings in every slicer", ("setting", "value"), rows.items(), visible_rows=len(rows)),)


def layers_of(design: Design) -> float:
    """How many layers a plate has; a solid has more than its shells."""
    printer = design.job.printing.printer
    return round(design.job.target.depth_mm * design.scale / printer.layer_height_mm, 3)


def _scale_words(printing: PrintSpec) -> str:
    percent = printing.shrink_compensation_percent
    if percent:
        return f"100 %: the files are already {percent:+g} % against the design, for shrinkage; don't scale again"
    return "100 %: don't scale in the slicer; a known shrinkage goes into --shrink-compensation, which keeps a record"


def _turn_words(printing: PrintSpec) -> str:
    if printing.skew_compensation_rad != NO_SKEW:
        skew = format_skew(printing.skew_compensation_rad)
        return f"don't turn or mirror it: the files are sheared against {skew} of this printer's axes as they lie"
    return "don't turn it on the bed: else the axes of calib measure are not the printer's (or say --bed-turn to it)"


def sticker_blocks(design: Design, sheets: tuple[Leaf, ...]) -> tuple[Block, ...]:
    """A body in one filament, and sheets to glue on; `sheets` shows them."""
    job, printing = design.job, design.job.printing
    lay = "It lies on a face, as it is printed; any other does as well, since without ink all of them are alike."
    if printing.skew_compensation_rad != NO_SKEW:
        lay = f"{_turn_words(printing)}."
    body = Steps((
        f"Open {job.name}.body.stl in your slicer; any one filament, matt. It is {printing.sticker_thickness_mm:g} mm "
        "smaller on every face than the finished target, the thickness of a sticker.",
        lay,
        f"{_scale_words(printing)}.",
        f"Layer height {printing.printer.layer_height_mm:g} mm, {Shells().words()}; ironing off. Remove blobs and "
        "seams: a sticker over them is not flat.",
    ))  # fmt: skip
    pages = f"{len(design.pages)} page{'s' if len(design.pages) > 1 else ''} of {job.page}"
    sheet_steps = Steps((
        f"Print {job.name}.pdf at 100 %, 'actual size', never 'fit to page', on matt label stock "
        f"{printing.sticker_thickness_mm:g} mm thick, {pages}.",
        f"Measure the scale bar of every sheet: {SCALE_BAR_MM:g} mm. Off by more than 0.1 mm (0.1 %): mend the "
        "printer's scale and print again.",
        "Cut along the thin line with knife and ruler; the marks at the corners show where to lay the ruler.",
    ))  # fmt: skip
    beside = adjacent_faces(design.target)[0].tolist()
    glue = Steps((
        f"A triangle outside a sticker points at its code corner; 'FACE 0' is its number, 'joins {beside[0]}' names "
        "the face across that edge.",
        f"Glue face 0 on any face, its border along the {COUNT[len(beside)]} edges. Then go on with those that it "
        f"joins: the edge marked 'joins {beside[0]}' of face 0 meets the edge marked 'joins 0' of face {beside[0]}.",
        "Rub each down from the middle outwards: bubbles and folds are errors of the target.",
        "Compare with the picture of the net before the glue sets: a face in another's place, or turned, does not fit "
        "the target file, and calib leaves it out.",
    ))  # fmt: skip
    return (
        Fold("1. The body", (body,), is_open=True),
        Fold("2. The sheets", (sheet_steps, *sheets), is_open=True),
        Fold("3. Glue by numbers", (glue,), is_open=True),
    )


def sheet_blocks(design: Design) -> tuple[Block, ...]:
    """Artwork for a print shop."""
    name = design.job.name
    shop = Steps((
        f"Send {name}.pdf, or {name}.svg to shops that cut: vector shapes at true size, to be printed at 100 %, not "
        "scaled and not traced. Magenta lines are the cut, everything else is ink.",
        "Matt surface, no gloss laminate: mirrored lamps hide rings. Deep black on white.",
        "Carrier: a stiff flat plate, such as aluminium composite of 3 mm or more, or glass. Printing straight on the "
        "plate leaves out glue and bubbles.",
        f"Measure the scale bar when it comes: {SCALE_BAR_MM:g} mm. Measure along both directions of the board: "
        "carriage and feed of a printer are driven apart, so both can be off by different amounts.",
        "Keep it flat: hold it by its edges, store it lying.",
    ))  # fmt: skip
    plate = f"{name}.body.stl is the bare plate, to print a carrier; printed plates warp, so a bought plate is better."
    return (shop, Paragraph(plate))
