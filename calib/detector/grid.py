"""Grids of rings: grown from two neighbours, step by step, through the map that takes a ring to the unit circle.

Each ring's ellipse says how the plane lies around it, up to a turn; the step by which it was reached says the turn. So
every step is predicted from its own ring alone, and perspective and lens distortion may bend the grid as they like.
"""

import itertools
import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.core.jit import jit
from calib.detector.candidates import Candidates
from designer.base.arrays import Array, Flags, Rows
from designer.target import TargetGeometry

Floats: TypeAlias = Array
Integers: TypeAlias = Rows

STEP_TOLERANCE = 0.25
"""How far a neighbour may lie from where it is predicted, as a share of the step."""
SHORTEST, LONGEST = 0.75, 1.33
"""The step back from a neighbour, by its own ellipse, over the lattice's step."""
MAX_TWIST_RAD = 0.4
SIZE_RATIO = 2.0
"""Neighbours' areas differ by no more than this."""
SCALE_SAMPLES = 300
SCALE_LEAST = 6
"""From so many rings the image's own ratio of pitch and radius is taken."""
HALF_SPAN = 512
"""Grids reach so many steps from their seed at most."""
NEIGHBOURHOOD = 2
"""A part is fitted to a member and those so many steps around it ..."""
TOLERANCE = 0.25
"""... and takes in all members closer than this share of the pitch to where the fit puts them."""
SMALLEST = 6


@dataclass(frozen=True, eq=False)
class Lattice:
    """K moves to neighbours, and the S proper and S mirrored integer matrices that map the lattice onto itself."""

    move: Integers  # (K, 2) steps in i and j
    move_in_radii: Floats  # (K, 2) the same in outer radii, y down as an image shows it
    turns: Integers  # (S, 2, 2) index' = turn @ index
    mirrors: Integers  # (S, 2, 2)


def lattice_of(target: TargetGeometry) -> Lattice:
    """The lattice of a target's faces, which all share one."""
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


@dataclass(frozen=True, eq=False)
class Grid:
    """N candidates on one lattice; indices are counted from the seed, in axes that the target does not know yet."""

    row: Integers  # (N,) of the candidates
    index: Integers  # (N, 2)
    turn_rad: Floats  # (N,) from the lattice to the ring's own plane axes


@jit
def _nearest(
    at: Floats, order: Integers, ellipse: Floats, grid_of: Integers, a: int, u: float, v: float, reach: float
) -> int:
    """The free candidate nearest to (u, v) in the plane of candidate a, closer than `reach` radii; -1: none."""
    e = ellipse[a]
    # Half width of the search ellipse in u.
    half = reach * math.sqrt(e[3] * e[3] + e[4] * e[4]) / (e[2] * e[4])
    first = np.searchsorted(at, u - half)
    best, found = reach, -1
    for k in range(first, len(at)):
        if at[k] > u + half:
            break
        n = order[k]
        if grid_of[n] >= 0:
            continue
        du, dv = ellipse[n, 0] - u, ellipse[n, 1] - v
        y0 = e[2] * du
        y1 = e[3] * du + e[4] * dv
        distance = math.sqrt(y0 * y0 + y1 * y1)
        if distance < best:
            share = ellipse[n, 2] * ellipse[n, 4] / (e[2] * e[4])
            if 1 / SIZE_RATIO < share < SIZE_RATIO:
                best, found = distance, n
    return found


@jit
def _turn(ellipse: Floats, n: int, du: float, dv: float, step: Floats) -> tuple[float, float]:
    """Length in radii of an image offset in the plane of candidate n, and its angle from a lattice step."""
    y0 = ellipse[n, 2] * du
    y1 = ellipse[n, 3] * du + ellipse[n, 4] * dv
    return math.sqrt(y0 * y0 + y1 * y1), math.atan2(y1, y0) - math.atan2(step[1], step[0])


