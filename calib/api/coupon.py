"""Photos of a printed coupon, and what they tell of the printer: what `calib coupon` does."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calib.api.page_shown import ShownAsPage
from calib.app.inputs import (
    Place,
    folder_of,
    photos_of,
    target_of,
)
from calib.as_built.deviations import Compensation
from calib.as_built.lengths import CaliperLength, asked_lengths, usual_sigmas
from calib.core.types import Detections
from calib.coupons.edges import edges_of
from calib.coupons.place import KnownLength, PlacedPictures, Sighting, place
from calib.coupons.reading import MUCH_CUT_OFF, Reading, read_edges
from calib.coupons.result import CouponMadeWith, PrinterFaults, found_in, next_of
from calib.detector.pipeline import MIRRORED
from calib.images.headers import exif_focal_px
from calib.images.photo import Grey, read_image, stated_dpi
from calib.observe.photos import PhotoFile, named_photos
from calib.observe.search import look_for, refuse_nothing
from calib.records.coupon import COUPON, COUPON_FILE, CouponRecord, ReadPicture
from calib.renderer.quantities import number
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.units import NO_SKEW, Skew, format_mm, format_skew
from designer.kinds.presets import preset_or_file
from designer.kinds.sizing import DEFAULT_PRINTER
from designer.kinds.spec_file import with_corrections
from designer.page.progress import Progress, unheard
from designer.spec.kind import kind_named
from designer.target import TargetGeometry

FILE = "file"
"""The resolution that a scan's file states."""
LEAST_RINGS = 15
DARKEST_WHITE, LIGHTEST_WHITE, LEAST_CONTRAST = 0.15, 0.985, 0.15
"""Of the full scale: below there are too few grey levels, above the paper's white is cut off and edges with it."""
MOST_LEFT_OUT = 0.5
LEAST_DPI, MOST_DPI = 50.0, 20_000.0
WRONG_DPI = 0.02
"""No print and no scanner is off by as much."""
MOST_ALIKE = 0.8
"""Of a picture's pixels that hold one of two grey levels: a drawing or a picture of a screen has more, a photo's noise
and light leave far fewer."""
SURE_AXES, SURE_SKEW_RAD = 5e-4, math.radians(0.05)
"""Axes and skew that are known worse are not worth dialling in."""
LEAST_TILT_RAD = math.radians(0.05)
"""Nobody holds a camera that square: a scanner does."""
WORST_MISFIT, MOST_BLEED = 6.0, 0.45
"""Edges with a profile of another kind than any lens and tone curve make; and a bleed as wide as a printed line."""

Resolution: TypeAlias = float | str | None


@dataclass(frozen=True, eq=False)
class CouponResult(ShownAsPage):
    """What photos of a coupon tell: `told.record.found.bleed_mm`, `told.next_print.ink_offset_mm`.

    In a notebook the result shows its page.
    """

    record: CouponRecord
    kind = "coupon"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person must know, a line each."""
        return self.record.remarks

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write `coupon.json` into a folder; its place.

        Raises:
            InputError: the folder takes no files.
        """
        path = folder_of(folder) / COUPON_FILE
        write_files({path: COUPON.text(self.record)})
        return (path,)

    def save_printer(self, path: Place, printer: str | None = None) -> Path:
        """Write a printer's file with what was found, as `design --printer` reads it; its place.

        Args:
            path: a TOML file.
            printer: the template or file whose other lines it takes over; None: the one `design` takes.

        Raises:
            InputError: no such printer, or a name or place that takes no such file.
        """
        place, before = require_printer_file(path, printer)
        told = self.record.next_print
        text = with_corrections(
            before, ink_offset_mm=told.ink_offset_mm,
            shrink_percent=told.shrink_percent, skew_rad=told.skew_rad,
        )  # fmt: skip
        write_files({place: text.encode()})
        return place


def require_printer_file(path: Place, printer: str | None) -> tuple[Path, Path]:
    """Where a printer's file is to be written, and the one whose lines it takes over.

    Raises:
        InputError: no such printer, or a name that no printer's file has.
    """
    place = Path(path)
    if place.suffix.lower() != ".toml":
        raise InputError(f"--save {place}: printer files end in .toml; call it {place.name or 'my-printer'}.toml")
    return place, preset_or_file("printers", printer or DEFAULT_PRINTER)


