"""Sheets as small pictures: what will lie on the printer's tray."""

import io
import math

from PIL import Image, ImageDraw

from designer.make.drawing import CUT_COLOUR, MARK_COLOUR, Area, Point, SheetPage, Text
from designer.page.blocks import Raster

WIDTH_PX = 800
_OVERSAMPLING = 2
_COLOURS = 32
_PAPER = "#ffffff"


def sheet_picture(page: SheetPage) -> Raster:
    """A page on white paper, as a PNG."""
    scale = WIDTH_PX * _OVERSAMPLING / page.width_mm
    canvas = _Canvas(page, scale)
    for area in page.drawing.areas:
        canvas.fill(area)
    for cut in page.drawing.cuts:
        canvas.line((*cut, cut[0]), CUT_COLOUR)
    for mark in page.drawing.marks:
        canvas.line(mark, MARK_COLOUR)
    for text in page.drawing.texts:
        canvas.write(text)
    small = canvas.image.reduce(_OVERSAMPLING).quantize(_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    stream = io.BytesIO()
    small.save(stream, "PNG", compress_level=6)
    return Raster(stream.getvalue(), small.width, small.height)


class _Canvas:
    """Shapes in millimetres, y up, on pixels, y down."""

    def __init__(self, page: SheetPage, scale: float) -> None:
        size = (round(page.width_mm * scale), round(page.height_mm * scale))
        self.image = Image.new("RGB", size, _PAPER)
        self._draw = ImageDraw.Draw(self.image)
        self._scale, self._height_mm = scale, page.height_mm

    def fill(self, area: Area) -> None:
        """The first, outermost contour in colour; the others lie inside it side by side and are bare."""
        contours = [(circle.centre_mm, circle.radius_mm) for circle in area.circles]
        for number, (centre, radius) in enumerate(contours):
            x, y = self._pixel(centre)
            r = radius * self._scale
            self._draw.ellipse((x - r, y - r, x + r, y + r), fill=_PAPER if number else area.colour)
        for number, polygon in enumerate(area.polygons, start=len(contours)):
            self._draw.polygon([self._pixel(point) for point in polygon], fill=_PAPER if number else area.colour)

    def line(self, points: tuple[Point, ...], colour: str) -> None:
        """A line as thin as can be seen."""
        self._draw.line([self._pixel(point) for point in points], fill=colour, width=_OVERSAMPLING)

    def write(self, text: Text) -> None:
        """A line of text, turned about its position."""
        size = max(text.size_mm * self._scale, 1.0)
        if not text.angle_rad:
            anchor = "ms" if text.centred else "ls"
            at = self._pixel(text.position_mm)
            self._draw.text(at, text.text, fill=MARK_COLOUR, font_size=size, anchor=anchor)
            return
        left = -self._draw.textlength(text.text, font_size=size) / 2 if text.centred else 0.0
        room = 2 * math.ceil(text.width_mm * self._scale + 2 * size)
        stamp = Image.new("L", (room, room), 0)
        middle = room / 2
        ImageDraw.Draw(stamp).text((middle + left, middle), text.text, fill=255, font_size=size, anchor="ls")
        turned = stamp.rotate(math.degrees(text.angle_rad), resample=Image.Resampling.BILINEAR)
        x, y = self._pixel(text.position_mm)
        self.image.paste(MARK_COLOUR, (round(x - middle), round(y - middle)), turned)

    def _pixel(self, point: Point) -> Point:
        return point[0] * self._scale, (self._height_mm - point[1]) * self._scale
