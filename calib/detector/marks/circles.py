"""Grids of circles in photos: dark ellipses that stand on the lattice, named only where the whole grid is in view.

Circles carry no names: what a grid's outermost rows and columns are has to be seen. Centres are measured here, as dots
of rings' targets are, with the vanishing line that the grid gives: they are images of the centres, not of ellipses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.detector.borders import reduced, reduction, thresholds
from calib.detector.candidates import Candidates, find_candidates, merged
from calib.detector.grid import Grid, Lattice, grow_grids, lattice_from
from calib.detector.marks import FoundFace
from calib.detector.marks.markers import INVERTED, MIRRORED
from calib.detector.measure import measure
from calib.detector.place import Naming, complete
from calib.detector.plan import TargetPlan, plan_for
from calib.detector.ring_marks import zone_levels
from designer.base.arrays import Array, Rows
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks
from designer.target import target_of_marks

ANY_RATIO = 0.5
"""Of circles: light on them, or a hole in them, is no matter."""
LEAST_SIDE_PX, SMALLEST = 16, 6
STRANGE = 2
"""So many circles more may stand on the lattice, beside it: clutter."""
CLEAR = 2
"""Circles that another place or turn of the grid explains less."""
SHOWN = 0.5
"""Least share of each outermost row and column."""
WORTH_A_WORD = 12
AMBIGUOUS = "ambiguous orientation (these circles look the same turned): the most upright one is taken"


@dataclass(frozen=True, eq=False)
class CirclePlan:
    """A grid of circles with what its search needs."""

    marks: Circles
    plan: TargetPlan
    lattice: Lattice  # on which each place has a circle
    index_from_lattice: Rows  # (2, 2)
    table: Array  # (I, J) 1 where the grid has a circle


@lru_cache(maxsize=64)
def plan_of(marks: Circles) -> CirclePlan:
    """The plan of a grid."""
    step = marks.pitch_mm / 2 if marks.asymmetric else marks.pitch_mm
    # Circles of an asymmetric grid stand along the diagonals of its half steps.
    index_from_lattice = np.array([[1, -1], [1, 1]]) if marks.asymmetric else np.eye(2, dtype=np.int64)
    nearest = step * float(np.linalg.norm(index_from_lattice[:, 0]))
    target = target_of_marks([marks], np.eye(4)[None], nearest / 2 - marks.radius_mm)
    table = np.zeros(marks.index.max(axis=0) + 1)
    table[marks.index[:, 0], marks.index[:, 1]] = 1
    steps = index_from_lattice.T * np.array([step, -step])
    return CirclePlan(marks, plan_for(target), lattice_from(steps, marks.radius_mm), index_from_lattice, table)


@dataclass(frozen=True, eq=False)
class GridFit:
    """A grid laid on a board."""

    hits: int
    index: Rows  # (N, 2) of the grid's members on the board, of which some may be beside it


def fits_of(grid: Grid, plan: CirclePlan, turns: Rows) -> tuple[GridFit, ...]:
    """The best places of a grid on a board for each turn, and the second best one of the best turn; best first."""
    found = []
    for turn in turns:
        index = (grid.index @ turn.T) @ plan.index_from_lattice.T
        low = index.min(axis=0)
        footprint = np.zeros(np.ptp(index, axis=0) + 1)
        footprint[tuple((index - low).T)] = 1
        # No shift meets the table's other side.
        shape = tuple(int(side) for side in np.array(footprint.shape) + plan.table.shape - 1)
        overlap = np.fft.irfft2(np.fft.rfft2(plan.table, shape) * np.fft.rfft2(footprint, shape).conj(), shape)
        order = np.argsort(-overlap.ravel().round(), kind="stable")[:2]
        for flat in order.tolist():
            shift = np.array(np.unravel_index(flat, shape))
            shift = np.where(shift >= plan.table.shape, shift - shape, shift)
            found.append(GridFit(round(float(overlap.flat[flat])), index - low + shift))
    return tuple(sorted(found, key=lambda fit: -fit.hits))


def named(candidates: Candidates, grid: Grid, plan: CirclePlan) -> tuple[Naming | None, tuple[str, ...]]:
    """Which circles of a board the members of a grid are, or why that is not told."""
    fits, count = fits_of(grid, plan, plan.lattice.turns), len(plan.marks.index)
    best, alike = fits[0], plan.marks.alike
    # An odd number of rows looks in a mirror as if turned by half a turn.
    if plan.marks.asymmetric and fits_of(grid, plan, plan.lattice.mirrors)[0].hits >= best.hits + CLEAR:
        return None, (MIRRORED,)
    rest = fits[alike].hits if len(fits) > alike else 0
    is_clear = len(grid.row) - best.hits <= STRANGE and rest <= best.hits - CLEAR
    if not is_clear or not _is_bounded(best.index, plan.table):
        return None, _size_words(grid, plan)
    row = np.full(plan.table.shape, -1)
    row[plan.marks.index[:, 0], plan.marks.index[:, 1]] = np.arange(count)
    options = [_naming(grid, fit, row) for fit in fits[:alike]]
    upright = max(options, key=lambda one: _uprightness(candidates, one, plan.marks))
    return upright, (AMBIGUOUS,) if alike > 1 else ()


def _naming(grid: Grid, fit: GridFit, row: Rows) -> Naming:
    inside = np.asarray(((fit.index >= 0) & (fit.index < row.shape)).all(axis=1))
    ring = np.full(len(inside), -1)
    ring[inside] = row[tuple(fit.index[inside].T)]
    order = np.argsort(ring, kind="stable")
    order = order[ring[order] >= 0]
    return Naming(grid.row[order], ring[order])


def _is_bounded(index: Rows, table: Array) -> bool:
    """Whether of each outermost row and column enough is seen."""
    inside = ((index >= 0) & (index < table.shape)).all(axis=1)
    seen = np.zeros(table.shape)
    seen[tuple(index[inside].T)] = 1
    seen *= table
    # Columns of an asymmetric grid count half steps: its sides have two of them.
    wide = 1 if table.all() else 2
    sides = [
        (slice(wide), slice(None)),
        (slice(-wide, None), slice(None)),
        (slice(None), slice(1)),
        (slice(None), slice(-1, None)),
    ]
    return all(seen[side].sum() >= SHOWN * table[side].sum() for side in sides)


def _uprightness(candidates: Candidates, naming: Naming, marks: Circles) -> float:
    """Cosine of how far the board's x stands off the image's."""
    there = homography.direct(marks.position_mm[naming.ring], candidates.ellipse[naming.candidate, :2])
    middle, beside = homography.apply(there, np.array([[0, 0], [0.1 * marks.pitch_mm, 0]]))
    return float((beside - middle)[0] / np.linalg.norm(beside - middle))


def _size_words(grid: Grid, plan: CirclePlan) -> tuple[str, ...]:
    """What a grid is that is not the target's, or not all of it."""
    if len(grid.row) < WORTH_A_WORD:
        return ()
    told = plan.marks
    across = np.ptp(grid.index, axis=0) + 1
    # Along the diagonals, where rows of an asymmetric grid are.
    half = np.ptp(grid.index @ np.array([[1, 1], [-1, 1]]), axis=0) + 1
    sizes = [(False, across[0], across[1]), (True, half[0] // 2, half[1]), (True, half[1] // 2, half[0])]
    mine, count = (told.asymmetric, *told.circles), len(grid.row)
    # Of the target cut somewhere rather than of another board.
    is_half, *seen = min(sizes, key=lambda size: abs(size[1] * size[2] - count) - (size == mine) * count / 5)
    # Of an asymmetric grid it matters which are the rows.
    seen, wanted = [int(side) for side in seen], list(told.circles)
    seen, wanted = (
        one if keep else sorted(one, reverse=True) for one, keep in ((seen, is_half), (wanted, told.asymmetric))
    )
    kind = "an asymmetric" if is_half else "a symmetric"
    words = f"{kind} grid of {seen[0]} x {seen[1]} circles is seen"
    if is_half == told.asymmetric and all(a <= b for a, b in zip(seen, wanted, strict=True)):
        words += " in part" if seen == wanted else f" of {wanted[0]} x {wanted[1]}"
        return (
            f"{words}: all rows and columns must be in view, or the target is another"
            f"{'' if is_half else ', such as an asymmetric grid: two of these, one in the gaps of the other'}",
        )
    own = "an asymmetric" if told.asymmetric else "a symmetric"
    return (f"{words}, the target is {own} one of {wanted[0]} x {wanted[1]}: make the target as it was printed",)


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """The grids that a photo shows, measured; see `calib.detector.marks.Finder`."""
    circles = [marks for marks in faces if isinstance(marks, Circles)]
    found = _find_all(pixels, circles)
    if not found:
        other = _find_all(np.asarray(cv2.bitwise_not(pixels)), circles)
        found = tuple(replace(one, remarks=(INVERTED, *one.remarks)) for one in other if len(one.row))
    return found


def _find_all(pixels: NDArray[np.uint8], circles: Sequence[Circles]) -> tuple[FoundFace, ...]:
    """In the image as it is; a face that is not in view is nothing to speak of where another is."""
    found: list[FoundFace] = []
    for marks in dict.fromkeys(circles):
        own = [face for face, one in enumerate(circles) if one == marks]
        records = _find(np.asarray(cv2.bitwise_not(pixels)) if marks.light else pixels, marks, own[0])
        if len(own) > 1 and any(len(one.row) for one in records):
            records = [_nothing(own[0], f"faces {own[0]} and {own[1]} are alike: which is seen is not told")]
        found += records
    is_any_named = any(len(one.row) for one in found)
    return tuple(one for one in found if len(one.row) or not is_any_named)


def _nothing(face: int, *remarks: str) -> FoundFace:
    return FoundFace(face, np.zeros(0, dtype=np.int64), np.zeros((0, 2)), remarks)


def _find(pixels: NDArray[np.generic], marks: Circles, face: int) -> list[FoundFace]:
    """By one threshold after the other, until all circles are named."""
    if min(pixels.shape) < LEAST_SIDE_PX:
        return []
    plan = plan_of(marks)
    factor = reduction((pixels.shape[0], pixels.shape[1]))
    grey = reduced(pixels, factor)
    candidates: Candidates | None = None
    best: tuple[int, Candidates, Naming, tuple[str, ...]] | None = None
    remarks: tuple[str, ...] = ()
    for threshold in thresholds(grey):
        more = find_candidates(grey, threshold, factor, 0, ANY_RATIO)
        # All may begin a grid, and a gap may be in any of them.
        more = Candidates(more.ellipse, np.full(more.count, ANY_RATIO), np.zeros(more.count, np.int64), more.misfit_px)
        candidates = more if candidates is None else merged(candidates, more)
        grids = grow_grids(candidates, plan.lattice, across_gaps=True, smallest=SMALLEST)
        whole = []
        for grid in grids:
            naming, words = named(candidates, grid, plan)
            if naming is not None:
                whole.append((len(naming.ring), candidates, naming, words))
            elif not remarks:
                remarks = words
        if len(whole) > 1:
            return [
                _nothing(face, f"two grids of {marks.circles[0]} x {marks.circles[1]} circles are in view: cover one")
            ]
        if whole and (best is None or whole[0][0] > best[0]):
            best = whole[0]
        if best is not None and best[0] == len(marks.index):
            break
    if best is None:
        return [_nothing(face, *remarks)] if remarks else []
    return [_measured(pixels, plan.plan, best[1], best[2], face, best[3])]


def _measured(
    pixels: NDArray[np.generic],
    plan: TargetPlan,
    candidates: Candidates,
    naming: Naming,
    face: int,
    remarks: tuple[str, ...],
) -> FoundFace:
    """The centres of the circles named, and of those between them."""
    size = pixels.shape[1], pixels.shape[0]
    naming, placement = complete(plan, candidates, naming, size, None)
    level = zone_levels(pixels, candidates.ellipse[naming.candidate], ratio=0.0, around=0.4 + 0.6 * plan.limit)
    step = level[:, 2] - level[:, 1]
    contrast = float(np.median(step[np.isfinite(step)])) if np.isfinite(step).any() else 1.0
    found = measure(pixels, plan, candidates, naming, placement, max(contrast, 1e-6), None)
    order = np.argsort(found.ring, kind="stable")
    return FoundFace(face, found.ring[order], found.center_px[order], (*remarks, *found.remarks), found.cov_px2[order])


FINDER = find