def coupon(
    photos: Place | Iterable[Place],
    *,
    target: TargetGeometry | Place | None = None,
    lengths: str | CaliperLength | Iterable[str | CaliperLength] = (),
    dpi: Resolution = None,
    ink_offset_mm: float = 0.0,
    shrink_compensation_percent: float = 0.0,
    skew_compensation_rad: Skew = NO_SKEW,
    progress: Progress = unheard,
) -> CouponResult:
    """Tell ink bleed, scale and skew of a printer from photos of its coupon: `coupon("coupon.jpg")`.

    >>> told = calib.coupon(["a.jpg", "b.jpg"], lengths="ring 0 to ring 4:30.35mm+-0.03mm")
    >>> told.record.found.bleed_mm, told.record.next_print.ink_offset_mm

    Args:
        photos: images, folders of images, or patterns.
        target: the coupon as designed, or its file; None: the one that `design coupon` makes.
        lengths: of a caliper, between rings, which tell the size.
        dpi: the pictures are a flatbed's scans of this resolution; "file": the one that they state; None: photos.
        ink_offset_mm: that this coupon was printed with, to tell that of the next print.
        shrink_compensation_percent: likewise.
        skew_compensation_rad: likewise, of xy, xz and yz.
        progress: is told how many photos were read.

    Raises:
        InputError: files or options that break a rule, or not one photo that can be used; it says why.
    """
    geometry = _coupon_target(target)
    asked = asked_lengths(lengths, geometry)
    made_with = CouponMadeWith(
        number("--ink-offset", ink_offset_mm), Compensation(shrink_compensation_percent, skew_compensation_rad)
    )
    found = photos_of(photos)
    files, looked = named_photos(found.paths), []
    for count, photo in enumerate(files, start=1):
        looked.append(_look(photo, geometry, dpi))
        progress("reading", count, len(files))
    _refuse(looked, found.failures)
    used = [one for one in looked if one.sighting is not None]
    known = [_between_rings(one) for one in asked]
    placement, used = _read_all(geometry, used, known)
    _refuse(looked, found.failures)
    size_known = bool(known) or dpi is not None
    told = found_in(geometry, placement, [one.reading for one in used if one.reading], size_known=size_known)
    _check_bleed(told.bleed_mm.value)
    record = CouponRecord(
        program(),
        {
            "length": "; ".join(one.text for one in asked), "dpi": "" if dpi is None else str(dpi),
            "ink-offset": format_mm(ink_offset_mm) if ink_offset_mm else "",
            "shrink-compensation": f"{shrink_compensation_percent:g}%" if shrink_compensation_percent else "",
            "skew-compensation": format_skew(skew_compensation_rad) if skew_compensation_rad != NO_SKEW else "",
        },
        tuple(_picture(one, placement, used) for one in looked), told, made_with, next_of(told, made_with),
        (
            *_remarks(looked, found.failures, asked, size_known=size_known, is_scan=dpi is not None),
            *_remarks_of_place(used, placement, told),
        ),
    )  # fmt: skip
    return CouponResult(record)


@dataclass(eq=False)
class _Looked:
    """A picture while it is read."""

    photo: PhotoFile
    seen: Detections | None = None
    image: Grey | None = None
    sighting: Sighting | None = None
    reading: Reading | None = None
    fault: str = ""


def _coupon_target(target: TargetGeometry | Place | None) -> TargetGeometry:
    """The coupon that photos show.

    Raises:
        InputError: a target without lines of graded width.
    """
    if target is None:
        from designer.kinds.coupon import COUPON as STANDARD

        return STANDARD.lay_out()
    geometry = target_of(target, "rings")
    if geometry.spec is None or geometry.spec.kind != kind_named("coupon").name or geometry.source != "nominal":
        raise InputError("the target is no coupon as designed; give the target file that `design coupon` wrote")
    return geometry


def _between_rings(length: CaliperLength) -> KnownLength:
    """The rings of a length's name, which is known to be right."""
    words = length.name.split()
    return KnownLength(int(words[1]), int(words[4]), length.value_mm, length.sigma_mm)


def _look(photo: PhotoFile, target: TargetGeometry, dpi: Resolution) -> _Looked:
    """Find the coupon's rings in a picture, and say why it cannot be used."""
    try:
        pixels = read_image(photo.path).pixels
        resolution = _resolution(photo, dpi)
        seen = look_for(target)(photo, pixels)
    except InputError as error:
        return _Looked(photo, fault=str(error))
    looked = _Looked(photo, seen, pixels)
    looked.fault = _not_one_coupon(looked, target)
    if looked.fault:
        return looked
    looked.sighting = Sighting(
        seen.image_size, seen.ring, seen.center_px, seen.cov_px2,
        None if resolution else exif_focal_px(photo.path), resolution,
    )  # fmt: skip
    if resolution:
        looked.fault = _wrong_resolution(photo, looked.sighting, target)
        looked.sighting = None if looked.fault else looked.sighting
    return looked


