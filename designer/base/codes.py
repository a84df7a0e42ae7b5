"""The codes that tell faces apart: which positions about a face's code corner carry dots, and how far codes differ."""

from collections.abc import Sequence
from itertools import combinations
from typing import Literal

import numpy as np

from designer.base.arrays import Flags, Rows
from designer.base.errors import InputError

Index = tuple[int, int]
CodedLattice = Literal["square", "triangular"]
POSITIONS: tuple[Index, ...] = tuple((row - j, j) for row in range(4) for j in range(row + 1))
"""The candidate positions: the rows of 1 + 2 + 3 + 4 at the code corner, on either lattice."""
TRIANGLE_POSITIONS = POSITIONS[:6]
"""Those of the first twenty codes."""
SQUARE_POSITIONS: tuple[Index, ...] = (*TRIANGLE_POSITIONS, (2, 1))
"""Those of the seven codes after these."""
# The lines of the Fano plane, by rows of `SQUARE_POSITIONS`: any two share one point.
_LINES = ((5, 1, 3), (5, 4, 2), (5, 0, 6), (1, 4, 0), (1, 2, 6), (3, 4, 6), (3, 2, 0))
# Rows of `POSITIONS`, found as cliques of codes that differ, on lattices of 5 rings a side and more: of four dots (of
# triangles: these, then such of five) in 4 marks from each other in any turn and in 2 in a mirror, themselves too, and
# in 3 from those before; the many after them in 2 (`tests/designer/test_code.py`).
_TRIANGLES = "0168 0179 0269 0378 0489 0567 1289 1569 1578 2368 2467 3469 3579 4568"
_TRIANGLES_OF_FIVE = (
    "01239 01248 01267 01356 01457 01469 01589 02346 02357 02459 02568 02789 03458 03689 04678 12347 12358 12456 12579 "
    "13459 16789 23679 24689 34789 35678 45679"
)
_SQUARES = (
    "0169 0178 0247 0259 0268 0346 0358 0379 0489 1249 1256 1389 1468 1579 2348 2357 2369 2789 3459 3678 4578 4679 5689"
)
_MANY_TRIANGLES = (
    "0178 0379 0479 0569 0579 0679 1268 1369 1379 1389 1479 1567 1568 2578 2678 01234 01236 01237 01238 01246 01345 "
    "01347 01348 01349 01357 01359 01367 01456 01458 01467 02389 02468 02478 03456 03467 03568 03589 04578 12346 12348 "
    "12356 12367 12378 12679 13456 13457 13458 13478 13678 14589 14689 23478 23479 23489 23567 23569 23589 23789 24569 "
    "25679 25689 34567 35689 36789"
)
_MANY_SQUARES = (
    "0125 0126 0128 0137 0138 0139 0156 0158 0159 0167 0168 0189 0246 0248 0249 0348 0349 0356 0367 0368 0369 0378 "
    "0389 0458 0468 0678 0679 1234 1236 1238 1248 1258 1268 1289 1346 1348 1349 1368 1369 1378 1379 1456 1458 1459 "
    "1467 1469 1478 1479 1489 1567 1568 1578 1589 1679 1689 1789 2356 2358 2359 3458 3468 3469 3489 3567 3568 3689 "
    "3789 4568 4589 4678"
)
_LISTS = tuple(map(str.split, (_TRIANGLES, _TRIANGLES_OF_FIVE, _SQUARES, _MANY_TRIANGLES, _MANY_SQUARES)))
CODES: tuple[frozenset[Index], ...] = (
    *(frozenset(dots) for dots in combinations(TRIANGLE_POSITIONS, 3)),
    *(frozenset(SQUARE_POSITIONS[row] for row in line) for line in _LINES),
    *(frozenset(POSITIONS[int(row)] for row in word) for words in _LISTS for word in words),
)
"""The positions that carry dots. A code keeps its row for ever: targets are printed."""
_ENDS = np.cumsum([20, 7, *map(len, _LISTS)]).tolist()
_OF_TRIANGLES, _OF_SQUARES, OWN_TRIANGLES, OF_FIVE, OWN_SQUARES, MANY_TRIANGLES, MANY_SQUARES = (
    range(start, end) for start, end in zip([0, *_ENDS], _ENDS, strict=False)
)
"""Rows of `CODES`: of the icosahedron, of the cube; of other kinds, each of which has its own; and of bodies of any
faces."""
_EVERY: dict[str, tuple[int, ...]] = {
    "triangular": (*MANY_TRIANGLES, *OF_FIVE, *OWN_TRIANGLES, *_OF_TRIANGLES),
    "square": (*MANY_SQUARES, *OWN_SQUARES, *_OF_SQUARES),
}
_TURN = {"triangular": np.array([[0, -1], [1, 1]]), "square": np.array([[0, -1], [1, 0]])}
_MIRROR = np.array([[0, 1], [1, 0]])


