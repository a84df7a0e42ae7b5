"""ChArUco boards in photos: markers are read, and the corners between squares named from them."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from calib.detector.marks import FoundFace
from calib.detector.marks.marker_points import MarkerLayout
from calib.detector.marks.markers import MarkedFace, Markers, find_marked
from designer.marks.charuco import Charuco
from designer.marks.face_marks import FaceMarks, lattice

MOST_COLUMNS = 40


@lru_cache(maxsize=256)
def layout_of(marks: Charuco) -> MarkerLayout:
    """Its markers, row by row in the light squares, and its corners."""
    square = lattice(*marks.squares)
    square = square[square.sum(axis=1) % 2 == int(not marks.light_first)]
    middle = (square - (np.array(marks.squares) - 1) / 2) * np.array([marks.square_mm, -marks.square_mm])
    corner = marks.marker_mm / 2 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    # The square up and left of a corner is dark where column and row make an even number, and the one across.
    sign = 1 - 2 * ((marks.index.sum(axis=1) + marks.light_first) % 2)
    return MarkerLayout(
        dictionary=marks.dictionary,
        border_bits=1,
        first=marks.marker_ids[0],
        quad_mm=middle[:, None] + corner,
        step_mm=marks.square_mm,
        point_mm=marks.position_mm,
        sector=sign[:, None] * np.array([1.0, -1.0, 1.0, -1.0]),
        clear_mm=0.9 * (marks.square_mm - marks.marker_mm) / 2,
    )


def _others(marks: Charuco, seen: Markers) -> Iterator[tuple[MarkerLayout, str]]:
    """The other pattern, other numbers of columns and rows, and other first markers."""
    columns, rows = marks.squares
    if rows % 2 == 0:
        now = "today's pattern: make the target without --legacy"
        yield (
            layout_of(replace(marks, legacy=not marks.legacy)),
            f"the photo shows {now if marks.legacy else 'the legacy pattern: make the target with --legacy'}",
        )
    low, high = int(seen.number.min()), int(seen.number.max())
    for first in sorted({marks.first_id, 0, low}, key=lambda one: (one != marks.first_id, one)):
        for width in sorted(range(3, MOST_COLUMNS), key=lambda one: abs(one - columns)):
            height = max(3, -(-2 * (high - first + 1) // width) + 1, rows if width == columns else 0)
            for legacy in (False, True):
                try:
                    other = replace(marks, squares=(width, height), first_id=first, legacy=legacy)
                except ValueError:
                    continue  # more markers than the dictionary has
                if not legacy or other.light_first:
                    yield layout_of(other), _words(marks, other, low, high)


def _words(told: Charuco, other: Charuco, low: int, high: int) -> str:
    """What is seen that is not as told."""
    words = [f"markers {low} to {high} of {told.dictionary} are seen"]
    if other.squares[0] != told.squares[0]:
        words.append(f"on a board of {other.squares[0]} columns of squares, not {told.squares[0]}")
    if other.first_id != told.first_id:
        words.append(f"with {other.first_id} as the first one, not {told.first_id}")
    if len(words) == 1:
        words.append(f"which are more than a board of {told.squares[0]} x {told.squares[1]} squares has")
    return f"{', '.join(words)}: make the target as it was printed"


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """A record for each board of which something is to be told; see `calib.detector.marks.Finder`."""
    own = [marks for marks in faces if isinstance(marks, Charuco)]
    return find_marked(pixels, [MarkedFace(layout_of(marks), partial(_others, marks)) for marks in own])


FINDER = find
