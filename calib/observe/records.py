"""The records of a detection run: what happened to each photo, and why rings are missing."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.core.types import Detections, FaceRecord
from designer.base.file_kind import FileKind
from designer.base.marks import AtLeast, Hash


@dataclass(frozen=True)
class ImageRecord:
    """What happened to one photo: the target found, not found, or the photo not read."""

    image: str
    image_size: tuple[int, int] | None  # width, height in px; None: it could not be read
    features: int
    rejected: int  # ring-like things that got no name
    faces: tuple[FaceRecord, ...]
    remarks: tuple[str, ...]
    failure: str = ""  # why it could not be read or searched
    motion_px: Annotated[float, AtLeast(0)] = 0.0  # see `Detections`

    @property
    def named(self) -> tuple[FaceRecord, ...]:
        """The faces that were named."""
        return tuple(face for face in self.faces if face.face is not None)

    @property
    def expected(self) -> int:
        """How many features of these faces could have been measured."""
        return sum(face.measurable for face in self.named)

    @property
    def missing(self) -> Counter[str]:
        """Why features of these faces are missing: how many of each reason."""
        missing = Counter[str]()
        for face in self.named:
            missing.update(dict(face.missing))
        return missing


@dataclass(frozen=True)
class Records:
    """What happened to each photo of a run."""

    detector: str  # program and version
    layout_id: Hash
    geometry_id: Hash
    images: tuple[ImageRecord, ...]
    rendered_id: Hash = ""  # of the geometry that the photos were rendered of; "": real photos


RECORDS = FileKind(Records, "records", "a records file", "detect again", largest_bytes=256 * 2**20)


def image_record(seen: Detections) -> ImageRecord:
    """The record of a photo that was searched."""
    rejected = 0 if seen.rejected_px is None else len(seen.rejected_px)
    return ImageRecord(
        seen.image, seen.image_size, len(seen.ring), rejected, seen.faces, seen.remarks, motion_px=seen.motion_px
    )


def median_sigma_px(seen: Detections) -> float:
    """Median of the centres' standard deviations, along their worse axis; nan without centres."""
    if not len(seen.ring):
        return math.nan
    return float(np.median(np.sqrt(np.linalg.eigvalsh(seen.cov_px2)[:, 1])))


def common_remarks(remarks: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """What is remarked of each of several photos, to be said once."""
    if len(remarks) < 2:
        return ()
    return tuple(remark for remark in dict.fromkeys(remarks[0]) if all(remark in each for each in remarks))


def records_path(detections: Path) -> Path:
    """Where the records of a `NAME.csv` lie: NAME.records.json."""
    return detections.with_suffix(".records.json")


def read_records(path: Path) -> Records:
    """Read `NAME.records.json`.

    Raises:
        InputError: it cannot be read, or holds no records of this version; the message names it.
    """
    return RECORDS.read(path)
