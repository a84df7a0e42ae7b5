"""How a grid may lie on a face: every turn and shift of its indices, and what its marks would then have to be."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.core.linear_algebra import least_squares
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid
from calib.detector.plan import TargetPlan
from calib.detector.ring_marks import DOT, RING, UNREADABLE, read_marks, usual_contrast
from designer.base.arrays import Array, Flags, Rows

DISAGREEMENT = 2
"""A mark that contradicts weighs as much as so many that agree."""
MAX_ALIGNMENTS = 4000
"""More are not worth trying: what fits in so many ways has no name of its own."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A turn and a shift: index on the face = turn @ index in the grid + shift."""

    turn: Rows  # (2, 2)
    shift: Rows  # (2,)

    def on_face(self, index: Rows) -> Rows:
        """Indices on the face.  # (N, 2)"""
        return np.asarray(index @ self.turn.T + self.shift)

    def on_grid(self, index: Rows) -> Rows:
        """Indices in the grid of indices on the face.  # (N, 2)"""
        (a, b), (c, d) = self.turn.tolist()
        # Of a turn or a mirror the determinant is 1 or -1, its own inverse.
        inverse = (a * d - b * c) * np.array([[d, -b], [-c, a]])
        return np.asarray((index - self.shift) @ inverse.T)


class GridReader:
    """Reads marks at lattice positions of one grid, each once: seen rings are rings, the rest is looked at."""

    def __init__(self, image: NDArray[np.generic], candidates: Candidates, grid: Grid, plan: TargetPlan) -> None:
        self._image, self._candidates, self._grid, self._plan = image, candidates, grid, plan
        self._row = {(int(i), int(j)): k for k, (i, j) in enumerate(grid.index)}
        self._mark: dict[tuple[int, int], int] = {}
        steps = plan.lattice
        self._basis = least_squares(steps.move.astype(np.float64), steps.move_in_radii)

    def marks(self, index: Rows) -> Rows:
        """RING, DOT or UNREADABLE at grid indices.  # (N, 2) -> (N,)"""
        keys: list[tuple[int, int]] = list(map(tuple, index.tolist()))
        new = sorted({key for key in keys if key not in self._mark})
        if new:
            read = read_marks(
                self._image,
                np.array([self._ellipse_at(key) for key in new]),
                ratio=self._plan.ratio,
                around=0.4 + 0.6 * self._plan.limit,
                contrast=self._contrast,
            )
            self._mark.update({key: self._judge(key, int(mark)) for key, mark in zip(new, read, strict=True)})
        return np.array([self._mark[key] for key in keys])

    @cached_property
    def _contrast(self) -> float:
        """Of the grid's own rings: its face may be in shadow."""
        return usual_contrast(self._image, self._candidates.take(self._grid.row))

    @cached_property
    def discs(self) -> Rows:
        """Grid indices of members without a white centre that read as dots.  # (D, 2)"""
        index = self._grid.index[self._candidates.ratio[self._grid.row] == 0]
        return np.asarray(index[self.marks(index) == DOT] if len(index) else index)

    def _judge(self, key: tuple[int, int], mark: int) -> int:
        """A border with a white centre inside is a ring, unless the brightness clearly says dot."""
        k = self._row.get(key)
        if k is not None and self._candidates.ratio[self._grid.row[k]] > 0:
            return UNREADABLE if mark == DOT else RING
        return mark

    def _ellipse_at(self, key: tuple[int, int]) -> Array:
        """The candidate there, or what its nearest neighbours in the grid predict."""
        grid, ellipse = self._grid, self._candidates.ellipse
        if key in self._row:
            return np.asarray(ellipse[grid.row[self._row[key]]])
        offset = np.array(key) - grid.index
        near = np.argsort((offset**2).sum(axis=1), kind="stable")[:4]
        places = []
        for k in near:
            x, y = offset[k] @ self._basis
            cos, sin = math.cos(grid.turn_rad[k]), math.sin(grid.turn_rad[k])
            y0, y1 = cos * x - sin * y, sin * x + cos * y
            e = ellipse[grid.row[k]]
            du = y0 / e[2]
            places.append([e[0] + du, e[1] + (y1 - e[3] * du) / e[4]])
        # Opposite neighbours err in opposite ways; the mean over the near ones is better than each.
        return np.concatenate([np.mean(places, axis=0), ellipse[grid.row[near], 2:].mean(axis=0)])


def alignments(plan: TargetPlan, face: int, grid: Grid, sure: Flags, turns: Rows) -> list[Alignment]:
    """All ways to lay a grid on a face so that its sure members (N,) fall on features, by turns (S, 2, 2)."""
    table = plan.row_table[face] >= 0
    found = []
    index = grid.index[sure]
    for turn in turns:
        turned = index @ turn.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        extent = high - low + 1
        room = np.array(table.shape) - extent + 1
        if (room <= 0).any():
            continue
        footprint = turned - low
        # All shifts at once.  # (N, I, 1), (N, 1, J)
        i = footprint[:, 0, None, None] + np.arange(room[0])[:, None]
        j = footprint[:, 1, None, None] + np.arange(room[1])
        fits = table[i, j].all(axis=0)
        found += [Alignment(turn, shift + plan.low - low) for shift in np.argwhere(fits)]
        if len(found) > MAX_ALIGNMENTS:
            return found[: MAX_ALIGNMENTS + 1]
    return found


def largest_overlap(plan: TargetPlan, index: Rows, turns: Rows) -> int:
    """How many rings of a grid (N, 2) fall on features of a face, laid on it as well as the turns (S, 2, 2) allow."""
    best = 0.0
    for face, turn in itertools.product(np.unique(plan.alike).tolist(), turns):
        table = (plan.row_table[face] >= 0).astype(np.float64)
        turned = index @ turn.T
        turned = turned - turned.min(axis=0)
        extent = turned.max(axis=0) + 1
        footprint = np.zeros(extent)
        footprint[turned[:, 0], turned[:, 1]] = 1
        shape = tuple(int(side) for side in extent + table.shape - 1)  # so that no shift meets the table's other side
        overlap = np.fft.irfft2(np.fft.rfft2(table, shape) * np.fft.rfft2(footprint, shape).conj(), shape)
        best = max(best, float(overlap.max()))
    return round(best)


def agreement(expected_dot: Flags, mark: Rows, weight: int = DISAGREEMENT) -> Rows:
    """Marks that agree, less `weight` times those that do not.  # (..., P), (P,) -> (...,)"""
    agrees = np.where(expected_dot, mark == DOT, mark == RING)
    denies = np.where(expected_dot, mark == RING, mark == DOT)
    return np.asarray(agrees.sum(axis=-1) - weight * denies.sum(axis=-1))
