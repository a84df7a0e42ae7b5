"""Files as print shops take them: a PDF with boxes and a spot colour for the cut, 1-bit pictures, and an order sheet.

Black is black ink alone (K), so that no plate that is out of register makes a coloured rim; the cut is a stroke in the
spot colour `CutContour` that overprints, as cutters of print shops look for; TrimBox is the finished size, BleedBox
3 mm more. Both sides of a plate have pages of one size, with the finished size in the same place.
"""

import io
import math
import textwrap
from collections.abc import Iterator

import numpy as np
from PIL import Image
from reportlab.lib.colors import CMYKColor, CMYKColorSep, Color
from reportlab.pdfgen.canvas import Canvas

from designer.formats.pdf import FONT, POINTS_PER_MM, encodable, fill_area, line_of, true_size
from designer.kinds.layout import narrowest_widths
from designer.make.pages import Drawing, moved, polygon
from designer.make.pattern import Pattern
from designer.make.sheets import ink_areas
from designer.make.textured import ink_share
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model

BLEED_MM = 3.0
MARK_GAP_MM, MARK_MM, MARK_LINE_MM = 1.0, 5.0, 0.1
"""Crop marks begin so far beyond the bleed, and are so long and wide."""
DOTS_PER_INCH = 1200
ROWS_AT_ONCE = 256
_AROUND_MM = BLEED_MM + MARK_GAP_MM + MARK_MM + 1.0
BLACK = CMYKColor(0, 0, 0, 1)
CUT_CONTOUR = CMYKColorSep(0, 1, 0, 0, spotName="CutContour", density=1)
SHEETS = "sheet-print"
"""The error template of what a print shop makes."""
DARKEST = 40
"""Of 255: a grey so dark is black ink."""

File = tuple[str, bytes, str]


def print_shop_files(name: str, target: TargetGeometry, pattern: Pattern, ink_colour: str) -> Iterator[File]:
    """The PDF, a 1-bit TIFF a face, and the order sheet.

    Args:
        name: of the design.
        target: what is printed.
        pattern: its ink, of scale 1.
        ink_colour: "#rrggbb".
    """
    several = len(pattern.faces) > 1
    what = "side" if target.is_plate else "face"
    yield "shop.pdf", _pdf(name, pattern, ink_colour), f"for a print shop: a page a {what}, K-only, TrimBox, CutContour"
    for number in range(len(pattern.faces)):
        stem = f"{what}-{number}." if several else ""
        yield f"{stem}tif", _tiff(pattern, number), f"the same at {DOTS_PER_INCH} dpi, black or white, cut to size"
    yield "order.pdf", _order(name, target, pattern), "what to order: a page for the shop"


