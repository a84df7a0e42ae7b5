"""Which face of a coded solid each grid is, and how it lies on it: by its code and its neighbours; or on a board.

Grids whose faces touch share corners in the image. A guess for one grid settles its neighbours, so a group of grids has
as many poses as the solid has turns (60 for the icosahedron); the one whose codes agree best wins, if by a margin.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.core.jit import jit
from calib.detector.alignment import DISAGREEMENT, Alignment, GridReader, agreement, alignments
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid, planar_parts
from calib.detector.plan import TargetPlan
from calib.detector.ring_marks import DOT
from designer.base.arrays import Array, Flags, Rows

Integers: TypeAlias = Rows

UNNAMED = -1


MIN_GRID = 6
"""Smaller grids are named by their neighbours only."""
MIN_MARGIN = 4
CORNER_TOLERANCE = 0.2
"""Corners of two grids closer than this share of an edge are one corner of the solid."""
OTHER_KIND = -99
"""The score of faces on which an option does not lie."""
MIN_BOARD_GRID = 4
RING_FOR_DOT = 3
"""A ring seen where the origin mark has a dot weighs so much: with one dot hidden, two must still decide."""
MAX_OUTSIDE = 0.02
"""Clutter may join so large a share of strangers to a board's grid."""


@jit
def _fitting_name(
    corner: Integers, score: Integers, options: int, corner_vertex: Integers, vertex: Integers, is_taken: Integers
) -> tuple[int, int]:
    """The face and the option whose corners fit the corners known so far, the best by its code; UNNAMED: none.

    Args:
        corner: of one grid: each option's corners, as numbers among the image's.  # (O, K)
        score: of its options as each face.  # (O, F)
        options: how many it has.
        corner_vertex: which points of the solid the faces' corners are.  # (F, K)
        vertex: which the image's corners are; UNNAMED: not known yet.  # (C,)
        is_taken: whether faces have grids.  # (F,)
    """
    best_face, best_option, best_score = UNNAMED, UNNAMED, 0
    for option in range(options):
        known = 0
        for place in range(corner.shape[1]):
            known += vertex[corner[option, place]] != UNNAMED
        if known < 2:
            continue
        for face in range(len(corner_vertex)):
            fits = is_taken[face] == 0
            for place in range(corner.shape[1]):
                point = vertex[corner[option, place]]
                fits = fits and (point == UNNAMED or point == corner_vertex[face, place])
            if fits and (best_face == UNNAMED or score[option, face] > best_score):
                best_face, best_option, best_score = face, option, score[option, face]
    return best_face, best_option


@jit
def follow(
    corner: Integers,
    score: Integers,
    options: Integers,
    touch: Flags,
    corner_vertex: Integers,
    corners: int,
    anchor: int,
    missing: int,
) -> tuple[Integers, Integers]:
    """Every pose of the solid that one grid of a group allows, followed through its neighbours.

    Args:
        corner: each grid's and option's corners, as numbers among the image's.  # (G, O, K)
        score: of the grids' options as each face.  # (G, O, F)
        options: how many each grid has.  # (G,)
        touch: which grids share an edge in the image.  # (G, G)
        corner_vertex: which points of the solid the faces' corners are.  # (F, K)
        corners: how many the image has.
        anchor: the grid to start from.
        missing: what a neighbour costs that lies where a pose has no such face.

    Returns:
        The poses' scores (Q,), and the face and option of each grid (Q, G, 2); UNNAMED: none.
    """
    grids, faces = len(options), len(corner_vertex)
    poses = faces * options[anchor]
    total = np.zeros(poses, dtype=np.int64)
    name = np.full((poses, grids, 2), UNNAMED)
    queue, vertex = np.empty(grids, dtype=np.int64), np.empty(corners, dtype=np.int64)
    for pose in range(poses):
        vertex[:] = UNNAMED
        is_reached, is_taken = np.zeros(grids, dtype=np.int64), np.zeros(faces, dtype=np.int64)
        name[pose, anchor, 0], name[pose, anchor, 1] = pose // options[anchor], pose % options[anchor]
        queue[0], is_reached[anchor], waiting = anchor, 1, 1
        done = 0
        while done < waiting:
            at = queue[done]
            done += 1
            face, option = name[pose, at]
            total[pose] += score[at, option, face]
            is_taken[face] = 1
            for place in range(corner.shape[2]):
                vertex[corner[at, option, place]] = corner_vertex[face, place]
            for other in range(grids):
                if is_reached[other] or not touch[at, other]:
                    continue
                is_reached[other] = 1
                found = _fitting_name(corner[other], score[other], options[other], corner_vertex, vertex, is_taken)
                if found[0] == UNNAMED:
                    total[pose] -= missing
                else:
                    name[pose, other, 0], name[pose, other, 1] = found
                    queue[waiting] = other
                    waiting += 1
    return total, name


