"""How to print a two-filament target in each slicer, and how to make the others: plain steps with numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from designer.base.units import NO_SKEW, SCALE_BAR_MM, format_skew
from designer.kinds.layout import adjacent_faces
from designer.make.bed import bed_from_target, overhang, printed_corners_mm
from designer.make.printability import COUNT
from designer.page.blocks import Block, Cell, Column, Fold, Leaf, Paragraph, Steps, Table
from designer.produce import Design
from designer.spec.spec import PrinterProfile, PrintSpec

DENSITY_G_PER_CM3 = 1.24
"""PLA, as the tables of filament makers and slicers have it."""
DIAMETER_MM = 1.75
INK_FILL = 0.93
"""Ink laid down over ink in the model: 0.91 to 0.95 in G-code (`tests/designer/test_design_report.py`)."""
INFILL_FILL = 0.93
"""Infill laid down over the percentage asked for, in the inside of solids sliced with gyroid or grid."""
PURGE_G_PER_CHANGE = 0.16
"""On a single nozzle: 120 g in the 757 changes of an icosahedron of edge 100 mm. Slicers differ by several times."""
SPREAD = 0.1
"""By how much slicers, at these settings, differ from this model: up to 6 % in PrusaSlicer."""
_SAME_NORMAL = 1e-6
_LAST_BITS = 1e-9


@dataclass(frozen=True)
class Shells:
    """The slicer's settings that decide on filament."""

    walls: int = 3
    bottom_layers: int = 4
    top_layers: int = 5
    infill: float = 0.15

    @property
    def text(self) -> str:
        """In words."""
        return (
            f"{self.walls} walls, {self.bottom_layers} solid layers at the bottom and {self.top_layers} at the top, "
            f"{100 * self.infill:g} % infill"
        )


@dataclass(frozen=True)
class FilamentAmount:
    """Filament of one slot."""

    volume_mm3: float

    @property
    def mass_g(self) -> float:
        """Of PLA."""
        return self.volume_mm3 / 1000 * DENSITY_G_PER_CM3

    @property
    def length_m(self) -> float:
        """Of filament of 1.75 mm."""
        return self.volume_mm3 / (math.pi / 4 * DIAMETER_MM**2) / 1000

    @property
    def mass_text(self) -> str:
        """The range within which slicers agree."""
        return f"{_range_text(self.mass_g)} g"

    @property
    def length_text(self) -> str:
        """The same in metres."""
        return f"{_range_text(self.length_m)} m"


def two_digits(value: float) -> str:
    """`120`: an estimate has no more digits."""
    return f"{float(f'{value:.2g}'):g}"


def _range_text(value: float) -> str:
    """`30-37`: the value's range, rounded outwards to two digits, or three of those above 100."""
    low, high = value * (1 - SPREAD), value * (1 + SPREAD)
    digits = 1 - math.floor(math.log10(high)) if high < 100 else 2 - math.floor(math.log10(high))
    step = 10.0**-digits
    shown = max(digits, 0)
    # A bound that is a round number but for its last bit stays what it is.
    down, up = math.floor(low / step + _LAST_BITS), math.ceil(high / step - _LAST_BITS)
    return f"{step * down:.{shown}f}-{step * up:.{shown}f}"


@dataclass(frozen=True)
class Filament:
    """Expected filament of a print, without what the printer purges, and without the stand."""

    shells: Shells
    body: FilamentAmount
    ink: FilamentAmount | None  # None: one filament
    changes: int  # of the filament
    inked_layers: int

    @property
    def total_g(self) -> float:
        """Weight of the print."""
        return self.body.mass_g + (self.ink.mass_g if self.ink else 0.0)

    @property
    def purge_g(self) -> float:
        """On a single nozzle, with the usual purge of a change."""
        return PURGE_G_PER_CHANGE * self.changes


def expected_filament(design: Design, shells: Shells | None = None) -> Filament:
    """What the part of a design takes in a slicer with these settings."""
    shells = Shells() if shells is None else shells
    body_mm3, part = design.part.body.volume_mm3, design.part
    core_mm3 = _core_mm3(design, shells)
    body = FilamentAmount(max(body_mm3 - core_mm3, 0.0) + INFILL_FILL * shells.infill * min(core_mm3, body_mm3))
    if part.ink is None:
        return Filament(shells, body, None, 0, 0)
    layers = inked_layers(design)
    # Within a layer the printer begins with the filament that it ended the last one with: one change a layer.
    last = 0 if layers >= _all_layers(design) else 1
    return Filament(shells, body, FilamentAmount(INK_FILL * part.ink.volume_mm3), layers + last, layers)


