"""From what was asked for to a full job: how the target is made, and defaults for what was left open.

The sizes of each kind of target are chosen by what was asked for of it (`Asked.sized`).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from designer.base.errors import InputError
from designer.base.units import NO_SKEW, format_mm, format_skew, round_down, round_up
from designer.base.words import with_article
from designer.kinds.board_cuts import room_mm
from designer.kinds.layout import (
    border_width_mm,
    corner_room_mm,
    deepest_inlay_mm,
    inset_per_depth,
    lay_out,
    lip_of,
    narrowest_widths,
)
from designer.kinds.presets import preset_names, preset_or_file
from designer.kinds.spec_file import read_printer_file
from designer.spec.build import ANY_MOUNT, BUILDS, STEM_MM, builds_of, mount_room_mm
from designer.spec.format import FORMATS, choose_formats
from designer.spec.kind import kinds
from designer.spec.machine import Machine
from designer.spec.options import Asked, AskedPrinting
from designer.spec.spec import FILAMENT_PRICE, PAPER_LINE_MM, Job, Line, PrinterProfile, PrintSpec, Spec
from designer.target import TargetGeometry

DEFAULT_PRINTER = "bambu-p1s"
SOLID_INLAY_MM = 1.0
"""Inlay of a one-piece icosahedron: its 12 steep faces fill to 70 % at 0.6 mm, to 93 % at 0.9-1.0 mm."""
LEAST_INK_MM = 0.2
"""Of flat faces. Assumption: black that lets a tenth of the light through half a millimetre; of this depth a sixth
of it comes back from the white behind (Beer and Lambert, both ways)."""
RAISED_MM = 0.4
"""Of rings above a plate: as little as is black, for what is higher casts a longer shadow on the white beside it."""
CHORD_ERROR_MM = 0.005
STICKER_THICKNESS_MM = 0.1
MARGIN_STEP = 0.6
"""Margin over lacking room: a corner's room grows 0.8 to 1.6 times as much as the margin."""


@dataclass(frozen=True)
class Sized:
    """A job and what was chosen for it, in words."""

    job: Job
    remarks: tuple[str, ...]


def size_job(asked: Asked) -> Sized:
    """Choose all that was left open, and check the result.

    Raises:
        InputError: a size that no target can have, or that this printer cannot print.
    """
    kind = next(kind for kind in kinds() if kind.asked is type(asked))
    printer, build = printer_of(asked), _choose_build(asked, builds_of(kind.spec.form), repr(kind.name))
    target, remark = asked.sized(_line_of(build, printer))
    geometry = lay_out(target)
    roomy = _with_room_for_mount(asked, printer, build, target)
    if roomy is not None:
        target, remark = roomy
        geometry = lay_out(target)
    if geometry.marks is not None and BUILDS[build].is_in_parts:
        ways = [repr(name) for name in builds_of(target.form) if not BUILDS[name].is_in_parts]
        what = with_article(geometry.marks[0].kind)
        raise InputError(f"build {build!r}: its seams would cut the marks of {what}; use {' or '.join(ways)}")
    if BUILDS[build].errors_of(target.form, geometry.face_count) is None:
        ways = [name for name in builds_of(target.form) if BUILDS[name].back_errors]
        raise InputError(f"build {build!r} is not for a board with a back; use {' or '.join(map(repr, ways))}")
    printing, print_remarks = _size_printing(asked, printer, build, geometry)
    formats, left_out = choose_formats(BUILDS[build].formats, tuple(asked.formats or ()), target.form, printing)
    widths = narrowest_widths(geometry)
    finest_mm = min(widths.stroke_mm, widths.centre_mm, widths.gap_mm)
    width, height = np.ptp(geometry.outline_mm[0], axis=0).tolist()
    large = (text for name in formats for text in FORMATS[name].remarks(name, (width, height), finest_mm))
    remarks = tuple(text for text in (remark, *print_remarks, *left_out, *large) if text)
    unusual = "" if build == builds_of(target.form)[0] else f"-{build}"
    name = asked.name or f"{target.kind}-{asked.size_name(target)}{unusual}"
    return Sized(Job(name, target, printing, formats, asked.page or target.page), remarks)