@dataclass(frozen=True, eq=False)
class NamedGrid:
    """A grid with its name."""

    grid: Grid
    face: int
    alignment: Alignment
    marks: tuple[int, ...]  # as read at the plan's mark positions
    margin: int


@dataclass(frozen=True)
class StrangeCode:
    """A face, by its neighbours, that shows another's code beyond doubt, or its own turned."""

    face: int
    carries: int


@dataclass(frozen=True, eq=False)
class NamedFaces:
    """The grids that have a name beyond doubt, and faces that carry a code which is not theirs."""

    named: tuple[NamedGrid, ...]
    strange: tuple[StrangeCode, ...]
    score: int  # in all


@dataclass(frozen=True, eq=False)
class _Option:
    """One way a grid may lie on any face of a kind, with the score of every face's code."""

    alignment: Alignment
    marks: Integers  # (P,)
    score: Integers  # (F,)
    corner_px: Array  # (K, 2) of the outline, in the order of the face's outline
    features: int  # of such a face


@dataclass(frozen=True, eq=False)
class _Placed:
    """A grid and the options left for it; those on faces of one kind have the same corners, in another order."""

    grid: Grid
    options: tuple[_Option, ...]
    corners: tuple[tuple[int, ...], ...] = ()  # an option's corners as numbers among the image's corners


def name_faces(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], image: NDArray[np.generic]
) -> tuple[NamedFaces, bool]:
    """Names of the grids that have one beyond doubt, and whether the image is a mirror image."""
    grids = tuple(part for grid in grids for part in _on_one_face(plan, candidates, grid))
    readers = [GridReader(image, candidates, grid, plan) for grid in grids]
    found = _name(plan, candidates, grids, readers, plan.lattice.turns)
    if len(found.named) == sum(len(grid.row) >= MIN_GRID for grid in grids):
        return found, False
    mirrored = _name(plan, candidates, grids, readers, plan.lattice.mirrors)
    if len(mirrored.named) > 1 and mirrored.score >= found.score + MIN_MARGIN:
        return NamedFaces((), (), 0), True
    return found, False


def _on_one_face(plan: TargetPlan, candidates: Candidates, grid: Grid) -> tuple[Grid, ...]:
    """A grid as it is, or in parts if no face can hold it: something on an edge joined two faces."""
    sure = candidates.ratio[grid.row] > 0
    turns = plan.lattice.turns
    if len(grid.row) < MIN_GRID or any(alignments(plan, face, grid, sure, turns) for face in np.unique(plan.alike)):
        return (grid,)
    return planar_parts(candidates, grid, plan.pitch_radii)


def _name(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], readers: list[GridReader], turns: Integers
) -> NamedFaces:
    """The best names with the given turns of the lattice."""
    placed = [
        item
        for grid, reader in zip(grids, readers, strict=True)
        if (item := _place(plan, candidates, grid, reader, turns)) is not None
    ]
    placed = _number_corners(placed)
    named: list[NamedGrid] = []
    strange: list[StrangeCode] = []
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
            if face != UNNAMED and (carries := _other_code(placed[group[k]], face, number)) is not None:
                strange.append(StrangeCode(face, carries))
    faces = [item.face for item in named]
    sure = tuple(item for item in named if faces.count(item.face) == 1)
    return NamedFaces(sure, tuple(strange), total)


def _other_code(item: _Placed, face: int, number: int) -> int | None:
    """The face whose code a grid shows beyond doubt, if that is not what its neighbours say; itself: it lies turned."""
    score = np.array([option.score for option in item.options])
    first, second = np.sort(score.ravel())[[-1, -2]]
    if first < MIN_MARGIN or first - second < MIN_MARGIN or score[number, face] == first:
        return None
    return int(score.max(axis=0).argmax())


def _place(plan: TargetPlan, candidates: Candidates, grid: Grid, reader: GridReader, turns: Integers) -> _Placed | None:
    """The options of a grid whose shift is known: it fills its face, or its marks leave no doubt."""
    if len(grid.row) < MIN_GRID:
        return None
    sure = candidates.ratio[grid.row] > 0
    if sure.sum() < MIN_GRID - 2 or not homography.is_determined(grid.index[sure].astype(np.float64)):
        return None
    kinds = np.unique(plan.alike).tolist()
    ways = [(kind, way) for kind in kinds for way in alignments(plan, kind, grid, sure, turns)]
    if not ways:
        return None
    reader.marks(np.concatenate([way.on_grid(plan.mark_index) for _, way in ways]))  # all at once
    options = [_option(plan, candidates, grid, reader, kind, way) for kind, way in ways]
    if len(options) > len({option.alignment.turn.tobytes() for option in options}):
        scores = np.array([option.score for option in options])
        flat = np.sort(scores.ravel())
        if len(flat) < 2 or flat[-1] - flat[-2] >= MIN_MARGIN:
            options = [options[int(np.argmax(scores.max(axis=1)))]]
        else:  # a grid as large as a small face lies on a larger one in many ways, and fills the small one
            options = [option for option in options if option.features == len(grid.row)] if len(kinds) > 1 else []
    return _Placed(grid, tuple(options)) if options else None


