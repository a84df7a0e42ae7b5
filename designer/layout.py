"""From a resolved spec to the nominal target geometry."""

import math

import numpy as np
from numpy.typing import NDArray

from designer.code import BOARD_DOTS, CODES, FACE_CODE, FACE_CORNER, Index
from designer.polyhedron import frames_of_triangles, icosahedron_faces, icosahedron_vertices
from designer.spec import BoardSpec, IcoSpec, Lattice, TargetSpec
from designer.target import TargetGeometry

_DECIMALS = 9
"""Coordinates are rounded to a picometre, so that processors whose sine differs in the last bit agree on ids."""

TRIANGLE_STEPS = np.array([[-0.5, -math.sqrt(3) / 2], [0.5, -math.sqrt(3) / 2]])
"""Steps of i and j on an icosahedron's face, from the code corner at the top down its two sides.  # (2, 2)"""


def lay_out(spec: TargetSpec) -> TargetGeometry:
    """The nominal geometry of a target."""
    return lay_out_ico(spec) if isinstance(spec, IcoSpec) else lay_out_board(spec)


def triangle_corners(inradius_mm: float) -> NDArray[np.float64]:
    """Corners of an equilateral triangle around the origin, the first on +y, counter-clockwise.  # (3, 2)"""
    turn = np.pi / 2 + 2 * np.pi / 3 * np.arange(3)
    return 2 * inradius_mm * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def lay_out_ico(spec: IcoSpec) -> TargetGeometry:
    """The icosahedron: the same triangular lattice on each face, and the face's code in dots.

    The face frame has its origin at the face's centroid, y towards the code corner, z outward.
    """
    corner_order = [np.roll(face, -corner) for face, corner in zip(icosahedron_faces(), FACE_CORNER, strict=True)]
    frames = frames_of_triangles(spec.edge_mm * icosahedron_vertices()[np.array(corner_order)])
    index = [(i, j) for i in range(spec.rings_per_side) for j in range(spec.rings_per_side - i)]
    apex = np.array([0.0, (spec.rings_per_side - 1) * spec.pitch_mm / math.sqrt(3)])
    in_face = apex + np.array(index) @ (spec.pitch_mm * TRIANGLE_STEPS)
    inradius = spec.edge_mm / (2 * math.sqrt(3))
    return _assemble(
        spec,
        index=index,
        in_face_mm=in_face,
        dots=[CODES[code] for code in FACE_CODE],
        target_from_face=frames,
        outline_mm=triangle_corners(inradius),
        window_mm=triangle_corners(inradius - spec.border_mm),
        face_code=list(FACE_CODE),
        lattice_mm=spec.pitch_mm * TRIANGLE_STEPS,
    )


def lay_out_board(spec: BoardSpec) -> TargetGeometry:
    """The board: x right, y up, z out of the face, origin at the face's centre.

    The lattice is centred on the face. Index (0, 0) is the corner dot of the origin mark, which lies near the
    middle; without dots the indices are counted from the same place.
    """
    steps = spec.pitch_mm * lattice_steps(spec.lattice)
    raw = board_index(spec.columns, spec.rows, spec.lattice)
    position = np.array(raw) @ steps
    origin = _origin_index(raw, position)
    width, height = spec.size_mm
    outline = 0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]])
    return _assemble(
        spec,
        index=[(i - origin[0], j - origin[1]) for i, j in raw],
        in_face_mm=position - 0.5 * (position.min(axis=0) + position.max(axis=0)),
        dots=[BOARD_DOTS if spec.dots else frozenset()],
        target_from_face=np.eye(4)[None],
        outline_mm=outline,
        window_mm=outline - np.sign(outline) * spec.border_mm,
        face_code=[-1],
        lattice_mm=steps,
    )


def lattice_steps(lattice: Lattice) -> NDArray[np.float64]:
    """Steps of i and j on a board with pitch 1, as rows.  # (2, 2)"""
    return np.array([[1.0, 0.0], [0.0, 1.0] if lattice == "square" else [0.5, math.sqrt(3) / 2]])


def board_index(columns: int, rows: int, lattice: Lattice) -> list[Index]:
    """Lattice indices of a board's features, row by row from below.

    Every second row of a triangular lattice is shifted by half a pitch and holds one ring less.
    """
    if lattice == "square":
        return [(i, j) for j in range(rows) for i in range(columns)]
    return [(i - j // 2, j) for j in range(rows) for i in range(columns - j % 2)]


def _origin_index(index: list[Index], position: NDArray[np.float64]) -> Index:
    """The index that brings the origin mark nearest to the middle of the lattice."""
    place = dict(zip(index, position, strict=True))
    middle = 0.5 * (position.min(axis=0) + position.max(axis=0))

    def distance(origin: Index) -> float:
        marks = [place.get((origin[0] + i, origin[1] + j)) for i, j in BOARD_DOTS]
        on_board = [mark for mark in marks if mark is not None]
        if len(on_board) < len(marks):
            return math.inf
        return round(float(np.linalg.norm(np.mean(on_board, axis=0) - middle)), _DECIMALS)

    return min(index, key=distance)


def _assemble(
    spec: TargetSpec,
    *,
    index: list[Index],
    in_face_mm: NDArray[np.float64],  # (N, 2), the same on every face
    dots: list[frozenset[Index]],  # (F,)
    target_from_face: NDArray[np.float64],  # (F, 4, 4)
    outline_mm: NDArray[np.float64],  # (K, 2)
    window_mm: NDArray[np.float64],  # (K, 2)
    face_code: list[int],  # (F,)
    lattice_mm: NDArray[np.float64],  # (2, 2)
) -> TargetGeometry:
    """Put the same lattice on every face."""
    face_count, per_face = len(target_from_face), len(index)
    is_dot = np.array([pair in face_dots for face_dots in dots for pair in index])
    center = np.einsum("fij,nj->fni", target_from_face[:, :3, :2], in_face_mm) + target_from_face[:, None, :3, 3]
    radius = spec.ring_diameter_mm / 2

    def on_every_face(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.tile(np.round(values, _DECIMALS), (face_count, 1, 1))

    return TargetGeometry(
        source="nominal",
        spec=spec,
        ring_face=np.repeat(np.arange(face_count), per_face),
        ring_index=np.tile(np.array(index), (face_count, 1)),
        center_mm=np.round(center.reshape(-1, 3), _DECIMALS),
        radius_outer_mm=np.full(face_count * per_face, radius),
        radius_inner_mm=np.where(is_dot, 0.0, radius * spec.ring_ratio),
        is_dot=is_dot,
        target_from_face=np.round(target_from_face, 12),
        outline_mm=on_every_face(outline_mm),
        window_mm=on_every_face(window_mm),
        face_code=np.array(face_code),
        lattice_mm=on_every_face(lattice_mm),
    )
