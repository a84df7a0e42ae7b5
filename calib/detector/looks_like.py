"""What pattern a photo shows, in words, whatever target was asked for."""

import numpy as np

from calib.detector.candidates import Candidates
from calib.detector.grid import Grid, Lattice, grow_grids, lattice_from
from designer.base.arrays import Array
from designer.spec.spec import RING_RATIO

FEWEST = 6
"""Rings of a grid that is more than clutter."""
SAMPLES = 300
NEIGHBOUR = 1.3
"""Neighbours lie closer than this, in distances of the nearest one; the diagonal of a square at 1.41."""
STEPS = {4: np.eye(2), 6: np.array([[1.0, 0.0], [0.5, 0.75**0.5]])}
WORDS = {4: "square", 6: "triangular"}


def looks_like(candidates: Candidates) -> str:
    """The pattern of the rings seen: its lattice, its size as far as it is seen, its proportions; "": none.

    How many fold the lattice is shows around each ring, in the plane that its ellipse tells: a neighbour at the angle
    `a` from another has `exp(n i a) = 1` on an n-fold lattice.
    """
    rings = candidates.take(np.flatnonzero(candidates.ratio > 0))
    if rings.count < FEWEST:
        return ""
    near = [_neighbours(rings, ring) for ring in range(0, rings.count, 1 + rings.count // SAMPLES)]
    crowded = [y for y in near if len(y) >= 3]
    if len(crowded) < FEWEST:
        return ""
    pitch_radii = float(np.median([np.hypot(*y.T).min() for y in crowded]))
    order = {fold: float(np.mean([_order(y, fold) for y in crowded])) for fold in STEPS}
    fold = max(order, key=lambda n: order[n])
    # Exposure moves both edges of the ink: the sum of the radii is what the print says.
    radius = float(np.median(1 + rings.ratio)) / (1 + RING_RATIO)
    lattice = lattice_from(pitch_radii * STEPS[fold], 1.0)
    grids = [grid for grid in grow_grids(candidates, lattice, across_gaps=False) if len(grid.row) >= FEWEST]
    if not grids:
        return ""
    on = f"on a {WORDS[fold]} lattice, their diameter {2 * radius / pitch_radii:.2f} of the pitch"
    columns, rows = _extent(grids[0], lattice)
    if len(grids) > 1:
        return f"{len(grids)} faces with rows of up to {columns} rings {on}"
    return f"a board of {columns} x {rows} rings or more {on}"


def _neighbours(rings: Candidates, ring: int) -> Array:
    """Where the nearest rings of about the same size lie in the plane of one, in its radii.  # (K, 2)"""
    e = rings.ellipse[ring]
    offset = rings.ellipse[:, :2] - e[:2]
    y = np.stack([e[2] * offset[:, 0], e[3] * offset[:, 0] + e[4] * offset[:, 1]], axis=1)
    size = rings.radius_px / rings.radius_px[ring]
    y = y[(size > 1 / NEIGHBOUR) & (size < NEIGHBOUR) & (np.arange(len(y)) != ring)]
    distance = np.hypot(*y.T)
    return np.asarray(y[distance < NEIGHBOUR * distance.min()] if len(y) else y)


def _order(y: Array, fold: int) -> float:
    """How well neighbours stand in an n-fold way, from 0 to 1."""
    return float(np.abs(np.exp(1j * fold * np.arctan2(y[:, 1], y[:, 0])).mean()))


def _extent(grid: Grid, lattice: Lattice) -> tuple[int, int]:
    """The longest row of a grid and the number of its rows, along those rows that make them fewest."""
    extents = []
    for turn in lattice.turns:
        index = grid.index @ turn.T
        _, length = np.unique(index[:, 1], return_counts=True)
        extents.append((int(length.max()), len(length)))
    columns, rows = min(extents, key=lambda extent: (extent[0] * extent[1], -extent[0]))
    return columns, rows