def _not_one_coupon(looked: _Looked, target: TargetGeometry) -> str:
    """Why a picture cannot be taken for that of a coupon alone, and what to do; "" if it can."""
    seen, name = looked.seen, looked.photo.name
    if seen is None or looked.image is None:
        return ""
    if MIRRORED in seen.remarks:
        return f"{name}: {MIRRORED.removesuffix(' and detect again')}, or turn off mirroring in camera or scanner"
    if _is_drawn(looked.image):
        return (
            f"{name}: most pixels hold one of two grey levels: a drawing, a picture of a screen, or far "
            "overexposed; print the coupon, and photograph or scan the print, white not burnt out"
        )
    if len(seen.ring) < LEAST_RINGS:
        found = f"{len(seen.ring)} of the coupon's {target.ring_count} rings were found"
        told = "; ".join((found, *dict.fromkeys(seen.remarks)))
        return (
            f"{name}: {told}; show a coupon whole, sharp and light, without glare or shadow on the three dots near its "
            "middle"
        )
    others = 0 if seen.rejected_px is None else len(seen.rejected_px)
    if others >= LEAST_RINGS:
        return f"{name}: {others} rings beside those of the coupon: is there a second one? Take a photo of each alone"
    return ""


def _is_drawn(pixels: Grey) -> bool:
    """Whether two grey levels make up most of a picture, neither of them cut off by the exposure alone."""
    _, count = np.unique(pixels, return_counts=True)
    return float(np.sort(count)[-2:].sum()) > MOST_ALIKE * pixels.size


def _resolution(photo: PhotoFile, dpi: Resolution) -> float | None:
    """Of a scan."""
    if dpi is None:
        return None
    if dpi != FILE:
        resolution = number("--dpi", dpi)
        if not LEAST_DPI <= resolution <= MOST_DPI:
            raise InputError(f"--dpi {resolution:g}: must be {LEAST_DPI:g} to {MOST_DPI:g} dots per inch, such as 600")
        return resolution
    stated = stated_dpi(photo.path)
    if stated is None:
        raise InputError(f"{photo.name}: the file states no resolution; give it with --dpi 600")
    return stated


def _wrong_resolution(photo: PhotoFile, seen: Sighting, target: TargetGeometry) -> str:
    """Why a stated resolution cannot be right; "" if it may be."""
    design = target.center_in_face_mm[seen.ring, :2]
    spread = np.linalg.norm(seen.center_px - seen.center_px.mean(axis=0)) / np.linalg.norm(design - design.mean(axis=0))
    looks = 25.4 * float(spread)
    if abs(looks / (seen.dpi or 1.0) - 1) < WRONG_DPI:
        return ""
    return (
        f"{photo.name}: {seen.dpi:g} dpi make the coupon {looks / (seen.dpi or 1.0):.3f} times as large as designed, "
        f"which no print is; was it scanned at {looks:.0f} dpi, or photographed (then leave out --dpi)?"
    )


def _read_all(
    target: TargetGeometry, used: list[_Looked], lengths: list[KnownLength]
) -> tuple[PlacedPictures, list[_Looked]]:
    """Place all pictures, read their edges, and place again without those that cannot be read."""
    edges = edges_of(target)
    placement = _placed(target, used, lengths)
    for one, placed in zip(used, placement.placed, strict=True):
        assert one.image is not None  # noqa: S101 - it has a sighting
        full = float(np.iinfo(one.image.dtype).max)
        one.reading = read_edges(one.image.astype(np.float64), placed, edges, full)
        one.fault = _unreadable(one, len(edges))
        if one.fault:
            one.reading = None
    left = [one for one in used if one.reading is not None]
    return (placement if len(left) == len(used) or not left else _placed(target, left, lengths)), left


def _placed(target: TargetGeometry, used: list[_Looked], lengths: list[KnownLength]) -> PlacedPictures:
    return place(target, [one.sighting for one in used if one.sighting is not None], lengths)


