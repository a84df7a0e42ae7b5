"""Sticker sheets and board artwork.

A solid gives a sticker for each face; it carries the ink of the nominal face, and its cut line is the facet of the
smaller body that it is glued on. A board gives one piece. Labels and marks stand outside the cut lines.
"""

import math
from collections.abc import Sequence

import numpy as np

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.layout import border_mm, joined_faces, sticker_inset_mm
from designer.make.pages import (
    DESCENT,
    MARK_COLOUR,
    Area,
    Circle,
    Drawing,
    PieceGrid,
    Point,
    SheetPage,
    Text,
    lay_out_pages,
    polygon,
)
from designer.make.pattern import Contour, FacePattern, Pattern, Stamp, moved_in
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

BLEED_MM = 0.5
"""How far a border's ink goes on beyond the nominal outline, so that a cut a little outside leaves no white."""

_CLEAR_MM = 0.6  # between ink, labels and marks
_TRIM_MARK_MM = 2.0
_TEXT_MM = 3.0
_ALIKE_MM = 1e-3
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
    if target.is_plate:
        pieces, grid, what = _board(pattern, printing)
        hints: tuple[str, ...] = ("Cut along the thin line.",)
        if not target.is_planar:
            hints = (*hints, "Side 0 is the front, side 1 the back; up is up on both: turn the board about its height.")
    else:
        pieces, grid, what = _stickers(target, pattern, printing)
        example = min(7, target.face_count - 1)
        hints = (
            "Cut along the thin line. A triangle marks the code corner.",
            f"An edge marked 'joins {example}' meets the sticker of face {example}.",
        )
    offset = f", ink offset {printing.ink_offset_mm:+g} mm" if printing.ink_offset_mm else ""
    about = (*hints, f"target {target.geometry_id}{offset}", what)
    return lay_out_pages(pieces, grid, page, name=name, what=what, about=about)


def _stickers(
    target: TargetGeometry, pattern: Pattern, printing: PrintSpec
) -> tuple[tuple[Drawing, ...], PieceGrid, str]:
    """The stickers, the grid they are set in, and a line about them."""
    # A solid build is not made smaller: its sheets show the nominal faces.
    thickness = printing.sticker_thickness_mm if printing.way.has_stickers else 0.0
    inset = sticker_inset_mm(target, printing)
    for face in pattern.faces:
        _check_cut(face, inset, thickness)
    cuts = [moved_in(face.outline, inset) for face in pattern.faces]
    edges = [float(np.linalg.norm(cut - np.roll(cut, -1, axis=0), axis=1).min()) for cut in cuts]
    edge = min(edges)
    # The lower side takes a face number and a neighbour's beside each other.
    text_mm = min(_TEXT_MM, edge / 11)
    reach = inset + BLEED_MM
    band = reach + _CLEAR_MM + (_ASCENT + DESCENT) * text_mm + _CLEAR_MM / 2
    trims = [_trim_marks(cut, reach, band - _CLEAR_MM / 2) for cut in cuts]
    used = max(abs(x) for x, _ in (*(point for mark in trims[0] for point in mark),
                                   *moved_in(pattern.faces[0].outline, -BLEED_MM)))  # fmt: skip
    grid = _grid([moved_in(cut, -band) for cut in cuts], used)
    beside = joined_faces(target)
    pieces = tuple(
        Drawing(
            areas=(*ink_areas(face, pattern.stamps, printing.ink_colour), _code_corner_mark(cut, reach, text_mm)),
            cuts=(polygon(cut),),
            marks=trim,
            texts=_sticker_labels(number, beside[number], cut, reach, text_mm, turns=grid.turns),
        )
        for number, (face, cut, trim) in enumerate(zip(pattern.faces, cuts, trims, strict=True))
    )
    thick = f" {thickness:g} mm thick" if thickness else ""
    shortest = "cut edge" if target.spec is None or target.spec.solid is not None else "shortest cut edge"
    return pieces, grid, f"{len(pieces)} stickers{thick}, {shortest} {edge:.2f} mm"


def _grid(rooms: Sequence[Contour], used_mm: float) -> PieceGrid:
    """How pieces are set side by side: triangles of one shape turn about, others stand alike.

    Args:
        rooms: pieces with their labels about their origins, one side lowest.  # of (K, 2)
        used_mm: how far the piece itself and its marks reach to both sides.
    """
    room = rooms[0]
    if any(len(each) != len(room) or np.abs(each - room).max() > _ALIKE_MM for each in rooms):
        below, above = -min(each[:, 1].min() for each in rooms), max(each[:, 1].max() for each in rooms)
        wide = 2 * float(max(np.abs(each[:, 0]).max() for each in rooms))
        return PieceGrid(wide, wide, float(below + above), float(below), turns=False)
    width, height = np.ptp(room, axis=0).tolist()
    below = -float(room[:, 1].min())
    if len(room) != 3:
        return PieceGrid(width, width, height, below, turns=False)
    # The tips of the room at both ends of a row are empty, so they may stand over the printable area.
    return PieceGrid(min(width, 2 * used_mm), width / 2, height, below, turns=True)