def _with_room_for_mount(asked: Asked, printer: PrinterProfile, build: str, usual: Spec) -> tuple[Spec, str] | None:
    """Sizes whose margin leaves a corner free for the mount that was named; None: the usual ones do, or are given.

    Raises:
        InputError: so wide a margin leaves no room for rings.
    """
    is_given = any(size is not None for size in (asked.margin, asked.ring_diameter, asked.pitch))
    if asked.mount is None or asked.mount not in STEM_MM or is_given:
        return None
    if usual.solid is None or not BUILDS[build].is_in_parts:
        return None
    needed = mount_room_mm(asked.mount, printer.clearance_mm, printer.line_width_mm)
    corner, spec, remark = usual.solid.polyhedron.vertices[0], usual, ""
    while (lacking := needed - corner_room_mm(lay_out(spec), corner)) > 0:
        margin = round_up(spec.margin_mm + max(MARGIN_STEP * lacking, 0.02))
        try:
            spec, remark = replace(asked, margin=margin).sized(_line_of(build, printer))
        except InputError:
            raise InputError(
                f"mount {asked.mount}: its post asks for a margin of {margin:g}mm, which leaves this edge no room for "
                "rings; use a larger edge, another mount, or --mount none"
            ) from None
    if spec is usual:
        return None
    now, before = (f"{lay_out(each).ring_count} rings of {each.ring_diameter_mm:g}mm" for each in (spec, usual))
    why = f"leaves a corner free for mount {asked.mount}, with {now} instead of {before}"
    return spec, f"{remark}; margin {spec.margin_mm:g}mm: {why}"


def size_printing(asked: AskedPrinting, target: TargetGeometry) -> PrintSpec:
    """How a target is made.

    Raises:
        InputError: a build that is not for this kind, an unknown printer, or a value that does not fit the target.
    """
    what = "a target with one face" if target.is_planar else f"a {target.form}"
    build = _choose_build(asked, builds_of(target.form), what)
    printing, _ = _size_printing(asked, printer_of(asked), build, target)
    return printing


def _size_printing(
    asked: AskedPrinting, printer: PrinterProfile, build: str, target: TargetGeometry
) -> tuple[PrintSpec, tuple[str, ...]]:
    """How a target is made, and remarks where a default had to give way or an option says nothing."""
    asked, corrected = _corrected(asked, build)
    idle = [option for option in BUILDS[build].idle if getattr(asked, option) is not None]
    nothing: dict[str, None] = dict.fromkeys(BUILDS[build].idle)
    asked = replace(asked, **nothing)
    remarks = [f"{option}: of no effect on the build {build!r}" for option in sorted(idle)]
    inlay, remark = _choose_inlay(asked, build, printer.layer_height_mm, target)
    printing = PrintSpec(
        build=build,
        printer=printer,
        inlay_mm=inlay,
        ink_offset_mm=asked.ink_offset or 0.0,
        shrink_compensation_percent=asked.shrink_compensation or 0.0,
        skew_compensation_rad=asked.skew_compensation or NO_SKEW,
        sticker_thickness_mm=asked.sticker_thickness or STICKER_THICKNESS_MM,
        body_colour=asked.body_colour or "#ffffff",
        ink_colour=asked.ink_colour or "#000000",
        labels=asked.labels is not False,
        stand=bool(asked.stand),
        filament_price=asked.filament_price or FILAMENT_PRICE,
        chord_error_mm=asked.chord_error or CHORD_ERROR_MM,
        ink_side=asked.ink_side or "down",
        mount=asked.mount or ANY_MOUNT,
        jig=bool(asked.jig),
    )
    if printing.jig and target.is_plate:
        raise InputError("jig: a board in tiles has no edges to hold at an angle; leave --jig out")
    _check_paper(printing, target)
    printing, framed = _with_lip(printing, target, asked.lip)
    return printing, (remark, *remarks, corrected, framed)


