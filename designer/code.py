"""Codes that name faces: which positions at a corner of the lattice carry a dot instead of a ring."""

from itertools import combinations

Index = tuple[int, int]

CODE_POSITIONS: tuple[Index, ...] = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""The candidate positions of a face code: the corner block of rows 1 + 2 + 3 at the face's code corner."""

CODES: tuple[frozenset[Index], ...] = tuple(frozenset(dots) for dots in combinations(CODE_POSITIONS, 3))
"""The 20 codes: the positions that carry dots."""
