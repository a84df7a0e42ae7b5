"""The 3D view of a design: the target as it is printed, its letters and its thickness included."""

import io
import math
from dataclasses import dataclass

import numpy as np
from manifold3d import triangulate
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from designer.formats.png import CAPTION_PX, HEIGHT_PX
from designer.make.pages import CUT_COLOUR, MARK_COLOUR, Area, Point, SheetPage, Text
from designer.make.pattern import Contour, Pattern
from designer.page.blocks import Raster
from designer.page.pictures import thumbnail
from designer.page.scene import Layer, Scene, Surface
from designer.produce import Design
from designer.report.making import colour_words
from designer.target import bounding_radius_mm
from designer.target_scene import target_scene

_LIFT = 5e-4
"""Of letters above the surface, over the target's radius: enough for a browser's depth buffer."""


def printed_scene(design: Design) -> Scene:
    """The target with what is written on it, in the target frame, at the design's size."""
    printing, pattern = design.job.printing, printed_ink(design)
    scale = design.scale if printing.is_two_filament else 1.0
    body, ink = printing.body_colour, printing.ink_colour
    lift = _LIFT * bounding_radius_mm(design.target)
    letters = (
        _letters(pattern, tuple(face.dark_text for face in pattern.faces), ink, scale, lift),
        _letters(pattern, tuple(face.light_text for face in pattern.faces), body, scale, lift),
    )
    written = tuple(surface for surface in letters if surface is not None)
    more = (Layer("printed letters", written, has_switch=False),) if written else ()
    ways = ("body", "ink") if printing.is_two_filament else ("ground", "print")
    legend = tuple((colour, f"{way}, {colour_words(colour)}") for colour, way in zip((body, ink), ways, strict=True))
    return target_scene(design.target, body_colour=body, ink_colour=ink, legend=legend, more=more)


def printed_ink(design: Design) -> Pattern:
    """The pattern as it is made: set into plastic, or on paper and sheet."""
    return design.printed_pattern if design.job.printing.is_two_filament else design.artwork


def _letters(
    pattern: Pattern, contours: tuple[tuple[Contour, ...], ...], colour: str, scale: float, lift_mm: float
) -> Surface | None:
    """All letters of one colour; None where there are none."""
    vertices: list[NDArray[np.float64]] = []
    triangles: list[NDArray[np.int64]] = []
    count = 0
    for frame, face in zip(pattern.target_from_face, contours, strict=True):
        for contour in face:
            outline = contour if _area_mm2(contour) > 0 else contour[::-1]
            at = (outline @ frame[:3, :2].T + frame[:3, 3]) / scale + lift_mm * frame[:3, 2]
            vertices.append(at)
            triangles.append(triangulate([outline]).astype(np.int64) + count)
            count += len(outline)
    if not vertices:
        return None
    return Surface(np.concatenate(vertices), np.concatenate(triangles), colour)


def _area_mm2(contour: Contour) -> float:
    """Twice the signed area: above 0 where the contour runs counter-clockwise."""
    x, y = contour.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


POSTER_PX = 800
NET_PX = 1400


@dataclass(frozen=True)
class Panels:
    """The two panels of a preview."""

    target: Raster
    net: Raster | None  # None: a board has a single face


def preview_panels(png: bytes) -> Panels:
    """Cut the preview that `designer.formats.png` made, without its caption."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[:-CAPTION_PX]  # (H, W, 3)
    target, net = pixels[:, :HEIGHT_PX], pixels[:, HEIGHT_PX:]
    return Panels(thumbnail(target, POSTER_PX), thumbnail(net, NET_PX) if net.size else None)


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