def inked_layers(design: Design) -> int:
    """How many layers hold ink."""
    ink = design.part.ink
    if ink is None:
        return 0
    height = ink.vertices_mm @ bed_from_target(design.target, design.job.printing)[2, :3]
    return round(float(np.ptp(height)) / design.job.printing.printer.layer_height_mm)


def _all_layers(design: Design) -> int:
    height = design.part.body.vertices_mm @ bed_from_target(design.target, design.job.printing)[2, :3]
    return round(float(np.ptp(height)) / design.job.printing.printer.layer_height_mm)


def _core_mm3(design: Design, shells: Shells) -> float:
    """The volume that is filled sparsely: the solid with its faces moved in."""
    printing = design.job.printing
    corners = printed_corners_mm(design.target, printing)
    up = bed_from_target(design.target, printing)[2, :3]
    core = Manifold.hull_points(corners)
    for normal in _normals(design):
        has_ink = printing.is_two_filament and _is_face(design, normal)
        inset = _inset_mm(float(normal @ up), printing.printer, shells, printing.inlay_mm if has_ink else 0.0)
        core = core.trim_by_plane(tuple((-normal).tolist()), inset - float((corners @ normal).max()))
    return max(float(core.volume()), 0.0)


def _normals(design: Design) -> NDArray[np.float64]:
    """Outward normals of all faces, of a board also of its sides and its back.  # (N, 3)"""
    if design.job.target.solid is None:
        return np.concatenate([np.eye(3), -np.eye(3)])
    return design.target.target_from_face[:, :3, 2]


def _is_face(design: Design, normal: NDArray[np.float64]) -> bool:
    """Whether a normal is that of a face with a pattern."""
    return bool((design.target.target_from_face[:, :3, 2] @ normal > 1 - _SAME_NORMAL).any())


def _inset_mm(upwards: float, printer: PrinterProfile, shells: Shells, inlay_mm: float) -> float:
    """How deep a face's shell is, normal to it.

    Args:
        upwards: cosine of the angle between the face's normal and the bed's.
        printer: gives line width and layer height.
        shells: the slicer's settings.
        inlay_mm: depth of the ink; 0 for none.
    """
    layer, line = printer.layer_height_mm, printer.line_width_mm
    # Lines have round sides and overlap by them: the spacing of the slicers' flow mathematics.
    spacing = line - layer * (1 - math.pi / 4)
    walls = line + (shells.walls - 1) * spacing
    sine = math.sqrt(max(1 - upwards**2, 0.0))
    layers = shells.top_layers if upwards > 0 else shells.bottom_layers
    return max(walls * sine + inlay_mm, layers * layer * abs(upwards))


_COLOUR_NAMES = {"#ffffff": "white", "#000000": "black"}
BODY_SLOT, INK_SLOT = 1, 2


@dataclass(frozen=True)
class Slicer:
    """A slicer: what it is called, which file it reads, and what to do in it."""

    title: str
    file: str
    steps: tuple[str, ...]


def colour_words(colour: str) -> str:
    """`white (#ffffff)`; only the code where a colour has no plain name."""
    name = _COLOUR_NAMES.get(colour)
    return f"{name} ({colour})" if name else colour


def slicer_folds(design: Design, files: Sequence[str]) -> tuple[Fold, ...]:
    """One fold for each slicer whose file is in the folder, that of the printer open and first."""
    first = usual_slicer(design.job.printing.printer)
    slicers = [slicer for slicer in _slicers(design) if slicer.file in files]
    ordered = sorted(slicers, key=lambda slicer: slicer.title != first)
    return tuple(Fold(s.title, (Steps(s.steps),), is_open=number == 0) for number, s in enumerate(ordered))


def usual_slicer(printer: PrinterProfile) -> str:
    """The title of the slicer that comes with a printer."""
    name = printer.name.lower()
    if "prusa" in name:
        return "PrusaSlicer"
    return "Cura" if "ultimaker" in name else "Bambu Studio, OrcaSlicer"


