"""Which face of a coded solid each grid is, and how it lies on it: by its code and by its neighbours together.

Grids whose faces touch share corners in the image. A guess for one grid settles its neighbours, so a group of grids has
as many poses as the solid has turns (60 for the icosahedron); the one whose codes agree best wins, if by a margin.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detector import homography
from calib.detector.alignment import DISAGREEMENT, Alignment, GridReader, agreement, alignments
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid
from calib.detector.neighbours import UNNAMED, follow
from calib.detector.plan import TargetPlan
from calib.detector.planar_parts import planar_parts

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_GRID = 6
"""Smaller grids are named by their neighbours only."""
MIN_MARGIN = 4
CORNER_TOLERANCE = 0.2
"""Corners of two grids closer than this share of an edge are one corner of the solid."""


@dataclass(frozen=True, eq=False)
class NamedGrid:
    """A grid with its name."""

    grid: Grid
    face: int
    alignment: Alignment
    marks: tuple[int, ...]  # as read at the plan's mark positions
    margin: int


@dataclass(frozen=True, eq=False)
class _Option:
    """One way a grid may lie on any face, with the score of every face's code."""

    alignment: Alignment
    marks: Integers  # (P,)
    score: Integers  # (F,)
    corner_px: Floats  # (K, 2) of the outline, in the order of the face's outline


@dataclass(frozen=True, eq=False)
class _Placed:
    """A grid and the options left for it; all of them have the same corners, in another order."""

    grid: Grid
    options: tuple[_Option, ...]
    corners: tuple[tuple[int, ...], ...] = ()  # an option's corners as numbers among the image's corners


def name_faces(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], image: NDArray[np.generic], contrast: float
) -> tuple[tuple[NamedGrid, ...], bool]:
    """Names of the grids that have one beyond doubt, and whether the image is a mirror image."""
    grids = tuple(part for grid in grids for part in _on_one_face(plan, candidates, grid))
    readers = [GridReader(image, candidates, grid, plan, contrast) for grid in grids]
    named, score = _name(plan, candidates, grids, readers, plan.lattice.turns)
    if len(named) == sum(len(grid.row) >= MIN_GRID for grid in grids):
        return named, False
    mirrored, mirrored_score = _name(plan, candidates, grids, readers, plan.lattice.mirrors)
    if len(mirrored) > 1 and mirrored_score >= score + MIN_MARGIN:
        return (), True
    return named, False


def _on_one_face(plan: TargetPlan, candidates: Candidates, grid: Grid) -> tuple[Grid, ...]:
    """A grid as it is, or in parts if no face can hold it: something on an edge joined two faces."""
    sure = candidates.ratio[grid.row] > 0
    if len(grid.row) < MIN_GRID or alignments(plan, 0, grid, sure, plan.lattice.turns):
        return (grid,)
    return planar_parts(candidates, grid, plan.pitch_radii)


def _name(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], readers: list[GridReader], turns: Integers
) -> tuple[tuple[NamedGrid, ...], int]:
    """The best names with the given turns of the lattice, and their total score."""
    placed = [
        item
        for grid, reader in zip(grids, readers, strict=True)
        if (item := _place(plan, candidates, grid, reader, turns)) is not None
    ]
    placed = _number_corners(placed)
    named: list[NamedGrid] = []
    total = 0
    for group in _groups(placed):
        scores, names = _poses(plan, [placed[k] for k in group])
        best = int(np.argmax(scores))
        score = int(scores[best])
        rivals = scores[(names != names[best]).any(axis=(1, 2))]
        margin = score - int(rivals.max(initial=-99))
        if score < MIN_MARGIN or margin < MIN_MARGIN:
            continue
        total += score
        for k, (face, number) in enumerate(names[best].tolist()):
            option = placed[group[k]].options[number]
            # A grid that its neighbours named against its own code is a doubt, not a feature.
            if face != UNNAMED and option.score[face] >= 0:
                marks = tuple(int(mark) for mark in option.marks)
                named.append(NamedGrid(placed[group[k]].grid, face, option.alignment, marks, margin))
    faces = [item.face for item in named]
    return tuple(item for item in named if faces.count(item.face) == 1), total


def _place(plan: TargetPlan, candidates: Candidates, grid: Grid, reader: GridReader, turns: Integers) -> _Placed | None:
    """The options of a grid whose shift is known: it fills its face, or its marks leave no doubt."""
    if len(grid.row) < MIN_GRID:
        return None
    sure = candidates.ratio[grid.row] > 0
    if sure.sum() < MIN_GRID - 2 or not homography.is_determined(grid.index[sure].astype(np.float64)):
        return None
    ways = alignments(plan, 0, grid, sure, turns)
    if not ways:
        return None
    reader.marks(np.concatenate([way.on_grid(plan.mark_index) for way in ways]))  # all at once
    options = [_option(plan, candidates, grid, reader, way) for way in ways]
    per_turn = len(options) / len({option.alignment.turn.tobytes() for option in options})
    if per_turn > 1:
        scores = np.array([option.score for option in options])
        flat = np.sort(scores.ravel())
        if len(flat) > 1 and flat[-1] - flat[-2] < MIN_MARGIN:
            return None
        options = [options[int(np.argmax(scores.max(axis=1)))]]
    return _Placed(grid, tuple(options))


