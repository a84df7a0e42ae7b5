"""Where a board that is larger than the printer's bed is cut: in the white between rows of rings.

Straight between rows and columns; in a triangular lattice, which has no columns, from row to row between two rings and
on to the left or right of the one between them, so that a seam has a tooth a row.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.layout import distance_to_sides
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM
from designer.spec.spec import PrinterProfile
from designer.target import PARALLEL, TargetGeometry

Point = tuple[float, float]

MOST_PIECES = 64


@dataclass(frozen=True)
class BoardCuts:
    """Where a board is cut, its own edges included."""

    x_mm: tuple[float, ...]  # of seams with teeth their middles
    y_mm: tuple[float, ...]
    is_turned: bool
    white_mm: float  # across the narrowest seam; infinite without one
    teeth_mm: Array  # (N, 2) how far aside seams that run upwards turn, and at what height; none: they are straight

    @property
    def tooth_mm(self) -> float:
        """How far teeth stand out of a seam."""
        return float(np.abs(self.teeth_mm[:, 0]).max(initial=0.0))

    def aside_mm(self, y_mm: Array) -> Array:
        """Where seams that run upwards are at these heights, from their middles."""
        return np.interp(y_mm, self.teeth_mm[:, 1], self.teeth_mm[:, 0]) if len(self.teeth_mm) else 0 * y_mm

    def outline_mm(self, low: Point, high: Point, beyond_mm: float = 0.0) -> Array:
        """A piece, counter-clockwise, and what of a frame of this width around the board is beside it.  # (N, 2)"""
        bottom, top = (y + beyond_mm * ((y == self.y_mm[-1]) - float(y == self.y_mm[0])) for y in (low[1], high[1]))
        sides = []
        for x, outwards in ((low[0], -1.0), (high[0], 1.0)):
            is_edge = x in (self.x_mm[0], self.x_mm[-1])
            turns = self.teeth_mm[(self.teeth_mm[:, 1] > bottom) & (self.teeth_mm[:, 1] < top), 1]
            y = np.array([bottom, *([] if is_edge else turns), top])
            aside = np.full(2, outwards * beyond_mm) if is_edge else self.aside_mm(y)
            sides.append(np.column_stack([x + aside, y]))
        return np.concatenate([sides[1], sides[0][::-1]])

    def cells(self) -> Iterator[tuple[Point, Point]]:
        """Lower left and upper right corners of the pieces, row by row from below."""
        for low_y, high_y in pairwise(self.y_mm):
            for low_x, high_x in pairwise(self.x_mm):
                yield (low_x, low_y), (high_x, high_y)


def strip_mm(printer: PrinterProfile) -> Array:
    """Where the prime tower stands: along the bed's longer side, in front, and left free there.  # (2,)

    In front, since printers keep a corner there for themselves (P1 and X1 of Bambu Lab 18 x 28 mm for the cutter).
    """
    across = 1 if printer.bed_mm[1] <= printer.bed_mm[0] else 0
    strip: Array = np.eye(2)[across] * TOWER_DEPTH_MM
    return strip


def room_mm(printer: PrinterProfile) -> tuple[Array, Array]:
    """What a bed takes beside brim, prime tower and what it excludes: front left corner and size.  # (2,), (2,)"""
    strip = strip_mm(printer)
    rooms = printer.rooms_mm(BRIM_MM, (float(strip[0]), float(strip[1])))
    left, front, right, rear = max(rooms, key=lambda room: (room[2] - room[0]) * (room[3] - room[1]))
    return np.array([left, front]), np.array([right - left, rear - front])


