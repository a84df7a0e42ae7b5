"""Face codes and the board's origin mark, recomputed from dots in space and independent of how they were found."""

import itertools
from collections.abc import Sequence
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from designer.base.codes import (
    CODES,
    MANY_SQUARES,
    MANY_TRIANGLES,
    OF_FIVE,
    OWN_SQUARES,
    OWN_TRIANGLES,
    SQUARE_POSITIONS,
    TRIANGLE_POSITIONS,
    CodedLattice,
    code_positions,
    face_codes,
    least_differing,
)
from designer.base.errors import InputError
from designer.kinds.layout import adjacent_faces, lay_out
from designer.kinds.regular_solid import SolidSpec
from designer.spec.kind import KINDS, kinds
from designer.target import TargetGeometry
from tests.support.designs import small

DotSet = frozenset[tuple[int, int]]
SOLIDS: dict[str, type[SolidSpec]] = {kind.name: kind.spec for kind in kinds() if issubclass(kind.spec, SolidSpec)}
each_solid = pytest.mark.parametrize("name", SOLIDS)

LEAST = {
    "ico": {5: 78, 6: 90, 7: 90, 8: 90},
    "cube": {5: 28, 6: 30, 7: 30, 8: 30},
    "octahedron": {5: 40, 6: 44, 7: 42, 8: 48},
    "tetrahedron": {5: 16, 6: 20, 7: 22, 8: 24},
}
"""By rings a side: how many marks of a solid disagree with any motion of it; at most twice as many as it has dots."""


def target_of(name: str, rings_per_side: int) -> TargetGeometry:
    """A target with room for so many rings a side at pitch 10 mm."""
    return lay_out(SOLIDS[name](12.0 * (rings_per_side + 2), rings_per_side, 7.0, 0.45, 10.0, 0.5, 1.0))


def turned(dots: DotSet, index: list[tuple[int, int]], place: np.ndarray, angle: float) -> DotSet:
    """The dots of a face's lattice after a turn about its middle.  # place: (N, 2)"""
    cos, sin = np.cos(angle), np.sin(angle)
    distance, to = cKDTree(place).query(place @ np.array([[cos, sin], [-sin, cos]]))
    assert distance.max() < 1e-6
    return frozenset(index[to[k]] for k, pair in enumerate(index) if pair in dots)


def turns_of(name: str, rings_per_side: int) -> set[DotSet]:
    """The dots of all faces under all turns of a face that map its lattice onto itself."""
    target = target_of(name, rings_per_side)
    mine = target.ring_face == 0
    index = [(i, j) for i, j in target.ring_index[mine].tolist()]
    place, sides = target.center_in_face_mm[mine, :2], target.outline_mm.shape[1]
    shape = SOLIDS[name].shape()
    codes = [CODES[code] for code in shape.face_code]
    return {turned(code, index, place, 2 * np.pi * k / sides) for code in codes for k in range(sides)}


def test_codes_of_triangles_are_the_twenty_triples_of_the_corner_block() -> None:
    """Three dots of six positions, 20 different codes; the positions are the rows of 1 + 2 + 3 at the corner."""
    assert set(TRIANGLE_POSITIONS) == {(i, j) for i in range(3) for j in range(3) if i + j < 3}
    assert list(CODES[:20]) == [frozenset(triple) for triple in combinations(TRIANGLE_POSITIONS, 3)]


def test_codes_of_squares_share_one_dot() -> None:
    """Seven triples of seven positions, each two with one dot in common: they differ in four positions."""
    lines = CODES[20:27]
    assert len(lines) == len(set(SQUARE_POSITIONS)) == 7
    assert all(len(line) == 3 and line <= set(SQUARE_POSITIONS) for line in lines)
    assert all(len(a & b) == 1 for a, b in combinations(lines, 2))
    assert all(CODES[code] <= set(code_positions(code)) for code in range(len(CODES)))


def images(code: int, lattice: CodedLattice, per_side: int) -> tuple[list[DotSet], list[DotSet]]:
    """A code's dots under all turns and under all mirrors of a face, recomputed from points in the plane."""
    is_square = lattice == "square"
    step = np.array([[1.0, 0.0], [0.0, 1.0] if is_square else [0.5, np.sqrt(3) / 2]])
    index = [(i, j) for i in range(per_side) for j in range(per_side if is_square else per_side - i)]
    place = np.array(index) @ step
    place -= place.mean(axis=0)
    across = place @ (np.eye(2) - 2 * np.outer(*[(step[0] - step[1]) / np.linalg.norm(step[0] - step[1])] * 2))
    sides = 4 if is_square else 3
    swapped = dict(zip(index, (index[k] for k in cKDTree(place).query(across)[1]), strict=True))
    angles = 2 * np.pi / sides * np.arange(sides)
    mirrored = frozenset(swapped[at] for at in CODES[code])
    return tuple([turned(dots, index, place, angle) for angle in angles] for dots in (CODES[code], mirrored))  # type: ignore[return-value]  # two


