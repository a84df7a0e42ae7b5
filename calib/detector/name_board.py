"""How a grid lies on a board: by its origin dots, or by its outline if the board has none."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calib.detector.alignment import Alignment, GridReader, agreement, alignments
from calib.detector.candidates import Candidates
from calib.detector.grid import Grid
from calib.detector.marks import DOT
from calib.detector.name_faces import MIN_MARGIN, NamedGrid
from calib.detector.plan import TargetPlan

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

MIN_BOARD_GRID = 4
RING_FOR_DOT = 3
"""A ring seen where the origin mark has a dot weighs so much: with one dot hidden, two must still decide."""

MAX_OUTSIDE = 0.02
"""Clutter may join so large a share of strangers to a board's grid."""


@dataclass(frozen=True, eq=False)
class BoardName:
    """What became of a board: a named grid, or the reason why there is none."""

    named: NamedGrid | None
    remark: str = ""
    is_mirrored: bool = False


def name_board(
    plan: TargetPlan, candidates: Candidates, grids: tuple[Grid, ...], image: NDArray[np.generic], contrast: float
) -> BoardName:
    """Name the grid that carries the origin mark, or the one that fills a board without marks."""
    reason = BoardName(None, "no grid of rings was found")
    for grid in grids:
        if len(grid.row) < MIN_BOARD_GRID:
            break
        reader = GridReader(image, candidates, grid, plan, contrast)
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


def _by_dots(plan: TargetPlan, grid: Grid, sure: NDArray[np.bool_], reader: GridReader) -> BoardName:
    """Every turn and shift that puts a seen dot on a dot of the target; the best one, if by a margin."""
    dots = reader.discs
    if not len(dots):
        return BoardName(None, "the origin dots were not seen")
    proper = _best(plan, grid, sure, reader, dots, plan.lattice.turns)
    mirror = _best(plan, grid, sure, reader, dots, plan.lattice.mirrors)
    if mirror is not None and mirror[0] >= max(3, MIN_MARGIN + (proper[0] if proper else -MIN_MARGIN)):
        return BoardName(None, "mirrored: the image shows the board in a mirror, or was flipped", is_mirrored=True)
    if proper is None:
        return BoardName(None, "the dots seen do not form the origin mark")
    score, margin, alignment = proper
    marks = reader.marks(alignment.on_grid(plan.mark_index))
    # All dots read and no other way to explain them as well; or two of them, and every other way denied.
    is_whole_mark = bool((marks == DOT).all()) and margin > 0
    if not is_whole_mark and (score < 2 or margin < MIN_MARGIN - 1):
        return BoardName(None, "the origin mark could not be read beyond doubt")
    return BoardName(NamedGrid(grid, 0, alignment, tuple(map(int, marks)), margin))


def _best(
    plan: TargetPlan, grid: Grid, sure: NDArray[np.bool_], reader: GridReader, dots: Integers, turns: Integers
) -> tuple[int, int, Alignment] | None:
    """Score, margin and alignment of the best way to explain the dots seen; None: nothing speaks for any.

    A way that leaves rings outside the target is a rival only where it explains the dots as well as the best one that
    does not: of a board a row larger than the target it is the true way.
    """
    index = grid.index[sure]
    fitting: list[tuple[int, Alignment]] = []
    outside: list[int] = []
    tried: set[bytes] = set()
    for turn in turns:
        for dot in dots:
            for origin in plan.mark_index:
                alignment = Alignment(turn, origin - turn @ dot)
                key = turn.tobytes() + alignment.shift.tobytes()
                if key in tried:
                    continue
                tried.add(key)
                marks = reader.marks(alignment.on_grid(plan.mark_index))
                strange = plan.rows_at(0, alignment.on_face(dots))
                false_dots = int(((strange >= 0) & ~plan.target.is_dot[strange]).sum())
                score = int(agreement(plan.mark_is_dot[0], marks, RING_FOR_DOT)) - false_dots
                if (plan.rows_at(0, alignment.on_face(index)) < 0).sum() <= MAX_OUTSIDE * len(index):
                    fitting.append((score, alignment))
                else:
                    outside.append(score)
    fitting.sort(key=lambda item: -item[0])
    if not fitting or fitting[0][0] <= 0:
        return None
    score, best = fitting[0]
    rivals = [other for other, _ in fitting[1:]] + [other for other in outside if other >= score]
    return score, score - max(rivals, default=-MIN_MARGIN), best


def _by_outline(plan: TargetPlan, candidates: Candidates, grid: Grid, sure: NDArray[np.bool_]) -> BoardName:
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
