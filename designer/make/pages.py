"""Drawings of exact shapes on pages, for any vector format to write down, and where pieces go on a page.

Page coordinates: millimetres, origin at the page's lower left corner, x right, y up.

What a laser or a plotter does with the sheets: contours to engrave, to cut, and to label the scrap with.

Coordinates: millimetres, x right, y up, the lower left corner of all that is drawn at (0, 0).
"""

import math
import string
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.units import MARGIN_MM, MAX_PAGE_MM, MIN_PAGE_MM, SCALE_BAR_MM, page_size_mm
from designer.make.lettering import HEIGHT, LETTERS, text_contours

CUT_COLOUR = "#ff00ff"
MARK_COLOUR = "#000000"
LINE_MM = 0.1

Point = tuple[float, float]
Polygon = tuple[Point, ...]
DESCENT = 0.22
"""How far letters reach below the baseline, of the text size."""
_FOOT_TEXT_MM = 2.7
_LINE_SPACING_MM = 3.6
_SLACK_MM = 1e-9  # sums of lengths that fit exactly may miss by a rounding


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


@dataclass(frozen=True)
class _Slot:
    """Where a piece's origin comes to lie; `turned` by half a turn."""

    at_mm: Point
    turned: bool


@dataclass(frozen=True)
class PieceGrid:
    """The room that pieces with their labels take, set in rows; every second triangle of a row is turned."""

    first_mm: float  # width of a row of one piece
    step_mm: float  # what each further piece adds
    row_mm: float  # height of a row
    origin_mm: float  # height of a piece's origin above the row's lower side
    turns: bool

    def block_mm(self, columns: int, rows: int) -> tuple[float, float]:
        """Width and height of so many pieces."""
        return self.first_mm + (columns - 1) * self.step_mm, rows * self.row_mm

    def slots(self, page_mm: tuple[float, float], line_count: int, count: int) -> tuple[_Slot, ...]:
        """All places on a page, row by row from the top, the rows centred and no longer than `count`."""
        width, height = _room_for_pieces(page_mm, line_count)
        columns = min(count, max(0, math.floor((width - self.first_mm + _SLACK_MM) / self.step_mm) + 1))
        rows = max(0, math.floor((height + _SLACK_MM) / self.row_mm))
        left = (page_mm[0] - self.block_mm(columns, 1)[0] + self.first_mm) / 2
        slots = []
        for row in range(rows):
            bottom = page_mm[1] - MARGIN_MM - (row + 1) * self.row_mm
            for column in range(columns):
                turned = self.turns and column % 2 == 1
                above = self.row_mm - self.origin_mm if turned else self.origin_mm
                slots.append(_Slot((left + column * self.step_mm, bottom + above), turned))
        return tuple(slots)


def lay_out_pages(
    pieces: tuple[Drawing, ...], grid: PieceGrid, page: str, *, name: str, what: str, about: tuple[str, ...]
) -> tuple[SheetPage, ...]:
    """Set pieces on as many pages as they need.

    Args:
        pieces: drawings about their own origins.
        grid: the room that each takes.
        page: see `page_size_mm`; "fit" makes one page of the size needed.
        name: of the document.
        what: names the pieces in messages.
        about: lines for every page's foot, the lowest first.

    Raises:
        InputError: a bad page size, or a piece that does not fit on the page.
    """
    line_count = len(about) + 1  # and the page's number
    size = _choose_size(page, grid, len(pieces), line_count, what)
    slots = grid.slots(size, line_count, len(pieces))
    title = _printable(name)
    count = math.ceil(len(pieces) / len(slots))
    pages = []
    for number in range(count):
        here = pieces[number * len(slots) : (number + 1) * len(slots)]
        placed = [moved(piece, slot.at_mm, turned=slot.turned) for piece, slot in zip(here, slots, strict=False)]
        foot = _foot(size[0], (*about, f"{title}, page {number + 1} of {count}"))
        pages.append(SheetPage(title, *size, together([*placed, foot])))
    return tuple(pages)


def _room_for_pieces(page_mm: tuple[float, float], line_count: int) -> tuple[float, float]:
    """Width and height of what is printable above the foot."""
    return page_mm[0] - 2 * MARGIN_MM, page_mm[1] - 2 * MARGIN_MM - _foot_height(page_mm[0], line_count)


