"""What board one photo shows: its kind, its dictionary and its layout, by OpenCV's detectors, without any length.

Markers are looked for in all dictionaries; the one that explains most of them without strangers is taken. Places of
markers come from the frames of their neighbours, counts of columns from their ids, ratios of lengths from the plane's
homography that fits best.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from calib.core.linear_algebra import solve_square
from calib.detector.boards import as_bytes
from calib.detector.marks import FINDERS
from calib.detector.marks.chessboard import darkness, is_checkered, is_whole, largest, lattices_at, scales_of, turned
from calib.detector.marks.circles import grids_in, layouts_of, named, plan_of, step_radii
from calib.detector.marks.markers import Markers, factors, read_markers
from designer.base.arrays import Array, Rows
from designer.base.words import counted, with_article
from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.chessboard import Chessboard
from designer.marks.circles import Circles
from designer.marks.dictionaries import MARKERS, TAG_TURN, family_of
from designer.marks.face_marks import FaceMarks

Pixels = NDArray[np.uint8]
LEAST_MARKERS, LEAST_AGREEING = 4, 0.8
"""Markers that make a board, and their share that its layout explains."""
MOST_ACROSS = 60
LEAST_CORNERS = 3
"""Of a chessboard, along a side."""
NEAR = 0.3
"""Of a step: a neighbour is off its place in the lattice by less."""
LEAST_CIRCLES = 3, 12
"""Along a side, and in all."""
_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@dataclass(frozen=True)
class BoardInPhoto:
    """A board as a photo shows it; of its marks one length is 1 mm: the square, the tag or the pitch."""

    marks: FaceMarks
    seen: int  # corners, markers or circles
    sure: tuple[str, ...]  # what the photo tells
    unsure: tuple[str, ...]  # what it does not


@dataclass(frozen=True, eq=False)
class _Markers(Markers):
    """Of one dictionary."""

    dictionary: str
    border_bits: int


def boards_in(photo: NDArray[np.generic]) -> tuple[BoardInPhoto, ...]:
    """The boards that explain a photo and that their detectors find, the best first: markers, squares, circles."""
    pixels = as_bytes(photo)
    seen, found = list[_Markers](), list[BoardInPhoto]()
    for factor in factors(pixels.shape):
        seen = list(_all_markers(pixels, factor))
        found = [board for markers in seen for board in _of_markers(markers, pixels)]
        if found:
            most = max(board.seen for board in found)
            return tuple(one for one in found if one.seen >= 0.9 * most and _is_found(pixels, one.marks))
    if max((len(markers.number) for markers in seen), default=0) >= 2 * LEAST_MARKERS:
        return ()  # of several boards, or of one that makes no sense: no chessboard for that
    others = itertools.chain(_chessboard(pixels), _circles(pixels))
    return tuple(itertools.islice((one for one in others if _is_found(pixels, one.marks)), 1))


def _is_found(pixels: Pixels, marks: FaceMarks) -> bool:
    return any(len(face.row) for face in FINDERS[marks.kind](pixels, [marks]))


def loose_markers(photo: NDArray[np.generic]) -> tuple[int, str] | None:
    """How many markers are seen, and of which dictionary, where they make no board."""
    pixels = as_bytes(photo)
    seen = (one for factor in factors(pixels.shape) for one in _all_markers(pixels, factor))
    return max(((len(one.number), one.dictionary) for one in seen), default=None)


def _all_markers(pixels: Pixels, factor: int) -> Iterator[_Markers]:
    """Markers of the largest dictionary of each family."""
    largest = {family_of(name): name for name in sorted(MARKERS, key=lambda name: MARKERS[name])}
    for name in largest.values():
        for bits in (1, 2) if name.startswith(TAG_TURN) else (1,):
            read = read_markers(pixels, name, bits, factor, is_fine=True)
            if len(read.number) >= LEAST_MARKERS:
                yield _Markers(read.number, read.corner_px, name, bits)


def _of_markers(markers: _Markers, pixels: Pixels) -> Iterator[BoardInPhoto]:
    """The boards that the markers may be of."""
    lattice = _lattice(markers)
    if lattice is None:
        return
    place, rows, is_diagonal = lattice
    kept = replace(markers, number=markers.number[rows], corner_px=markers.corner_px[rows])
    if len(rows) >= LEAST_MARKERS and len(rows) >= LEAST_AGREEING * len(markers.number):
        yield from _charuco(kept, place, pixels) if is_diagonal else _aprilgrid(kept, place, pixels)


def _lattice(markers: _Markers) -> tuple[Rows, Rows, bool] | None:
    """Places of markers, x right and y down as they stand, in steps; which markers; whether neighbours lie aslant.

    Of a chessboard's light squares the nearest lie aslant, and steps are squares; in a grid they lie beside, and steps
    are from tag to tag.
    """
    corner = markers.corner_px
    middle = corner.mean(axis=1)
    across = 0.5 * (corner[:, 1] - corner[:, 0] + corner[:, 2] - corner[:, 3])
    down = 0.5 * (corner[:, 3] - corner[:, 0] + corner[:, 2] - corner[:, 1])
    frame = np.stack([across, down], axis=2)  # (N, 2, 2)
    if not (np.abs(np.linalg.det(frame)) > 1).all():
        return None
    inverse = solve_square(frame, np.broadcast_to(np.eye(2), frame.shape))
    both = 0.5 * (inverse[:, None] + inverse[None])
    apart = np.einsum("nmij,nmj->nmi", both, middle[None] - middle[:, None])  # (N, N, 2) in markers' sides
    length = np.linalg.norm(apart, axis=2) + 1e9 * np.eye(len(middle))
    nearest = apart[np.arange(len(middle)), length.argmin(axis=1)]
    slope = np.abs(nearest).min(axis=1) / np.abs(nearest).max(axis=1).clip(1e-9)
    is_diagonal = bool(np.median(slope) > 0.5)
    step = float(np.median(np.abs(nearest).max(axis=1)))
    if not 1.0 < step < 4.0:
        return None
    near = np.abs(apart / step - np.round(apart / step)).max(axis=2) < NEAR
    links = near & (length < (1.2 * math.sqrt(2) if is_diagonal else 1.2) * step)
    place, known = np.zeros((len(middle), 2), dtype=np.int64), np.zeros(len(middle), dtype=bool)
    queue = [int(links.sum(axis=1).argmax())]
    known[queue[0]] = True
    while queue:
        here = queue.pop(0)
        for other in np.flatnonzero(links[here] & ~known).tolist():
            place[other] = place[here] + np.round(apart[here, other] / step).astype(int)
            known[other] = True
            queue.append(other)
    rows = np.flatnonzero(known)
    return place[rows], rows, is_diagonal


def _charuco(markers: _Markers, place: Rows, pixels: Pixels) -> Iterator[BoardInPhoto]:
    """ChArUco boards of which the ids make sense where the markers are."""
    ids, at = markers.number, place - place.min(axis=0)
    by_place = dict(zip(map(tuple, at.tolist()), ids.tolist(), strict=True))
    steps = [by_place[x, y + 2] - number for (x, y), number in by_place.items() if (x, y + 2) in by_place]
    if not steps:
        return
    columns, (width, height) = int(np.median(steps)), (at.max(axis=0) + 1).tolist()
    if not 3 <= columns <= MOST_ACROSS or width > columns:
        return
    step = _ratio(at, markers, 1.05, 3.0, inset=True)
    ends = _ends(markers, at, step, pixels, inset=True)
    found = list[tuple[int, int, bool]]()  # first id, rows above, whether the corner is light
    for is_light, left, top in itertools.product((False, True), range(columns - width + 1), range(MOST_ACROSS)):
        x, y = (at + np.array([left, top])).T
        first = ids - (y * columns + is_light) // 2 - x // 2
        usual = int(np.median(first))
        if ((x + y) % 2 != is_light).all() and np.mean(first == usual) >= LEAST_AGREEING:
            found += [(usual, top, is_light)] if usual == 0 or (top == 0 and usual > 0) else []
    for first_id, top, is_light in sorted(found, key=lambda one: (bool(one[1]) == ends[0], one)):
        rows = max(top + height, 3)
        rows += is_light and rows % 2  # a row that is not seen
        marks = Charuco(
            (columns, rows), 1.0, round(1 / step, 3), _smallest(markers.dictionary, first_id + columns * rows // 2),
            first_id, is_light,
        )  # fmt: skip
        same = "the same before and since OpenCV 4.6" if rows % 2 else "not legacy"
        sure = (f"{columns} columns", "legacy: as OpenCV before 4.6" if is_light else same)
        yield _proposal(
            marks, len(ids), sure, f"a marker is {marks.marker_mm:.2f} of a square, to some percent", rows, top, ends,
        )  # fmt: skip


def _aprilgrid(markers: _Markers, place: Rows, pixels: Pixels) -> Iterator[BoardInPhoto]:
    """Grids of tags: which way ids go tells how the tags stand."""
    ids, at = markers.number, place - place.min(axis=0)
    by_place = dict(zip(map(tuple, at.tolist()), ids.tolist(), strict=True))
    right = [by_place[x + 1, y] - number for (x, y), number in by_place.items() if (x + 1, y) in by_place]
    down = [by_place[x, y + 1] - number for (x, y), number in by_place.items() if (x, y + 1) in by_place]
    if not right or not down:
        return
    along, below = int(np.median(right)), int(np.median(down))
    columns, is_tag = abs(below), markers.dictionary.startswith(TAG_TURN)
    if abs(along) != 1 or not 1 < columns <= MOST_ACROSS or (along < 0 and not is_tag):
        return
    # Tags that are turned stand on their heads: their ids go to the left.
    column, row = (at if step > 0 else at.max() - at for at, step in zip(at.T, (along, below), strict=True))
    offset = ids - row * columns - column
    first, width, height = int(np.median(offset)), int(column.max()) + 1, int(row.max()) + 1
    if np.mean(offset == first) < LEAST_AGREEING or first < 0 or width > columns:
        return
    step, is_turned = _ratio(at, markers, 1.02, 3.0, inset=False), along < 0
    ends = _ends(markers, at, step, pixels, inset=False)
    ends = ends if below > 0 else (ends[1], ends[0])
    top, left = divmod(first, columns)
    found = [(0, top)] if left + width <= columns else []
    found += [(first, 0)] if first and width == columns else []
    squares = _has_squares(markers, at, step, pixels)
    for first_id, before in sorted(found, key=lambda one: bool(one[1]) == ends[0]):
        marks = AprilGrid(
            (columns, height + before), 1.0, round(step - 1, 3),
            _smallest(markers.dictionary, first_id + columns * (height + before)), first_id, markers.border_bits,
            squares, from_top=(below > 0) != is_turned, upright=is_tag and not is_turned,
        )  # fmt: skip
        sure = (
            f"{columns} columns", f"a border of {counted(markers.border_bits, 'cell')}",
            f"{'' if squares else 'no '}small squares between the corners",
            f"numbered from the {'upper' if marks.from_top else 'lower'} left",
            *((f"tags stand as {'OpenCV draws' if marks.upright else 'Kalibr prints'} them",) if is_tag else ()),
        )  # fmt: skip
        gap = f"the gap is {marks.spacing:.2f} of a tag, to some percent"
        yield _proposal(marks, len(ids), sure, gap, height + before, before, ends)


def _proposal(
    marks: Charuco | AprilGrid, seen: int, sure: tuple[str, ...], ratio: str, rows: int, before: int,
    ends: tuple[bool, bool],
) -> BoardInPhoto:  # fmt: skip
    """A board of markers, with what is sure of it.

    Args:
        marks: of the board.
        seen: markers.
        sure: of its layout.
        ratio: of lengths.
        rows: of the board.
        before: of them, that are before the first that is seen.
        ends: whether the photo shows that there are no rows before and after those that are seen.
    """
    ids, name = marks.marker_ids, marks.dictionary
    alike = [one for one in MARKERS if family_of(one) == family_of(name) and MARKERS[one] > MARKERS[name]]
    begin = f"; {', '.join(alike)} begin with the same markers" if alike else ""
    ends_shown = ends[1] and (ends[0] or not before)
    count = f"{rows} rows" if ends_shown else f"{rows} rows, or more: the photo does not show where the board ends"
    some = (f"{counted(before, 'row')} of them not seen, if its first id is 0",) if before else ()
    told = (*sure, *((count,) if ends_shown else ()), f"markers {ids[0]} to {ids[-1]} of {name}, the smallest{begin}")
    return BoardInPhoto(marks, seen, told, (*(() if ends_shown else (count,)), *some, ratio))


def _plane(markers: _Markers, place: Rows, step: float, *, inset: bool) -> tuple[Array, Array]:
    """Corners on the board in sides of a marker (N, 2), and the homography from there to the photo; nan: none."""
    offset = 0.5 * (step - 1) * inset
    plane = (place[:, None] * step + offset + _SQUARE).reshape(-1, 2)
    matrix, _ = cv2.findHomography(plane, markers.corner_px.reshape(-1, 2), 0)
    return plane, np.full((3, 3), np.nan) if matrix is None else np.asarray(matrix, dtype=float)


def _ratio(place: Rows, markers: _Markers, low: float, high: float, *, inset: bool) -> float:
    """The step over a marker's side with which one homography explains all corners best."""
    corners = markers.corner_px.reshape(-1, 2)

    def misfit(step: float) -> float:
        plane, matrix = _plane(markers, place, step, inset=inset)
        if not np.isfinite(matrix).all():
            return 1e9
        return float(((cv2.perspectiveTransform(plane[None], matrix)[0] - corners) ** 2).sum())

    return float(minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-4}).x)


