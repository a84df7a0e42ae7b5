"""A board that is larger than the bed, in flat pieces: seams between rows of rings, joined by keys from behind.

`board_in_pieces(target, printing)` cuts it. Seams run in the middle of the white between two columns or rows, those
between columns of a triangular lattice with a tooth a row (`board_cuts`). Two pieces touch at two pads of each seam and
are apart by the clearance elsewhere, so that no elephant foot presses them apart; bow-tie keys (butterflies) in pockets
of the backs hold them. No two seams have their keys as far apart, and none has them in its middle: a piece goes to one
place, one way round.

All lengths are the design's, in the target's frame: the face at z = 0, the back at z = -thickness.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold, triangulate

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.kinds.board_cuts import BoardCuts, Point, cut_board, room_mm, strip_mm
from designer.make.bed import QUARTER_TURN, Piece, Plate, in_rows, lying, numbered
from designer.make.lettering import HEIGHT, ID_DIGITS, text_contours, text_width
from designer.make.mesh import Mesh, Part, inlaid, mesh_of, plate_hull, prism, solid_of, union, wall_strip
from designer.make.pattern import Contour, make_pattern, moved_in
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry
from designer.target_scene import polygon_area_mm2

KEY_REACH_MM, KEY_WAIST_MM, KEY_END_MM = 9.0, 5.0, 9.0
"""Of a bow tie: how far it reaches into each piece, how wide it is in the seam and at its ends. Assumptions: a waist of
eleven lines does not break by hand, and flanks of 12 degrees hold without glue."""
_LOWER = ((-KEY_REACH_MM, -KEY_END_MM / 2), (0.0, -KEY_WAIST_MM / 2), (KEY_REACH_MM, -KEY_END_MM / 2))
BOW_TIE_MM = np.array([*_LOWER, *((-x, -y) for x, y in _LOWER)])
"""A key about its middle, its waist along y.  # (6, 2)"""
MOST_KEY_DEPTH_MM = 3.0
LEAST_KEY_LAYERS = 3
CLOSED_LAYERS, ENGRAVED_LAYERS = 2, 2
"""Between the ink and a pocket behind it; of letters."""
CHAMFER_LAYERS = 2
"""Of edges in a seam that lie on the bed: elephant feet bulge in the first layers (an assumption)."""
FIRST_KEY, FARTHEST_KEY = 0.2, 0.75
"""Where the first key of a seam lies, and the second one at most, over the seam's length."""
KEY_STEP_MM = 1.0
"""By which the distances of two seams' keys differ: four clearances or more."""
PAD_PLACES, PAD_WIDTH_MM = (0.08, 0.92), 6.0
NUMBER_STROKE_MM, JOINS_STROKE_MM = 2.0, 0.8
_FAR_MM = 1000.0


@dataclass(frozen=True, eq=False)
class Seam:
    """Where two pieces meet: a line with the lower-numbered piece on its left; of a seam with teeth their middle."""

    pieces: tuple[int, int]  # rows of `BoardInPieces.pieces`
    start_mm: Array  # (2,)
    end_mm: Array  # (2,)
    keys_mm: Array  # (2, 2) middles of its keys

    @property
    def along(self) -> Array:
        """Unit vector.  # (2,)"""
        step: Array = self.end_mm - self.start_mm
        return step / np.linalg.norm(step)

    @property
    def across(self) -> Array:
        """From the piece on its left to the other.  # (2,)"""
        return np.array([self.along[1], -self.along[0]])

    @property
    def length_mm(self) -> float:
        """From end to end."""
        return float(np.linalg.norm(self.end_mm - self.start_mm))


@dataclass(frozen=True, eq=False)
class BoardPiece:
    """A piece in the target's frame."""

    number: int  # from 1, row by row from below
    low_mm: Point  # of its share of the board
    high_mm: Point
    outline_mm: Array  # (N, 2) the share, with the teeth of its seams
    part: Part


@dataclass(frozen=True, eq=False)
class BoardInPieces:
    """A board in pieces, and the keys that join them."""

    pieces: tuple[BoardPiece, ...]
    seams: tuple[Seam, ...]
    columns: int  # pieces side by side
    is_turned: bool  # pieces lie on the bed turned by a quarter
    key: Mesh  # upright, as it is printed, over its middle; its waist along y
    key_top_mm: float  # z of the pockets' floors