def _choose_size(page: str, grid: PieceGrid, count: int, line_count: int, what: str) -> tuple[float, float]:
    """The page's width and height: portrait, unless landscape holds more pieces."""
    given = page_size_mm(page)
    if given is None:
        return _fitting_size(grid, count, line_count, what)
    short, long = sorted(given)
    both = ((short, long), (long, short))
    usable = [size for size in both if size[0] >= MIN_PAGE_MM[0] and size[1] >= MIN_PAGE_MM[1]]
    best = max(usable, key=lambda size: min(count, len(grid.slots(size, line_count, count))))
    if not grid.slots(best, line_count, count):
        needed, room = grid.block_mm(1, 1), _room_for_pieces(best, line_count)
        width, height = _page_around(needed, line_count)
        raise InputError(
            f"{what}: a piece with its marks needs {needed[0]:.1f} x {needed[1]:.1f}mm, but page {page} has a "
            f"printable area of {room[0]:.1f} x {room[1]:.1f}mm; use --page fit, or a page of at least "
            f"{math.ceil(width)}x{math.ceil(height)}mm"
        )
    return best


def _page_around(block_mm: tuple[float, float], line_count: int) -> tuple[float, float]:
    """The smallest page that holds a block."""
    width = max(block_mm[0] + 2 * MARGIN_MM, MIN_PAGE_MM[0])
    return width, max(block_mm[1] + 2 * MARGIN_MM + _foot_height(width, line_count), MIN_PAGE_MM[1])


def _fitting_size(grid: PieceGrid, count: int, line_count: int, what: str) -> tuple[float, float]:
    """The size of one page that holds all pieces, as square as can be."""
    blocks = (grid.block_mm(columns, math.ceil(count / columns)) for columns in range(1, count + 1))
    width, height = min((_page_around(block, line_count) for block in blocks), key=lambda size: (max(size), sum(size)))
    if max(width, height) > MAX_PAGE_MM:
        raise InputError(
            f"{what}: they need a page of {width:.0f} x {height:.0f}mm, and PDF allows at most {MAX_PAGE_MM:g}mm; "
            "use a smaller target, or a page size that spreads stickers over several pages"
        )
    return width, height


def _foot_is_wide(page_width: float) -> bool:
    """Whether the foot's lines stand beside the scale bar, not above it."""
    return page_width - 2 * MARGIN_MM >= SCALE_BAR_MM + 75


def _foot_height(page_width: float, line_count: int) -> float:
    """Height of scale bar and lines, and the gap above."""
    bar_lines = 2
    stacked = max(line_count, bar_lines) if _foot_is_wide(page_width) else line_count + bar_lines
    return stacked * _LINE_SPACING_MM + 2.0


def _foot(page_width: float, lines: tuple[str, ...]) -> Drawing:
    """The scale bar, its caption and lines of text, from below."""
    left, bottom = MARGIN_MM, MARGIN_MM
    ticks = []
    for k in range(11):
        x = left + k * SCALE_BAR_MM / 10
        ticks.append(((x, bottom), (x, bottom + (2.5 if k % 5 == 0 else 1.5))))
    bar = ((left, bottom), (left + SCALE_BAR_MM, bottom))
    caption = "100 mm - print at 100 %, then measure this bar"
    texts = [Text(caption, (left, bottom + _LINE_SPACING_MM), _FOOT_TEXT_MM)]
    if _foot_is_wide(page_width):
        x, y = left + SCALE_BAR_MM + 5, bottom + DESCENT * _FOOT_TEXT_MM
    else:
        x, y = left, bottom + 2 * _LINE_SPACING_MM
    room = page_width - MARGIN_MM - x
    size = min(_FOOT_TEXT_MM, room / max(width_em(line) for line in lines))
    texts += [Text(line, (x, y + k * _LINE_SPACING_MM), size) for k, line in enumerate(lines)]
    return Drawing(marks=(bar, *ticks), texts=tuple(texts))


def _printable(name: str) -> str:
    """The name without control characters and not too long for the foot."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in name)
    return clean if len(clean) <= 60 else clean[:57] + "..."


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
