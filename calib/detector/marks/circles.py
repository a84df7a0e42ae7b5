"""Grids of circles in photos: dark ellipses that stand on the lattice, named only where the whole grid is in view.

Circles carry no names: what a grid's outermost rows and columns are has to be seen. Centres are measured here, as dots
of rings' targets are, with the vanishing line that the grid gives: they are images of the centres, not of ellipses.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.detector.borders import reduced, reduction, thresholds
from calib.detector.candidates import Candidates, find_candidates, merged
from calib.detector.grid import Grid, grow_grids, lattice_from
from calib.detector.marks import FoundFace
from calib.detector.marks.markers import INVERTED, MIRRORED
from calib.detector.measure import measure
from calib.detector.place import Naming, complete
from calib.detector.plan import TargetPlan, plan_for
from calib.detector.ring_marks import zone_levels
from designer.base.arrays import Array, Rows
from designer.marks.circles import Circles
from designer.marks.face_marks import MOST_ACROSS, FaceMarks
from designer.target import target_of_marks

ANY_RATIO = 0.5
"""Of circles: light on some, or a hole in them, is no matter."""
CONTRAST = 20.0
"""Grey levels of 256 between circles and the ground between them, which of rings are alike."""
LEAST_SIDE_PX, SMALLEST = 16, 6
STRANGE = 2
"""So many circles more may stand on the lattice, beside it: clutter."""
CLEAR = 2
"""Circles that another place or turn of the grid explains less."""
SHOWN = 0.5
"""Least share of each outermost row and column."""
WORTH_A_WORD, MOST_ODD = 12, 1 / 3
"""Circles of a grid that is spoken of, and their share that makes it no grid."""
SAMPLES, MOST_PAIRS, MOST_STEPS, SAME = 300, 500_000, 3, 0.12
"""Circles that tell steps, their pairs with others, steps that are tried, and logarithms of steps that are one."""
TOUCHING, FARTHEST, ALIKE = 2.0, 20.0, 2.0
"""Radii from circle to circle, and their areas' ratio."""
COARSER = 1.3
"""Steps that much longer are others: of every second circle they are 1.41 times as long."""
OTHER_WIDTH, WIDEST = 1.15, 0.95
"""Circles that much wider or narrower than told, which exposure may make a little; of the way to the next one."""
AMBIGUOUS = "ambiguous orientation (these circles look the same turned): the most upright one is taken"
KEY = np.array([1 << 13, 1])
"""Of column and row, more than grids reach."""
SQUARE = lattice_from(np.diag([1.0, -1.0]), 1.0)
"""Of neighbours, columns to the right and rows down; of asymmetric grids these lie aslant."""


@dataclass(frozen=True, eq=False)
class CirclePlan:
    """A grid of circles with what its search needs."""

    marks: Circles
    index_from_lattice: Rows  # (2, 2)
    table: Array  # (I, J) 1 where the grid has a circle

    @cached_property
    def plan(self) -> TargetPlan:
        """For measuring."""
        margin_mm = self.marks.nearest_mm / 2 - self.marks.radius_mm
        return plan_for(target_of_marks([self.marks], np.eye(4)[None], margin_mm))


@lru_cache(maxsize=64)
def plan_of(marks: Circles) -> CirclePlan:
    """The plan of a grid."""
    # Circles of an asymmetric grid stand along the diagonals of its half steps.
    index_from_lattice = np.array([[1, -1], [1, 1]]) if marks.asymmetric else np.eye(2, dtype=np.int64)
    table = np.zeros(marks.index.max(axis=0) + 1)
    table[marks.index[:, 0], marks.index[:, 1]] = 1
    return CirclePlan(marks, index_from_lattice, table)


