"""Boards in pieces: whole rings where the target has them, no overlap, clearances, keys that tell pieces apart."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from manifold3d import Manifold
from shapely import Point, Polygon, box, unary_union

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.kinds.sizing import size_job
from designer.make.board_tiles import CLOSED_LAYERS, BoardInPieces, board_in_pieces, board_plates
from designer.make.mesh import Mesh, solid_of
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM
from designer.spec.spec import Job
from tests.support.designs import asked_for

LARGE: dict[str, object] = {"size": "330x260mm", "pitch": "20mm", "bed": "180x180x180mm", "chord_error": "50um"}


@cache
def job(**values: object) -> Job:
    """A board of 16 x 13 rings on a bed that takes six pieces of it."""
    return size_job(asked_for("board", {**LARGE, **values})).job


@cache
def large(**values: object) -> BoardInPieces:
    """The same in pieces."""
    made = job(**values)
    return board_in_pieces(made.target.lay_out(), made.printing)


def placed_keys(board: BoardInPieces) -> Iterator[Manifold]:
    """Each key in its pockets, in the target's frame: on the pockets' floors, a layer below the back."""
    for seam in board.seams:
        for middle in seam.keys_mm:
            frame = np.eye(4)
            frame[:2, 0], frame[:2, 1] = seam.across, seam.along
            frame[:3, 3] = [*middle, board.key_top_mm - float(board.key.vertices_mm[:, 2].max())]
            yield solid_of(board.key).transform(frame[:3])


def solids(board: BoardInPieces) -> list[Manifold]:
    """Pieces with their ink, in the target's frame."""
    found = []
    for piece in board.pieces:
        assert piece.part.ink is not None
        found.append(solid_of(piece.part.body) + solid_of(piece.part.ink))
    return found


