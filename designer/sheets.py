"""Sticker sheets and board artwork as pages of exact shapes, for any vector format to write down.

Page coordinates: millimetres, origin at the page's lower left corner, x right, y up. An icosahedron gives 20
triangular stickers; each carries the ink of a nominal face, and its cut line is the facet of the smaller body
that it is glued on. A board gives one piece. Labels and marks stand outside the cut lines.
"""

import math
import re
import string
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from designer.code import FACE_CORNER
from designer.errors import InputError
from designer.pattern import Contour, FacePattern, Pattern, Stamp, moved_in
from designer.polyhedron import FACE_COUNT, INSET_PER_DEPTH, adjacent_faces
from designer.spec import PrintSpec
from designer.target import TargetGeometry

PAGE_SIZES_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}
MARGIN_MM = 10.0
"""What a printer may leave white along the paper's edges."""
SCALE_BAR_MM = 100.0
MIN_PAGE_MM = (SCALE_BAR_MM + 2 * MARGIN_MM, 60.0)
MAX_PAGE_MM = 5000.0
"""PDF readers stop at 14400 points, which is 5080 mm."""

BLEED_MM = 0.5
"""How far a border's ink goes on beyond the nominal outline, so that a cut a little outside leaves no white."""
CUT_COLOUR = "#ff00ff"
MARK_COLOUR = "#000000"
LINE_MM = 0.1

STICKER_HINTS: tuple[str, ...] = (
    "Cut along the thin line. A triangle marks the code corner.",
    "An edge marked 'joins 7' meets the sticker of face 7.",
)
BOARD_HINTS: tuple[str, ...] = ("Cut along the thin line.",)

_CLEAR_MM = 0.6  # between ink, labels and marks
_TRIM_MARK_MM = 2.0
_TEXT_MM = 3.0
_FOOT_TEXT_MM = 2.7
_LINE_SPACING_MM = 3.6
_ASCENT, _DESCENT = 0.75, 0.22  # of the text size
_SLACK_MM = 1e-9  # sums of lengths that fit exactly may miss by a rounding

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
        return self.size_mm * _width_em(self.text)


@dataclass(frozen=True)
class Drawing:
    """What is drawn: filled areas, closed cut lines, straight marks and texts."""

    areas: tuple[Area, ...] = ()
    cuts: tuple[Polygon, ...] = ()
    marks: tuple[tuple[Point, Point], ...] = ()
    texts: tuple[Text, ...] = ()


@dataclass(frozen=True)
class Page:
    """A page at its true size; see the module for its coordinates."""

    title: str  # of the whole document
    width_mm: float
    height_mm: float
    drawing: Drawing


def page_size_mm(page: str) -> tuple[float, float] | None:
    """Width and height of a page: "A4", "A3", "Letter" or "WIDTHxHEIGHTmm"; None for "fit".

    Raises:
        InputError: another text, a size that is not finite, too small for the scale bar, or absurdly large.
    """
    if page.casefold() == "fit":
        return None
    for known, size in PAGE_SIZES_MM.items():
        if page.casefold() == known.casefold():
            return size
    rule = f"use {', '.join(PAGE_SIZES_MM)}, fit or WIDTHxHEIGHTmm such as 400x600mm"
    match = re.fullmatch(r"\s*([^x]+)x([^x]+?)(mm)?\s*", page.casefold())
    try:
        width, height = (float(number) for number in match.groups()[:2]) if match else (math.nan, math.nan)
    except ValueError:
        width = height = math.nan
    if not (math.isfinite(width) and math.isfinite(height)):
        raise InputError(f"page {page!r} is no page size; {rule}")
    wide, low = MIN_PAGE_MM
    if max(width, height) < wide or min(width, height) < low:
        raise InputError(f"page {page!r} is too small for the scale bar; use at least {wide:g}x{low:g}mm")
    if max(width, height) > MAX_PAGE_MM:
        raise InputError(f"page {page!r} is larger than {MAX_PAGE_MM:g}mm, the most that PDF allows; use a smaller one")
    return width, height


