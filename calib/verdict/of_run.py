"""The verdict on a run: of the recommended model, in the light of the others."""

from collections.abc import Sequence
from dataclasses import dataclass

from calib.core.one_thread import one_thread
from calib.solver.calibration import Calibration
from calib.verdict.advice import DETECTED, Inputs, advice_of
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import evidence_of
from calib.verdict.halves import HalfSplit
from calib.verdict.judge import judge
from calib.verdict.next_views import NextView
from calib.verdict.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and the half solutions it rests on."""

    verdict: Verdict
    criteria: Criteria
    halves: HalfSplit
    observations_sha256: str = ""  # of the judged camera, as its calibration states it; "" before that is written


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
    return Judged(judge(evidence, criteria, advice), criteria, halves)