def code_positions(code: int) -> tuple[Index, ...]:
    """The candidate positions of a row of `CODES`."""
    return TRIANGLE_POSITIONS if code in _OF_TRIANGLES else SQUARE_POSITIONS if code in _OF_SQUARES else POSITIONS


def face_codes(
    places: Sequence[Rows], lattice: CodedLattice, codes: Sequence[int] | None = None
) -> tuple[tuple[int, ...], int]:
    """Codes for any number of faces, and the fewest marks in which any two of them, or one and itself turned, differ.

    `face_codes([index_of_face_0, index_of_face_1], "triangular")`: each face takes the code that differs most from
    those before it.

    Args:
        places: indices of each face's features, all of `POSITIONS` among them: the code's corner is (0, 0).  # (N, 2)
        lattice: of all faces.
        codes: rows of `CODES` to choose from; None: those that no kind of target has for its own, or, for more faces
            than these, all of the lattice.

    Raises:
        InputError: more faces than codes.
    """
    if codes is None:
        many = MANY_TRIANGLES if lattice == "triangular" else MANY_SQUARES
        codes = many if len(places) <= len(many) else _EVERY[lattice]
    if len(places) > len(codes):
        raise InputError(
            f"{len(places)} faces ask for as many codes, and a {lattice} lattice has {len(codes)}; leave faces bare"
        )
    shapes, shape = _shapes(places)
    apart = {(a, b): _differences(shapes[a], shapes[b], lattice, codes)[0] for a in shapes for b in shapes}
    chosen: list[int] = []
    least = 2 * len(POSITIONS)
    for face, own in enumerate(shape):
        to_others = [apart[own, shape[other]][:, code] for other, code in enumerate(chosen)]
        worst = np.min([apart[own, own].diagonal(), *to_others], axis=0)
        worst[chosen] = -1
        chosen.append(int(worst.argmax()))
        least = min(least, int(worst[chosen[face]]))
    return tuple(codes[code] for code in chosen), least


def least_differing(places: Sequence[Rows], lattice: CodedLattice, codes: Sequence[int]) -> tuple[int, int]:
    """The fewest marks in which any two of some faces, or one and itself, differ: turned, and in a mirror.

    Args:
        places: see `face_codes`.
        lattice: of all faces.
        codes: of each face.
    """
    shapes, shape = _shapes(places)
    of = {name: [face for face, own in enumerate(shape) if own == name] for name in shapes}
    apart = [
        [distance[np.ix_(of[a], of[b])].min() for distance in _differences(shapes[a], shapes[b], lattice, codes)]
        for a in shapes for b in shapes
    ]  # fmt: skip
    turned, mirrored = np.min(apart, axis=0).tolist()
    return turned, mirrored


def differing_words(turned: int, mirrored: int) -> str:
    """How far codes are apart, for a table of facts."""
    mirror = f"{mirrored} in a mirror" if mirrored else "in a mirror some are alike"
    return f"{turned} marks or more between any two faces in any turn; {mirror}"


def _shapes(places: Sequence[Rows]) -> tuple[dict[bytes, Rows], list[bytes]]:
    """The different sets of places, and which each face has."""
    ordered = [np.unique(place, axis=0) for place in places]
    keys = [place.tobytes() for place in ordered]
    return dict(zip(keys, ordered, strict=True)), keys


def _differences(first: Rows, second: Rows, lattice: CodedLattice, codes: Sequence[int]) -> tuple[Rows, Rows]:
    """In how many marks codes differ at least where places fall on places: in any turn, and in any mirror.

    A code does not differ from itself unmoved; where no places fall on others, all is taken to differ.  # (C, C)
    """
    there = {tuple(at): row for row, at in enumerate(second.tolist())}
    most = 2 * len(POSITIONS)
    least = np.full((2, len(codes), len(codes)), most)
    if len(first) != len(second):
        return least[0], least[1]
    a, is_dot = (_is_dot(places, codes).astype(np.int64) for places in (first, second))
    for mirror, power in ((mirror, power) for mirror in range(2) for power in range(6)):
        motion = np.linalg.matrix_power(_TURN[lattice], power) @ np.linalg.matrix_power(_MIRROR, mirror)
        moved = first @ motion.T
        shift = second.min(axis=0) - moved.min(axis=0)
        rows = [there.get(tuple(at), -1) for at in (moved + shift).tolist()]
        if -1 in rows:
            continue
        b = is_dot[:, rows]
        differing = a.sum(axis=1)[:, None] + b.sum(axis=1) - 2 * a @ b.T
        if (moved + shift == first).all():
            np.fill_diagonal(differing, most)
        least[mirror] = np.minimum(least[mirror], differing)
    return least[0], least[1]


def _is_dot(places: Rows, codes: Sequence[int]) -> Flags:
    """Which places are dots with each code.  # (C, N)"""
    every = list(map(tuple, places.tolist()))
    return np.array([[at in CODES[code] for at in every] for code in codes])