def _option(
    plan: TargetPlan, candidates: Candidates, grid: Grid, reader: GridReader, kind: int, alignment: Alignment
) -> _Option:
    """Read the marks an alignment on faces of a kind asks for and compare them with all their codes."""
    marks = reader.marks(alignment.on_grid(plan.mark_index))
    row = plan.rows_at(kind, alignment.on_face(grid.index))
    known = row >= 0
    plane = plan.target.center_in_face_mm[row[known], :2]
    mapped = homography.direct(plane, candidates.ellipse[grid.row[known], :2])
    strange = _dots_on_rings(plan, alignment.on_face(reader.discs))
    return _Option(
        alignment=alignment,
        marks=marks,
        score=np.where(plan.alike == kind, agreement(plan.mark_is_dot, marks) - DISAGREEMENT * strange, OTHER_KIND),
        corner_px=homography.apply(mapped, plan.target.outline_mm[kind][plan.corner[kind]]),
        features=int((plan.row_table[kind] >= 0).sum()),
    )


def _dots_on_rings(plan: TargetPlan, index: Integers) -> Integers:
    """How many seen dots lie where each face has rings, other than at mark positions, which are scored apart."""
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
        corners = []
        for option in item.options:
            apart = np.linalg.norm(option.corner_px[:, None] - corner[None], axis=2)
            own = [numbers[k] for k in apart.argmin(axis=1)]
            for k in np.flatnonzero(apart.min(axis=1) > 0.5 * reach / CORNER_TOLERANCE).tolist():  # another outline's
                own[k], seen = len(seen), np.vstack([seen, option.corner_px[k]])
            corners.append(tuple(own))
        out.append(_Placed(item.grid, item.options, tuple(corners)))
    return out


def _touch(a: _Placed, b: _Placed) -> bool:
    """Whether two grids share an edge in the image."""
    first, second = ({frozenset(own) for own in item.corners} for item in (a, b))
    return any(len(own & other) == 2 for own, other in itertools.product(first, second))


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
    fresh = max(max(own) for item in group for own in item.corners) + 1
    for k, item in enumerate(group):
        for number, own in enumerate(item.corners):  # where a face has fewer corners, points that no other has
            beyond = corner.shape[2] - len(own)
            corner[k, number] = (*own, *range(fresh, fresh + beyond))
            fresh += beyond
        score[k, : options[k]] = [option.score for option in item.options]
    touch = np.array([[_touch(a, b) for b in group] for a in group])
    anchor = max(range(len(group)), key=lambda k: len(group[k].grid.row))
    # A grid that lies where a pose has no such face is as bad as a code that is wrong throughout.
    missing = plan.mark_index.shape[0]
    return follow(corner, score, options, touch, plan.corner_vertex, int(corner.max()) + 1, anchor, missing)


@dataclass(frozen=True, eq=False)
class BoardName:
    """What became of a board: a named grid, or the reason why there is none."""

    named: NamedGrid | None
    remark: str = ""
    is_mirrored: bool = False


def name_board(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], image: NDArray[np.generic]
) -> BoardName:
    """Name the grid that carries the origin mark, or the one that fills a board without marks."""
    reason = BoardName(None, "no grid of rings was found")
    for grid in grids:
        if len(grid.row) < MIN_BOARD_GRID:
            break
        reader = GridReader(image, candidates, grid, plan)
        sure = candidates.ratio[grid.row] > 0
        if sure.sum() < MIN_BOARD_GRID - 1:
            continue
        name = (
            _by_dots(plan, grid, sure, reader)
            if plan.target.is_dot.any()
            else _by_outline(plan, candidates, grid, sure)
        )
        if name.named or name.is_mirrored:
            return name
        if reason.named is None and grid is grids[0]:
            reason = name
    return reason


