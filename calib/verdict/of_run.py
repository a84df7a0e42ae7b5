"""The verdict on a run: of the recommended model, in the light of the others."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from calib.core.one_thread import one_thread
from calib.solver.calibration import Calibration
from calib.verdict.advice import DETECTED, Inputs, advice_of
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import evidence_of
from calib.verdict.halves import Half, HalfSplit, Halves, NoHalves
from calib.verdict.judge import judge
from calib.verdict.next_views import NextView
from calib.verdict.verdict import Verdict
from designer.base.file_kind import FileKind
from designer.base.marks import Key, Line, Word


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and the half solutions it rests on."""

    verdict: Verdict
    criteria: Criteria
    pairs: Annotated[tuple[tuple[Half, Half], ...] | None, Key("halves")]
    no_halves: Line | None  # why there are none
    observations_sha256: Word = ""  # of the judged camera, as its calibration states it; "" before that is written

    def __post_init__(self) -> None:
        if self.pairs is not None:
            Halves(self.pairs)

    @staticmethod
    def by(verdict: Verdict, criteria: Criteria, halves: HalfSplit) -> "Judged":
        """A verdict that rests on half solutions, or on none."""
        reason, pairs = (halves.reason, None) if isinstance(halves, NoHalves) else (None, halves.pairs)
        return Judged(verdict, criteria, pairs, reason)

    @property
    def halves(self) -> HalfSplit:
        """The half solutions, or why there are none."""
        if self.pairs is None:
            return NoHalves(self.no_halves or "no half solutions are stored")
        return Halves(self.pairs)


VERDICT_FILE = "verdict.json"
VERDICT = FileKind(Judged, "verdict", "a verdict.json", "solve again", largest_bytes=16 * 2**20)
"""With the calibrations beside it the halves suffice to judge again by other limits without solving anything."""


@one_thread
def judge_run(
    calibrations: Sequence[Calibration],
    best: int,
    halves: HalfSplit,
    criteria: Criteria,
    views: Sequence[NextView] | None = None,
    inputs: Inputs = DETECTED,
) -> Judged:
    """Judge the recommended camera of a run; nothing is solved.

    Args:
        calibrations: of the same photos by different models.
        best: row of the one that is judged.
        halves: of that one, by `calib.verdict.halves.half_split`.
        criteria: the limits.
        views: the photos to take next, which the advice names; None: nobody looked for any.
        inputs: the files it was solved from, which the advice names.
    """
    evidence = evidence_of(calibrations, best, halves)
    advice = advice_of(calibrations[best], evidence, criteria, views, inputs)
    return Judged.by(judge(evidence, criteria, advice), criteria, halves)
