"""What a bootstrap of a rig found, in its file."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from calib.studies.rig_bootstrap import PairSpread
from designer.base.file_kind import FileKind
from designer.base.marks import Count, FewLines, Gap, Length, Line, Word


@dataclass(frozen=True, eq=False)
class RigBootstrapStudy:
    """How far samples of a rig's frames scatter: `found.study.ratio`. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    rig: Word
    cameras: Annotated[tuple[Word, ...], Length(2, 256)]
    frames: Count
    samples: Count  # that were solved
    failed: Count  # that do not determine the rig
    ratio: Gap  # spread over stated sigma by the noise, root mean square over places and turns of all pairs
    ratio_of_all: Gap  # over all that is stated, what the target may have done, too; null: that is not known
    pairs: Annotated[tuple[PairSpread, ...], Length(1, 100_000)]
    remarks: FewLines


RIG_BOOTSTRAP = FileKind(RigBootstrapStudy, "rig_bootstrap", "the table of a rig's bootstrap", "make the study again")