@pytest.mark.parametrize("per_side", [5, 6, 7, 8])
@pytest.mark.parametrize(
    ("lattice", "codes", "others", "least"),
    [
        ("triangular", OWN_TRIANGLES, range(20), (4, 2, 3)),
        ("triangular", OF_FIVE, [*range(20), *OWN_TRIANGLES], (4, 2, 2)),
        ("triangular", MANY_TRIANGLES, [*range(20), *OWN_TRIANGLES, *OF_FIVE], (2, 1, 2)),
        ("square", OWN_SQUARES, range(20, 27), (4, 2, 3)),
        ("square", MANY_SQUARES, [*range(20, 27), *OWN_SQUARES], (2, 2, 2)),
    ],
)
def test_codes_differ_however_a_face_is_turned(
    lattice: CodedLattice, codes: Sequence[int], others: Sequence[int], least: tuple[int, int, int], per_side: int
) -> None:
    """Codes of a list differ in so many marks from each other, in turns and in mirrors, and from those of others."""
    in_turns, in_mirrors, from_others = least
    shown = {code: images(code, lattice, per_side) for code in (*codes, *others)}
    for code in codes:
        (as_it_is, *turns), mirrors = shown[code]
        assert min(len(as_it_is ^ image) for image in turns) >= in_turns
        assert min(len(as_it_is ^ image) for image in mirrors) >= in_mirrors
        for other, both in shown.items():
            due = (from_others, 0) if other in others else (in_turns, in_mirrors)
            if other != code:
                for images_of_other, apart in zip(both, due, strict=True):
                    assert min(len(as_it_is ^ image) for image in images_of_other) >= apart


def test_told_differences_are_those_of_dots_in_the_plane() -> None:
    """What a target's facts say of its codes is what turns and mirrors of their dots show."""
    index = np.array([(i, j) for i in range(6) for j in range(6 - i)])
    codes = [3, 30, 45, 100]
    shown = {code: images(code, "triangular", 6) for code in codes}
    turns = [len(CODES[a] ^ b) for a in codes for other in codes for b in shown[other][0][a == other :]]
    mirrors = [len(CODES[a] ^ b) for a in codes for other in codes for b in shown[other][1]]
    assert least_differing([index] * 4, "triangular", codes) == (min(turns), min(mirrors))


@pytest.mark.parametrize(
    ("lattice", "count", "least"), [("triangular", 12, 4), ("square", 12, 4), ("triangular", 124, 2)]
)
def test_any_number_of_faces_finds_codes(lattice: CodedLattice, count: int, least: int) -> None:
    """Each face has its own; a dozen differ as those of a kind do, and as many as there are codes in two marks."""
    index = np.array([(i, j) for i in range(8) for j in range(8 if lattice == "square" else 8 - i)])
    codes, told = face_codes([index] * count, lattice)
    assert len(set(codes)) == count
    assert told == least == least_differing([index] * count, lattice, codes)[0]


def test_more_faces_than_codes_are_refused() -> None:
    """One line says how many there are."""
    index = np.array([(i, j) for i in range(5) for j in range(5)])
    with pytest.raises(InputError, match="101 faces ask for as many codes, and a square lattice has 100"):
        face_codes([index] * 101, "square")


def test_no_two_kinds_share_a_code() -> None:
    """A single face of one kind's target is never named as another's."""
    targets = [small(name).target for name in KINDS]
    codes = [code for target in targets if target.has_codes for code in target.face_code.tolist()]
    assert len(set(codes)) == len(codes)


@each_solid
def test_every_face_has_its_own_code(name: str) -> None:
    """No code is used twice; each stands at one of its face's corners, and the target's dots are those of the codes."""
    shape, target = SOLIDS[name].shape(), target_of(name, 6)
    assert len(set(shape.face_code)) == len(shape.face_code) == len(shape.code_corner) == len(shape.faces)
    assert set(shape.code_corner) <= set(range(shape.sides))
    assert target.face_code.tolist() == list(shape.face_code)
    for face, code in enumerate(shape.face_code):
        dots = target.ring_index[target.is_dot & (target.ring_face == face)]
        assert frozenset(map(tuple, dots.tolist())) == CODES[code]