def grids_in(pixels: NDArray[np.generic]) -> Iterator[tuple[Candidates, tuple[Grid, ...]]]:
    """All dark circles on square lattices whose steps many of them have, by one threshold after the other.

    Circles that are every second one of others on a lattice, such as those of one colour of a chessboard, are no grid.
    """
    if min(pixels.shape) < LEAST_SIDE_PX:
        return
    factor = reduction((pixels.shape[0], pixels.shape[1]))
    grey = reduced(pixels, factor)
    candidates: Candidates | None = None
    for threshold in thresholds(grey):
        more = find_candidates(grey, threshold, factor, 0, ANY_RATIO)
        # All may begin a grid, and a gap may be in any of them.
        more = replace(more, ratio=np.full(more.count, ANY_RATIO), region=np.zeros(more.count, np.int64))
        candidates = more if candidates is None else merged(candidates, more)
        nearest, found = np.full(candidates.count, np.inf), list[Grid]()
        for step in sorted(_usual_steps(candidates)):
            lattice = replace(SQUARE, move_in_radii=step * SQUARE.move_in_radii)
            grids = grow_grids(candidates, lattice, across_gaps=True, smallest=SMALLEST, is_scaled=True)
            grids = tuple(grid for grid in grids if _is_on_ground(grey, factor, candidates, grid))
            found += [grid for grid in grids if np.mean(nearest[grid.row] < step / COARSER) < 0.5]
            for grid in grids:
                nearest[grid.row] = np.minimum(nearest[grid.row], step)
        yield candidates, tuple(sorted(found, key=lambda grid: -len(grid.row)))