def _corrected(asked: AskedPrinting, build: str) -> tuple[AskedPrinting, str]:
    """What is asked for with what a printer's own file corrects, and a remark on it; options replace it."""
    is_resolved = asked.nozzle and asked.line_width and asked.layer_height and asked.bed
    if asked.printer is None or asked.printer in preset_names("printers") or is_resolved:
        return asked, ""
    file, way = read_printer_file(preset_or_file("printers", asked.printer)), BUILDS[build]
    names = ("ink_offset",) * way.is_two_filament + (
        "shrink_compensation",
        "skew_compensation",
        "filament_price",
    ) * way.has_body
    own = {name: value for name in names if getattr(asked, name) is None and (value := getattr(file, name)) is not None}
    told = {
        "ink_offset": format_mm,
        "shrink_compensation": lambda value: f"{value:g}%",
        "skew_compensation": format_skew,
    }
    words = ", ".join(f"{name.replace('_', ' ')} {told[name](value)}" for name, value in own.items() if name in told)
    return replace(asked, **own), f"{words}: as the printer's file has it" if words else ""


def printer_of(asked: AskedPrinting) -> PrinterProfile:
    """A printer with one of its nozzles; single values may be replaced.

    Raises:
        InputError: an unknown printer, or a nozzle it has no line for while none is given.
    """
    name = DEFAULT_PRINTER if asked.printer is None else asked.printer
    nozzle, line, layer, bed, machine = (asked.nozzle, asked.line_width, asked.layer_height, asked.bed, asked.machine)
    # A full profile, as a resolved spec has it, stands without the file it once came from.
    if not (nozzle and line and layer and bed):
        file = read_printer_file(preset_or_file("printers", name))
        nozzle, bed = nozzle or file.nozzle, bed or file.bed
        if machine is None:
            machine = file.machine_with(nozzle)
            if asked.bed is not None and asked.printer is None:  # a bed of some other printer
                machine = replace(machine, excluded_mm=())
        if not (line and layer):
            known = next((one for one in file.nozzles if one.diameter == nozzle), None)
            if known is None:
                there = ", ".join(f"{one.diameter:g}mm" for one in file.nozzles)
                raise InputError(
                    f"nozzle {nozzle:g}mm: printer {name!r} has {there}; use one of them, or give --line-width and "
                    "--layer-height"
                )
            line, layer = line or known.line_width, layer or known.layer_height
        if name not in preset_names("printers"):
            name = file.title
    if not 0.6 * nozzle <= line <= 2.5 * nozzle:
        raise InputError(
            f"line width {line:g}mm does not fit a {nozzle:g}mm nozzle; "
            f"use {0.6 * nozzle:.3g}mm to {2.5 * nozzle:.3g}mm"
        )
    if layer > 0.8 * nozzle:
        raise InputError(
            f"layer height {layer:g}mm is too high for a {nozzle:g}mm nozzle; use at most {0.8 * nozzle:.3g}mm"
        )
    return PrinterProfile(name, bed, nozzle, line, layer, machine or _machine_of(name, nozzle))


def _machine_of(printer: str, nozzle_mm: float) -> Machine:
    """Of a printer whose bed and lines were all given: what its template says, or the defaults."""
    known = printer in preset_names("printers")
    return read_printer_file(preset_or_file("printers", printer)).machine_with(nozzle_mm) if known else Machine()


def _choose_build(asked: AskedPrinting, known: tuple[str, ...], what: str) -> str:
    if asked.build is not None and asked.build not in known:
        why, wanted = BUILDS[asked.build].why_not, BUILDS[asked.build].loads_two
        known = tuple(sorted(known, key=lambda name: BUILDS[name].loads_two != wanted))  # with as many filaments first
        raise InputError(
            f"build {asked.build!r} is not for {what}{f': {why}' * bool(why)}; use {' or '.join(map(repr, known))}"
        )
    return asked.build or known[0]


