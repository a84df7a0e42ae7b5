"""What a laser or a plotter does with the sheets: contours to engrave, to cut, and to label the scrap with.

Coordinates: millimetres, x right, y up, the lower left corner of all that is drawn at (0, 0).
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array
from designer.make.lettering import HEIGHT, LETTERS, text_contours
from designer.make.pages import Area, Drawing, Polygon, SheetPage, Text, moved, polygon

CUT, ENGRAVE, LABEL = "CUT", "ENGRAVE", "LABEL"
"""Names of the layers."""
_CAPITAL = 0.73
"""Height of capitals over the size of a text."""


@dataclass(frozen=True)
class Cutting:
    """One sheet of stock; areas are filled under the even-odd rule, cuts and labels are closed lines."""

    width_mm: float
    height_mm: float
    engrave: tuple[Area, ...]
    cuts: tuple[Polygon, ...]
    labels: tuple[Polygon, ...]  # on the scrap, beside the pieces

    @property
    def lines(self) -> tuple[tuple[str, tuple[Polygon, ...]], ...]:
        """Closed lines by layer."""
        return (CUT, self.cuts), (LABEL, self.labels)


def cuttings(pages: Iterable[SheetPage]) -> tuple[Cutting, ...]:
    """Of each page what is engraved and cut: `cuttings(design.pages)`; without marks, scale bar and foot."""
    return tuple(map(_cutting, pages))


def _cutting(page: SheetPage) -> Cutting:
    """One page, moved into its corner."""
    drawing = page.drawing
    labels = tuple(outline for text in drawing.texts if text.centred for outline in _stencil(text))
    corners = np.concatenate([_bounds(drawing), *(np.array(outline) for outline in labels)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    kept = moved(Drawing(areas=drawing.areas, cuts=(*drawing.cuts, *labels)), (-low[0], -low[1]), turned=False)
    count = len(drawing.cuts)
    width, height = (high - low).tolist()
    return Cutting(width, height, kept.areas, kept.cuts[:count], kept.cuts[count:])


def _bounds(drawing: Drawing) -> Array:
    """Corners of all that is engraved or cut.  # (N, 2)"""
    boxes = [np.array(outline) for outline in drawing.cuts]
    for area in drawing.areas:
        boxes += [np.array(outline) for outline in area.polygons]
        boxes += [
            np.array(circle.centre_mm) + circle.radius_mm * np.array([[-1, -1], [1, 1]]) for circle in area.circles
        ]
    return np.concatenate(boxes)


def _stencil(text: Text) -> tuple[Polygon, ...]:
    """A label in the letters of the target itself, as no program then lacks its font; words without such letters go."""
    words = " ".join(word for word in text.text.split() if LETTERS.issuperset(word))
    turn = np.array(
        [[np.cos(text.angle_rad), np.sin(text.angle_rad)], [-np.sin(text.angle_rad), np.cos(text.angle_rad)]]
    )
    outlines = text_contours(words, _CAPITAL * text.size_mm / HEIGHT, 0.0)
    return tuple(polygon(outline @ turn + np.array(text.position_mm)) for outline in outlines)
