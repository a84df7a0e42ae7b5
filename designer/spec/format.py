"""The formats of a target's files: an entry here for each; `designer.builds.design.EXPORTERS` makes them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from designer.base.errors import InputError
from designer.base.units import NO_SKEW, format_skew
from designer.spec.build import Form, Format
from designer.spec.spec import PrintSpec


@dataclass(frozen=True)
class FileFormat:
    """A format, as far as options and pages ask."""

    title: str  # what it is, for whom
    forms: tuple[Form, ...] = ("solid", "polyhedron", "trihedron", "plate")
    instead: str = ""  # what a target of another form takes in its place
    is_flat: bool = False  # of flat stock, which neither shrinks nor skews as plastic does
    has_true_circles: bool = False  # which do not stay circles in a sheared part
    is_of_one_piece: bool = False  # it holds a target as a whole
    is_of_filaments: bool = False  # body and ink as they are printed: where ink is on a sheet, it would be blank
    is_flush: bool = False  # both filaments lie in one surface
    is_of_plates: bool = False  # it holds all plates of a build in parts, with presets of the printer
    suffix: str = ""  # of its files' names, where there is a guide
    guide: str = ""  # module of `designer.formats` that tells what to do with it; "": the build's own text does
    largest_mm: tuple[float, float] | None = None  # that is usually made
    largest_of: str = ""  # who says so
    least_mm: float = 0.0  # finest line that its makers hold
    least_of: str = ""

    def why_not(self, form: Form, printing: PrintSpec) -> str:
        """Why a target so made has no such file, with the remedy; "" if it has one."""
        name = self.title.partition(",")[0]
        is_skewed = printing.skew_compensation_rad != NO_SKEW
        is_scaled = printing.shrink_compensation_percent != 0
        if form not in self.forms:
            return f"{name} is of a {' or a '.join(self.forms)}, and this is a {form}; use {self.instead}"
        if self.is_of_one_piece and printing.way.is_in_parts:
            return f"{name} is of one piece, and this build is in parts; use 3mf or stl"
        if self.is_of_filaments and not printing.way.is_two_filament:
            return f"{name} shows what is printed of plastic, and the rings of this build are on a sheet; use pdf"
        if self.is_flush and printing.way.ink != "flush":
            return f"{name} has ink in the body's face, and that of this build is {printing.way.ink}; use 3mf or stl"
        if self.is_of_plates and not printing.way.is_in_parts:
            return f"{name} is of several plates, and this build lies on one; use 3mf"
        if self.is_of_plates and printing.printer.presets is None:
            printer, bed = printing.printer, "x".join(f"{side:g}" for side in printing.printer.bed_mm[:2])
            return (
                f"{name} names the slicers' presets, and none are known of {printer.name} with a "
                f"{printer.nozzle_mm:g}mm nozzle and a bed of {bed}mm; open the plates one by one, or put "
                "[machine.presets] into the printer's file"
            )
        if self.has_true_circles and is_skewed:
            skew = format_skew(printing.skew_compensation_rad)
            return f"skew compensation '{skew}' shears meshes, not {name}; leave out the one or the other"
        if self.is_flat and printing.way.is_two_filament and (is_skewed or is_scaled):
            what = "skew" if is_skewed else "shrink"
            return f"{name} is for flat stock, {what} compensation for printed plastic; leave out the one or the other"
        return ""

    def remarks(self, name: str, size_mm: tuple[float, float], finest_mm: float) -> Iterator[str]:
        """What to know of a board of this size, whose finest stroke or gap is so wide."""
        if finest_mm < self.least_mm:
            yield (
                f"{name}: the finest stroke or gap, {finest_mm:.3g}mm, is below {self.least_mm:g}mm ({self.least_of}); "
                "use larger rings"
            )
        largest = self.largest_mm or size_mm
        if any(have > most for have, most in zip(sorted(size_mm), sorted(largest), strict=True)):
            yield (
                f"{name}: a board of {size_mm[0]:g} x {size_mm[1]:g}mm is larger than the usual {largest[0]:g} x "
                f"{largest[1]:g}mm ({self.largest_of}); ask the maker, or use a smaller one"
            )


_GERBER = FileFormat(
    "Gerber, a printed circuit: black silkscreen on a white solder mask",
    ("plate",),
    "dxf or laser for the sheets of its faces",
    is_flat=True,
    suffix=".gerber.zip",
    guide="gerber",
    largest_mm=(400.0, 500.0),
    largest_of="JLCPCB's capabilities, two layers",
    least_mm=0.15,
    least_of="lines of silkscreen in the tolerances of PCBWay and others",
)
FORMATS: Mapping[Format, FileFormat] = {
    "3mf": FileFormat("3MF, for slicers", is_of_filaments=True),
    "project": FileFormat("3MF project, for Bambu Studio and OrcaSlicer: all plates in one file", is_of_plates=True),
    "painted": FileFormat(
        "painted 3MF, for slicers: one mesh, ink as a colour of its surface",
        is_of_one_piece=True,
        is_of_filaments=True,
        is_flush=True,
    ),
    "stl": FileFormat("STL, for slicers"),
    "png": FileFormat("PNG, a preview"),
    "pdf": FileFormat("PDF, artwork for printers"),
    "svg": FileFormat("SVG, artwork for print shops"),
    "shop": FileFormat("Print-shop files: PDF with trim, bleed and cut, TIFF, and an order sheet", is_flat=True),
    "step": FileFormat(
        "STEP, for CAD",
        ("solid", "plate"),
        "3mf or stl",
        has_true_circles=True,
        is_of_one_piece=True,
        is_of_filaments=True,
    ),
    "glb": FileFormat("GLB, for viewers", is_of_filaments=True),
    "colour": FileFormat("Full-colour models, for printing services: 3MF, PLY, VRML, OBJ with MTL"),
    "simulator": FileFormat("Simulator models, for Gazebo, MuJoCo, PyBullet, Isaac Sim and Blender"),
    "dxf": FileFormat("DXF, for lasers, cutters and CAD", is_flat=True, suffix=".dxf", guide="dxf"),
    "laser": FileFormat("Laser SVG, to engrave and cut", is_flat=True, suffix=".laser.svg", guide="laser"),
    "gerber": _GERBER,
    "gerber-mask": replace(
        _GERBER,
        title="Gerber, a printed circuit: black solder mask opened where it is white",
        suffix=".gerber-mask.zip",
        least_mm=0.1,
        least_of="an assumption for webs of solder mask",
    ),
}
"""By name, in the order in which they are written."""


def choose_formats(
    usual: tuple[Format, ...], asked: tuple[Format, ...], form: Form, printing: PrintSpec
) -> tuple[tuple[Format, ...], tuple[str, ...]]:
    """The usual formats and those asked for, in a fixed order, and why others are left out.

    Who asks for all gets those that there can be; one that is asked for by name must be possible.

    Raises:
        InputError: it is not.
    """
    wanted, remarks = {*usual, *asked}, []
    if "3mf" in wanted and not printing.way.is_two_filament:
        wanted.remove("3mf")
        remarks.append("3mf: left out, this build is in one filament; print the STL")
    reasons = {name: FORMATS[name].why_not(form, printing) for name in FORMATS}
    for name in (name for name in usual if FORMATS[name].is_of_plates and name not in asked and reasons[name]):
        wanted.remove(name)
        remarks.append(f"{name}: left out, {reasons[name]}")
    impossible = [name for name in FORMATS if name in wanted and reasons[name]]
    if set(asked) == set(FORMATS):
        return tuple(name for name in FORMATS if name in wanted and not reasons[name]), (
            *remarks,
            *(f"{name}: left out, {reasons[name]}" for name in impossible),
        )
    for name in impossible:
        others = ", ".join(name for name, reason in reasons.items() if not reason)
        raise InputError(f"{reasons[name]}: formats that go with it are {others}")
    return tuple(name for name in FORMATS if name in wanted), tuple(remarks)
