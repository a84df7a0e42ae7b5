"""What a study of a target's errors and a rig found, in its file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from calib.studies.tolerance.rig_costs import RigCost
from designer.base.file_kind import FileKind
from designer.base.marks import Count, FewLines, Gap, Length, Line, Word
from designer.tolerance.sources import SOURCES


@dataclass(frozen=True, eq=False)
class RigToleranceStudy:
    """What errors of a target cost a rig: `found.study.together.baseline_mm`. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    target: Word
    rig: Word
    errors: Line  # the way of making, in words
    cameras: Annotated[tuple[Word, ...], Length(2, 256)]
    frames: Count  # in which a camera sees the target
    sightings: Count
    length_mm: Gap  # whose error is told
    away_mm: Gap  # of the point that is told of, from the nearest camera; null: no two cameras see the middle
    costs: Annotated[tuple[RigCost, ...], Length(0, len(SOURCES))]  # of each error source, the largest first
    together: RigCost  # all errors
    noise: RigCost
    draws: Count
    drawn: RigCost | None  # prints that were drawn, with noise; null: none were
    remarks: FewLines


RIG_TOLERANCE = FileKind(
    RigToleranceStudy, "rig_tolerance", "the table of a study of a rig's target", "make the study again"
)