def _check_cut(face: FacePattern, inset_mm: float, thickness_mm: float) -> None:
    """Hold the cut inside the border."""
    if face.window is None:
        return
    border = border_mm(face.outline, face.window[::-1])
    if inset_mm >= border:
        raise InputError(
            f"stickers {thickness_mm:g}mm thick are cut {inset_mm:.3g}mm inside the face's outline, through the border "
            f"of {border:.3g}mm; use stickers thinner than {border * thickness_mm / inset_mm:.2g}mm or a wider border"
        )


def _sticker_labels(
    face: int, joins: list[int], cut: Contour, reach: float, text_mm: float, *, turns: bool
) -> tuple[Text, ...]:
    """The face's number, and along each edge the number of the face that it joins; all read from below.

    Where stickers turn about, the labels of the upper sides stand nearer the lower side, away from those of the turned
    sticker beside them.
    """
    beside = reach + _CLEAR_MM
    under, above = beside + _ASCENT * text_mm, beside + DESCENT * text_mm
    side = np.stack([cut, np.roll(cut, -1, axis=0)], axis=1)  # (K, 2, 2)
    lowest = int(np.round(side[:, :, 1].mean(axis=1), 6).argmin())
    texts = [_along(side[lowest], 0.27, under, f"FACE {face}", text_mm, 0.0)]
    for k, other in ((k, other) for k, other in enumerate(joins) if other >= 0):  # none: a bare face
        if k == lowest:
            texts.append(_along(side[k], 0.75, under, f"joins {other}", text_mm, 0.0))
            continue
        x, y = side[k, 1] - side[k, 0]
        share = 0.5 if not turns else 0.7 if k < lowest else 0.3
        texts.append(_along(side[k], share, above, f"joins {other}", text_mm, math.atan2(-y, -x)))
    return tuple(texts)


def _along(side: Array, fraction: float, outward_mm: float, text: str, text_mm: float, angle: float) -> Text:
    """A text beside one side of a counter-clockwise outline.  # side: (2, 2)"""
    step = side[1] - side[0]
    outward = np.array([step[1], -step[0]]) / np.linalg.norm(step)
    at = side[0] + fraction * step + outward_mm * outward
    return Text(text, (float(at[0]), float(at[1])), text_mm, angle, centred=True)


def _code_corner_mark(cut: Contour, reach: float, text_mm: float) -> Area:
    """A small triangle that points at the first corner from outside, between the trim marks."""
    outward = cut[0] / np.linalg.norm(cut[0])
    across = np.array([outward[1], -outward[0]])
    sides = [(other - cut[0]) / np.linalg.norm(other - cut[0]) for other in (cut[1], cut[-1])]
    half_angle = math.acos(float(np.clip(sides[0] @ sides[1], -1.0, 1.0))) / 2
    tip = cut[0] + (reach / math.sin(half_angle) + _CLEAR_MM) * outward  # beyond the corner of the ink
    half, height = 0.3 * text_mm, 0.6 * text_mm
    base = tip + height * outward
    return Area(MARK_COLOUR, polygons=(polygon([tip, base + half * across, base - half * across]),))


def _board(pattern: Pattern, printing: PrintSpec) -> tuple[tuple[Drawing, ...], PieceGrid, str]:
    """The artwork of the board's sides, the room each takes, and a line about it."""
    several = len(pattern.faces) > 1
    label_mm = (_TEXT_MM + _CLEAR_MM) if several else 0.0
    band = BLEED_MM + _CLEAR_MM + max(_TRIM_MARK_MM, label_mm)
    outline = pattern.faces[0].outline
    width, height = np.ptp(outline, axis=0).tolist()
    below = (0.0, -height / 2 - BLEED_MM - _CLEAR_MM - _ASCENT * _TEXT_MM)
    pieces = tuple(
        Drawing(
            areas=ink_areas(face, pattern.stamps, printing.ink_colour),
            cuts=(polygon(outline),),
            marks=_trim_marks(outline, BLEED_MM, band),
            texts=(Text(f"SIDE {number}", below, _TEXT_MM, centred=True),) if several else (),
        )
        for number, face in enumerate(pattern.faces)
    )
    room = (width + 2 * band, height + 2 * band)
    grid = PieceGrid(room[0], room[0], room[1], room[1] / 2, turns=False)
    return pieces, grid, f"{'two sides of a ' if several else ''}board {width:g} x {height:g} mm"


def ink_areas(
    face: FacePattern, stamps: tuple[Stamp, ...], colour: str, bleed_mm: float = BLEED_MM
) -> tuple[Area, ...]:
    """A face's rings, dots, border and letters, in its own frame."""
    rings = []
    for row, (x, y) in zip(face.stamp.tolist(), face.position_mm.tolist(), strict=True):
        radii = (stamps[row].outer_radius_mm, stamps[row].inner_radius_mm)
        rings.append(Area(colour, circles=tuple(Circle((x, y), radius) for radius in radii if radius > 0)))
    letters = [Area(colour, polygons=(polygon(contour),)) for contour in face.dark_text]
    if face.window is None:
        return (*rings, *letters)
    contours = (moved_in(face.outline, -bleed_mm), face.window, *face.light_text)
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