@jit
def _grow(
    seed: int,
    number: int,
    at: Floats,
    order: Integers,
    ellipse: Floats,
    region: Integers,
    move: Integers,
    step: Floats,
    grid_of: Integers,
    index: Integers,
    turn: Floats,
    slot: NDArray[np.int32],
    queue: Integers,
    farthest: int,
) -> int:
    """Grow a grid from a seed whose turn is set; returns how many candidates it holds (they stand in `queue`)."""
    grid_of[seed] = number
    index[seed, 0] = index[seed, 1] = 0
    slot[HALF_SPAN, HALF_SPAN] = seed
    queue[0] = seed
    head, tail = 0, 1
    while head < tail:
        a = queue[head]
        head += 1
        e = ellipse[a]
        cos, sin = math.cos(turn[a]), math.sin(turn[a])
        for k in range(len(move)):
            for jump in range(1, farthest + 1):
                i, j = index[a, 0] + jump * move[k, 0], index[a, 1] + jump * move[k, 1]
                if abs(i) >= HALF_SPAN or abs(j) >= HALF_SPAN or slot[HALF_SPAN + i, HALF_SPAN + j] >= 0:
                    break
                y0 = jump * (cos * step[k, 0] - sin * step[k, 1])
                y1 = jump * (sin * step[k, 0] + cos * step[k, 1])
                du = y0 / e[2]
                dv = (y1 - e[3] * du) / e[4]
                length = math.sqrt(y0 * y0 + y1 * y1)
                n = _nearest(at, order, ellipse, grid_of, a, e[0] + du, e[1] + dv, STEP_TOLERANCE * length / jump**0.5)
                if n < 0 or (jump > 1 and region[n] != region[a]):
                    continue
                back, angle = _turn(ellipse, n, ellipse[n, 0] - e[0], ellipse[n, 1] - e[1], step[k])
                twist = (angle - turn[a] + math.pi) % (2 * math.pi) - math.pi
                if not SHORTEST < back / length < LONGEST or abs(twist) > MAX_TWIST_RAD:
                    continue
                grid_of[n] = number
                index[n, 0], index[n, 1] = i, j
                turn[n] = angle
                slot[HALF_SPAN + i, HALF_SPAN + j] = n
                queue[tail] = n
                tail += 1
                break
    for k in range(tail):
        slot[HALF_SPAN + index[queue[k], 0], HALF_SPAN + index[queue[k], 1]] = -1
    return tail


@jit
def _neighbours_in_place(
    seed: int, angle: float, at: Floats, order: Integers, ellipse: Floats, step: Floats, grid_of: Integers
) -> int:
    """How many free candidates lie where a seed with a turn predicts its neighbours."""
    e = ellipse[seed]
    cos, sin = math.cos(angle), math.sin(angle)
    count = 0
    for k in range(len(step)):
        du = (cos * step[k, 0] - sin * step[k, 1]) / e[2]
        dv = (sin * step[k, 0] + cos * step[k, 1] - e[3] * du) / e[4]
        reach = STEP_TOLERANCE * math.sqrt(step[k, 0] ** 2 + step[k, 1] ** 2)
        if _nearest(at, order, ellipse, grid_of, seed, e[0] + du, e[1] + dv, reach) >= 0:
            count += 1
    return count


@jit
def _turn_of_pair(seed: int, n: int, ellipse: Floats, step: Floats, first_move: int) -> tuple[int, float]:
    """The first move, from a given one on, that may lead from a seed to n, and the seed's turn then; -1: none."""
    du, dv = ellipse[n, 0] - ellipse[seed, 0], ellipse[n, 1] - ellipse[seed, 1]
    for k in range(first_move, len(step)):
        length = math.sqrt(step[k, 0] ** 2 + step[k, 1] ** 2)
        alike = abs(length - math.sqrt(step[0, 0] ** 2 + step[0, 1] ** 2)) < 0.02 * length
        if k > 0 and alike:
            # Steps of one length give the same grid, turned.
            continue
        here, angle = _turn(ellipse, seed, du, dv, step[k])
        there, _ = _turn(ellipse, n, du, dv, step[k])
        if SHORTEST < here / length < LONGEST and SHORTEST < there / length < LONGEST:
            return k, angle
    return -1, 0.0


