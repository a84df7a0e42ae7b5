"""How to photograph a print that tells of its printer, and what to type then, for a design's page."""

from designer.base.units import format_mm
from designer.kinds.presets import preset_names
from designer.page.blocks import Cell, Column, Command, Paragraph, Section, Steps, Table
from designer.produce import Design
from designer.report.measuring import READING, corner_rings, made_with, ring_to_ring_mm
from designer.spec.spec import Job

PICTURE, SCAN, PRINTER_FILE = "coupon.jpg", "scan.png", "my-printer.toml"
SCAN_DPI = 600
_CALIPER_MM = 0.03
"""Standard deviation of a distance between the rims of two rings. An assumption: twice what a caliper promises, as
its jaws are laid on by eye."""
_KEEP = f"--save {PRINTER_FILE}"


def photo_line(job: Job) -> str:
    """The command that follows when there is a photo."""
    return f"calib coupon {PICTURE}{_printed_with(job)} {_KEEP}"


def _printed_with(job: Job) -> str:
    """What calib has to know of the print, as options."""
    offset_mm = job.printing.ink_offset_mm
    ink = f" --ink-offset {format_mm(offset_mm)}" if offset_mm else ""
    name = job.printing.printer.name
    return f"{ink}{made_with(job.printing)}" + (f" --printer {name}" if name in preset_names("printers") else "")


def trial_sections(design: Design) -> tuple[Section, ...]:
    """The photo, the lengths that tell the size, and the commands."""
    pairs = _pairs(design)
    lengths = " ".join(f'--length "{name}:{READING}mm+-{_CALIPER_MM:g}mm"' for name, _ in pairs)
    printed_with = _printed_with(design.job)
    return (
        Section("Photo or scan", (
            Steps((
                "Let the print cool. Pattern up, flat on an even, dark or grey ground; tape an edge down that lifts.",
                "Squarely from above, within a few degrees, the print filling the picture; main camera, no portrait "
                "mode, no digital zoom.",
                "Even light, from a window for example: no lamp mirrored, no shadow of the hand.",
                "Sharp, and white not burnt out: tap on the print to focus, then turn the exposure down a little.",
                "The camera's own JPEG or PNG, without filter, crop, or a messenger in between.",
                "One is enough. Four, turned by a quarter between them, tell axes and skew better.",
            )),
            Table(
                "Lengths for the caliper", (Column("length", is_number=False), Column("design, mm")),
                tuple((Cell(name), Cell(f"{length_mm:.2f}", length_mm)) for name, length_mm in pairs),
                "From the left rim of one ring to the left rim of the other, or from lower rim to lower rim, so that "
                "bleed cancels. Any of them tell the size, all four also axes and skew, however the photo was taken. "
                "Rings count row by row from below, from the left, from 0, with the target id at the bottom. "
                "Nothing else in a photo tells the size; a scan does.",
            ),
        ), "Bleed, axes and skew come from the picture; the size from a caliper or a scanner."),
        Section("What it tells", (
            Command(
                f"calib coupon {PICTURE} {lengths}{printed_with} {_KEEP}",
                f"a photo, and readings in place of {READING}; without a --length all but the size",
            ),
            Command(
                f"calib coupon {SCAN} --dpi {SCAN_DPI}{printed_with} {_KEEP}",
                f"or a flatbed's scan at {SCAN_DPI} dpi; no caliper",
            ),
            Command(f"design ico --edge 100mm --printer {PRINTER_FILE}", "a target, printed with what was found"),
            Command(f"design make {design.job.name}.toml -o .", "all files of this folder again, byte for byte"),
            Paragraph(
                "Print the target with the same filaments, layers and speeds: bleed and scale are theirs too, not only "
                "the printer's."
            ),
        ), "Type the commands in this folder, with the picture in it."),
    )  # fmt: skip


def _pairs(design: Design) -> tuple[tuple[str, float], ...]:
    """The outermost rings along the lower and the left side, and across."""
    a, b, c, d = corner_rings(design.target)
    pairs = ((a, b), (a, d), (a, c), (b, d))
    return tuple((f"ring {one} to ring {other}", ring_to_ring_mm(design.target, one, other)) for one, other in pairs)
