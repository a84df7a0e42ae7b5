"""AprilGrids in photos: tags are read, and their corners named.

OpenCV draws tags of the AprilTag families upside down, and some makers print OpenCV's pictures: a target says which.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from calib.detector.marks import FoundFace
from calib.detector.marks.marker_points import MarkerLayout
from calib.detector.marks.markers import MarkedFace, Markers, find_marked
from designer.marks.aprilgrid import AprilGrid
from designer.marks.face_marks import FaceMarks

MOST_COLUMNS = 30


@lru_cache(maxsize=256)
def layout_of(marks: AprilGrid) -> MarkerLayout:
    """Its tags, turned as AprilTag and Kalibr print them where the dictionary is theirs, and their corners."""
    quad = marks.position_mm.reshape(-1, 4, 2)
    # Points run counter-clockwise from the lower left; OpenCV clockwise from a marker's own upper left, which those
    # who print AprilTags have at the lower right.
    quad = quad[:, [3, 2, 1, 0]]
    gap, cell = marks.tag_mm * marks.spacing, marks.tag_mm / 10
    dark = [[0, 2], [1, 3], [2, 0], [3, 1]] if marks.corner_squares else [[0], [1], [2], [3]]
    squares = "out small squares beside" if marks.corner_squares else " small squares beside"
    sector = np.ones((4, 4))
    for corner, quadrants in enumerate(dark):
        sector[corner, quadrants] = -1
    return MarkerLayout(
        dictionary=marks.dictionary,
        border_bits=marks.border_bits,
        first=marks.marker_ids[0],
        quad_mm=np.roll(quad, -2, axis=1) if marks.is_turned else quad,
        step_mm=marks.pitch_mm,
        point_mm=marks.position_mm,
        sector=np.tile(sector, (len(quad), 1)),
        clear_mm=0.9 * min(gap if marks.corner_squares else gap / 2, marks.border_bits * cell),
        unlike=f"their corners are not as the target's: too small or blurred, or printed with{squares} them",
    )


def _others(marks: AprilGrid, seen: Markers) -> Iterator[tuple[MarkerLayout, str]]:
    """Tags turned in their places, numbers from the other side, other columns, rows and first tags."""
    columns, rows = marks.tags
    low, high = int(seen.number.min()), int(seen.number.max())
    for first in sorted({marks.first_id, 0, low}, key=lambda one: (one != marks.first_id, one)):
        for width in sorted(range(1, MOST_COLUMNS), key=lambda one: abs(one - columns)):
            height = max(2, -(-(high - first + 1) // width), rows if width == columns else 0)
            for k in range(4):
                turned, upright = marks.from_top ^ (k % 2 > 0), marks.upright ^ (k > 1)
                try:
                    other = replace(marks, tags=(width, height), first_id=first, from_top=turned, upright=upright)
                except ValueError:
                    continue  # more tags than the dictionary has
                yield layout_of(other), _words(marks, other, low, high)


def _words(told: AprilGrid, other: AprilGrid, low: int, high: int) -> str:
    """What is seen that is not as told."""
    words = [f"tags {low} to {high} of {told.dictionary} are seen"]
    if other.tags[0] != told.tags[0]:
        words.append(f"on a grid of {other.tags[0]} columns, not {told.tags[0]}")
    if other.first_id != told.first_id:
        words.append(f"with {other.first_id} as the first one, not {told.first_id}")
    if other.from_top != told.from_top:
        words.append(f"numbered from the {'upper' if other.from_top else 'lower'} left")
    if other.upright != told.upright:
        words.append(f"tags stand {'as OpenCV draws them' if other.upright else 'as AprilTag and Kalibr print them'}")
    if len(words) == 1:
        words.append(f"which are more than a grid of {told.tags[0]} x {told.tags[1]} tags has")
    return f"{', '.join(words)}: make the target as it was printed"


def find(pixels: NDArray[np.uint8], faces: Sequence[FaceMarks]) -> tuple[FoundFace, ...]:
    """A record for each grid of which something is to be told; see `calib.detector.marks.Finder`."""
    own = [marks for marks in faces if isinstance(marks, AprilGrid)]
    return find_marked(pixels, [MarkedFace(layout_of(marks), partial(_others, marks)) for marks in own])


FINDER = find
