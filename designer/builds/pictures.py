"""Pictures on a design's page: the target as it is printed in 3D, the panels of its preview, and its sheets."""

import io
from dataclasses import dataclass

import numpy as np
from manifold3d import triangulate
from PIL import Image

from designer.base.arrays import Array, Rows
from designer.builds.design import Design
from designer.builds.slicing import colour_words
from designer.formats.png import CAPTION_PX, HEIGHT_PX
from designer.formats.svg import svg_bytes
from designer.make.pattern import Contour, Pattern
from designer.page.blocks import Figure, Leaf, Link, Paragraph, Raster, Svg
from designer.page.pictures import thumbnail
from designer.page.scene import Layer, Scene, Surface
from designer.target import bounding_radius_mm
from designer.target_scene import polygon_area_mm2, target_scene

_LIFT = 5e-4
"""Of letters above the surface, over the target's radius: enough for a browser's depth buffer."""


def printed_scene(design: Design) -> Scene:
    """The target with what is written on it, in the target frame, at the design's size."""
    printing, pattern = design.job.printing, printed_ink(design)
    scale = design.scale if printing.way.is_two_filament else 1.0
    body, ink = printing.body_colour, printing.ink_colour
    lift = _LIFT * bounding_radius_mm(design.target)
    letters = (
        _letters(pattern, tuple(face.dark_text for face in pattern.faces), ink, scale, lift),
        _letters(pattern, tuple(face.light_text for face in pattern.faces), body, scale, lift),
    )
    written = tuple(surface for surface in letters if surface is not None)
    more = (Layer("printed letters", written, has_switch=False),) if written else ()
    ways = ("body", "ink") if printing.way.is_two_filament else ("ground", "print")
    legend = tuple((colour, f"{way}, {colour_words(colour)}") for colour, way in zip((body, ink), ways, strict=True))
    return target_scene(design.target, body_colour=body, ink_colour=ink, legend=legend, more=more)


def printed_ink(design: Design) -> Pattern:
    """The pattern as it is made: set into plastic, or on paper and sheet."""
    return design.printed_pattern if design.job.printing.way.is_two_filament else design.artwork


def _letters(
    pattern: Pattern, contours: tuple[tuple[Contour, ...], ...], colour: str, scale: float, lift_mm: float
) -> Surface | None:
    """All letters of one colour; None where there are none."""
    vertices: list[Array] = []
    triangles: list[Rows] = []
    count = 0
    for frame, face in zip(pattern.target_from_face, contours, strict=True):
        for contour in face:
            outline = contour if polygon_area_mm2(contour) > 0 else contour[::-1]
            at = (outline @ frame[:3, :2].T + frame[:3, 3]) / scale + lift_mm * frame[:3, 2]
            vertices.append(at)
            triangles.append(triangulate([outline]).astype(np.int64) + count)
            count += len(outline)
    if not vertices:
        return None
    return Surface(np.concatenate(vertices), np.concatenate(triangles), colour)


_PX_PER_MM = 96 / 25.4
POSTER_PX = 800
MOST_SHEETS = 10
"""Pages of stickers that are shown; the others are in the PDF file."""
NET_PX = 1400


@dataclass(frozen=True)
class Panels:
    """The two panels of a preview."""

    target: Raster
    net: Raster | None  # of a board the back; None: it has a single face


def preview_panels(png: bytes) -> Panels:
    """Cut the preview that `designer.formats.png` made, without its caption."""
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[:-CAPTION_PX]  # (H, W, 3)
    target, net = pixels[:, :HEIGHT_PX], pixels[:, HEIGHT_PX:]
    return Panels(thumbnail(target, POSTER_PX), thumbnail(net, NET_PX) if net.size else None)


def sheet_figures(design: Design) -> tuple[Leaf, ...]:
    """The pages to print."""
    name, count, shown = design.job.name, len(design.pages), design.pages[:MOST_SHEETS]
    files = (Link(f"{name}.pdf", f"{name}.pdf"),) if "pdf" in design.job.formats else ()
    figures = []
    for number, page in enumerate(shown, start=1):
        size = f"{page.width_mm:.0f} x {page.height_mm:.0f} mm"
        title = "What is printed" if count == 1 else f"Page {number} of {count}"
        alt = f"A page of {size} with the pattern, cut lines and a scale bar."
        caption = f"{size}. Magenta lines are cut, not printed."
        # On white paper, as the SVG file draws it.
        white = b'<rect width="100%" height="100%" fill="#ffffff"/>\n<title>'
        drawn = svg_bytes((page,)).replace(b"<title>", white, 1)
        picture = Svg(drawn, page.width_mm * _PX_PER_MM, page.height_mm * _PX_PER_MM)
        figures.append(Figure(title, picture, alt, caption, files if number == 1 else ()))
    more = (Paragraph(f"{count - len(shown)} more pages are in {name}.pdf."),) if count > len(shown) else ()
    return (*figures, *more)