def _by_dots(plan: TargetPlan, grid: Grid, sure: Flags, reader: GridReader) -> BoardName:
    """Every face, turn and shift that puts a seen dot on a dot of the target; the best one, if by a margin."""
    dots = reader.discs
    if not len(dots):
        return BoardName(None, "the origin dots were not seen")
    proper = _best(plan, grid, sure, reader, dots, plan.lattice.turns)
    mirror = _best(plan, grid, sure, reader, dots, plan.lattice.mirrors)
    if mirror is not None and mirror[0] >= max(3, MIN_MARGIN + (proper[0] if proper else -MIN_MARGIN)):
        return BoardName(None, "mirrored: the image shows the board in a mirror, or was flipped", is_mirrored=True)
    if proper is None:
        return BoardName(None, "the dots seen do not form the origin mark")
    score, margin, face, alignment = proper
    marks = reader.marks(alignment.on_grid(plan.mark_index))
    # All dots read and no other way to explain them as well; or two of them, and every other way denied.
    is_whole_mark = bool((marks[plan.mark_is_dot[face]] == DOT).all()) and margin > 0
    if not is_whole_mark and (score < 2 or margin < MIN_MARGIN - 1):
        return BoardName(None, "the origin mark could not be read beyond doubt")
    return BoardName(NamedGrid(grid, face, alignment, tuple(map(int, marks)), margin))


def _best(
    plan: TargetPlan, grid: Grid, sure: Flags, reader: GridReader, dots: Integers, turns: Integers
) -> tuple[int, int, int, Alignment] | None:
    """Score, margin, face and alignment of the best way to explain the dots seen; None: nothing speaks for any.

    A way that leaves rings outside the target is a rival only where it explains the dots as well as the best one that
    does not: of a board a row larger than the target it is the true way.
    """
    index = grid.index[sure]
    fitting: list[tuple[int, int, Alignment]] = []
    outside: list[int] = []
    for face, alignment in _ways(plan, dots, turns):
        own = plan.mark_is_dot[face]
        marks = reader.marks(alignment.on_grid(plan.mark_index[own]))
        strange = plan.rows_at(face, alignment.on_face(dots))
        false_dots = int(((strange >= 0) & ~plan.target.is_dot[strange]).sum())
        score = int(agreement(own[own], marks, RING_FOR_DOT)) - false_dots
        if (plan.rows_at(face, alignment.on_face(index)) < 0).sum() <= MAX_OUTSIDE * len(index):
            fitting.append((score, face, alignment))
        else:
            outside.append(score)
    fitting.sort(key=lambda item: -item[0])
    if not fitting or fitting[0][0] <= 0:
        return None
    score, face, best = fitting[0]
    rivals = [other for other, *_ in fitting[1:]] + [other for other in outside if other >= score]
    return score, score - max(rivals, default=-MIN_MARGIN), face, best


def _ways(plan: TargetPlan, dots: Integers, turns: Integers) -> Iterator[tuple[int, Alignment]]:
    """Faces, and how a grid lies on them so that one of its dots (D, 2) is one of theirs; each way once."""
    tried: set[tuple[int, bytes, bytes]] = set()
    for face, turn, dot in itertools.product(range(plan.target.face_count), turns, dots):
        for origin in plan.mark_index[plan.mark_is_dot[face]]:
            shift = origin - turn @ dot
            key = face, turn.tobytes(), shift.tobytes()
            if key not in tried:
                tried.add(key)
                yield face, Alignment(turn, shift)


def _by_outline(plan: TargetPlan, candidates: Candidates, grid: Grid, sure: Flags) -> BoardName:
    """A board without dots: the grid must fill it; of the ways left, the most upright is taken and said to be so."""
    options = alignments(plan, 0, grid, sure, plan.lattice.turns)
    if not options:
        return BoardName(None, "the grid found is larger than the target")
    per_turn = len(options) / len({option.turn.tobytes() for option in options})
    if per_turn > 1:
        return BoardName(None, "the board has no dots and is not seen whole, so its place is ambiguous")
    best = max(options, key=lambda option: _uprightness(candidates, grid, option))
    remark = "" if len(options) == 1 else f"ambiguous orientation ({len(options)} ways), the most upright one is taken"
    return BoardName(NamedGrid(grid, 0, best, (), 0), remark)


def _uprightness(candidates: Candidates, grid: Grid, alignment: Alignment) -> float:
    """How far the face's first axis points right and its second up."""
    on_face = alignment.on_face(grid.index).astype(np.float64)
    centred = on_face - on_face.mean(axis=0)
    point = candidates.ellipse[grid.row, :2]
    slope = np.linalg.lstsq(centred, point - point.mean(axis=0), rcond=None)[0]
    right, up = slope[0] / np.linalg.norm(slope[0]), slope[1] / np.linalg.norm(slope[1])
    return float(right[0] - up[1])