def _option(plan: TargetPlan, candidates: Candidates, grid: Grid, reader: GridReader, alignment: Alignment) -> _Option:
    """Read the marks an alignment asks for and compare them with all codes."""
    marks = reader.marks(alignment.on_grid(plan.mark_index))
    row = plan.rows_at(0, alignment.on_face(grid.index))
    known = row >= 0
    plane = plan.target.center_in_face_mm[row[known], :2]
    mapped = homography.direct(plane, candidates.ellipse[grid.row[known], :2])
    strange = _dots_on_rings(plan, alignment.on_face(reader.discs))
    return _Option(
        alignment=alignment,
        marks=marks,
        score=agreement(plan.mark_is_dot, marks) - DISAGREEMENT * strange,
        corner_px=homography.apply(mapped, plan.target.outline_mm[0]),
    )


def _dots_on_rings(plan: TargetPlan, index: Integers) -> Integers:
    """How many seen dots lie where each face has rings, other than at mark positions, which are scored apart.

    Args:
        plan: the target's.
        index: of the dots on the face.  # (D, 2)
    """
    if not len(index):
        return np.zeros(plan.target.face_count, dtype=np.int64)
    at_mark = (index[:, None] == plan.mark_index[None]).all(axis=2).any(axis=1)
    row = plan.rows_on_all(index[~at_mark])
    return np.asarray(((row >= 0) & ~plan.target.is_dot[row]).sum(axis=1))


def _number_corners(placed: list[_Placed]) -> list[_Placed]:
    """Give corners that coincide in the image one number."""
    seen = np.zeros((0, 2))
    out = []
    for item in placed:
        corner = item.options[0].corner_px
        reach = CORNER_TOLERANCE * float(np.linalg.norm(corner - np.roll(corner, 1, axis=0), axis=1).min())
        numbers = []
        for point in corner:
            distance = np.hypot(*(seen - point).T)
            nearest = int(np.argmin(distance)) if len(seen) else -1
            if nearest >= 0 and distance[nearest] < reach and nearest not in numbers:
                numbers.append(nearest)
            else:
                numbers.append(len(seen))
                seen = np.vstack([seen, point])
        out.append(
            _Placed(item.grid, item.options, tuple(_in_order(option, corner, numbers) for option in item.options))
        )
    return out


def _in_order(option: _Option, corner_px: Floats, numbers: list[int]) -> tuple[int, ...]:
    """The numbers of an option's corners; all options of a grid have the same corners, in another order."""
    nearest = np.argmin(np.linalg.norm(option.corner_px[:, None] - corner_px[None], axis=2), axis=1)
    return tuple(numbers[k] for k in nearest)


def _touch(a: _Placed, b: _Placed) -> bool:
    """Whether two grids share an edge in the image."""
    return len(set(a.corners[0]) & set(b.corners[0])) == 2


def _groups(placed: list[_Placed]) -> list[list[int]]:
    """Grids connected through shared edges."""
    left = set(range(len(placed)))
    groups = []
    while left:
        group = [min(left)]
        left.discard(group[0])
        for a in group:
            near = [b for b in sorted(left) if _touch(placed[a], placed[b])]
            group += near
            left.difference_update(near)
        groups.append(group)
    return groups


def _poses(plan: TargetPlan, group: list[_Placed]) -> tuple[Integers, Integers]:
    """Every pose of the solid that the largest grid of a group allows: scores (Q,), faces and options (Q, G, 2)."""
    options = np.array([len(item.options) for item in group])
    corner = np.zeros((len(group), options.max(), plan.corner_vertex.shape[1]), dtype=np.int64)
    score = np.zeros((len(group), options.max(), plan.target.face_count), dtype=np.int64)
    for k, item in enumerate(group):
        corner[k, : options[k]] = item.corners
        score[k, : options[k]] = [option.score for option in item.options]
    touch = np.array([[_touch(a, b) for b in group] for a in group])
    anchor = max(range(len(group)), key=lambda k: len(group[k].grid.row))
    # A grid that lies where a pose has no such face is as bad as a code that is wrong throughout.
    missing = plan.mark_index.shape[0]
    return follow(corner, score, options, touch, plan.corner_vertex, int(corner.max()) + 1, anchor, missing)