def _slicers(design: Design) -> tuple[Slicer, ...]:
    """All slicers that the two packages are made for."""
    name, printing = design.job.name, design.job.printing
    body, ink = colour_words(printing.body_colour), colour_words(printing.ink_colour)
    tower = _tower_words(design)
    bambu = Slicer(
        "Bambu Studio, OrcaSlicer",
        f"{name}.bambu.3mf",
        (
            f"Choose the printer and its {printing.printer.nozzle_mm:g} mm nozzle. Put two filaments of one material "
            f"in the list: {BODY_SLOT} is {body}, {INK_SLOT} is {ink}.",
            f"Open {name}.bambu.3mf. A notice that the file is not from Bambu Lab and only geometry is loaded is "
            "right: the settings are yours. If Bambu Studio asks for colours, give each colour its filament.",
            f"Look at the object list: one object with two parts, body in filament {BODY_SLOT} and ink in filament "
            f"{INK_SLOT}. If they differ, set the numbers there. Don't print two separate objects: open the file "
            "as a whole.",
            "Set layer height, line width, walls and infill as in the table above; supports and ironing off.",
            "Flushing volumes: let them be computed from the two colours. White after black needs several times as "
            "much as black after white; too little greys the white. Leave 'flush into objects' infill' off: dark "
            "infill shows through a white wall.",
            tower,
            "Slice, and look at the preview by filament: every ring whole, no ink elsewhere. On a Bambu Lab printer, "
            "give each filament its AMS slot before you send it.",
        ),
    )
    prusa = Slicer(
        "PrusaSlicer",
        f"{name}.prusa.3mf",
        (
            "Choose a printer with two filaments or more: an MMU or XL profile. With a profile of one filament "
            "PrusaSlicer prints everything in that one, without a word.",
            f"Filament {BODY_SLOT} is {body}, filament {INK_SLOT} is {ink}, of one material.",
            f"Open {name}.prusa.3mf. It holds no settings, only the part; a notice about that is right.",
            f"Look at the object list: one object with two parts, body in extruder {BODY_SLOT} and ink in extruder "
            f"{INK_SLOT}. The bambu.3mf falls into two objects in PrusaSlicer: don't take that one.",
            "Set layer height and first layer height, extrusion widths, perimeters and infill as in the table above; "
            "supports and ironing off.",
            f"{tower} On an MMU, check the purging volumes: white after black needs the most.",
            "Slice, and look at the preview by tool: every ring whole, no ink elsewhere.",
        ),
    )
    cura = Slicer(
        "Cura",
        f"{name}.bambu.3mf",
        (
            f"Choose a printer with two extruders. Extruder {BODY_SLOT} gets {body}, extruder {INK_SLOT} {ink}, of one "
            "material.",
            f"Open {name}.bambu.3mf: it carries Cura's extruder numbers too. The two parts come as one group: don't "
            "ungroup them.",
            f"Ctrl-click a part to select it alone: body must be in extruder {BODY_SLOT}, ink in extruder {INK_SLOT}.",
            "Set layer height and initial layer height, line width, wall count and infill as in the table above; "
            "supports and ironing off.",
            tower,
            "Slice, and look at the preview by material colour: every ring whole, no ink elsewhere.",
        ),
    )
    return bambu, prusa, cura


def _tower_words(design: Design) -> str:
    if not design.target.is_planar:
        return "Prime tower on. It grows as high as the part, since every layer changes the filament: leave it room."
    return "Prime tower on: only the first layers change the filament."


def print_settings(design: Design, shells: Shells) -> tuple[Leaf, ...]:
    """What holds in every slicer."""
    printing, printer = design.job.printing, design.job.printing.printer
    ink_layers = printing.inlay_mm / printer.layer_height_mm
    depth = f"the ink is {printing.inlay_mm:g} mm deep, {ink_layers:.3g} layers of a flat face"
    rows = [
        ("printer", f"{printer.name}, nozzle {printer.nozzle_mm:g} mm"),
        ("how it lies", _lying(design)),
        ("filament 1", f"body, {colour_words(printing.body_colour)}"),
        ("filament 2", f"ink, {colour_words(printing.ink_colour)}"),
        ("surface", "matt for both: on glossy plastic lamps are mirrored, and glare hides the edges of rings"),
        ("layer height", f"{printer.layer_height_mm:g} mm, the first layer too: {depth}"),
        ("line width", f"{printer.line_width_mm:g} mm: the design rules above were held to it"),
        ("walls, infill", f"{shells.text}; not critical, the filament below is for these"),
        ("supports", _supports(design)),
        ("brim", _brim(design)),
        ("ironing", "off: it drags ink over white"),
        ("outline", _outline_words(printing)),
        ("size", _scale_words(printing)),
        ("turning", _turn_words(printing)),
        ("temperature", "as the filament's maker says; nothing in the design depends on it"),
    ]
    columns = (Column("setting", is_number=False), Column("value", is_number=False))
    cells = tuple((Cell(name), Cell(value)) for name, value in rows)
    return (Table("Settings in every slicer", columns, cells, visible_rows=len(rows)),)