def _ink(colour: str) -> Color:
    """Black ink alone for what is nearly black, else the nearest mixture."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    if max(red, green, blue) <= DARKEST:
        return BLACK
    cyan, magenta, yellow = (1 - value / 255 for value in (red, green, blue))
    black = min(cyan, magenta, yellow)
    left = 1 - black
    return CMYKColor((cyan - black) / left, (magenta - black) / left, (yellow - black) / left, black)


def _pdf(name: str, pattern: Pattern, ink_colour: str) -> bytes:
    """A page a face."""
    buffer = io.BytesIO()
    canvas = true_size(buffer, name)
    colour = _ink(ink_colour)
    for face in pattern.faces:
        low, high = face.outline.min(axis=0), face.outline.max(axis=0)
        size_mm = (high - low + 2 * _AROUND_MM).tolist()
        canvas.setPageSize(tuple(POINTS_PER_MM * side for side in size_mm))
        trim = (_AROUND_MM, _AROUND_MM, size_mm[0] - _AROUND_MM, size_mm[1] - _AROUND_MM)
        canvas.setTrimBox(_points(trim, 0.0))
        canvas.setBleedBox(_points(trim, BLEED_MM))
        areas = ink_areas(face, pattern.stamps, ink_colour, BLEED_MM)
        to = _AROUND_MM - float(low[0]), _AROUND_MM - float(low[1])
        placed = moved(Drawing(areas, cuts=(polygon(face.outline),)), to, turned=False)
        canvas.scale(POINTS_PER_MM, POINTS_PER_MM)
        for area in placed.areas:
            fill_area(canvas, area, colour)
        canvas.saveState()
        canvas.setStrokeColor(CUT_CONTOUR)
        canvas.setStrokeOverprint(True)
        canvas.setLineWidth(0.25 / POINTS_PER_MM)
        canvas.drawPath(line_of(canvas.beginPath(), placed.cuts[0]))
        canvas.restoreState()
        _draw_marks(canvas, trim, colour)
        canvas.showPage()
    canvas.save()
    return buffer.getvalue()


def _points(box_mm: tuple[float, float, float, float], more_mm: float) -> tuple[float, ...]:
    left, bottom, right, top = box_mm
    return tuple(POINTS_PER_MM * side for side in (left - more_mm, bottom - more_mm, right + more_mm, top + more_mm))


def _draw_marks(canvas: Canvas, trim: tuple[float, float, float, float], colour: Color) -> None:
    """Crop marks at the corners of the finished size, beyond the bleed."""
    left, bottom, right, top = trim
    near, far = BLEED_MM + MARK_GAP_MM, BLEED_MM + MARK_GAP_MM + MARK_MM
    canvas.setStrokeColor(colour)
    canvas.setLineWidth(MARK_LINE_MM)
    for x, way in ((left, -1), (right, 1)):
        for y, up in ((bottom, -1), (top, 1)):
            canvas.line(x + way * near, y, x + way * far, y)
            canvas.line(x, y + up * near, x, y + up * far)


def _tiff(pattern: Pattern, number: int) -> bytes:
    """A face's artwork within its outline's box: a dot is black if most of it is ink."""
    face, per_mm = pattern.faces[number], DOTS_PER_INCH / 25.4
    low, high = face.outline.min(axis=0), face.outline.max(axis=0)
    width, height = np.round((high - low) * per_mm).astype(int).tolist()
    x = low[0] + (np.arange(width) + 0.5) / per_mm
    picture = Image.new("1", (width, height))
    for top in range(0, height, ROWS_AT_ONCE):
        y = high[1] - (np.arange(top, min(top + ROWS_AT_ONCE, height)) + 0.5) / per_mm
        picture.paste(Image.fromarray(ink_share(face, pattern, x, y) < 0.5), (0, top))
    buffer = io.BytesIO()
    picture.save(buffer, "TIFF", compression="group4", dpi=(DOTS_PER_INCH, DOTS_PER_INCH))
    return buffer.getvalue()


def _order(name: str, target: TargetGeometry, pattern: Pattern) -> bytes:
    """A page of text."""
    width, height = np.ptp(pattern.faces[0].outline, axis=0).tolist()
    count = len(pattern.faces)
    strokes = (stamp.outer_radius_mm - stamp.inner_radius_mm for stamp in pattern.stamps)
    stroke = min(strokes, default=narrowest_widths(target).stroke_mm)
    pieces = f"{count} sides of one plate, in register" if target.has_back else f"{count} pieces" if count > 1 else "1"
    what = target.feature_word
    far = np.ptp(target.center_in_face_mm[target.ring_face == 0], axis=0).tolist()
    material = (
        "aluminium composite 3 mm (or glass, or aluminium 4 mm), matt white"
        if target.is_plate else "matt white vinyl, self-adhesive, 0.1 mm; it is glued on a solid, face by face"
    )  # fmt: skip
    lines = (
        ("What", f"camera-calibration target {name}, target id {target.geometry_id}"),
        ("Files", f"{name}.shop.pdf (vectors), or the TIFF files of {DOTS_PER_INCH} dpi; print one of them"),
        ("Finished size", f"{width:.2f} x {height:.2f} mm (TrimBox); number: {pieces}"),
        ("Print", "direct UV print or resin-coated laser, 100 %, one colour, black alone (K), no raster, no scaling"),
        ("Finest line", f"{stroke:.2f} mm: at least 1200 dpi, no halo, no smoothing"),
        ("Surface", "matt, without gloss laminate: mirrored lamps hide the marks"),
        ("Material", material),
        ("Cut", "along the spot colour CutContour, which is not printed; bleed 3 mm is in the file"),
        ("Tolerance", f"{_tolerance(target)}; say if you cannot hold that"),
        ("On arrival", f"we measure far {what}, centre to centre: {far[0]:.2f} mm across, {far[1]:.2f} mm upwards"),
    )
    buffer = io.BytesIO()
    canvas = Canvas(buffer, invariant=True, pagesize=(210 * POINTS_PER_MM, 297 * POINTS_PER_MM))
    canvas.setTitle(encodable(f"{name}: order"))
    canvas.setFont(f"{FONT}-Bold", 16)
    canvas.drawString(20 * POINTS_PER_MM, 270 * POINTS_PER_MM, "Order: a printed calibration target")
    y = 255.0
    for head, text in lines:
        canvas.setFont(f"{FONT}-Bold", 10)
        canvas.drawString(20 * POINTS_PER_MM, y * POINTS_PER_MM, head)
        canvas.setFont(FONT, 10)
        for part in textwrap.wrap(text, 85):
            canvas.drawString(52 * POINTS_PER_MM, y * POINTS_PER_MM, encodable(part))
            y -= 5.5
        y -= 3.0
    canvas.save()
    return buffer.getvalue()


def _tolerance(target: TargetGeometry) -> str:
    """Two standard deviations of what such prints are taken to be off, which studies and calibrations count with."""
    if not target.is_plate:
        return "lengths within 0.1 % (0.1 mm of 100 mm)"
    errors = error_model(SHEETS)
    scale, apart, skew, warp = (2 * errors.amount(name).sigma for name in ("scale", "axis_scale", "skew", "warp"))
    return (
        f"lengths within {100 * scale:.2g} %, both axes alike to {100 * apart:.2g} %, square to "
        f"{math.degrees(skew):.2g} deg, flat to {warp:.2g} mm"
    )