def centres_of_ink(ink: Mesh, near_mm: np.ndarray) -> np.ndarray:
    """Centroids of the ink at the surface, of each place the ink nearest to it; nan: none.  # (R, 2)"""
    corner = ink.vertices_mm[ink.triangles]
    corner = corner[(np.abs(corner[:, :, 2]) < 1e-9).all(axis=1)][:, :, :2]
    side = corner[:, 1:] - corner[:, :1]
    area = 0.5 * (side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
    middle = corner.mean(axis=1)
    of = np.linalg.norm(middle[:, None] - near_mm, axis=2).argmin(axis=1)
    total = np.bincount(of, area, len(near_mm))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.stack([np.bincount(of, area * middle[:, k], len(near_mm)) / total for k in (0, 1)], axis=1)


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_every_ring_is_whole_and_in_its_place(lattice: str) -> None:
    """Each ring is in one piece only, its centre within 1e-5 mm of the target's; no ink is lost."""
    target, board = job(lattice=lattice).target.lay_out(), large(lattice=lattice)
    seen = np.zeros(target.ring_count, dtype=np.int64)
    for piece in board.pieces:
        assert piece.part.ink is not None
        centre = centres_of_ink(piece.part.ink, target.center_mm[:, :2])
        here = np.isfinite(centre[:, 0])
        seen += here
        assert np.abs(centre - target.center_mm[:, :2])[here].max() < 1e-5
    assert (seen == 1).all()
    ink = sum(piece.part.ink.volume_mm3 for piece in board.pieces if piece.part.ink is not None)
    area = np.pi * (target.radius_outer_mm**2 - target.radius_inner_mm**2).sum()
    assert ink == pytest.approx(area * job().printing.inlay_mm, rel=1e-4)


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_the_target_says_which_piece_a_ring_is_on(lattice: str) -> None:
    """As they are cut; of the same board in one piece it says nothing."""
    target, pieces = Design(job(build="tiles", lattice=lattice)).target, large(lattice=lattice).pieces
    assert target.ring_piece is not None
    shares = [Polygon(piece.outline_mm) for piece in pieces]
    for place, piece, radius in zip(
        target.center_in_face_mm[:, :2], target.ring_piece, target.radius_outer_mm, strict=True
    ):
        assert shares[piece].contains(Point(place).buffer(radius + 0.5))
    assert target.ring_piece.max() + 1 == len(pieces)
    assert Design(job()).target.ring_piece is None


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_nothing_overlaps_and_clearances_are_the_printers(lattice: str) -> None:
    """Pieces touch at their pads alone, and lie a clearance apart elsewhere; so do keys from their pockets' walls."""
    board, clearance = large(lattice=lattice), job().printing.printer.clearance_mm
    parts, keys = solids(board), list(placed_keys(board))
    assert len(board.pieces) == 6
    assert len(keys) == 2 * len(board.seams) == 14
    shares = [Polygon(piece.outline_mm) for piece in board.pieces]
    assert unary_union(shares).equals(box(-165, -130, 165, 130))
    seams = (sum(share.length for share in shares) - 2 * (330 + 260)) / 2
    assert 330 * 260 - sum(part.slice(-1.5).area() for part in parts) == pytest.approx(clearance * seams, rel=0.01)
    for a, b in combinations(parts, 2):
        assert (a ^ b).volume() < 1e-6
    front = [part.trim_by_plane((0.0, 0.0, 1.0), -0.4 * 5.0) for part in parts]
    back = [part.trim_by_plane((0.0, 0.0, -1.0), 0.6 * 5.0) for part in parts]
    for seam in board.seams:
        a, b = seam.pieces
        assert front[a].min_gap(front[b], 5.0) == pytest.approx(clearance, abs=1e-6)
        assert back[a].min_gap(back[b], 5.0) == pytest.approx(0.0, abs=1e-6)
    for number, key in enumerate(keys):
        lowered = key.translate((0.0, 0.0, -0.5))  # off the pockets' floors, on which it lies
        for row in board.seams[number // 2].pieces:
            assert (key ^ parts[row]).volume() < 1e-6
            assert lowered.min_gap(parts[row], 5.0) == pytest.approx(clearance, abs=1e-6)
        for step in (*np.eye(3)[:2], *-np.eye(3)[:2]):  # pulled along or across, it soon runs into a wall
            pulled = lowered.translate(tuple(2 * clearance * step))
            assert max((pulled ^ parts[row]).volume() for row in board.seams[number // 2].pieces) > 1e-3
        assert key.bounding_box()[2] > -5.0 + 0.1  # no key stands out of the back


def test_pockets_stay_clear_of_the_ink() -> None:
    """Two closed layers at least between them."""
    board, printing = large(), job().printing
    assert board.key_top_mm <= -(printing.inlay_mm + CLOSED_LAYERS * printing.printer.layer_height_mm) + 1e-9


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_a_piece_fits_one_place_one_way_round(lattice: str) -> None:
    """In any other piece's place, or turned by half a turn, keys of the place run into it (or its seams are others)."""
    board = large(lattice=lattice)
    parts, keys = solids(board), list(placed_keys(board))
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    for place, there in enumerate(board.pieces):
        needed = [key for n, key in enumerate(keys) if place in board.seams[n // 2].pieces]
        middle = np.array([*there.low_mm, 0.0]) / 2 + np.array([*there.high_mm, 0.0]) / 2
        for row, here in enumerate(board.pieces):
            own = np.array([*here.low_mm, 0.0]) / 2 + np.array([*here.high_mm, 0.0]) / 2
            for is_turned in (False, True):
                if row == place and not is_turned:
                    continue
                moved = parts[row].translate(tuple(-own))
                moved = (moved.transform(turn[:3]) if is_turned else moved).translate(tuple(middle))
                assert max((key ^ moved).volume() for key in needed) > 1.0


@pytest.mark.parametrize("ink_side", ["down", "up"])
def test_plates_hold_everything_once_beside_brim_and_tower(ink_side: str) -> None:
    """Every piece and key, ink in the first layers (or the last); room for a brim, and the tower's strip free."""
    made = job()
    printing = replace(made.printing, ink_side=ink_side)
    board = board_in_pieces(made.target.lay_out(), printing)
    plates = board_plates(board, printing)
    names = [piece.name for plate in plates for piece in plate.pieces]
    assert len(names) == len(set(names)) == 6 + 14
    assert [plate.is_two_filament for plate in plates] == [True] * (len(plates) - 1) + [False]
    for plate in plates:
        for piece in plate.pieces:
            placed = piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T + piece.bed_from_part[:3, 3]
            assert (placed.min(axis=0)[:2] >= [BRIM_MM, BRIM_MM + TOWER_DEPTH_MM]).all()
            assert (placed.max(axis=0)[:2] <= 180 - BRIM_MM).all()
            if piece.part.ink is not None:
                ink = piece.part.ink.vertices_mm @ piece.bed_from_part[:3, :3].T + piece.bed_from_part[:3, 3]
                levels = (0.0, 0.6) if ink_side == "down" else (4.4, 5.0)
                assert (ink[:, 2].min(), ink[:, 2].max()) == pytest.approx(levels)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"size": "130x120mm"}, "fits the bed of .* in one piece; use build one-piece"),
        ({"ring_diameter": "19mm"}, "white of 1mm between columns is too little .* use 1.05mm or more"),
        (
            {"lattice": "triangular", "ring_diameter": "18mm"},
            "no straight white between its columns for seams; use --lattice square",
        ),
        ({"lattice": "triangular", "ring_diameter": "17mm"}, "white of 0.321mm between columns is too little"),
        ({"thickness": "1.2mm"}, "thickness 1.2mm leaves .* use a thickness of at least"),
        ({"pitch": "140mm", "size": "600x600mm", "ring_diameter": "80mm"}, "takes 170 x 135mm .* larger printer"),
        ({"two_sided": True}, "no back for keys; use build one-piece or sheet"),
    ],
)
def test_what_no_board_in_pieces_can_be(values: dict[str, object], message: str) -> None:
    """The value, the rule, the remedy."""
    with pytest.raises(InputError, match=message):
        large(**values)


def test_a_triangular_board_is_cut_between_its_rows() -> None:
    """Where only its rows are too many."""
    board = large(lattice="triangular", size="130x300mm")
    assert board.columns == 1
    assert len(board.pieces) > 1
