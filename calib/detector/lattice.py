"""The lattice of a target as the grid search needs it: steps in ring radii, and the turns that map it onto itself."""

import itertools
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from designer.target import TargetGeometry

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Lattice:
    """K moves to neighbours, and the S proper and S mirrored integer matrices that map the lattice onto itself."""

    move: Integers  # (K, 2) steps in i and j
    move_in_radii: Floats  # (K, 2) the same in outer radii, y down as an image shows it
    turns: Integers  # (S, 2, 2) index' = turn @ index
    mirrors: Integers  # (S, 2, 2)


def lattice_of(target: TargetGeometry) -> Lattice:
    """The lattice of a target's faces, which all share one.

    Raises:
        ValueError: the faces' lattices differ, or a lattice's two steps lie on one line.
    """
    steps = target.lattice_mm[0]
    if np.abs(target.lattice_mm - steps).max() > 0.05 * np.linalg.norm(steps, axis=1).min():
        raise ValueError("the faces' lattices differ; all faces must share one lattice")
    if abs(np.linalg.det(steps)) < 0.1 * float(np.linalg.norm(steps[0]) * np.linalg.norm(steps[1])):
        raise ValueError("lattice_mm holds two steps along one line; a lattice needs two directions")
    return lattice_from(steps, float(np.median(target.radius_outer_mm)))


def lattice_from(steps: Floats, radius: float) -> Lattice:
    """The lattice of two steps, y up, and rings of a radius.  # (2, 2)"""
    move = np.array([m for m in itertools.product((-1, 0, 1), repeat=2) if m != (0, 0)])
    length = np.linalg.norm(move @ steps, axis=1)
    move = move[length < 1.25 * length.min()]
    turns, mirrors = _isometries(steps)
    return Lattice(move, (move @ steps) * np.array([1.0, -1.0]) / radius, turns, mirrors)


def _isometries(steps: Floats) -> tuple[Integers, Integers]:
    """Integer matrices that keep all lengths and angles of the lattice, by the sign of their determinant."""
    gram = steps @ steps.T
    matrices = np.array(list(itertools.product((-1, 0, 1), repeat=4))).reshape(-1, 2, 2)
    moved = np.einsum("nki,kl,nlj->nij", matrices, gram, matrices)
    keeps = np.abs(moved - gram).max(axis=(1, 2)) < 0.1 * gram.max()
    det = matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]
    return matrices[keeps & (det == 1)], matrices[keeps & (det == -1)]