@each_solid
@pytest.mark.parametrize("more", [0, 1, 2, 5])
def test_no_code_turns_into_a_code(name: str, more: int) -> None:
    """The codes under all turns of a face are different sets of dots: face and turn are unique."""
    shape = SOLIDS[name].shape()
    assert len(turns_of(name, SOLIDS[name].fewest_rings + more)) == len(shape.faces) * shape.sides


@each_solid
def test_fewer_rings_a_side_are_too_few(name: str) -> None:
    """With fewer than the fewest rings, corners with codes share positions so far that some motion goes unnoticed."""
    few = SOLIDS[name].fewest_rings - 1
    shape = SOLIDS[name].shape()
    is_ambiguous = len(turns_of(name, few)) < len(shape.faces) * shape.sides
    assert is_ambiguous or disagreements(name, few).min() < LEAST[name][few + 1]


@cache
def isometries(name: str) -> tuple[np.ndarray, ...]:
    """The matrices other than the identity, mirrors too, that map the solid's vertices to themselves."""
    shape = SOLIDS[name].shape()
    vertices, first = shape.vertices, shape.faces[0][:3]
    known = {tuple(np.round(v, 6) + 0.0) for v in vertices}
    found = {}
    for face in shape.faces:
        for k, way in itertools.product(range(shape.sides), (1, -1)):
            image = np.roll(face[::way], k)[:3]
            matrix = vertices[image].T @ np.linalg.inv(vertices[first].T)
            if {tuple(np.round(v, 6) + 0.0) for v in vertices @ matrix.T} == known:
                found[tuple(np.round(matrix.ravel(), 6) + 0.0)] = matrix
    assert len(found) == 2 * shape.faces.size
    return tuple(matrix for matrix in found.values() if not np.allclose(matrix, np.eye(3)))


@cache
def disagreements(name: str, rings_per_side: int) -> np.ndarray:
    """How many features of each face change between ring and dot, for each motion of the target.  # (M, F)"""
    target = target_of(name, rings_per_side)
    tree, is_dot = cKDTree(target.center_mm), target.is_dot
    counts = []
    for matrix in isometries(name):
        distance, nearest = tree.query(target.center_mm @ matrix.T)
        assert distance.max() < 1e-6  # every feature falls on a feature ...
        assert len(set(nearest.tolist())) == is_dot.size  # ... of its own
        seen = np.empty(is_dot.size, dtype=bool)
        seen[nearest] = is_dot
        counts.append(np.bincount(target.ring_face[seen != is_dot], minlength=target.face_count))
    return np.array(counts)


# With 5 rings a side the corner blocks of a face share positions, and fewer marks can disagree.
@pytest.mark.parametrize(
    ("name", "rings_per_side", "least"), [(name, m, least) for name, rows in LEAST.items() for m, least in rows.items()]
)
def test_moved_target_differs_almost_everywhere(name: str, rings_per_side: int, least: int) -> None:
    """Against itself turned or mirrored, `least` of all marks disagree, and at most one face agrees."""
    marks = disagreements(name, rings_per_side)
    assert marks.sum(axis=1).min() >= least
    assert (marks == 0).sum(axis=1).max() <= 1


@each_solid
@pytest.mark.parametrize("rings_per_side", [5, 6, 8])
def test_two_faces_that_meet_tell_a_moved_target_apart(name: str, rings_per_side: int) -> None:
    """Against itself turned or mirrored, any two faces with a common edge or corner disagree in 4 marks or more."""
    corners = [set(face) for face in SOLIDS[name].shape().faces.tolist()]
    meeting = np.array([(a, b) for a, b in combinations(range(len(corners)), 2) if corners[a] & corners[b]])
    assert disagreements(name, rings_per_side)[:, meeting].sum(axis=2).min() >= 4


@each_solid
def test_every_kind_of_solid_is_held_to_a_number(name: str) -> None:
    """A new solid says how far it is from itself moved; a face beside another tells its code from that one's."""
    assert set(LEAST) == set(SOLIDS)
    shape = SOLIDS[name].shape()
    for face, row in enumerate(adjacent_faces(target_of(name, 6)).tolist()):
        assert all(CODES[shape.face_code[face]] != CODES[shape.face_code[other]] for other in row)
