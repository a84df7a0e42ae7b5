"""Sticker sheets and board artwork.

An icosahedron gives 20 triangular stickers; each carries the ink of a nominal face, and its cut line is the facet
of the smaller body that it is glued on. A board gives one piece. Labels and marks stand outside the cut lines.
"""

import math

import numpy as np
from numpy.typing import NDArray

from designer.code import FACE_CORNER
from designer.errors import InputError
from designer.make.drawing import MARK_COLOUR, Area, Circle, Drawing, Point, SheetPage, Text, polygon
from designer.make.pages import DESCENT, PieceGrid, lay_out_pages
from designer.make.pattern import Contour, FacePattern, Pattern, Stamp, moved_in
from designer.polyhedron import FACE_COUNT, INSET_PER_DEPTH, adjacent_faces
from designer.spec import PrintSpec
from designer.target import TargetGeometry

BLEED_MM = 0.5
"""How far a border's ink goes on beyond the nominal outline, so that a cut a little outside leaves no white."""

STICKER_HINTS: tuple[str, ...] = (
    "Cut along the thin line. A triangle marks the code corner.",
    "An edge marked 'joins 7' meets the sticker of face 7.",
)
BOARD_HINTS: tuple[str, ...] = ("Cut along the thin line.",)

_CLEAR_MM = 0.6  # between ink, labels and marks
_TRIM_MARK_MM = 2.0
_TEXT_MM = 3.0
_ASCENT = 0.75  # of the text size


def lay_out_sheets(
    target: TargetGeometry, pattern: Pattern, printing: PrintSpec, page: str, name: str
) -> tuple[SheetPage, ...]:
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
    return lay_out_pages(pieces, grid, page, name=name, what=what, about=about)


def _stickers(pattern: Pattern, printing: PrintSpec) -> tuple[tuple[Drawing, ...], PieceGrid, str]:
    """The 20 stickers, the grid they are set in, and a line about them."""
    # A solid build is not made smaller: its sheets show the nominal faces.
    thickness = printing.sticker_thickness_mm if printing.build == "stickers" else 0.0
    outline = pattern.faces[0].outline
    inset = INSET_PER_DEPTH * thickness
    _check_cut(pattern.faces[0], inset, thickness)
    cut = moved_in(outline, inset)
    edge = float(np.linalg.norm(cut[1] - cut[0]))
    text_mm = min(_TEXT_MM, edge / 11)  # the lower side takes a face number and a neighbour's beside each other
    reach = inset + BLEED_MM
    band = reach + _CLEAR_MM + (_ASCENT + DESCENT) * text_mm + _CLEAR_MM / 2
    inradius = edge / (2 * math.sqrt(3)) + band
    side = 2 * math.sqrt(3) * inradius
    trim = _trim_marks(cut, reach, band - _CLEAR_MM / 2)
    # The tips of the room at both ends of a row are empty, so they may stand over the printable area.
    used = max(abs(x) for x, _ in (*(point for mark in trim for point in mark), *moved_in(outline, -BLEED_MM)))
    grid = PieceGrid(min(side, 2 * used), side / 2, 3 * inradius, inradius, turns=True)
    pieces = tuple(
        Drawing(
            areas=(*_ink(face, pattern.stamps, printing.ink_colour), _code_corner_mark(cut, reach, text_mm)),
            cuts=(polygon(cut),),
            marks=trim,
            texts=_sticker_labels(number, cut, reach, text_mm),
        )
        for number, face in enumerate(pattern.faces)
    )
    thick = f" {thickness:g} mm thick" if thickness else ""
    return pieces, grid, f"{len(pieces)} stickers{thick}, cut edge {edge:.2f} mm"


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
    above = beside + DESCENT * text_mm
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
    return Area(MARK_COLOUR, polygons=(polygon([(x, tip), (x + half, tip + height), (x - half, tip + height)]),))


def _board(pattern: Pattern, printing: PrintSpec) -> tuple[tuple[Drawing, ...], PieceGrid, str]:
    """The board's artwork, the room it takes, and a line about it."""
    face = pattern.faces[0]
    band = BLEED_MM + _CLEAR_MM + _TRIM_MARK_MM
    width, height = np.ptp(face.outline, axis=0).tolist()
    piece = Drawing(
        areas=_ink(face, pattern.stamps, printing.ink_colour),
        cuts=(polygon(face.outline),),
        marks=_trim_marks(face.outline, BLEED_MM, band),
    )
    room = (width + 2 * band, height + 2 * band)
    return (piece,), PieceGrid(room[0], room[0], room[1], room[1] / 2, turns=False), f"board {width:g} x {height:g} mm"


def _ink(face: FacePattern, stamps: tuple[Stamp, ...], colour: str) -> tuple[Area, ...]:
    """A face's rings, dots, border and letters."""
    rings = []
    for row, (x, y) in zip(face.stamp.tolist(), face.position_mm.tolist(), strict=True):
        radii = (stamps[row].outer_radius_mm, stamps[row].inner_radius_mm)
        rings.append(Area(colour, circles=tuple(Circle((x, y), radius) for radius in radii if radius > 0)))
    letters = [Area(colour, polygons=(polygon(contour),)) for contour in face.dark_text]
    if face.window is None:
        return (*rings, *letters)
    contours = (moved_in(face.outline, -BLEED_MM), face.window, *face.light_text)
    border = Area(colour, polygons=tuple(polygon(contour) for contour in contours))
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
            near, far = polygon([corner + start * way, corner + end * way])
            marks.append((near, far))
    return tuple(marks)
