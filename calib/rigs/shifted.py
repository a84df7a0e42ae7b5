"""Photos of one camera that are counted from another frame on than those of the others: a list that lacks its first.

Two cameras that are held together see the target from poses that differ alike in all frames. If they do not, but would
with one camera's frames counted some further, the photos are paired wrongly, and no adjustment can make up for it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.core.types import RigObservations
from calib.rigs.start import Alone, relative_poses
from designer.base.errors import InputError
from designer.base.words import printable

Array = NDArray[np.float64]

FARTHEST = 5
"""Frames by which photos are tried to be shifted."""
LEAST_FRAMES = 6
"""That two cameras share, from which is told whether they fit."""
MOST_FRAMES = 40
"""That are compared."""
FITS = 0.05
"""Scatter of the pose between two cameras, radians and parts of the distance, up to which nothing is tried."""
BETTER = 0.2
"""Of the scatter as the frames are, up to which frames that are shifted fit."""


def require_same_frames(observations: RigObservations, alone: Sequence[Alone]) -> None:
    """Refuse photos of which the frames would fit if those of some cameras were shifted.

    Raises:
        InputError: the message names the cameras, and how far.
    """
    late = [(number, by) for number, by in enumerate(_offsets(observations, alone)) if by]
    if not late:
        return
    frames = observations.frame_names
    number, by = late[0]
    first = next(frame for frame in observations.frame[number].tolist() if 0 <= frame + by < len(frames))
    told = ", ".join(
        f"camera {printable(observations.camera_names[row])}: its frames fit if shifted by {shift}"
        for row, shift in late
    )
    raise InputError(
        f"{told}: what it shows in {printable(frames[first])} the others show in {printable(frames[first + by])}; "
        "name or list the photos of one moment alike"
        + ", or estimate the time offsets of the cameras"
        * (observations.time_s is not None)
    )


def _offsets(observations: RigObservations, alone: Sequence[Alone]) -> list[int]:
    """By how much each camera's frames are to be counted further to fit those of most cameras; 0 where none fit."""
    count = len(alone)
    shift: dict[tuple[int, int], int] = {}
    for first in range(count):
        for second in range(first + 1, count):
            by = _shift(observations, alone, first, second)
            if by is not None:
                shift[first, second], shift[second, first] = by, -by
    if not any(shift.values()):
        return [0] * count
    begin = max(range(count), key=lambda one: sum(pair[0] == one and not by for pair, by in shift.items()))
    offset, open_ends = {begin: 0}, [begin]
    while open_ends:
        known = open_ends.pop()
        for (one, other), by in shift.items():
            if one == known and other not in offset:
                offset[other] = offset[known] + by
                open_ends.append(other)
    return [offset.get(number, 0) for number in range(count)]


def _shift(observations: RigObservations, alone: Sequence[Alone], first: int, second: int) -> int | None:
    """By how much the second camera's frames are to be counted further to fit the first's; None: not to be told."""
    as_they_are = _scatter(observations, alone, first, second, 0)
    if not np.isfinite(as_they_are) or as_they_are <= FITS:
        return 0 if np.isfinite(as_they_are) else None
    tried = [by for by in range(-FARTHEST, FARTHEST + 1) if by]
    scatter = [_scatter(observations, alone, first, second, by) for by in tried]
    best = int(np.argmin(scatter))
    return tried[best] if scatter[best] <= BETTER * as_they_are else None


def _scatter(observations: RigObservations, alone: Sequence[Alone], first: int, second: int, by: int) -> float:
    """Of the pose between two cameras, the second's frames counted further; infinite where they share few."""
    _, at_first, at_second = np.intersect1d(
        observations.frame[first], observations.frame[second] + by, return_indices=True
    )
    one, other = alone[first].cam_from_target[at_first], alone[second].cam_from_target[at_second]
    rows = np.flatnonzero(np.isfinite(one[:, 0, 0]) & np.isfinite(other[:, 0, 0]))
    if len(rows) < LEAST_FRAMES:
        return np.inf
    rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), MOST_FRAMES)).astype(int)]
    apart = relative_poses(one[rows], other[rows])[1]
    return float(np.median(apart, axis=1).min())
