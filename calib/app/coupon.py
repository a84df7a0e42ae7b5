"""What a printed coupon tells of its printer: `calib coupon`, `calib.coupon("coupon.jpg")`."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from calib.app.options import MadeWithShrink, MadeWithSkew, Photos
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.marks import NOT_IN_FILE
from designer.base.options import option
from designer.base.units import NO_SKEW, format_mm, format_skew
from designer.base.words import counted
from designer.kinds.presets import preset_or_file, printer_templates
from designer.page.capability import capability, written_to
from designer.page.output import Output
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.coupon_reading.pictures import ReadPicture
    from calib.coupon_reading.result import CouponMadeWith, NextPrint, PrinterFaults
    from calib.draw.print_errors import NextOption
    from calib.measure_target.lengths import CaliperLength
    from designer.page.blocks import Headline, Page, Table
    from designer.target import TargetGeometry

FILE = "file"
"""The resolution that a scan's file states."""
LEAST_DPI, MOST_DPI = 50.0, 20_000.0
SURE_MM = 0.02
"""A bleed that is known to this is worth dialling in."""
FEATURES = {"ring": "stroke of rings", "black line": "black line", "white line": "white line, in black"}


@dataclass(frozen=True, eq=False)
class CouponReading(Result, kind="coupon", title="Coupon"):
    """What photos of a coupon tell: `told.found.bleed_mm`, `told.next_print.ink_offset_mm`."""

    program: str
    settings: dict[str, str]
    pictures: "tuple[ReadPicture, ...]"
    found: "PrinterFaults"
    made_with: "CouponMadeWith"
    next_print: "NextPrint"
    remarks: tuple[str, ...]
    printer_file: Annotated[Path | None, NOT_IN_FILE] = None  # that holds what was found, for the next print

    def page(self) -> "Page":
        """How much wider, larger and askew the printer draws, and what takes it back."""
        return _page(self)

    def save_printer(self, path: "Place", printer: str | None = None) -> Path:
        """Write a printer's file with what was found, as `design --printer` reads it; its place.

        Args:
            path: a TOML file.
            printer: the template or file whose other lines it takes over; None: the one `design` takes.

        Raises:
            InputError: no such printer, or a name or place that takes no such file.
        """
        from designer.kinds.spec_file import with_corrections

        place, before = _printer_file(path, printer)
        told = self.next_print
        text = with_corrections(
            before, ink_offset_mm=told.ink_offset_mm, shrink_percent=told.shrink_percent, skew_rad=told.skew_rad
        )
        write_files({place: text.encode()})
        return place


def _printer_file(path: "Place", printer: str | None) -> tuple[Path, Path]:
    """Where a printer's file goes, and whose lines it takes over; InputError: no such printer, or no such name."""
    from designer.kinds.sizing import DEFAULT_PRINTER

    place = Path(path)
    if place.suffix.lower() != ".toml":
        raise InputError(f"--save {place}: printer files end in .toml; call it {place.name or 'my-printer'}.toml")
    return place, preset_or_file("printers", printer or DEFAULT_PRINTER)


def _dpi(text: str) -> float | str:
    try:
        return FILE if text == FILE else float(text.lower().removesuffix("dpi"))
    except ValueError:
        raise ValueError(f"give a number such as 600, or {FILE}") from None