def lay_out_sheets(
    target: TargetGeometry, pattern: Pattern, printing: PrintSpec, page: str, name: str
) -> tuple[Page, ...]:
    """Pages with the target's stickers, or with the board's artwork.

    Args:
        target: the nominal geometry.
        pattern: its ink, of scale 1.
        printing: gives the sticker's thickness and the ink's colour and offset.
        page: see `page_size_mm`; "fit" makes one page of the size needed.
        name: of the target, for the page's foot.

    Raises:
        InputError: a bad page size, a piece that does not fit on the page, or a sticker so thick that the cut
            runs through the border.
    """
    if target.face_count == FACE_COUNT:
        pieces, grid, what = _stickers(pattern, printing)
        hints = STICKER_HINTS
    else:
        pieces, grid, what = _board(pattern, printing)
        hints = BOARD_HINTS
    offset = f", ink offset {printing.ink_offset_mm:+g} mm" if printing.ink_offset_mm else ""
    about = (*hints, f"target {target.geometry_id}{offset}", what)
    line_count = len(about) + 1  # and the page's number
    size = _choose_size(page, grid, len(pieces), line_count, what)
    slots = grid.slots(size, line_count)
    title = _printable(name)
    count = math.ceil(len(pieces) / len(slots))
    pages = []
    for number in range(count):
        here = pieces[number * len(slots) : (number + 1) * len(slots)]
        placed = [_placed(piece, slot) for piece, slot in zip(here, slots, strict=False)]
        foot = _foot(size[0], (*about, f"{title}, page {number + 1} of {count}"))
        pages.append(Page(title, *size, _together([*placed, foot])))
    return tuple(pages)


# Where pieces go


@dataclass(frozen=True)
class _Slot:
    """Where a piece's origin comes to lie; `turned` by half a turn."""

    at_mm: Point
    turned: bool


@dataclass(frozen=True)
class _Grid:
    """The room that pieces with their labels take, set in rows; every second triangle of a row is turned."""

    first_mm: float  # width of a row of one piece
    step_mm: float  # what each further piece adds
    row_mm: float  # height of a row
    origin_mm: float  # height of a piece's origin above the row's lower side
    turns: bool

    def block_mm(self, columns: int, rows: int) -> tuple[float, float]:
        """Width and height of so many pieces."""
        return self.first_mm + (columns - 1) * self.step_mm, rows * self.row_mm

    def slots(self, page_mm: tuple[float, float], line_count: int) -> tuple[_Slot, ...]:
        """All places on a page, row by row from the top, the rows centred."""
        width, height = _room_for_pieces(page_mm, line_count)
        columns = max(0, math.floor((width - self.first_mm + _SLACK_MM) / self.step_mm) + 1)
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


def _room_for_pieces(page_mm: tuple[float, float], line_count: int) -> tuple[float, float]:
    """Width and height of what is printable above the foot."""
    return page_mm[0] - 2 * MARGIN_MM, page_mm[1] - 2 * MARGIN_MM - _foot_height(page_mm[0], line_count)


def _choose_size(page: str, grid: _Grid, count: int, line_count: int, what: str) -> tuple[float, float]:
    """The page's width and height: portrait, unless landscape holds more pieces."""
    given = page_size_mm(page)
    if given is None:
        return _fitting_size(grid, count, line_count, what)
    short, long = sorted(given)
    both = ((short, long), (long, short))
    usable = [size for size in both if size[0] >= MIN_PAGE_MM[0] and size[1] >= MIN_PAGE_MM[1]]
    best = max(usable, key=lambda size: min(count, len(grid.slots(size, line_count))))
    if not grid.slots(best, line_count):
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


def _fitting_size(grid: _Grid, count: int, line_count: int, what: str) -> tuple[float, float]:
    """The size of one page that holds all pieces, as square as can be."""
    blocks = (grid.block_mm(columns, math.ceil(count / columns)) for columns in range(1, count + 1))
    width, height = min((_page_around(block, line_count) for block in blocks), key=lambda size: (max(size), sum(size)))
    if max(width, height) > MAX_PAGE_MM:
        raise InputError(
            f"{what}: they need a page of {width:.0f} x {height:.0f}mm, and PDF allows at most {MAX_PAGE_MM:g}mm; "
            "use a smaller target, or a page size that spreads stickers over several pages"
        )
    return width, height


def _placed(piece: Drawing, slot: _Slot) -> Drawing:
    """The piece at its place on the page."""
    sign, (x, y) = (-1.0 if slot.turned else 1.0), slot.at_mm

    def at(point: Point) -> Point:
        return x + sign * point[0], y + sign * point[1]

    def polygon(points: Polygon) -> Polygon:
        return tuple(at(point) for point in points)

    turn = math.pi if slot.turned else 0.0
    return Drawing(
        areas=tuple(
            Area(
                area.colour,
                tuple(Circle(at(circle.centre_mm), circle.radius_mm) for circle in area.circles),
                tuple(polygon(points) for points in area.polygons),
            )
            for area in piece.areas
        ),
        cuts=tuple(polygon(points) for points in piece.cuts),
        marks=tuple((at(start), at(end)) for start, end in piece.marks),
        texts=tuple(
            replace(text, position_mm=at(text.position_mm), angle_rad=text.angle_rad + turn) for text in piece.texts
        ),
    )