def _unreadable(one: _Looked, edges: int) -> str:
    """Why the edges of a picture cannot be used, and what to do; "" if they can."""
    name, reading = one.photo.name, one.reading
    if reading is None or reading.left_out > MOST_LEFT_OUT * edges:
        told = "" if reading is None else f" (blur {reading.shape.blur_px:.1f} px, {reading.px_per_mm:.0f} px/mm)"
        return (
            f"{name}: the edges of strokes and lines run into each other{told}: blurred, or taken from too far; the "
            "coupon should fill the picture, and be sharp"
        )
    ink, white = reading.levels
    if white > LIGHTEST_WHITE:
        return (
            f"{name}: overexposed: white is at {100 * white:.0f} % of the scale; expose darker, by half a stop or more"
        )
    if white < DARKEST_WHITE or white - ink < LEAST_CONTRAST:
        return (
            f"{name}: white is at {100 * white:.0f} % of the scale and black at {100 * ink:.0f} %: too dark, or glare "
            "on the black; more light, from the side"
        )
    if reading.misfit > WORST_MISFIT:
        return (
            f"{name}: edges look like those of no lens (misfit {reading.misfit:.1f}): shaken, heavily processed or "
            "compressed; take it again, steady, without filters"
        )
    return ""


def _refuse(looked: list[_Looked], failures: tuple[str, ...]) -> None:
    """End if nothing is left."""
    if all(one.fault for one in looked):
        refuse_nothing([*failures, *(one.fault for one in looked)], "no photos of a coupon")


def _check_bleed(bleed_mm: float) -> None:
    if not abs(bleed_mm) < MOST_BLEED:
        raise InputError(
            f"ink is {bleed_mm:+.2f}mm wider at each edge than designed, which no print is: is it another coupon? Give "
            "its own file with --target"
        )


def _picture(one: _Looked, placement: PlacedPictures, used: list[_Looked]) -> ReadPicture:
    """What is kept of a picture."""
    rings = 0 if one.seen is None else len(one.seen.ring)
    is_scan = one.sighting is not None and one.sighting.dpi is not None
    reading = one.reading
    if reading is None:
        gaps = (math.nan,) * 7
        return ReadPicture(one.photo.name, is_scan, rings, 0, 0, *gaps, one.fault or "not used")
    shape = reading.shape
    return ReadPicture(
        one.photo.name, is_scan, rings, len(reading.fits), reading.left_out, reading.px_per_mm, shape.blur_px,
        math.exp(shape.tone.log_gamma), reading.noise, reading.misfit, placement.rms_px[used.index(one)],
        math.degrees(placement.placed[used.index(one)].tilt_rad),
    )  # fmt: skip


def _remarks(
    looked: Iterable[_Looked],
    failures: Iterable[str],
    lengths: Iterable[CaliperLength],
    *,
    size_known: bool,
    is_scan: bool,
) -> Iterable[str]:
    """What a person must know."""
    yield from failures
    yield from (f"left out: {one.fault}" for one in looked if one.fault)
    yield from (
        f"{one.photo.name}: black or white is cut off in {100 * one.reading.cut_off:.0f} % of the pixels beside edges: "
        "sharpened, or too light; a photo without sharpening, a little darker, tells the ink better"
        for one in looked if one.reading and one.reading.cut_off > MUCH_CUT_OFF
    )  # fmt: skip
    yield from usual_sigmas(lengths)
    if is_scan:
        yield "a scan's size and shape are the scanner's too: 0.1 % of size and axes and 0.02 deg are assumed of it"
    elif not size_known:
        yield "nothing in a photo tells the size: give a length with --length, or scan the coupon with --dpi"
    yield "light that scatters within white plastic makes ink look wider, and no photo tells that from ink that is"


def _remarks_of_place(used: Sequence[_Looked], placement: PlacedPictures, told: PrinterFaults) -> Iterable[str]:
    """What would tell size and shape better."""
    photos = [
        (one.photo.name, one.sighting, placed)
        for one, placed in zip(used, placement.placed, strict=True) if one.sighting and one.sighting.dpi is None
    ]  # fmt: skip
    for name, sighting, placed in photos:
        if sighting.is_cropped:
            size = " x ".join(map(str, sighting.image_size))
            yield f"{name}: {size} px is no camera's, so little is known of its lens: if it was cropped, give all of it"
        if placed.tilt_rad < LEAST_TILT_RAD:
            yield f"{name}: as square as only a scanner looks; of a scan give --dpi, as scanners have errors too"
    axes, skew = told.whole.axes["x"].sigma, told.whole.skews_rad["xy"].sigma
    if photos and (axes > SURE_AXES or skew > SURE_SKEW_RAD):
        tilt = max(math.degrees(placed.tilt_rad) for *_, placed in photos)
        yield (
            f"at a tilt of up to {tilt:.0f} deg axes are known to {100 * axes:.2g} % and skew to "
            f"{math.degrees(skew):.2g} deg only: hold the camera flat above the coupon, or take three photos with the "
            "coupon turned by a quarter between them, or measure both axes and both diagonals (--length)"
        )
