"""Chessboards: found by OpenCV, and named as far as the colours of squares tell."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.detector.borders import reduced
from calib.detector.marks import FoundFace
from designer.base.arrays import Array
from designer.marks.chessboard import Chessboard
from designer.marks.face_marks import FaceMarks

MOST_PIXELS = 2_000_000
"""Boards are looked for in images reduced to about this size at first."""
AMBIGUOUS = "ambiguous orientation (these squares look the same turned): the most upright one is taken"
SWAPPED = "dark and light squares are exchanged: another board than the target's (`light_first`), or a mirrored photo"


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """The board of the first face; equal boards cannot be told."""
    found = []
    for face, marks in enumerate(faces):
        assert isinstance(marks, Chessboard)  # noqa: S101 - the registry's promise
        if marks in faces[:face]:
            continue
        size = marks.squares[0] - 1, marks.squares[1] - 1
        lattice = next((one for one in _lattices(pixels, size) if one is not None), None)
        if lattice is not None:
            found.append(named(pixels, lattice, marks, face))
    return tuple(found)


def _lattices(pixels: NDArray[np.uint8], size: tuple[int, int]) -> Iterator[Array | None]:
    """What OpenCV's finders make of it, one after the other.  # (rows, columns, 2)"""
    factor = max(1, int(np.ceil(np.sqrt(pixels.size / MOST_PIXELS))))
    grey = pixels if factor == 1 else reduced(pixels, factor)
    normal = cv2.CALIB_CB_NORMALIZE_IMAGE
    for flags in (normal, normal | cv2.CALIB_CB_EXHAUSTIVE):
        is_found, corner = cv2.findChessboardCornersSB(grey, size, flags=flags)
        yield _in_full(np.asarray(corner), size, factor) if is_found else None
    is_found, corner = cv2.findChessboardCorners(grey, size, flags=normal | cv2.CALIB_CB_ADAPTIVE_THRESH)
    yield _in_full(np.asarray(corner), size, factor) if is_found else None


def _in_full(corner: NDArray[np.generic], size: tuple[int, int], factor: int) -> Array:
    return factor * (corner.reshape(size[1], size[0], 2).astype(np.float64) + 0.5) - 0.5


def named(pixels: NDArray[np.uint8], lattice_px: Array, marks: Chessboard, face: int) -> FoundFace:
    """The points of a whole board, turned so that colours fit and, where that leaves a choice, as upright as can be."""
    columns, rows = marks.squares[0] - 1, marks.squares[1] - 1
    ways = [np.rot90(at, turn) for at in (lattice_px, lattice_px[::-1]) for turn in range(4)]
    ways = [at for at in ways if at.shape[:2] == (rows, columns) and _is_seen_from_front(at)]
    fits = [at for at in ways if (_darkness(pixels, at) > 0) != marks.light_first]
    upright = max(fits or ways, key=lambda at: float((at[:, -1, 0] - at[:, 0, 0]).mean()))
    remarks = (AMBIGUOUS,) if len(fits or ways) > 1 else ()
    return FoundFace(face, np.arange(rows * columns), upright.reshape(-1, 2), remarks if fits else (*remarks, SWAPPED))


def _is_seen_from_front(at: Array) -> bool:
    """Whether columns run to the right where rows run down."""
    across, down = (at[:, -1] - at[:, 0]).mean(axis=0), (at[-1] - at[0]).mean(axis=0)
    return bool(across[0] * down[1] - across[1] * down[0] > 0)


def _darkness(pixels: NDArray[np.uint8], at: Array) -> float:
    """By how many levels the square right below the first corner, and all of its colour, are darker than the others."""
    middle = 0.25 * (at[:-1, :-1] + at[:-1, 1:] + at[1:, :-1] + at[1:, 1:])
    u, v = np.moveaxis(middle.round().astype(np.int64), -1, 0)
    level = pixels[v.clip(0, pixels.shape[0] - 1), u.clip(0, pixels.shape[1] - 1)].astype(np.float64)
    is_first = np.add.outer(np.arange(len(level)), np.arange(level.shape[1])) % 2 == 0
    return float(level[~is_first].mean() - level[is_first].mean())


FINDER = find
