"""The decode record: what was read of each face that shows, and why features are missing."""

from collections import Counter

import numpy as np

from calib.core.types import FaceRecord, Mark
from calib.detector.marks import DOT, RING
from calib.detector.measure import Measured
from calib.detector.name_faces import NamedGrid
from calib.detector.place import Placement
from calib.detector.plan import TargetPlan

_WORDS: dict[int, Mark] = {DOT: "dot", RING: "ring"}


def face_records(
    plan: TargetPlan, named: tuple[NamedGrid, ...], placement: Placement, measured: Measured
) -> tuple[FaceRecord, ...]:
    """A record for each face that shows, in the order of the faces."""
    read = {item.face: item for item in named}
    face_of = plan.target.ring_face
    found = Counter(face_of[measured.ring].tolist())
    records = []
    for face in placement.seen().tolist():
        missing = Counter(reason for row, reason in measured.missing if face_of[row] == face)
        item = read.get(face)
        records.append(
            FaceRecord(
                face=face,
                code_read=() if item is None else tuple(_WORDS.get(mark, "unreadable") for mark in item.marks),
                margin=0 if item is None else item.margin,
                rings_found=found.get(face, 0),
                rings_expected=int(np.count_nonzero(face_of == face)),
                missing=tuple(sorted(missing.items())),
                remark=_remark(item, found.get(face, 0)),
            )
        )
    return tuple(records)


def _remark(item: NamedGrid | None, found: int) -> str:
    """How a face came to its name, where it was not by its own code."""
    if item is not None:
        return ""
    return "named by the other faces" if found else "turned to the camera, but nothing on it could be measured"