def _ends(markers: _Markers, place: Rows, step: float, pixels: Pixels, *, inset: bool) -> tuple[bool, bool]:
    """Whether a row before the first one that is seen, and one after the last, would be in the photo."""
    _, matrix = _plane(markers, place, step, inset=inset)
    last = place.max(axis=0) + 1.0
    found = []
    for y in (-1.0, last[1] + 1):
        ends = np.array([[0.0, y], [last[0], y]]) * step
        u, v = cv2.perspectiveTransform(ends[None], matrix)[0].T
        found.append(bool(((u > 0) & (v > 0) & (u < pixels.shape[1]) & (v < pixels.shape[0])).all()))
    return found[0], found[1]


def _smallest(dictionary: str, count: int) -> str:
    """The smallest dictionary of the family that has so many markers."""
    alike = [name for name in MARKERS if family_of(name) == family_of(dictionary) and MARKERS[name] >= count]
    return min(alike, key=lambda name: MARKERS[name], default=dictionary)


def _has_squares(markers: _Markers, place: Rows, step: float, pixels: Pixels) -> bool:
    """Whether small black squares lie between four tags: darker there than half-way between two."""
    _, matrix = _plane(markers, place, step, inset=False)
    gap, at = step - 1, place * step
    shades = []
    for offset in ([1 + gap / 2, 1 + gap / 2], [1 + gap / 2, 0.5], [0.5, 1 + gap / 2]):
        u, v = np.round(cv2.perspectiveTransform((at + offset)[None], matrix)[0]).astype(int).T
        inside = (u >= 0) & (v >= 0) & (u < pixels.shape[1]) & (v < pixels.shape[0])
        shades.append(float(np.median(pixels[v[inside], u[inside]])) if inside.any() else 255.0)
    return shades[0] < 0.6 * min(shades[1:])