def _lying(design: Design) -> str:
    if not design.target.is_planar:
        return f"as the file has it: face {design.target.face_count - 1} down"
    return "as the file has it: the printed side down, so that ink is in the first layers and the bed makes it flat"


def _supports(design: Design) -> str:
    over = overhang(design.target, design.job.printing)
    if over is None:
        return "off: nothing overhangs"
    count, slope = over
    return (
        f"off: the steepest overhang rises at {math.degrees(slope):.1f} deg from the bed. Put them on if your printer "
        f"cannot do that; they scar the {COUNT[count]} faces beside the lowest"
    )


def _brim(design: Design) -> str:
    if not design.target.is_planar:
        return "if the part comes loose: it stands on one face; cut it off flush, or it adds to the caliper's lengths"
    return "worth it on a large board: corners that lift bend the plate; cut it off flush"


def _outline_words(printing: PrintSpec) -> str:
    offset = f"this design has {printing.ink_offset_mm:+g} mm" if printing.ink_offset_mm else "this design has none"
    return (
        "elephant-foot and XY compensation of the slicer move the outline, not the ink; leave XY at 0. Ink that "
        f"bleeds is corrected with --ink-offset ({offset})"
    )


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
    inside = printing.sticker_thickness_mm
    if printing.skew_compensation_rad != NO_SKEW:
        lay = f"{_turn_words(printing)}."
    else:
        lay = "Lay it on any of its faces ('place on face', 'lay flat'); without ink all of them are alike."
    body = Steps((
        f"Open {job.name}.body.stl in your slicer; any one filament, matt. It is {inside:g} mm smaller on every face "
        "than the finished target, the thickness of a sticker.",
        lay,
        f"{_scale_words(printing)}.",
        f"Layer height {printing.printer.layer_height_mm:g} mm, {Shells().text}; ironing off. Remove blobs and seams: "
        "a sticker over them is not flat.",
    ))  # fmt: skip
    beside = adjacent_faces(design.target)[0].tolist()
    glue = (
        f"A triangle outside a sticker points at its code corner; 'FACE 0' is its number, 'joins {beside[0]}' names "
        "the face across that edge.",
        f"Glue face 0 on any face, its border along the {COUNT[len(beside)]} edges. Then go on with those that it "
        f"joins: the edge marked 'joins {beside[0]}' of face 0 meets the edge marked 'joins 0' of face {beside[0]}.",
        "Rub each down from the middle outwards: bubbles and folds are errors of the target.",
        "Compare with the picture of the net before the glue sets: a face in another's place, or turned, does not fit "
        "the target file, and calib leaves it out.",
    )
    return (
        Fold("1. The body", (body,), is_open=True),
        Fold("2. The sheets", (Steps(_sheet_steps(design)), *sheets), is_open=True),
        Fold("3. Glue by numbers", (Steps(glue),), is_open=True),
    )


def _sheet_steps(design: Design) -> tuple[str, ...]:
    name, printing = design.job.name, design.job.printing
    bar = f"{SCALE_BAR_MM:g} mm"
    return (
        f"Print {name}.pdf at 100 %, 'actual size', never 'fit to page', on matt label stock "
        f"{printing.sticker_thickness_mm:g} mm thick, {len(design.pages)} "
        f"page{'s' if len(design.pages) > 1 else ''} of {design.job.page}.",
        f"Measure the scale bar of every sheet: {bar}. Off by more than 0.1 mm (0.1 %): mend the printer's scale and "
        "print again; a ruler is good enough to find 'fit to page', a caliper finds the rest.",
        "Cut along the thin line with knife and ruler; the marks at the corners show where to lay the ruler.",
    )


def sheet_blocks(design: Design) -> tuple[Block, ...]:
    """Artwork for a print shop."""
    name = design.job.name
    shop = (
        f"Send {name}.pdf, or {name}.svg to shops that cut: vector shapes at true size, to be printed at 100 %, not "
        "scaled and not traced. Magenta lines are the cut, everything else is ink.",
        "Matt surface, no gloss laminate: mirrored lamps hide rings. Deep black on white.",
        "Carrier: a stiff flat plate, such as aluminium composite of 3 mm or more, or glass. Printing straight on the "
        "plate leaves out glue and bubbles.",
        f"Measure the scale bar when it comes: {SCALE_BAR_MM:g} mm. Measure along both directions of the board: "
        "carriage and feed of a printer are driven apart, so both can be off by different amounts.",
        "Keep it flat: hold it by its edges, store it lying.",
    )
    plate = Paragraph(
        f"{name}.body.stl is the bare plate, for those who want to print a carrier; printed plates warp, so a bought "
        "plate is better."
    )
    return (Steps(shop), plate)