def _usual_steps(candidates: Candidates) -> Iterator[float]:
    """From circle to circle in radii, where many circles have the same; the commonest first."""
    best = np.argsort(candidates.misfit_px / candidates.radius_px, kind="stable")
    best = best[: min(SAMPLES, MOST_PAIRS // max(len(best), 1))]
    if len(best) < SMALLEST:
        return
    offset, area = candidates.ellipse[None, :, :2] - candidates.ellipse[best, None, :2], candidates.radius_px**2
    # By the planes around both, as one is farther from the camera.
    away = np.sqrt(_in_radii(candidates.ellipse[best, None], offset) * _in_radii(candidates.ellipse[None], offset))
    share = area / area[best, None]
    away[(away < TOUCHING) | (share < 1 / ALIKE) | (share > ALIKE)] = np.inf
    step = np.log(np.partition(away, 1, axis=1)[:, :2].mean(axis=1))
    step = np.sort(step[step < np.log(FARTHEST)])
    for _ in range(MOST_STEPS):
        inside = np.abs(step[:, None] - step) < SAME
        if not len(step) or (most := inside.sum(axis=1)).max() < SMALLEST:
            return
        usual = float(np.median(step[inside[most.argmax()]]))
        yield float(np.exp(usual))
        step = step[np.abs(step - usual) > 2 * SAME]


def _neighbours(candidates: Candidates, grid: Grid) -> tuple[Array, Array]:
    """Ellipses of neighbouring circles of a grid.  # (P, 5), (P, 5)"""
    at = grid.index - grid.index.min(axis=0)
    row = np.full(np.ptp(grid.index, axis=0) + 1, -1)
    row[tuple(at.T)] = grid.row
    pairs = np.hstack([[row[1:].ravel(), row[:-1].ravel()], [row[:, 1:].ravel(), row[:, :-1].ravel()]])
    here, there = candidates.ellipse[pairs[:, (pairs >= 0).all(axis=0)]]
    return here, there


def _is_on_ground(grey: NDArray[np.uint8], factor: int, candidates: Candidates, grid: Grid) -> bool:
    """Whether the ground between circles is lighter, as between rings or their centres it is not."""
    here, there = _neighbours(candidates, grid)
    if not len(here):
        return False
    at = np.stack([here[:, :2], 0.5 * (here[:, :2] + there[:, :2])])
    u, v = np.moveaxis(np.round((at + 0.5) / factor - 0.5).astype(np.int64), -1, 0)
    level = np.median(grey[v.clip(0, len(grey) - 1), u.clip(0, grey.shape[1] - 1)], axis=1)
    return bool(level[1] > level[0] + CONTRAST)


def step_radii(candidates: Candidates, grid: Grid) -> float:
    """From circle to circle of a grid in radii, in the plane around them."""
    here, there = _neighbours(candidates, grid)
    offset = there[:, :2] - here[:, :2]
    return float(np.median([_in_radii(here, offset), _in_radii(there, offset)]))


def _in_radii(ellipse: Array, offset_px: Array) -> Array:
    """Lengths in the planes around circles.  # (..., 5), (..., 2) -> (...)"""
    u, v = np.moveaxis(offset_px, -1, 0)
    return np.asarray(np.hypot(ellipse[..., 2] * u, ellipse[..., 3] * u + ellipse[..., 4] * v))


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
    fits = fits_of(grid, plan, SQUARE.turns)
    best, alike = fits[0], plan.marks.alike
    # An odd number of rows looks in a mirror as if turned by half a turn.
    if plan.marks.asymmetric and fits_of(grid, plan, SQUARE.mirrors)[0].hits >= best.hits + CLEAR:
        return None, (MIRRORED,)
    rest = fits[alike].hits if len(fits) > alike else 0
    is_clear = len(grid.row) - best.hits <= STRANGE and rest <= best.hits - CLEAR
    if not is_clear or not _is_bounded(best.index, plan.table):
        return None, _size_words(grid, plan)
    options = [_naming(grid, fit, plan) for fit in fits[:alike]]
    upright = max(options, key=lambda one: _uprightness(candidates, one, plan.marks))
    return upright, (AMBIGUOUS,) if alike > 1 else ()


def _naming(grid: Grid, fit: GridFit, plan: CirclePlan) -> Naming:
    _, member, ring = np.intersect1d(fit.index @ KEY, plan.marks.index @ KEY, return_indices=True)
    order = np.argsort(ring)
    return Naming(grid.row[member[order]], ring[order])


def _is_bounded(index: Rows, table: Array) -> bool:
    """Whether of each outermost row and column enough is seen."""
    inside = ((index >= 0) & (index < table.shape)).all(axis=1)
    seen = np.zeros(table.shape)
    seen[tuple(index[inside].T)] = 1
    seen *= table
    # Columns of an asymmetric grid count half steps: its sides have two of them, of each of which half as much will do.
    wide = 1 if table.all() else 2
    had, shown = (
        np.array([at[:1].sum(), at[-1:].sum(), at[:wide].sum(), at[-wide:].sum(), at[:, 0].sum(), at[:, -1].sum()])
        for at in (table, seen)
    )
    return bool((shown >= SHOWN / np.array([wide, wide, 1, 1, 1, 1]) * had).all())


def _uprightness(candidates: Candidates, naming: Naming, marks: Circles) -> float:
    """Cosine of how far the board's x stands off the image's."""
    there = homography.direct(marks.position_mm[naming.ring], candidates.ellipse[naming.candidate, :2])
    middle, beside = homography.apply(there, np.array([[0, 0], [0.1 * marks.pitch_mm, 0]]))
    return float((beside - middle)[0] / np.linalg.norm(beside - middle))


def layouts_of(grid: Grid, step: float = FARTHEST) -> Mapping[Circles, int]:
    """What a grid may be, circles in a row 1 mm apart, with how many places of it and circles do not fit each other.

    `step` is from circle to circle in radii.
    """
    across, half = _extent(grid.index), _extent(grid.index @ np.array([[1, 1], [-1, 1]]))
    found = dict[Circles, int]()
    # Along the diagonals rows of an asymmetric grid are.
    for columns, rows, is_aslant in ((*across, False), (half[0] // 2, half[1], True), (half[1] // 2, half[0], True)):
        if 2 <= min(columns, rows) <= max(columns, rows) <= MOST_ACROSS:
            size = (columns, rows) if is_aslant else (max(columns, rows), min(columns, rows))
            nearest = math.sqrt(0.5) if is_aslant else 1.0
            marks = Circles(size, 1.0, round(min(2 / step, WIDEST), 2) * nearest, asymmetric=is_aslant)
            hits = fits_of(grid, plan_of(marks), SQUARE.turns)[0].hits
            found[marks] = len(grid.row) + columns * rows - 2 * hits
    return found


def _extent(index: Rows) -> tuple[int, int]:
    """Columns and rows, without those at the ends that hold few circles, which are clutter."""
    ends = []
    for at in (index - index.min(axis=0)).T:
        count = np.bincount(at)
        full = np.flatnonzero(count >= SHOWN * np.median(count[count > 0]))
        ends.append(int(full[-1] - full[0] + 1))
    return ends[0], ends[1]


def _size_words(grid: Grid, plan: CirclePlan) -> tuple[str, ...]:
    """What a grid is that is not the target's, or not all of it."""
    if len(grid.row) < WORTH_A_WORD:
        return ()
    told, layouts, count = plan.marks, layouts_of(grid), len(grid.row)

    def misfit(one: Circles) -> float:
        # Of the target cut somewhere rather than of another board.
        is_same = (one.asymmetric, one.circles) == (told.asymmetric, told.circles)
        return layouts[one] - is_same * count / 5

    best = min(layouts, key=misfit, default=told)
    if layouts.get(best, count) > MOST_ODD * count:
        return ()
    is_half = best.asymmetric
    # Of an asymmetric grid it matters which are the rows.
    seen, wanted = (
        one.circles if is_aslant else sorted(one.circles, reverse=True)
        for one, is_aslant in ((best, is_half), (told, told.asymmetric))
    )
    kind, own = ("an asymmetric" if is_aslant else "a symmetric" for is_aslant in (is_half, told.asymmetric))
    words = f"{kind} grid of {seen[0]} x {seen[1]} circles is seen"
    if is_half == told.asymmetric and all(a <= b for a, b in zip(seen, wanted, strict=True)):
        words += " in part" if list(seen) == list(wanted) else f" of {wanted[0]} x {wanted[1]}"
        return (
            f"{words}: all rows and columns must be in view, or the target is another"
            f"{'' if is_half else ', such as an asymmetric grid: two of these, one in the gaps of the other'}",
        )
    return (f"{words}, the target is {own} one of {wanted[0]} x {wanted[1]}: make the target as it was printed",)


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """The grids that a photo shows, measured; see `calib.detector.marks.Finder`."""
    circles = [marks for marks in faces if isinstance(marks, Circles)]
    found = _find_all(pixels, circles)
    if any(len(one.row) for one in found):
        return found
    other = _find_all(np.asarray(cv2.bitwise_not(pixels)), circles)
    return tuple(replace(one, remarks=(INVERTED, *one.remarks)) for one in other if len(one.row)) or found


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
    plan = plan_of(marks)
    best: tuple[Candidates, Grid, Naming, tuple[str, ...]] | None = None
    remarks: tuple[str, ...] = ()
    for candidates, grids in grids_in(pixels):
        whole = []
        for grid in grids:
            naming, words = named(candidates, grid, plan)
            if naming is not None:
                whole.append((candidates, grid, naming, words))
            elif not remarks:
                remarks = words
        if len(whole) > 1:
            size = f"{marks.circles[0]} x {marks.circles[1]}"
            return [_nothing(face, f"two grids of {size} circles are in view: cover one")]
        if whole and (best is None or len(whole[0][2].ring) > len(best[2].ring)):
            best = whole[0]
        if best is not None and len(best[2].ring) == len(marks.index):
            break
    if best is None:
        return [_nothing(face, *remarks)] if remarks else []
    candidates, grid, naming, words = best
    share = 2 * marks.nearest_mm / step_radii(candidates, grid) / marks.diameter_mm
    if not 1 / OTHER_WIDTH < share < OTHER_WIDTH:
        # Rounded, for photos of one board to share a plan.
        wide = min(round(share * marks.diameter_mm / marks.nearest_mm, 2), WIDEST) * marks.nearest_mm
        words = (*words, f"circles look {wide:.3g} mm wide, not {marks.diameter_mm:g}: they are measured as they look")
        plan = plan_of(replace(marks, diameter_mm=wide))
    return [_measured(pixels, plan.plan, candidates, naming, face, words)]


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