def _chessboard(pixels: Pixels) -> Iterator[BoardInPhoto]:
    """The largest chessboard that is whole, at any scale."""
    every = [at for scale in scales_of(pixels) for at in lattices_at(pixels, scale)]
    boards = [at for at in every if min(at.shape[:2]) >= LEAST_CORNERS and is_whole(at) and is_checkered(pixels, at)]
    if not boards:
        return
    best = largest(boards)
    at = turned(best, *sorted(best.shape[:2]))[0]
    rows, columns = at.shape[0] + 1, at.shape[1] + 1
    # Of an odd sum one of the two corners that may be the upper left one is dark.
    is_light_first = (rows + columns) % 2 == 0 and darkness(pixels, at) <= 0
    yield BoardInPhoto(
        Chessboard((columns, rows), 1.0, light_first=is_light_first), at.size // 2,
        (f"{columns - 1} x {rows - 1} inner corners are seen, so {columns} x {rows} squares or more",),
        ("how many squares there are, if the photo does not show all, and which side is up",),
    )  # fmt: skip


def _circles(pixels: Pixels) -> Iterator[BoardInPhoto]:
    """The largest grids of dark or light circles, as their detector finds them."""
    found = dict[Circles, int]()
    for is_light in (False, True):
        for candidates, grids in grids_in(np.asarray(cv2.bitwise_not(pixels)) if is_light else pixels):
            for grid in grids:
                for marks in layouts_of(grid, step_radii(candidates, grid)):
                    naming, _ = named(candidates, grid, plan_of(marks))
                    if (
                        naming is not None
                        and min(marks.circles) >= LEAST_CIRCLES[0]
                        and len(naming.ring) >= LEAST_CIRCLES[1]
                    ):
                        seen = replace(marks, light=is_light)
                        found[seen] = max(found.get(seen, 0), len(naming.ring))
    for marks in sorted(found, key=lambda one: -found[one]):
        way = "asymmetric" if marks.asymmetric else "symmetric"
        yield BoardInPhoto(
            marks, found[marks],
            (f"{marks.circles[0]} x {marks.circles[1]} circles are seen in {with_article(way)} grid",),
            ("circles: more, if the photo does not show all",
             f"their diameter is {marks.diameter_mm:.2f} of their distance in a row, to some percent"),
        )  # fmt: skip
