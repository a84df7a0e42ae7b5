"""Several detections files of one camera as one."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from calib.core.types import Detections


def joined(sets: Sequence[Sequence[Detections]], names: Sequence[str]) -> tuple[Detections, ...]:
    """The photos of several files; those with a name that comes again get their file's name before it.

    Args:
        sets: of one layout.
        names: of their files.
    """
    count = Counter(photo.image for one in sets for photo in one)
    return tuple(
        replace(photo, image=f"{number}-{file}/{photo.image}") if count[photo.image] > 1 else photo
        for number, (one, file) in enumerate(zip(sets, names, strict=True), start=1)
        for photo in one
    )