def _together(drawings: Iterable[Drawing]) -> Drawing:
    """All in one."""
    parts = tuple(drawings)
    return Drawing(
        areas=tuple(area for part in parts for area in part.areas),
        cuts=tuple(cut for part in parts for cut in part.cuts),
        marks=tuple(mark for part in parts for mark in part.marks),
        texts=tuple(text for part in parts for text in part.texts),
    )


# The pieces, each in its face's frame


def _stickers(pattern: Pattern, printing: PrintSpec) -> tuple[tuple[Drawing, ...], _Grid, str]:
    """The 20 stickers, the grid they are set in, and a line about them."""
    thickness = printing.sticker_thickness_mm
    outline = pattern.faces[0].outline
    inset = INSET_PER_DEPTH * thickness
    _check_cut(pattern.faces[0], inset, thickness)
    cut = moved_in(outline, inset)
    edge = float(np.linalg.norm(cut[1] - cut[0]))
    text_mm = min(_TEXT_MM, edge / 11)  # the lower side takes a face number and a neighbour's beside each other
    reach = inset + BLEED_MM
    band = reach + _CLEAR_MM + (_ASCENT + _DESCENT) * text_mm + _CLEAR_MM / 2
    inradius = edge / (2 * math.sqrt(3)) + band
    side = 2 * math.sqrt(3) * inradius
    trim = _trim_marks(cut, reach, band - _CLEAR_MM / 2)
    # The tips of the room at both ends of a row are empty, so they may stand over the printable area.
    used = max(abs(x) for x, _ in (*(point for mark in trim for point in mark), *moved_in(outline, -BLEED_MM)))
    grid = _Grid(min(side, 2 * used), side / 2, 3 * inradius, inradius, turns=True)
    pieces = tuple(
        Drawing(
            areas=(*_ink(face, pattern.stamps, printing.ink_colour), _code_corner_mark(cut, reach, text_mm)),
            cuts=(_polygon(cut),),
            marks=trim,
            texts=_sticker_labels(number, cut, reach, text_mm),
        )
        for number, face in enumerate(pattern.faces)
    )
    return pieces, grid, f"{len(pieces)} stickers {thickness:g} mm thick, cut edge {edge:.2f} mm"


def _check_cut(face: FacePattern, inset_mm: float, thickness_mm: float) -> None:
    """Hold the cut inside the border."""
    if face.window is None:
        return
    border = float(face.window[:, 1].min() - face.outline[:, 1].min())
    if inset_mm >= border:
        raise InputError(
            f"stickers {thickness_mm:g}mm thick are cut {inset_mm:.3g}mm inside the face's outline, through the border "
            f"of {border:.3g}mm; use stickers thinner than {border / INSET_PER_DEPTH:.2g}mm or a wider border"
        )


def _sticker_labels(face: int, cut: Contour, reach: float, text_mm: float) -> tuple[Text, ...]:
    """The face's number, and along each edge the number of the face that it joins; all read from below.

    The labels of the upper sides stand nearer the lower side, away from those of the turned sticker beside them.
    """
    corner = FACE_CORNER[face]
    neighbours = adjacent_faces()[face]
    joins = [f"joins {neighbours[(k + corner) % 3]}" for k in range(3)]  # the outline begins at the code corner
    left, lower, right = (np.stack([cut[k], cut[(k + 1) % 3]]) for k in range(3))
    beside = reach + _CLEAR_MM
    under = beside + _ASCENT * text_mm
    above = beside + _DESCENT * text_mm
    return (
        _along(lower, 0.27, under, f"FACE {face}", text_mm, 0.0),
        _along(left, 0.7, above, joins[0], text_mm, math.pi / 3),
        _along(lower, 0.75, under, joins[1], text_mm, 0.0),
        _along(right, 0.3, above, joins[2], text_mm, -math.pi / 3),
    )


def _along(
    side: NDArray[np.float64], fraction: float, outward_mm: float, text: str, text_mm: float, angle: float
) -> Text:
    """A text beside one side of a counter-clockwise outline.  # side: (2, 2)"""
    step = side[1] - side[0]
    outward = np.array([step[1], -step[0]]) / np.linalg.norm(step)
    at = side[0] + fraction * step + outward_mm * outward
    return Text(text, (float(at[0]), float(at[1])), text_mm, angle, centred=True)


