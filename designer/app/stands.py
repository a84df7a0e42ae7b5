"""The page's section on the stand: how it carries the target, how it lies on the bed, and what it takes.

How to photograph a print that tells of its printer, and what to type then, for a design's page.
"""

from dataclasses import replace

import numpy as np

from designer.app.measuring import READING, corner_rings, made_with, ring_to_ring_mm
from designer.base.units import format_mm
from designer.builds.design import Design
from designer.builds.pictures import printed_scene
from designer.kinds.presets import preset_names
from designer.make.bed import Piece, Plate, bed_words
from designer.make.estimate import duration, estimate, grams
from designer.make.mesh import Part
from designer.make.stand import make_stand, stand_from_target
from designer.page.blocks import Cell, Column, Command, Facts, Paragraph, Section, Steps, Table, View3d
from designer.page.scene import Layer, Surface
from designer.spec.spec import Job

STAND_COLOUR = "#9aa1a9"


def stand_section(design: Design) -> Section:
    """What a maker has to know of it; its file is in the folder.

    Raises:
        InputError: the target leaves no room for a stand.
    """
    job = design.job
    stand = make_stand(design.target, job.printing)
    size_mm = np.ptp(stand.vertices_mm, axis=0)
    plate = Plate("stand", (Piece("stand", Part(stand, None), np.eye(4)),))
    takes = estimate((plate,), job.printing)
    rows = [
        ("how it lies", "on its base, as the file has it; supports off"),
        ("size", f"{' x '.join(f'{length:.0f}' for length in size_mm)} mm"),
        ("weight", grams(takes.body_g)),
        ("time", duration(takes.time_s)),
    ]
    printer = job.printing.printer
    width, depth, height = size_mm.tolist()
    is_wide = all(printer.place_mm(size) is None for size in ((width, depth), (depth, width)))
    if is_wide or height > printer.bed_mm[2]:
        rows.append(("bed", f"it does not fit: {bed_words(printer)}; print it on another"))
    # The printed target and its stand, at the design's size, in the target frame; the stand's z is up.
    motion, printed = stand_from_target(design.target), printed_scene(design)
    in_target_mm = (stand.vertices_mm / design.scale - motion[:3, 3]) @ motion[:3, :3]
    surface = Surface(in_target_mm, stand.triangles.astype(np.int64), STAND_COLOUR)
    up, seen_from = (motion[:3, :3].T @ axis for axis in np.array([[0.0, 0.0, 1.0], [1.0, -1.0, 0.35]]))
    view = View3d(
        "The target on its stand",
        replace(
            printed,
            layers=(*printed.layers, Layer("stand", (surface,))),
            up=tuple(up.tolist()),
            from_direction=tuple(seen_from.tolist()),
            legend=(*printed.legend, (STAND_COLOUR, "stand")),
        ),
        "The target standing on its stand, no ring covered.",
        caption="As it stands on the table.",
    )
    lead = f"{job.name}.stand.stl, of one filament, any colour; estimated like the target, and not in its figures."
    return Section("The stand", (view, Facts(tuple(rows))), lead)


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
                "Let it cool. Pattern up, flat on an even, dark or grey ground; tape an edge down that lifts.",
                "Squarely from above, within a few degrees, filling the picture; main camera, no portrait mode or "
                "zoom.",
                "Even light: no lamp mirrored, no shadow of the hand; focused on the print, a little darker than "
                "usual.",
                "The camera's own JPEG or PNG, without filter, crop, or a messenger in between.",
                "One is enough. Four, turned by a quarter between them, tell axes and skew better.",
            )),
            Table(
                "Lengths for the caliper", (Column("length", is_number=False), Column("design, mm")),
                tuple((Cell(name), Cell(f"{length_mm:.2f}", length_mm)) for name, length_mm in pairs),
                "From left rim to left rim, or lower to lower, so that bleed cancels. One tells the size, all four "
                "also axes and skew. Rings count from 0, row by row from below, from the left, the target id at the "
                "bottom.",
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
            Paragraph("Print the target with the same filaments, layers and speeds: bleed and scale are theirs, too."),
        ), "Type the commands in this folder, with the picture in it."),
    )  # fmt: skip


def _pairs(design: Design) -> tuple[tuple[str, float], ...]:
    """The outermost rings along the lower and the left side, and across."""
    a, b, c, d = corner_rings(design.target)
    pairs = ((a, b), (a, d), (a, c), (b, d))
    return tuple((f"ring {one} to ring {other}", ring_to_ring_mm(design.target, one, other)) for one, other in pairs)
