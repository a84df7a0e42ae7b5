"""Pieces of a target that were put on in each other's places, or turned."""

from collections import Counter
from collections.abc import Iterable

from calib.core.types import Detections

LEAST_PHOTOS = 2
"""That must show it; one may be misread."""


def misplaced_pieces(seen: Iterable[Detections]) -> tuple[str, ...]:
    """A line on the faces that show another's code, or their own turned, in most photos in which it was read.

    Their rings have the names of their places, as their neighbours tell them, so that a calibration holds.
    """
    read: dict[int, Counter[int | None]] = {}
    for record in (record for one in seen for record in one.faces):
        if record.face is not None and (record.code_read or record.carries is not None):
            read.setdefault(record.face, Counter())[record.carries] += 1
    said = [words for face, codes in sorted(read.items()) if (words := _words(face, codes))]
    if not said:
        return ()
    return (
        f"{'; '.join(said)}: put each piece on the face of its number, or leave it: its rings were named by the faces "
        "around it, and only dots of its code are lost",
    )


def _words(face: int, codes: Counter[int | None]) -> str:
    """`face 7 carries the code of face 12 in 9 of 10 photos`; "" if it is its own, or not sure."""
    ((code, times),) = codes.most_common(1)
    total = codes.total()
    if code is None or times < LEAST_PHOTOS or 2 * times <= total:
        return ""
    what = "lies turned on its place" if code == face else f"carries the code of face {code}"
    return f"face {face} {what} in {times} of {total} photos"
