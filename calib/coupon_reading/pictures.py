"""Photos and scans of a printed coupon: which can be used, why not, and what they tell together."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.core.types import Detections
from calib.coupon_reading.edges import edges_of
from calib.coupon_reading.place import KnownLength, PlacedPictures, Sighting, place
from calib.coupon_reading.reading import MUCH_CUT_OFF, Reading, read_edges
from calib.coupon_reading.result import PrinterFaults, found_in
from calib.detector.pipeline import MIRRORED
from calib.images.headers import exif_focal_px
from calib.images.photo import Grey, stated_dpi
from calib.measure_target.lengths import CaliperLength, usual_sigmas
from calib.observe.photos import FoundPhotos, PhotoFile, named_photos
from calib.observe.search import look_for, refuse_nothing
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.page.progress import Progress
from designer.target import TargetGeometry

LEAST_RINGS = 15
DARKEST_WHITE, LIGHTEST_WHITE, LEAST_CONTRAST = 0.15, 0.985, 0.15
"""Of the full scale: below there are too few grey levels, above the paper's white is cut off and edges with it."""
MOST_LEFT_OUT = 0.5
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


@dataclass(frozen=True)
class ReadPicture:
    """What one photo or scan gave."""

    name: str
    is_scan: bool
    rings: int
    edges: int
    left_out: int  # edges
    px_per_mm: Gap
    blur_px: Gap
    gamma: Gap  # of its tone curve
    noise: Gap  # in grey levels
    misfit: Gap  # of the edges' profile; 1 or less is good
    rings_px: Gap  # root mean square of the centres' residuals
    tilt_deg: Gap  # between the print's normal and the camera's axis
    fault: str = ""  # why it was left out; "": it was used


def read_pictures(
    target: TargetGeometry,
    photos: FoundPhotos,
    lengths: Sequence[CaliperLength],
    dpi: float | str | None,
    progress: Progress,
) -> tuple[tuple[ReadPicture, ...], PrinterFaults, tuple[str, ...]]:
    """What pictures of one print gave each, what they tell together, and what a person must know, a line each.

    Args:
        target: the coupon as designed.
        photos: of it.
        lengths: of a caliper, between rings.
        dpi: the pictures are scans of this resolution; text: of the one that their files state; None: photos.
        progress: is told how many were read.

    Raises:
        InputError: none can be used, or no print looks so; it says why.
    """
    files, looked = named_photos(photos.photos), []
    for count, photo in enumerate(files, start=1):
        looked.append(_look(photo, target, dpi))
        progress("reading", count, len(files))
    _refuse(looked, photos.failures)
    used = [one for one in looked if one.sighting is not None]
    placement, used = _read_all(target, used, [_between_rings(one) for one in lengths])
    _refuse(looked, photos.failures)
    size_known = bool(lengths) or dpi is not None
    found = found_in(target, placement, [one.reading for one in used if one.reading], size_known=size_known)
    if not abs(found.bleed_mm.value) < MOST_BLEED:
        raise InputError(
            f"ink is {found.bleed_mm.value:+.2f}mm wider at each edge than designed, which no print is: is it another "
            "coupon? Give its own file with --target"
        )
    remarks = (
        *_remarks(looked, photos.failures, lengths, size_known=size_known, is_scan=dpi is not None),
        *_remarks_of_place(used, placement, found),
    )
    return tuple(_picture(one, placement, used) for one in looked), found, remarks


@dataclass(eq=False)
class _Looked:
    """A picture while it is read."""

    photo: PhotoFile
    seen: Detections | None = None
    image: Grey | None = None
    sighting: Sighting | None = None
    reading: Reading | None = None
    fault: str = ""


def _between_rings(length: CaliperLength) -> KnownLength:
    """The rings of a length's name, which is known to be right."""
    words = length.name.split()
    return KnownLength(int(words[1]), int(words[4]), length.value_mm, length.sigma_mm)


def _look(photo: PhotoFile, target: TargetGeometry, dpi: float | str | None) -> _Looked:
    """Find the coupon's rings in a picture, and say why it cannot be used."""
    try:
        pixels = photo.read().pixels
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


def _resolution(photo: PhotoFile, dpi: float | str | None) -> float | None:
    """Of a scan."""
    if not isinstance(dpi, str):
        return dpi
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
        for one in looked
        if one.reading and one.reading.cut_off > MUCH_CUT_OFF
    )
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
        for one, placed in zip(used, placement.placed, strict=True)
        if one.sighting and one.sighting.dpi is None
    ]
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
