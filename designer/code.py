"""Marks that name faces and orient boards: which lattice positions carry a dot instead of a ring."""

from itertools import combinations

Index = tuple[int, int]

CODE_POSITIONS: tuple[Index, ...] = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""The candidate positions of a face code: the corner block of rows 1 + 2 + 3 at the face's code corner."""

CODES: tuple[frozenset[Index], ...] = tuple(frozenset(dots) for dots in combinations(CODE_POSITIONS, 3))
"""The 20 codes: the positions that carry dots."""

MIN_RINGS_PER_SIDE = 5
"""With fewer rings along a side, the corner blocks overlap so far that a code turns into another."""

BOARD_DOTS: frozenset[Index] = frozenset({(0, 0), (1, 0), (0, 2)})
"""The origin mark of a board. Its three distances differ on both lattices, so no rotation and no mirror image
maps it onto itself. The dot at (0, 0) is the index origin."""

# Which code each face carries, and at which of its three corners (in the vertex order of `icosahedron_faces`).
# Found by simulated annealing to set a target apart from itself turned by any of the 59 other rotations and seen
# in a mirror by any of the 60 mirror symmetries: at least 90 of its 120 code marks then disagree (78 with 5 rings a
# side, whose corner blocks overlap), at most one face agrees, and any two faces that share an edge or a corner
# disagree in 4 marks or more (`tests/test_code.py`).
FACE_CODE: tuple[int, ...] = (6, 17, 8, 13, 12, 19, 1, 16, 7, 2, 18, 3, 10, 9, 5, 4, 0, 14, 11, 15)
FACE_CORNER: tuple[int, ...] = (1, 2, 1, 0, 0, 1, 0, 2, 1, 1, 0, 2, 0, 1, 2, 1, 2, 0, 1, 1)
