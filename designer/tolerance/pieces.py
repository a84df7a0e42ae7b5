"""What of a target moves as one where it is put together: the faces of a solid, the pieces of a board."""

from functools import lru_cache

import numpy as np

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.board_cuts import ring_pieces
from designer.target import TargetGeometry


def piece_of_ring(target: TargetGeometry) -> Rows:
    """The piece that each ring is on: its face; of a board with one face the piece of it.  # (R,)

    Of a board whose file names no pieces they are those that it would be cut in for the usual printer.
    """
    if target.ring_piece is not None:
        return target.ring_piece
    return _as_usual(target) if target.is_planar and target.is_plate else target.ring_face


@lru_cache(maxsize=8)
def _as_usual(target: TargetGeometry) -> Rows:
    """For the usual printer; one piece if it fits the bed, or cannot be cut."""
    from designer.kinds.sizing import size_printing
    from designer.spec.options import AskedPrinting

    try:
        piece = ring_pieces(target, size_printing(AskedPrinting(), target).printer)
    except InputError:
        piece = None
    return target.ring_face if piece is None else piece


def piece_count(target: TargetGeometry) -> int:
    """How many pieces."""
    return target.face_count if is_by_face(target) else int(piece_of_ring(target).max()) + 1


def is_by_face(target: TargetGeometry) -> bool:
    """Whether each face is a piece."""
    return piece_of_ring(target) is target.ring_face


def face_middle_mm(target: TargetGeometry) -> Array:
    """Middle of each face's outline, about which a face turns and bends.  # (F, 2)"""
    middle: Array = target.outline_mm.mean(axis=1)
    return middle


def piece_middle_mm(target: TargetGeometry) -> Array:
    """Middle of each piece, about which it turns: of a board that of the outer rings on it.  # (P, 2)"""
    if is_by_face(target):
        return face_middle_mm(target)
    piece, place = piece_of_ring(target), target.center_in_face_mm[:, :2]
    each = [place[piece == one] for one in range(piece_count(target))]
    return np.array([(one.min(axis=0) + one.max(axis=0)) / 2 for one in each])
