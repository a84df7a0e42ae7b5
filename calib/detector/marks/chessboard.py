"""Chessboards in photos: lattices of corners, named as far as the colours of squares tell."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.marks import FoundFace
from calib.detector.saddles import CornerLattice, find_lattices, levels_at
from designer.base.arrays import Array
from designer.marks.chessboard import Chessboard
from designer.marks.face_marks import FaceMarks

MOST_PIXELS = 2_000_000
"""Boards are looked for in images reduced to about this size at first, then in larger and smaller ones."""
FEW_PIXELS = 700_000
"""Smaller photos are looked at enlarged, too, where nothing is found."""
CLOSED = 0.4
"""Rows at the end of a lattice with a smaller share of their corners are not the board's."""
WHOLE = 0.75
"""A board has this share of its corners found, so that the others can be predicted."""
SURE = 0.9
"""With this share a lattice is no chance."""
WORTH_A_WORD = 12
CHECKERED, BRIDGED = 0.9, 0.8
"""Places in squares that must have the right shade; how far a corner's own shade may be from half-way to a square's."""
AMBIGUOUS = "ambiguous orientation (these squares look the same turned): the most upright one is taken"
SWAPPED = "dark and light squares are exchanged: another board than the target's (`light_first`), or a mirrored photo"
WHOLE_NEEDED = "a chessboard needs all of it in view, a ChArUco board does not"


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """Each board that is seen whole, or why none is; equal boards cannot be told from each other."""
    boards = {marks: face for face, marks in reversed(list(enumerate(faces))) if isinstance(marks, Chessboard)}
    lattices: list[list[Array]] = []
    found = []
    for marks, face in boards.items():
        size = marks.squares[0] - 1, marks.squares[1] - 1
        whole: list[Array] = []
        for number, scale in enumerate(scales_of(pixels)):
            if number == len(lattices):
                lattices.append(lattices_at(pixels, scale))
            whole = [one for one in lattices[number] if sorted(one.shape[:2]) == sorted(size) and is_whole(one)]
            if whole:
                break
        if len(whole) > 1:
            found.append(_nothing(face, f"{len(whole)} boards like the target's are in view: cover all but one"))
            continue
        seen = [one for each in lattices for one in each]
        # Of a larger board OpenCV's finder takes a part.
        larger = any(one[..., 0].size > size[0] * size[1] and _share(one) >= SURE for one in seen)
        if whole or larger or (other := _by_opencv(pixels, size)) is None:
            found += [named(pixels, whole[0], marks, face)] if whole else _told(pixels, seen, size, face)
        else:
            found.append(named(pixels, other, marks, face))
    return tuple(found)


def _nothing(face: int, remark: str) -> FoundFace:
    return FoundFace(face, np.zeros(0, dtype=np.int64), np.zeros((0, 2)), (remark,))


def scales_of(pixels: NDArray[np.uint8]) -> Iterator[float]:
    """By which a photo is multiplied, one after the other."""
    first = min(1.0, (MOST_PIXELS / pixels.size) ** 0.5)
    yield first
    yield from (0.5 * first, 0.25 * first)
    if first < 1:
        yield min(2 * first, 1.0)
    elif pixels.size < FEW_PIXELS:
        yield 2.0


def lattices_at(pixels: NDArray[np.uint8], scale: float) -> list[Array]:
    """Corners at a scale, in pixels of the photo, by row and column; nan: missing.  # each (rows, columns, 2)"""
    height, width = round(pixels.shape[0] * scale), round(pixels.shape[1] * scale)
    if min(height, width) < 16:
        return []
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    grey = pixels if scale == 1 else np.asarray(cv2.resize(pixels, (width, height), interpolation=way), dtype=np.uint8)
    back = np.array([pixels.shape[1] / width, pixels.shape[0] / height])
    return [(_closed(lattice) + 0.5) * back - 0.5 for lattice in find_lattices(grey)]


