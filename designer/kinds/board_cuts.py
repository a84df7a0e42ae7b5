"""Where a board that is larger than the printer's bed is cut: straight, in the white between rows of rings."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM
from designer.spec.spec import PrinterProfile
from designer.target import TargetGeometry

Point = tuple[float, float]

MOST_PIECES = 64


@dataclass(frozen=True)
class BoardCuts:
    """Where a board is cut, its own edges included."""

    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    is_turned: bool
    white_mm: float  # across the narrowest seam; infinite without one

    @property
    def unlike_mm(self) -> float:
        """By how much the largest piece is longer one way."""
        return float(abs(np.diff(self.x_mm).max() - np.diff(self.y_mm).max()))

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
    needed = printer.clearance_mm + 2 * printer.line_width_mm
    places = [[at for at, width in one if width >= needed - 1e-9] for one in white]
    best: BoardCuts | None = None
    for count in range(2, MOST_PIECES + 1):
        for across in (n for n in range(1, count + 1) if count % n == 0):
            ways = [_split(float(low[k]), float(high[k]), n, places[k]) for k, n in ((0, across), (1, count // across))]
            if None in ways:
                continue
            x, y = (np.array(way) for way in ways)
            largest = np.array([np.diff(x).max(), np.diff(y).max()])
            turned = _fits(largest, room)
            if turned is not None and (best is None or abs(largest[0] - largest[1]) < best.unlike_mm):
                widths = [width for one, at in zip(white, (x, y), strict=True) for place, width in one if place in at]
                best = BoardCuts(tuple(x.tolist()), tuple(y.tolist()), turned, min(widths))
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
    column, row = (
        np.searchsorted(edges[1:-1], target.center_in_face_mm[:, axis])
        for axis, edges in enumerate((cuts.x_mm, cuts.y_mm))
    )
    return np.asarray(row * (len(cuts.x_mm) - 1) + column, dtype=np.int64)
