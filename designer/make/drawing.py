"""Drawings of exact shapes on pages, for any vector format to write down.

Page coordinates: millimetres, origin at the page's lower left corner, x right, y up.
"""

import math
import string
from collections.abc import Iterable
from dataclasses import dataclass, replace

CUT_COLOUR = "#ff00ff"
MARK_COLOUR = "#000000"
LINE_MM = 0.1

Point = tuple[float, float]
Polygon = tuple[Point, ...]


@dataclass(frozen=True)
class Circle:
    """A true circle, not a polygon."""

    centre_mm: Point
    radius_mm: float


@dataclass(frozen=True)
class Area:
    """Circles and polygons filled together under the even-odd rule: what is a hole stays bare on any stock."""

    colour: str  # "#rrggbb"
    circles: tuple[Circle, ...] = ()
    polygons: tuple[Polygon, ...] = ()


@dataclass(frozen=True)
class Text:
    """A line of sans-serif text on its baseline."""

    text: str
    position_mm: Point
    size_mm: float  # of the em square
    angle_rad: float = 0.0
    centred: bool = False  # else it begins at the position

    @property
    def width_mm(self) -> float:
        """At most as wide as this in the usual sans-serif fonts."""
        return self.size_mm * width_em(self.text)


@dataclass(frozen=True)
class Drawing:
    """What is drawn: filled areas, closed cut lines, straight marks and texts."""

    areas: tuple[Area, ...] = ()
    cuts: tuple[Polygon, ...] = ()
    marks: tuple[tuple[Point, Point], ...] = ()
    texts: tuple[Text, ...] = ()


@dataclass(frozen=True)
class SheetPage:
    """A page at its true size; see the module for its coordinates."""

    title: str  # of the whole document
    width_mm: float
    height_mm: float
    drawing: Drawing


def moved(drawing: Drawing, to_mm: Point, *, turned: bool) -> Drawing:
    """The drawing with its origin at `to_mm`, turned by half a turn if asked."""
    sign, (x, y) = (-1.0 if turned else 1.0), to_mm

    def at(point: Point) -> Point:
        return x + sign * point[0], y + sign * point[1]

    def all_at(points: Polygon) -> Polygon:
        return tuple(at(point) for point in points)

    turn = math.pi if turned else 0.0
    return Drawing(
        areas=tuple(
            Area(
                area.colour,
                tuple(Circle(at(circle.centre_mm), circle.radius_mm) for circle in area.circles),
                tuple(all_at(points) for points in area.polygons),
            )
            for area in drawing.areas
        ),
        cuts=tuple(all_at(points) for points in drawing.cuts),
        marks=tuple((at(start), at(end)) for start, end in drawing.marks),
        texts=tuple(
            replace(text, position_mm=at(text.position_mm), angle_rad=text.angle_rad + turn) for text in drawing.texts
        ),
    )


def together(drawings: Iterable[Drawing]) -> Drawing:
    """All in one."""
    parts = tuple(drawings)
    return Drawing(
        areas=tuple(area for part in parts for area in part.areas),
        cuts=tuple(cut for part in parts for cut in part.cuts),
        marks=tuple(mark for part in parts for mark in part.marks),
        texts=tuple(text for part in parts for text in part.texts),
    )


def polygon(points: Iterable[Iterable[float]]) -> Polygon:
    """Rows of x and y as plain numbers."""
    return tuple((float(x), float(y)) for x, y in points)


def width_em(text: str) -> float:
    """An upper bound of a line's width in Helvetica, Arial or DejaVu Sans, in em."""
    return sum(_letter_em(letter) for letter in text)


def _letter_em(letter: str) -> float:
    if letter in " ,.'ijl":
        return 0.33
    return 0.64 if letter in string.digits + string.ascii_lowercase.replace("m", "").replace("w", "") else 1.05