def _closed(lattice: CornerLattice) -> Array:
    """By row and column, without rows at the ends that hardly hang on; nan: missing.  # (rows, columns, 2)"""
    columns, rows = lattice.size
    at = np.full((rows, columns, 2), np.nan)
    at[lattice.index[:, 1], lattice.index[:, 0]] = lattice.center_px
    while min(at.shape[:2]) > 1:
        there = np.isfinite(at[..., 0])
        share = [there[0].mean(), there[-1].mean(), there[:, 0].mean(), there[:, -1].mean()]
        worst = int(np.argmin(share))
        if share[worst] >= CLOSED:
            break
        at = (at[1:], at[:-1], at[:, 1:], at[:, :-1])[worst]
    return at


def _share(at: Array) -> float:
    return float(np.isfinite(at[..., 0]).mean())


def is_whole(at: Array) -> bool:
    """Whether so many corners of a lattice are there that the others can be predicted."""
    return _share(at) >= WHOLE


def largest(lattices: Sequence[Array]) -> Array:
    """That of most corners and large squares; those that hang on by a few, and boards on a screen, are clutter."""
    return max(lattices, key=lambda at: at.size * _share(at) ** 4 * _square_px(at) ** 0.5)


def _square_px(at: Array) -> float:
    """The side of a square."""
    steps = [np.linalg.norm(np.diff(at, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return float(np.nanmedian(np.concatenate(steps)))


def is_checkered(pixels: NDArray[np.uint8], at: Array) -> bool:
    """Whether a lattice's squares are dark and light in turn up to their corners, and corners half-way between.

    Between circles, or rings, the ground is one: it has the same shade at each place that looks like a corner.
    """
    x, y = np.array([0.5, 0.2, 0.8, 0.2, 0.8]), np.array([0.5, 0.2, 0.2, 0.8, 0.8])
    shares = [(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y]
    four = [at[:-1, :-1], at[:-1, 1:], at[1:, :-1], at[1:, 1:]]
    place = sum(share[:, None] * one[:, :, None] for share, one in zip(shares, four, strict=True))
    row, column = np.nonzero(np.isfinite(place).all(axis=(2, 3)))
    first = (row + column) % 2 == 0
    if first.all() or not first.any():
        return False
    shade = levels_at(pixels, place[row, column])
    middle = 0.5 * (np.median(shade[first]) + np.median(shade[~first]))
    is_dark = (shade < middle) == (np.median(shade[first]) < middle)
    around = np.full(place.shape[:2], np.nan)
    around[row, column] = shade[:, 0]
    light, dark = (
        f([around[:-1, :-1], around[:-1, 1:], around[1:, :-1], around[1:, 1:]], axis=0) for f in (np.max, np.min)
    )
    inner = np.isfinite(light) & np.isfinite(at[1:-1, 1:-1, 0])
    away = np.abs(2 * levels_at(pixels, at[1:-1, 1:-1][inner]) - light[inner] - dark[inner])
    is_bridged = len(away) > 0 and np.median(away) > BRIDGED * np.median((light - dark)[inner])
    return bool(np.mean(is_dark == first[:, None]) > CHECKERED and not is_bridged)


def _by_opencv(pixels: NDArray[np.uint8], size: tuple[int, int]) -> Array | None:
    """What OpenCV's finder makes of a reduced photo.  # (rows, columns, 2)"""
    scale = min(1.0, (FEW_PIXELS / pixels.size) ** 0.5)
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else pixels
    is_found, corner = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not is_found:
        return None
    at: Array = (np.asarray(corner).reshape(size[1], size[0], 2).astype(np.float64) + 0.5) / scale - 0.5
    return at


def _told(pixels: NDArray[np.uint8], seen: Sequence[Array], size: tuple[int, int], face: int) -> list[FoundFace]:
    """What is seen instead of the board, if that is no chance."""
    seen = [one for one in seen if min(one.shape[:2]) > 1 and np.isfinite(one[..., 0]).sum() >= WORTH_A_WORD]
    seen = [one for one in seen if _share(one) >= SURE and is_checkered(pixels, one)]
    if not seen:
        return []
    best = largest(seen)
    short, long = sorted(best.shape[:2])
    told = f"{long} x {short} inner corners are seen, the target has {max(size)} x {min(size)}"
    if (short, long) == (min(size) + 1, max(size) + 1):
        why = f"were these counted as squares, which are one more each way: {long + 1} x {short + 1}?"
    elif short > min(size) or long > max(size):
        why = f"another board, of {long + 1} x {short + 1} squares?"
    elif _is_near_edge(pixels, best):
        why = f"cut by the image's edge? {WHOLE_NEEDED}"
    else:
        why = f"covered in part, or another board, of {long + 1} x {short + 1} squares? {WHOLE_NEEDED}"
    return [_nothing(face, f"{told}: {why}")]


def _is_near_edge(pixels: NDArray[np.uint8], at: Array) -> bool:
    """Whether a row more of corners would lie outside the image somewhere."""
    more = [2 * end[0] - end[1] for end in (at, at[::-1], at.swapaxes(0, 1), at.swapaxes(0, 1)[::-1])]
    there = np.concatenate(more)
    there = there[np.isfinite(there[:, 0])]
    return bool(((there < 2) | (there > np.array(pixels.shape[::-1]) - 3)).any())


def named(pixels: NDArray[np.uint8], lattice_px: Array, marks: Chessboard, face: int) -> FoundFace:
    """The points of a board, turned so that colours fit and, where that leaves a choice, as upright as can be."""
    columns, rows = marks.squares[0] - 1, marks.squares[1] - 1
    ways = turned(lattice_px, rows, columns)
    fits = [at for at in ways if (darkness(pixels, at) > 0) != marks.light_first]
    remarks = (AMBIGUOUS,) if len(fits or ways) > 1 else ()
    at = (fits or ways)[0].reshape(-1, 2)
    row = np.flatnonzero(np.isfinite(at[:, 0]))
    return FoundFace(face, row, at[row], remarks if fits else (*remarks, SWAPPED))


def turned(lattice_px: Array, rows: int, columns: int) -> list[Array]:
    """The ways to turn a lattice, seen from the front, to so many rows and columns; the most upright one first."""
    ways = [np.rot90(at, turn) for at in (lattice_px, lattice_px[::-1]) for turn in range(4)]
    ways = [at for at in ways if at.shape[:2] == (rows, columns) and _is_seen_from_front(at)]
    return sorted(ways, key=lambda at: float(np.nanmean(at[:, 0, 0]) - np.nanmean(at[:, -1, 0])))


def _is_seen_from_front(at: Array) -> bool:
    """Whether columns run to the right where rows run down."""
    across, down = np.nanmean(np.diff(at, axis=1), axis=(0, 1)), np.nanmean(np.diff(at, axis=0), axis=(0, 1))
    return bool(across[0] * down[1] - across[1] * down[0] > 0)


def darkness(pixels: NDArray[np.uint8], at: Array) -> float:
    """By how many levels the square right below the first corner, and all of its colour, are darker than the others."""
    middle = 0.25 * (at[:-1, :-1] + at[:-1, 1:] + at[1:, :-1] + at[1:, 1:])
    there = np.isfinite(middle[..., 0])
    u, v = middle[there].round().astype(np.int64).T
    level = pixels[v.clip(0, pixels.shape[0] - 1), u.clip(0, pixels.shape[1] - 1)].astype(np.float64)
    is_first = (np.add.outer(np.arange(len(middle)), np.arange(middle.shape[1])) % 2 == 0)[there]
    if is_first.all() or not is_first.any():
        return 0.0
    return float(level[~is_first].mean() - level[is_first].mean())


FINDER = find
