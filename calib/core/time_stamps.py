"""Names that are the time of a photo, or of a robot's pose: as ROS and cameras write them."""

import re
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

SECONDS_DIGITS, LAST_DIGITS = 10, 19
"""Of the seconds since 1970, from 2001 to 2286; and of nanoseconds."""
_STAMP = re.compile(r"([0-9]{10})[._]?([0-9]{6,9})")


def stamps_s(*names: Sequence[str]) -> list[NDArray[np.float64]] | None:
    """The times of some rows of names, in seconds from the first of all; None if a name is no time.

    A time has 16 to 19 digits: seconds since 1970 of ten, and a fraction.
    """
    found = [[_nanoseconds(name) for name in row] for row in names]
    known = [stamp for row in found for stamp in row if stamp is not None]
    if not known or len(known) < sum(map(len, found)):
        return None
    first = min(known)
    return [np.array([1e-9 * (stamp - first) for stamp in row if stamp is not None]) for row in found]


def _nanoseconds(name: str) -> int | None:
    """Of a name with or without a file's ending."""
    match = _STAMP.fullmatch(name) or _STAMP.fullmatch(PurePath(name).stem)
    return None if match is None else int((match[1] + match[2]).ljust(LAST_DIGITS, "0"))