@lru_cache(maxsize=2)
def board_in_pieces(target: TargetGeometry, printing: PrintSpec) -> BoardInPieces:
    """Cut a board into as few pieces as the printer's bed takes.

    Args:
        target: the nominal geometry of a board with one face.
        printing: how it is made.

    Raises:
        InputError: it fits the bed in one piece, has two faces, is too thin for keys or has too little white between
            its rings for seams, or a piece would be larger than the bed.
    """
    if target.spec is None or not target.is_planar:
        raise InputError("a board with rings on both faces has no back for keys; use build one-piece or sheet")
    printer, scale = printing.printer, 1 + printing.shrink_compensation_percent / 100
    thickness, inlay, layer = target.spec.depth_mm, printing.inlay_mm / scale, printer.layer_height_mm
    depth = _key_depth_mm(thickness, inlay, layer)
    cuts = cut_board(target, printer, scale)
    seams = tuple(_seams(cuts, printer.clearance_mm))
    # Ink is offset by what the print bleeds, whatever it shrinks; letters that a seam would cut stand on the backs.
    pattern = make_pattern(target, replace(printing, labels=False, ink_offset_mm=printing.ink_offset_mm / scale))
    whole = inlaid(pattern, plate_hull(pattern, thickness, inlay), inlay)
    assert whole.ink is not None  # noqa: S101 - rings are ink
    key_top = depth - thickness
    body, ink = (
        solid_of(whole.body) - union(list(_pockets(seams, printer.clearance_mm, key_top))),
        solid_of(whole.ink),
    )
    chamfer = min(CHAMFER_LAYERS * layer, (cuts.white_mm - printer.clearance_mm) / 2 - printer.line_width_mm)
    target_id = target.geometry_id[:ID_DIGITS].upper()
    pieces = []
    # Farther out than any inset of seams, which leaves the board's own edges as they are.
    beyond = printer.clearance_mm + chamfer + 4.0
    for row, (low, high) in enumerate(cuts.cells()):
        share = cuts.outline_mm(low, high, beyond)
        cell = _cell(share, printer.clearance_mm, chamfer, thickness, is_down=printing.ink_side == "down")
        mine = [seam for seam in seams if row in seam.pieces]
        solid = union([body ^ cell, *_pads(share, mine, cuts.tooth_mm, thickness)])
        letters = tuple(_letters(row, low, high, mine, target_id, cuts.tooth_mm))
        solid -= prism(letters, -thickness - 1.0, -thickness + ENGRAVED_LAYERS * layer)
        pieces.append(
            BoardPiece(row + 1, low, high, cuts.outline_mm(low, high), Part(mesh_of(solid), mesh_of(ink ^ cell)))
        )
    key = mesh_of(Manifold.extrude(CrossSection([BOW_TIE_MM]), depth - layer))
    return BoardInPieces(tuple(pieces), seams, len(cuts.x_mm) - 1, cuts.is_turned, key, key_top)


def _key_depth_mm(thickness: float, inlay: float, layer: float) -> float:
    """Depth of the pockets in whole layers.

    Raises:
        InputError: the board is too thin.
    """
    closed = inlay + CLOSED_LAYERS * layer
    layers = math.floor(min(MOST_KEY_DEPTH_MM, thickness - closed) / layer + 1e-9)
    if layers < LEAST_KEY_LAYERS + 1:
        least = math.ceil(10 * (closed + (LEAST_KEY_LAYERS + 1) * layer) - 1e-6) / 10
        raise InputError(
            f"thickness {thickness:g}mm leaves {max(layers, 0)} layers for keys behind ink of {inlay:g}mm; use a "
            f"thickness of at least {least:g}mm"
        )
    return layers * layer


def _seams(cuts: BoardCuts, clearance: float) -> Iterator[Seam]:
    """All seams with their keys.

    Raises:
        InputError: pieces are too small to be told apart by their keys.
    """
    columns, step, number = len(cuts.x_mm) - 1, max(KEY_STEP_MM, 4 * clearance), 0
    for row, (low, high) in enumerate(cuts.cells()):
        for other, start, end in (
            (row + 1, (high[0], low[1]), (high[0], high[1])),  # to the right
            (row + columns, (high[0], high[1]), (low[0], high[1])),  # above
        ):
            if (other == row + 1 and high[0] == cuts.x_mm[-1]) or (other == row + columns and high[1] == cuts.y_mm[-1]):
                continue
            seam = Seam((row, other), np.array(start), np.array(end), np.zeros((2, 2)))
            first, apart = FIRST_KEY * seam.length_mm, (FARTHEST_KEY - FIRST_KEY) * seam.length_mm - number * step
            if apart < 2 * KEY_END_MM or first < KEY_REACH_MM + KEY_END_MM / 2:
                raise InputError(
                    f"a seam of {seam.length_mm:.0f}mm has no room for two keys that no other seam has so far apart; "
                    "use fewer pieces: a larger printer, or a smaller board"
                )
            keys = seam.start_mm + np.array([[first], [first + apart]]) * seam.along
            keys[:, 0] += cuts.aside_mm(keys[:, 1]) * abs(seam.along[1])
            yield replace(seam, keys_mm=keys)
            number += 1