def cut_board(target: TargetGeometry, printer: PrinterProfile, scale: float) -> BoardCuts:
    """The fewest pieces that fit the bed, as near to squares as that allows.

    Raises:
        InputError: none do, or the board needs no cut.
    """
    room = room_mm(printer)[1] / scale
    low, high = target.outline_mm[0].min(axis=0), target.outline_mm[0].max(axis=0)
    size = high - low
    if _fits(size, room) is not None:
        raise InputError(
            f"board {size[0]:g}x{size[1]:g}mm fits the bed of {printer.name} in one piece; use build one-piece"
        )
    white = [_white(target, axis) for axis in (0, 1)]
    teeth = np.empty((0, 2))
    if not white[0]:
        teeth, white[0] = _toothed(target)
    tooth = float(np.abs(teeth[:, 0]).max(initial=0.0))
    needed = printer.clearance_mm + 2 * printer.line_width_mm
    places = [[at for at, width in one if width >= needed - 1e-9] for one in white]
    best: BoardCuts | None = None
    unlike = math.inf  # by how much the largest piece is longer one way
    for count in range(2, MOST_PIECES + 1):
        for across in (n for n in range(1, count + 1) if count % n == 0):
            ways = [_split(float(low[k]), float(high[k]), n, places[k]) for k, n in ((0, across), (1, count // across))]
            if None in ways:
                continue
            x, y = (np.array(way) for way in ways)
            both_sides = np.r_[0.0, np.full(across - 1, tooth), 0.0]  # teeth stand out of pieces on both sides of seams
            largest = np.array([(np.diff(x) + both_sides[1:] + both_sides[:-1]).max(), np.diff(y).max()])
            turned = _fits(largest, room)
            if turned is not None and abs(largest[0] - largest[1]) < unlike:
                widths = [width for one, at in zip(white, (x, y), strict=True) for place, width in one if place in at]
                best = BoardCuts(tuple(x.tolist()), tuple(y.tolist()), turned, min(widths), teeth)
                unlike = float(abs(largest[0] - largest[1]))
        if best is not None:
            return best
    raise InputError(_why_not(size, room, white, places, needed, printer))


def _fits(size: Array, room: Array) -> bool | None:
    """Whether a rectangle is to be turned by a quarter to lie in the room; None: it is too large either way."""
    if (size <= room + 1e-9).all():
        return False
    return True if (size[::-1] <= room + 1e-9).all() else None


def _white(target: TargetGeometry, axis: int) -> list[tuple[float, float]]:
    """Middles and widths of the straight strips without ring or dot across an axis."""
    center, radius = target.center_in_face_mm[:, axis], target.radius_outer_mm
    order = np.argsort(center - radius)
    begin, end = (center - radius)[order], np.maximum.accumulate((center + radius)[order])
    gaps = begin[1:] - end[:-1]
    (at,) = np.nonzero(gaps > 0)
    return [(float((begin[k + 1] + end[k]) / 2), float(gaps[k])) for k in at.tolist()]


def _toothed(target: TargetGeometry) -> tuple[Array, list[tuple[float, float]]]:
    """Teeth of a seam upwards, and its middles with the white across it.

    Row by row it passes between two rings half a pitch farther left or right than in the row before.  # (N, 2)
    """
    center, radius = target.center_in_face_mm[:, :2], target.radius_outer_mm
    rows = np.unique(np.round(center[:, 1], 6))
    pitch = float(np.linalg.norm(target.lattice_mm[0, 0]))
    first = center[np.abs(center[:, 1] - rows[0]) < PARALLEL, 0]
    teeth = np.column_stack([0.25 * pitch * np.where(np.arange(len(rows)) % 2, 1.0, -1.0), rows])
    from_seam = center[:, 0] - np.interp(center[:, 1], rows, teeth[:, 0])
    places = []
    for middle in (np.sort(first)[:-1] + 0.75 * pitch).tolist():
        corner = teeth + np.array([middle, 0.0])
        near = np.abs(from_seam - middle) < pitch
        gap = distance_to_sides(center[near, None], corner[:-1], corner[1:]).min(axis=1) - radius[near]
        places.append((middle, 2 * float(gap.min())))
    return teeth, [(middle, width) for middle, width in places if width > 0]


def _split(low: float, high: float, count: int, places: list[float]) -> list[float] | None:
    """Edges of so many pieces, cut at the places nearest to equal parts; None: there are too few."""
    wanted = [low + (high - low) * k / count for k in range(1, count)]
    cuts = [min(places, key=lambda at: abs(at - middle), default=low) for middle in wanted]
    edges = [low, *cuts, high]
    return edges if all(after > before for before, after in pairwise(edges)) else None


def _why_not(
    size: Array, room: Array, white: list[list[tuple[float, float]]], places: list[list[float]], needed: float,
    printer: PrinterProfile,
) -> str:  # fmt: skip
    """What stands against any cut, and what would help."""
    for axis, what in ((0, "columns"), (1, "rows")):
        if size[axis] <= room.min() or places[axis]:
            continue
        if not white[axis]:
            return (
                f"the lattice has no straight white between its {what} for seams; use --lattice square, or a board of "
                f"at most {room.min():.0f}mm across them"
            )
        widest = max(width for _, width in white[axis])
        return (
            f"white of {widest:.3g}mm between {what} is too little for a seam of {printer.clearance_mm:g}mm with a "
            f"line of {printer.line_width_mm:g}mm on either side; use {needed:.3g}mm or more: smaller rings or a "
            "larger pitch"
        )
    bed = " x ".join(f"{length:g}" for length in printer.bed_mm[:2])
    return (
        f"no {MOST_PIECES} pieces of a board of {size[0]:g}x{size[1]:g}mm fit the bed of {bed}mm, which takes "
        f"{room[0]:.0f} x {room[1]:.0f}mm beside brim and prime tower; use a smaller pitch, a smaller board or a "
        "larger printer"
    )


def ring_pieces(target: TargetGeometry, printer: PrinterProfile, scale: float = 1.0) -> Rows | None:
    """The piece that each ring is on, from 0, row by row from below; None: it is not a board that can be cut.  # (R,)

    Args:
        target: the nominal geometry.
        printer: on whose bed the pieces lie.
        scale: of the print over the design.
    """
    if not (target.is_planar and target.is_plate):
        return None
    try:
        cuts = cut_board(target, printer, scale)
    except InputError:
        return None
    x, y = target.center_in_face_mm[:, :2].T
    column, row = np.searchsorted(cuts.x_mm[1:-1], x - cuts.aside_mm(y)), np.searchsorted(cuts.y_mm[1:-1], y)
    return np.asarray(row * (len(cuts.x_mm) - 1) + column, dtype=np.int64)