def _code_corner_mark(cut: Contour, reach: float, text_mm: float) -> Area:
    """A small triangle that points at the first corner from outside, between the trim marks."""
    x, corner = cut[0]
    tip = corner + 2 * reach + _CLEAR_MM
    half, height = 0.3 * text_mm, 0.6 * text_mm
    return Area(MARK_COLOUR, polygons=(_polygon([(x, tip), (x + half, tip + height), (x - half, tip + height)]),))


def _board(pattern: Pattern, printing: PrintSpec) -> tuple[tuple[Drawing, ...], _Grid, str]:
    """The board's artwork, the room it takes, and a line about it."""
    face = pattern.faces[0]
    band = BLEED_MM + _CLEAR_MM + _TRIM_MARK_MM
    width, height = np.ptp(face.outline, axis=0).tolist()
    piece = Drawing(
        areas=_ink(face, pattern.stamps, printing.ink_colour),
        cuts=(_polygon(face.outline),),
        marks=_trim_marks(face.outline, BLEED_MM, band),
    )
    room = (width + 2 * band, height + 2 * band)
    return (piece,), _Grid(room[0], room[0], room[1], room[1] / 2, turns=False), f"board {width:g} x {height:g} mm"


def _ink(face: FacePattern, stamps: tuple[Stamp, ...], colour: str) -> tuple[Area, ...]:
    """A face's rings, dots, border and letters."""
    rings = []
    for row, (x, y) in zip(face.stamp.tolist(), face.position_mm.tolist(), strict=True):
        radii = (stamps[row].outer_radius_mm, stamps[row].inner_radius_mm)
        rings.append(Area(colour, circles=tuple(Circle((x, y), radius) for radius in radii if radius > 0)))
    letters = [Area(colour, polygons=(_polygon(contour),)) for contour in face.dark_text]
    if face.window is None:
        return (*rings, *letters)
    contours = (moved_in(face.outline, -BLEED_MM), face.window, *face.light_text)
    border = Area(colour, polygons=tuple(_polygon(contour) for contour in contours))
    return (border, *rings, *letters)


def _trim_marks(cut: Contour, reach: float, band: float) -> tuple[tuple[Point, Point], ...]:
    """Marks that lengthen each side of the cut beyond both its ends: where to lay the ruler.

    They begin clear of the ink, which reaches `reach` beyond the cut, and end within `band` of it.
    """
    marks = []
    for k in range(len(cut)):
        before, corner, after = cut[k - 1], cut[k], cut[(k + 1) % len(cut)]
        ways = [(corner - other) / np.linalg.norm(corner - other) for other in (before, after)]
        sine = abs(ways[0][0] * ways[1][1] - ways[0][1] * ways[1][0])
        start = (reach + _CLEAR_MM) / sine
        end = min(start + _TRIM_MARK_MM, band / sine)
        for way in ways:
            near, far = _polygon([corner + start * way, corner + end * way])
            marks.append((near, far))
    return tuple(marks)


def _polygon(points: Iterable[Iterable[float]]) -> Polygon:
    """Rows of x and y as plain numbers."""
    return tuple((float(x), float(y)) for x, y in points)


# The page's foot


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
        x, y = left + SCALE_BAR_MM + 5, bottom + _DESCENT * _FOOT_TEXT_MM
    else:
        x, y = left, bottom + 2 * _LINE_SPACING_MM
    room = page_width - MARGIN_MM - x
    size = min(_FOOT_TEXT_MM, room / max(_width_em(line) for line in lines))
    texts += [Text(line, (x, y + k * _LINE_SPACING_MM), size) for k, line in enumerate(lines)]
    return Drawing(marks=(bar, *ticks), texts=tuple(texts))


def _printable(name: str) -> str:
    """The name without control characters and not too long for the foot."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in name)
    return clean if len(clean) <= 60 else clean[:57] + "..."


def _width_em(text: str) -> float:
    """An upper bound of a line's width in Helvetica, Arial or DejaVu Sans, in em."""
    return sum(_letter_em(letter) for letter in text)


def _letter_em(letter: str) -> float:
    if letter in " ,.'ijl":
        return 0.33
    return 0.64 if letter in string.digits + string.ascii_lowercase.replace("m", "").replace("w", "") else 1.05