def _pockets(seams: tuple[Seam, ...], clearance: float, top_mm: float) -> Iterator[Manifold]:
    """Room for the keys with the clearance around them, from far behind up to the pockets' floors."""
    room = Manifold.extrude(CrossSection([BOW_TIE_MM]).offset(clearance, JoinType.Miter), _FAR_MM)
    for seam in seams:
        for middle in seam.keys_mm:
            frame = np.eye(4)
            frame[:2, 0], frame[:2, 1] = seam.across, seam.along
            frame[:3, 3] = [*middle, top_mm - _FAR_MM]
            yield room.transform(frame[:3])


def _cell(share: Contour, clearance: float, chamfer: float, thickness: float, *, is_down: bool) -> Manifold:
    """All that belongs to a piece: its share less half the clearance at seams, their edges on the bed chamfered."""
    bed, away = (0.0, -1.0) if is_down else (-thickness, 1.0)
    levels = [(bed - away, chamfer + 1.0), (bed + away * chamfer, 0.0), (bed + away * (thickness + 1.0), 0.0)]
    loops = [(z, moved_in(share, clearance / 2 + extra)) for z, extra in sorted(levels, reverse=True)]
    corners = len(share)
    ids = np.arange(3 * corners, dtype=np.int32).reshape(3, corners)
    cap = triangulate([loops[0][1]]), triangulate([loops[-1][1]])[:, ::-1] + 2 * corners
    walls = [wall_strip(upper, lower) for upper, lower in pairwise(ids)]
    points = np.concatenate([np.column_stack([loop, np.full(corners, z)]) for z, loop in loops])
    return solid_of(Mesh(points, np.concatenate([*cap, *walls]).astype(np.int32)))


def _pads(share: Contour, seams: list[Seam], tooth: float, thickness: float) -> Iterator[Manifold]:
    """What touches the other pieces: two low pads on the rear half of each seam's wall, up to the seam itself."""
    whole = CrossSection([share])
    for seam in seams:
        for place in PAD_PLACES:
            middle = seam.start_mm + place * seam.length_mm * seam.along
            reach = [PAD_WIDTH_MM / 2 * seam.along, (tooth + 1.0) * seam.across]
            corners = [middle + a * reach[0] + b * reach[1] for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
            contour = np.array(corners)
            contour = contour if polygon_area_mm2(contour) > 0 else contour[::-1]
            pad = CrossSection([contour]) ^ whole
            yield Manifold.extrude(pad, thickness / 2).translate((0.0, 0.0, -thickness))


def _letters(row: int, low: Point, high: Point, seams: list[Seam], target_id: str, tooth: float) -> Iterator[Contour]:
    """The piece's number and the target's id in the middle of its back, and at each seam the number that it joins.

    They are read from behind, the board's upper side up.
    """
    middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2])

    def written(text: str, stroke: float, at: Array, below: float) -> Iterator[Contour]:
        for contour in text_contours(text, stroke, -HEIGHT * stroke / 2 - below):
            yield (contour * [-1.0, 1.0])[::-1] + at

    yield from written(str(row + 1), NUMBER_STROKE_MM, middle, 0.0)
    yield from written(target_id, JOINS_STROKE_MM, middle, HEIGHT * NUMBER_STROKE_MM)
    for seam in seams:
        other = seam.pieces[1] if row == seam.pieces[0] else seam.pieces[0]
        inward = -seam.across if row == seam.pieces[0] else seam.across
        room = JOINS_STROKE_MM * max(HEIGHT, text_width(str(other + 1))) + tooth * abs(seam.along[1])
        yield from written(str(other + 1), JOINS_STROKE_MM, (seam.start_mm + seam.end_mm) / 2 + room * inward, 0.0)


def board_plates(board: BoardInPieces, printing: PrintSpec) -> tuple[Plate, ...]:
    """The pieces in two filaments, then the keys in one."""
    flat = np.diag([-1.0, 1.0, -1.0]) if printing.ink_side == "down" else np.eye(3)
    axes = QUARTER_TURN @ flat if board.is_turned else flat
    pieces = [lying(f"piece {one.number}", one.part, axes, printing) for one in board.pieces]
    key = Part(board.key, None)
    keys = [lying(f"key {number}", key, np.eye(3), printing) for number in range(1, 2 * len(board.seams) + 1)]
    left, front = strip_mm(printing.printer).tolist()
    tower = (0.0, 0.0, left or printing.printer.bed_mm[0], front or printing.printer.bed_mm[1])
    corner, room = room_mm(printing.printer)

    def place(size_mm: tuple[float, float]) -> tuple[float, float] | None:
        """In the middle of the room behind the prime tower."""
        x, y = (corner + (room - size_mm) / 2).tolist()
        return (x, y) if (np.array(size_mm) <= room + 1e-6).all() else None

    return numbered(in_rows(pieces, room[0], place), in_rows(keys, room[0], place), tower, _words)


def _words(group: tuple[Piece, ...]) -> str:
    """What a plate holds: `pieces 1, 2`, `14 keys`."""
    if group[0].part.ink is None:
        return f"{len(group)} keys"
    return f"piece{'s' * (len(group) > 1)} {', '.join(piece.name.split()[1] for piece in group)}"
