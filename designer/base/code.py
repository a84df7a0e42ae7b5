"""Codes that name faces: which positions at a corner of the lattice carry a dot instead of a ring."""

from itertools import combinations

Index = tuple[int, int]

TRIANGLE_POSITIONS: tuple[Index, ...] = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""The candidate positions on triangular faces: the rows of 1 + 2 + 3 at the face's code corner."""
SQUARE_POSITIONS: tuple[Index, ...] = (*TRIANGLE_POSITIONS, (2, 1))
"""The candidate positions on square faces."""

# The lines of the Fano plane, by rows of `SQUARE_POSITIONS`: any two share one point.
_LINES = ((5, 1, 3), (5, 4, 2), (5, 0, 6), (1, 4, 0), (1, 2, 6), (3, 4, 6), (3, 2, 0))

CODES: tuple[frozenset[Index], ...] = (
    *(frozenset(dots) for dots in combinations(TRIANGLE_POSITIONS, 3)),
    *(frozenset(SQUARE_POSITIONS[row] for row in line) for line in _LINES),
)
"""The positions that carry dots: 20 codes for triangles, which differ in 2 positions or more, then 7 for squares, of
which a photo shows fewer: they differ in 4."""

_TRIANGLE_CODES = 20


def code_positions(code: int) -> tuple[Index, ...]:
    """The candidate positions of a row of `CODES`."""
    return TRIANGLE_POSITIONS if code < _TRIANGLE_CODES else SQUARE_POSITIONS