@capability
def coupon(
    photos: Photos,
    *,
    target: Annotated[
        "TargetGeometry | Place | None",
        option("the coupon's target file (default: that of design coupon, all are alike)"),
    ] = None,
    lengths: Annotated[
        "str | CaliperLength | Iterable[str | CaliperLength]",
        option(
            "a caliper's length between rings, which tells the size: 'ring 0 to ring 4:30.38mm+-0.03mm'",
            flag="--length",
            is_many=True,
        ),
    ] = (),
    dpi: Annotated[
        float | Literal["file"] | None,
        option(
            f"the pictures are a flatbed's scans: 600, or {FILE} for what their files state",
            LEAST_DPI,
            MOST_DPI,
            parse=_dpi,
        ),
    ] = None,
    ink_offset_mm: Annotated[float, option("that this coupon was printed with, to tell that of the next")] = 0.0,
    shrink_compensation_percent: MadeWithShrink = 0.0,
    skew_compensation_rad: MadeWithSkew = NO_SKEW,
    save: Annotated[
        "Place | None", option("printer file to write, for design --printer: with what was found", metavar="FILE.toml")
    ] = None,
    printer: Annotated[
        str | None, option("whose other lines --save takes over (default: that of design)", complete=printer_templates)
    ] = None,
    out: Annotated[
        "Output | Place | None", written_to("folder for the page and coupon.json (default: exports/coupon)")
    ] = None,
    progress: Progress = unheard,
) -> CouponReading:
    """Tell ink bleed, scale and skew of a printer from photos or scans of its coupon: `coupon("coupon.jpg")`.

    Print it with `design coupon`. Take the photo squarely from above, sharp, the coupon filling the picture; one is
    enough, more are surer.

    >>> told = calib.coupon(["a.jpg", "b.jpg"], lengths="ring 0 to ring 4:30.35mm+-0.03mm")
    >>> told.found.bleed_mm, told.next_print.ink_offset_mm

    Args:
        dpi: the pictures are a flatbed's scans of this resolution; "file": the one that they state; None: photos.

    Raises:
        InputError: files or options that break a rule, or not one photo that can be used; it says why.
    """
    from calib.app.inputs import photos_of
    from calib.coupon_reading.pictures import read_pictures
    from calib.coupon_reading.result import CouponMadeWith, next_of
    from calib.measure_target.deviations import Compensation
    from calib.measure_target.lengths import asked_lengths

    if save is not None:
        _printer_file(save, printer)
    elif printer is not None:
        raise InputError("--printer: is whose other lines --save takes over; give --save FILE.toml, or leave it out")
    if isinstance(dpi, str) and dpi != FILE:
        raise InputError(f"--dpi {dpi!r}: give a number such as 600, or {FILE}")
    to = CouponReading.begun(out)
    geometry = _coupon_target(target)
    asked = asked_lengths(lengths, geometry)
    made_with = CouponMadeWith(ink_offset_mm, Compensation(shrink_compensation_percent, skew_compensation_rad))
    pictures, found, remarks = read_pictures(geometry, photos_of(photos), asked, dpi, progress)
    told = CouponReading(
        program=program(),
        settings={
            "length": "; ".join(one.text for one in asked), "dpi": "" if dpi is None else str(dpi),
            "ink-offset": format_mm(ink_offset_mm) if ink_offset_mm else "",
            "shrink-compensation": f"{shrink_compensation_percent:g}%" if shrink_compensation_percent else "",
            "skew-compensation": format_skew(skew_compensation_rad) if skew_compensation_rad != NO_SKEW else "",
        },
        pictures=pictures, found=found, made_with=made_with, next_print=next_of(found, made_with), remarks=remarks,
    )  # fmt: skip
    if save is not None:
        told = replace(told, printer_file=told.save_printer(save, printer))
    if to is not None:
        to.files += [*told.save(to.place, has_page=to is not out), *filter(None, [told.printer_file])]
        to.finished.append(to.place)
    return told


def _coupon_target(target: "TargetGeometry | Place | None") -> "TargetGeometry":
    """The coupon that photos show; InputError: a target without lines of graded width."""
    from calib.app.inputs import target_of
    from designer.kinds.coupon import COUPON
    from designer.spec.kind import kind_named

    if target is None:
        return COUPON.lay_out()
    geometry = target_of(target, "rings")
    if geometry.spec is None or geometry.spec.kind != kind_named("coupon").name or geometry.source != "nominal":
        raise InputError("the target is no coupon as designed; give the target file that `design coupon` wrote")
    return geometry


