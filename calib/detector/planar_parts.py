"""Grids that run over two faces, taken apart: each part is what one homography maps from the lattice to the image."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detector import homography
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid

Floats: TypeAlias = NDArray[np.float64]

NEIGHBOURHOOD = 2
"""A part is fitted to a member and those so many steps around it ..."""
TOLERANCE = 0.25
"""... and takes in all members closer than this share of the pitch to where the fit puts them."""
SMALLEST = 6


def planar_parts(candidates: Candidates, grid: Grid, pitch_radii: float) -> tuple[Grid, ...]:
    """The parts of a grid, the largest first; members of no part are left out.

    Args:
        candidates: what the grid's rows refer to.
        grid: of the grid growth.
        pitch_radii: distance of neighbours in outer radii.
    """
    parts = []
    left = np.arange(len(grid.row))
    while len(left) >= SMALLEST:
        inside = _largest_part(
            grid.index[left].astype(np.float64),
            candidates.ellipse[grid.row[left], :2],
            TOLERANCE * pitch_radii * candidates.radius_px[grid.row[left]],
        )
        if inside.sum() < SMALLEST:
            break
        part = left[inside]
        parts.append(Grid(grid.row[part], grid.index[part], grid.turn_rad[part]))
        left = left[~inside]
    return tuple(parts)


def _largest_part(index: Floats, point: Floats, reach_px: Floats) -> NDArray[np.bool_]:
    """Members that one homography places within their reach, for the neighbourhood that has most of them.  # (N,)"""
    best = np.zeros(len(index), dtype=np.bool_)
    for middle in index:
        near = np.abs(index - middle).max(axis=1) <= NEIGHBOURHOOD
        if near.sum() < SMALLEST or not homography.is_determined(index[near]):
            continue
        off = np.linalg.norm(homography.apply(homography.direct(index[near], point[near]), index) - point, axis=1)
        inside = off < reach_px
        if inside.sum() > best.sum():
            best = np.asarray(inside)
    return best