def _line_of(build: str, printer: PrinterProfile) -> Line:
    if BUILDS[build].is_two_filament:
        longer, shorter = sorted(room_mm(printer)[1].tolist(), reverse=True)
        return Line(
            printer.line_width_mm, printer.nozzle_mm, f"a {printer.nozzle_mm:g}mm nozzle", 10_000, SOLID_INLAY_MM,
            (longer, shorter),
        )  # fmt: skip
    return Line(PAPER_LINE_MM, PAPER_LINE_MM, "a printed sheet", 50_000, 0.0)


def _choose_inlay(asked: AskedPrinting, build: str, layer_mm: float, target: TargetGeometry) -> tuple[float, str]:
    """The ink's depth in whole layers, and a remark where it is less than usual."""
    if asked.inlay_depth is not None:
        return asked.inlay_depth, ""
    usual_layers = (target.spec or Spec).flat_ink_layers
    layers = max(usual_layers, math.ceil(LEAST_INK_MM / layer_mm - 1e-9))
    if BUILDS[build].ink == "raised":
        layers = math.ceil(RAISED_MM / layer_mm - 1e-9)
    if target.is_plate:
        depth = math.inf if target.spec is None else target.spec.depth_mm
        return round(min(layers * layer_mm, depth / (2 * target.face_count)), 6), ""
    border_mm = border_width_mm(target)
    usual = layers * layer_mm if BUILDS[build].is_in_parts else SOLID_INLAY_MM
    deepest = min(usual, deepest_inlay_mm(target))
    inlay = round(max(1, math.floor(deepest / layer_mm + 1e-9)) * layer_mm, 6)
    is_shallow = BUILDS[build].is_two_filament and inlay < usual - layer_mm
    return inlay, f"inlay {inlay:g}mm: as deep as a border of {border_mm:g}mm allows" if is_shallow else ""


def _with_lip(printing: PrintSpec, target: TargetGeometry, asked: bool | None) -> tuple[PrintSpec, str]:
    """Stickers in lips unless told otherwise, where the border is wide enough, and a remark where it is not.

    Raises:
        InputError: they were asked for, and it is not.
    """
    if not printing.way.has_stickers or asked is False:
        return printing, ""
    if target.form in ("polyhedron", "trihedron"):  # the frames of unlike faces are none that was tried
        if asked:
            raise InputError("lip: frames around stickers are for regular solids; leave --lip out")
        return printing, ""
    border_mm, least_mm = border_width_mm(target), round_up(lip_of(target, printing).least_border_mm)
    if border_mm >= least_mm:
        return replace(printing, lip=True), ""
    why = f"a border of {border_mm:g}mm is too narrow for frames around stickers; --border {least_mm:g}mm is enough"
    if asked:
        raise InputError(f"lip: {why}, or leave --lip out")
    return printing, f"lip: left out, {why}"


def _check_paper(printing: PrintSpec, target: TargetGeometry) -> None:
    """Sheets neither shrink nor skew; the border must outlive the strip that the stickers' thickness takes off it."""
    if not printing.way.has_body and printing.shrink_compensation_percent:
        raise InputError(
            f"shrink compensation {printing.shrink_compensation_percent:g}% is for printed plastic, and a sheet has "
            "none; leave it out, and check the print against the scale bar"
        )
    if not printing.way.has_body and printing.skew_compensation_rad != NO_SKEW:
        skew = format_skew(printing.skew_compensation_rad)
        raise InputError(f"skew compensation '{skew}' is for printed plastic, and a sheet has none; leave it out")
    if not printing.way.has_stickers:
        return
    border_mm, inset = border_width_mm(target), inset_per_depth(target)
    thickness, thickest = printing.sticker_thickness_mm, 0.5 * border_mm / inset
    if thickness > thickest:
        raise InputError(
            f"sticker thickness {thickness:g}mm takes {inset * thickness:.2g}mm off a border of "
            f"{border_mm:g}mm; use stickers of at most {round_down(thickest):g}mm or a wider border"
        )
