"""Face codes and the board's origin mark, recomputed from dots in space and independent of how they were found."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from designer.code import BOARD_DOTS, CODE_POSITIONS, CODES, FACE_CODE, FACE_CORNER, MIN_RINGS_PER_SIDE
from designer.layout import lattice_steps, lay_out
from designer.polyhedron import icosahedron_faces, icosahedron_vertices
from designer.spec import BoardSpec, IcoSpec, Lattice

DotSet = frozenset[tuple[int, int]]


def turned(dots: DotSet, rings_per_side: int, turns: int) -> DotSet:
    """The dots of a face's lattice after third turns: (i, j, k) with i + j + k = m - 1 goes round."""
    for _ in range(turns):
        dots = frozenset((rings_per_side - 1 - i - j, i) for i, j in dots)
    return dots


def test_codes_are_the_twenty_triples_of_the_corner_block() -> None:
    """Three dots of six positions, 20 different codes; the positions are the rows of 1 + 2 + 3 at the corner."""
    assert set(CODE_POSITIONS) == {(i, j) for i in range(3) for j in range(3) if i + j < 3}
    assert set(CODES) == {frozenset(triple) for triple in combinations(CODE_POSITIONS, 3)}
    assert len(CODES) == 20


def test_every_face_has_its_own_code() -> None:
    """All 20 codes are used once, each at one of its face's three corners."""
    assert sorted(FACE_CODE) == list(range(20))
    assert len(FACE_CORNER) == 20
    assert set(FACE_CORNER) <= {0, 1, 2}


@pytest.mark.parametrize("rings_per_side", range(MIN_RINGS_PER_SIDE, 13))
def test_no_code_turns_into_a_code(rings_per_side: int) -> None:
    """The 20 codes under three in-plane rotations are 60 different dot sets: face and rotation are unique."""
    seen = {turned(code, rings_per_side, turns) for code in CODES for turns in range(3)}
    assert len(seen) == 60


def test_four_rings_a_side_are_too_few() -> None:
    """With fewer than MIN_RINGS_PER_SIDE rings the rule above breaks, so the limit is not too strict."""
    few = MIN_RINGS_PER_SIDE - 1
    assert len({turned(code, few, turns) for code in CODES for turns in range(3)}) < 60


@cache
def dots_in_space(rings_per_side: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of all features and whether they are dots, grouped by face.  # (20, N, 3), (20, N)"""
    edge = 10.0 * (rings_per_side + 2)
    target = lay_out(IcoSpec(edge, rings_per_side, 7.0, 0.45, 10.0, 0.5, 1.0))
    return target.center_mm.reshape(20, -1, 3), target.is_dot.reshape(20, -1)


@cache
def isometries() -> tuple[np.ndarray, ...]:
    """The 120 matrices that map the icosahedron's vertices to themselves, the identity first."""
    vertices = icosahedron_vertices()
    basis = vertices[icosahedron_faces()[0]].T
    found = []
    for image in np.array([p for f in icosahedron_faces() for p in (f, np.roll(f, 1), np.roll(f, 2))]):
        for triple in (image, image[::-1]):
            matrix = vertices[triple].T @ np.linalg.inv(basis)
            assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-9)
            found.append(matrix)
    assert len({tuple(np.round(m.ravel(), 6)) for m in found}) == 120
    return tuple(sorted(found, key=lambda m: np.abs(m - np.eye(3)).max()))


def disagreement(rings_per_side: int, matrix: np.ndarray) -> np.ndarray:
    """How many features of each face change between ring and dot when the target is moved.  # (20,)"""
    positions, is_dot = dots_in_space(rings_per_side)
    distance, nearest = cKDTree(positions.reshape(-1, 3)).query((positions @ matrix.T).reshape(-1, 3))
    assert distance.max() < 1e-6  # every feature falls on a feature ...
    assert len(set(nearest.tolist())) == is_dot.size  # ... of its own
    seen = np.empty(is_dot.size, dtype=bool)
    seen[nearest] = is_dot.ravel()
    return (seen.reshape(is_dot.shape) != is_dot).sum(axis=1)


# With 5 rings a side the corner blocks of a face share positions, and fewer marks can disagree.
@pytest.mark.parametrize(("rings_per_side", "least"), [(5, 78), (6, 90), (7, 90), (8, 90)])
def test_moved_target_differs_almost_everywhere(rings_per_side: int, least: int) -> None:
    """Against itself turned or mirrored, `least` of 120 marks disagree, and at most one face agrees."""
    assert not disagreement(rings_per_side, isometries()[0]).any()
    for matrix in isometries()[1:]:
        marks = disagreement(rings_per_side, matrix)
        assert marks.sum() >= least
        assert (marks == 0).sum() <= 1


@pytest.mark.parametrize("rings_per_side", [5, 6, 8])
def test_two_faces_that_meet_tell_a_moved_target_apart(rings_per_side: int) -> None:
    """Against itself turned or mirrored, any two faces with a common edge or corner disagree in 4 marks or more."""
    corners = [set(face) for face in icosahedron_faces().tolist()]
    meeting = np.array([(a, b) for a, b in combinations(range(20), 2) if corners[a] & corners[b]])
    for matrix in isometries()[1:]:
        assert disagreement(rings_per_side, matrix)[meeting].sum(axis=1).min() >= 4


def test_origin_mark_of_a_board_is_three_dots_at_zero() -> None:
    """The mark holds three dots, one of them the index origin."""
    assert len(BOARD_DOTS) == 3
    assert (0, 0) in BOARD_DOTS


@pytest.mark.parametrize(("lattice", "order"), [("square", 4), ("triangular", 6)])
def test_origin_mark_has_no_symmetry(lattice: Lattice, order: int) -> None:
    """No rotation or mirror image of the lattice maps the board's mark onto itself, wherever it is moved."""
    mark = np.array(sorted(BOARD_DOTS)) @ lattice_steps(lattice)
    flip = np.diag([1.0, -1.0])
    for k in range(order):
        angle = 2 * np.pi * k / order
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        for matrix in (rotation, rotation @ flip):
            image = mark @ matrix.T
            shift_free = {tuple(np.round(p - image.mean(axis=0), 6) + 0.0) for p in image}
            is_same = shift_free == {tuple(np.round(p - mark.mean(axis=0), 6) + 0.0) for p in mark}
            assert is_same == (matrix == np.eye(2)).all()


@pytest.mark.parametrize("lattice", ["square", "triangular"])
def test_board_shows_the_mark(lattice: Lattice) -> None:
    """Exactly the indices of BOARD_DOTS carry dots, and none do without dots."""
    spec = BoardSpec((90.0, 90.0), 5.0, 7, 7, lattice, 7.0, 0.45, 10.0, 0.0, 5.0, dots=True)
    target = lay_out(spec)
    assert {tuple(index) for index in target.ring_index[target.is_dot].tolist()} == BOARD_DOTS