def _page(told: CouponReading) -> "Page":
    from calib.draw.print_errors import errors_table, millimetres, whole_rows
    from designer.page.blocks import Command, Facts, Finding, Findings, Page, Section
    from designer.page.folders import notes
    from designer.page.terminal import quoted

    found, used = told.found, [one for one in told.pictures if not one.fault]
    options = _options(told)
    kinds = (("photo", sum(not one.is_scan for one in used)), ("scan", sum(one.is_scan for one in used)))
    count = ", ".join(counted(number, name) for name, number in kinds if number)
    seen = f"{count}; {sum(one.edges for one in used)} edges, {sum(one.rings for one in used)} rings"
    facts = [(one.name, one.value + (f" ± {one.sigma}" if one.sigma else "")) for one in options]
    facts += [("measured from", seen)]
    plain = ("length", "dpi")
    facts += [
        (name if name in plain else f"printed with {name.replace('-', ' ')}", value)
        for name, value in told.settings.items() if value
    ]  # fmt: skip
    bleeds = (
        ("black between white, mean", found.bleed_mm, millimetres),
        *((f"black between white, along {axis}", one, millimetres) for axis, one in found.black_mm.items()),
        *((f"white between black, along {axis}", one, millimetres) for axis, one in found.white_mm.items()),
        ("along y beyond along x", found.y_beyond_x_mm, millimetres),
        ("at white lines beyond black lines", found.white_beyond_black_mm, millimetres),
    )
    bleed_table = errors_table(
        "Ink bleed at each edge",
        bleeds,
        "Black into white is +. What the picture's tone curve leaves open is in each sigma; in differences it cancels.",
    )
    shape_table = errors_table(
        "Size and shape",
        whole_rows(found.whole),
        "Axes are the bed's, with the coupon as design lays it: pattern down. A tilted photo tells little of axes and "
        "skew: take one squarely from above, or several from several sides and turned by a quarter.",
    )
    remarks = Findings(
        tuple(Finding("usable" if line.startswith("left out") else "note", "", line) for line in told.remarks)
    )
    typed = " ".join(one.typed for one in options if (one.value, one.made_with) != ("0", "0"))
    sure = ", ".join(one.sigma for one in options if one.sigma)
    steps = (Command(f"design ... {typed}", f"prints right (± {sure})"),) if sure else ()
    if told.printer_file is not None:
        steps = (Command(f"design ... --printer {quoted(told.printer_file)}", "with all that was found"),)
    sections = (
        Section("Ink bleed", (bleed_table, _widths_table(told))),
        Section("Size and shape", (shape_table,)),
        Section("Pictures", (_pictures_table(told), remarks)),
    )
    return Page(
        "", "", _headline(told), sections, lead=(Facts(tuple(facts)), *notes(_advice(told, options, typed))),
        next_steps=steps,
    )  # fmt: skip


def _headline(told: CouponReading) -> "Headline":
    """Bleed, shape, and how sure it is."""
    from calib.draw.print_errors import degrees, millimetres, percent
    from calib.measure_target.deviations import Estimate
    from designer.page.blocks import Headline

    found, noise = told.found, ", which may be noise"
    bleed, size = found.bleed_mm, found.whole.known_size
    much = millimetres(Estimate(abs(bleed.value), bleed.sigma), signed=False)
    wider = "wider" if bleed.value >= 0 else "narrower"
    parts = [f"Ink is {much} {wider} at each edge than designed{'' if bleed.is_significant else noise}"]
    if found.y_beyond_x_mm.is_significant:
        parts.append(f"along x {millimetres(found.black_mm['x'])}, along y {millimetres(found.black_mm['y'])}")
    if size is None:
        parts.append("the size is not known, as no length was given")
    else:
        much = percent(Estimate(abs(size.value), size.sigma), signed=False)
        larger = "larger" if size.value >= 0 else "smaller"
        parts.append(f"the print is {much} {larger}{'' if size.is_significant else noise}")
    parts += [f"skew {name} is {degrees(one)}" for name, one in found.whole.skews_rad.items() if one.is_significant]
    sentence = f"{'; '.join(parts)}."
    return Headline("good", "measured", sentence) if bleed.sigma <= SURE_MM else Headline("usable", "rough", sentence)