@jit
def _grow_all(
    ellipse: Floats, region: Integers, seeds: Integers, move: Integers, step: Floats, smallest: int, farthest: int
) -> tuple[Integers, Integers, Floats]:
    """Grow a grid from each seed that no grid has yet; returns the grid (-1: none), index and turn of each.

    Seeds with three neighbours in place come first: a stranger among the rings has none but by chance.
    """
    count = len(ellipse)
    order = np.argsort(ellipse[:, 0], kind="mergesort")
    at = ellipse[order, 0].copy()
    grid_of = np.full(count, -1, dtype=np.int64)
    index = np.zeros((count, 2), dtype=np.int64)
    turn = np.zeros(count)
    slot = np.full((2 * HALF_SPAN + 1, 2 * HALF_SPAN + 1), -1, dtype=np.int32)
    queue = np.empty(count, dtype=np.int64)
    number = 0
    for least in (3, 1):
        for seed in seeds:
            if grid_of[seed] >= 0:
                continue
            e = ellipse[seed]
            reach = 1.4 * math.sqrt(step[0, 0] ** 2 + step[0, 1] ** 2)
            half = reach * math.sqrt(e[3] * e[3] + e[4] * e[4]) / (e[2] * e[4])
            for k in range(np.searchsorted(at, e[0] - half), count):
                if at[k] > e[0] + half or grid_of[seed] >= 0:
                    break
                n = order[k]
                if n == seed or grid_of[n] >= 0:
                    continue
                used, angle = _turn_of_pair(seed, n, ellipse, step, 0)
                while used >= 0:
                    turn[seed] = angle
                    if _neighbours_in_place(seed, angle, at, order, ellipse, step, grid_of) >= least:
                        grown = _grow(
                            seed, number, at, order, ellipse, region, move, step, grid_of, index, turn, slot, queue,
                            farthest,
                        )  # fmt: skip
                        if grown >= smallest:
                            number += 1
                            break
                        for q in range(grown):
                            grid_of[queue[q]] = -1
                    used, angle = _turn_of_pair(seed, n, ellipse, step, used + 1)
    return grid_of, index, turn


def grow_grids(
    candidates: Candidates, lattice: Lattice, *, across_gaps: bool, smallest: int = 3, is_scaled: bool = False
) -> tuple[Grid, ...]:
    """All grids of at least `smallest` candidates, the largest first. Seeds are rings; any candidate may join.

    Args:
        candidates: what was seen.
        lattice: the target's.
        across_gaps: whether a grid may step over one missing feature inside the same white region. On a solid it may
            not: its lattice can go on beyond an edge as if unfolded, with just one row missing.
        smallest: the least number of members.
        is_scaled: whether the lattice's steps were measured in this image.
    """
    if candidates.count < 2:
        return ()
    rings = np.flatnonzero(candidates.ratio > 0)
    seeds = rings[np.argsort(candidates.misfit_px[rings] / candidates.radius_px[rings], kind="stable")]
    grid_of, index, turn = _grow_all(
        candidates.ellipse,
        candidates.region,
        seeds,
        lattice.move,
        (1.0 if is_scaled else _pitch_scale(candidates, lattice)) * lattice.move_in_radii,
        smallest,
        2 if across_gaps else 1,
    )
    grids = []
    for number in range(int(grid_of.max()) + 1):
        row = np.flatnonzero(grid_of == number)
        grids.append(Grid(row, index[row], turn[row]))
    return tuple(sorted(grids, key=lambda grid: -len(grid.row)))


def _pitch_scale(candidates: Candidates, lattice: Lattice) -> float:
    """Pitch over radius as the image shows it, over what the target says; 1 if the image does not say.

    Exposure makes rings look larger or smaller, and of targets made by others the size may be known in part only.
    """
    ring = np.flatnonzero(candidates.ratio > 0)
    ring = ring[:: max(1, len(ring) // SCALE_SAMPLES)]
    if len(ring) < SCALE_LEAST:
        return 1.0
    e = candidates.ellipse[ring]
    offset = candidates.ellipse[None, :, :2] - e[:, None, :2]
    u = e[:, 2, None] * offset[..., 0]
    v = e[:, 3, None] * offset[..., 0] + e[:, 4, None] * offset[..., 1]
    # The nearest is the ring itself; the nearest neighbour errs low, the next one high.
    near = np.sqrt(np.partition(u * u + v * v, 2, axis=1)[:, 1:3]).mean(axis=1)
    scale = near / np.linalg.norm(lattice.move_in_radii, axis=1).min()
    likely = scale[(scale > SHORTEST) & (scale < LONGEST)]
    return float(np.median(likely)) if len(likely) >= max(SCALE_LEAST, len(scale) // 3) else 1.0


def planar_parts(candidates: Candidates, grid: Grid, pitch_radii: float) -> tuple[Grid, ...]:
    """The parts of a grid, the largest first; members of no part are left out."""
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


def _largest_part(index: Floats, point: Floats, reach_px: Floats) -> Flags:
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