def _options(told: CouponReading) -> "tuple[NextOption, ...]":
    """What the next design is to be printed with."""
    from calib.draw.print_errors import NextOption, next_options

    offset_mm, made_mm = told.next_print.ink_offset_mm, told.made_with.ink_offset_mm
    ink = NextOption(
        "--ink-offset", format_mm(offset_mm) if offset_mm else "0", format_mm(made_mm) if made_mm else "0",
        f"{told.found.bleed_mm.sigma:.2g} mm" if offset_mm != made_mm else "",
    )  # fmt: skip
    return (ink, *next_options(told.found.whole, told.made_with.whole))


def _advice(told: CouponReading, options: "tuple[NextOption, ...]", typed: str) -> list[str]:
    """What no option takes back, and what would tell more."""
    found, advice = told.found, list[str]()
    if all(one.value == one.made_with for one in options):
        advice.append("Nothing needs a correction" + (f": keep {typed}." if typed else "."))
    if found.y_beyond_x_mm.is_significant:
        advice.append(
            "One ink offset is for both axes: what they differ by stays, half of it on each; it moves no centre."
        )
    if any(one.is_significant for one in found.whole.axes.values()):
        scale = ", ".join(f"{name} {100 / (1 + one.value):.3f}%" for name, one in found.whole.axes.items())
        advice.append(f"In the slicer, beside that: scale {scale}.")
    if found.whole.known_size is None:
        advice.append(
            'For the size measure from the left rim of one ring to that of another and give --length "ring 0 to '
            'ring 24:42.98mm+-0.03mm", or scan the coupon and give --dpi.'
        )
    return advice


def _widths_table(told: CouponReading) -> "Table":
    """Strokes and lines as they came out."""
    from calib.coupon_reading.result import Width
    from calib.draw.print_errors import told as words
    from designer.page.blocks import Cell
    from designer.page.folders import Shown, table_of

    return table_of(
        told.found.widths,
        Shown[Width]("feature", lambda one: FEATURES[one.feature]),
        Shown[Width]("designed mm", lambda one: Cell(f"{one.designed_mm:g}", one.designed_mm)),
        Shown[Width](
            "printed across x mm", lambda one: Cell(words(one.printed_mm[0], signed=False), one.printed_mm[0].value)
        ),
        Shown[Width](
            "printed across y mm", lambda one: Cell(words(one.printed_mm[1], signed=False), one.printed_mm[1].value)
        ),
        title="Widths", note="What a stroke of a target comes out as.", visible_rows=20,
    )  # fmt: skip


def _pictures_table(told: CouponReading) -> "Table":
    """Each photo, and what it is worth."""
    from calib.coupon_reading.pictures import ReadPicture
    from designer.page.blocks import Cell
    from designer.page.folders import Shown, table_of

    kind = Shown[ReadPicture]
    return table_of(
        told.pictures,
        kind("picture", lambda one: Cell(one.name, level="usable" if one.fault else None)),
        kind("rings", lambda one: one.rings),
        kind("edges", lambda one: one.edges),
        kind("px/mm", lambda one: one.px_per_mm, digits=3),
        kind("blur px", lambda one: one.blur_px, digits=3),
        kind("tone curve", lambda one: one.gamma, "its power; a linear file has 1, the usual encoding about 2.2", 3),
        kind("misfit", lambda one: one.misfit, "of the edges' profile; 1 or less is good", 3),
        kind("rings off px", lambda one: one.rings_px, digits=3),
        kind("tilt deg", lambda one: one.tilt_deg, digits=3),
        kind("left out", lambda one: one.fault),
        title="Pictures",
    )
