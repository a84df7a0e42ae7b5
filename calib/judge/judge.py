"""The verdict: the worst of what is known, and no praise where nothing independent was checked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from calib.core.parallel import one_thread
from calib.judge import camera_checks, rig_checks
from calib.judge.advice import DETECTED, Inputs, advice_of, is_hopeless
from calib.judge.checks import Evidence, applied, checks_of, faults_of, missing_of
from calib.judge.evidence import CameraEvidence, evidence_of
from calib.judge.halves import Half, HalfSplit, Halves, NoHalves
from calib.judge.next_views import NextView, next_views
from calib.judge.verdict import Check, Criteria, Grade, Verdict
from calib.solver.calibration import Calibration, without_surface
from calib.solver.target_error import left_open, stated_prior
from designer.base.file_kind import FileKind
from designer.base.marks import Key, Line, Word
from designer.target import TargetGeometry

WORSE: tuple[Grade, ...] = ("good", "usable", "bad")
OF_A_RIG = "rig"
"""What a verdict says in the place of a camera's model."""


def judge(evidence: Evidence, criteria: Criteria, advice: Sequence[str] = ()) -> Verdict:
    """The verdict on a camera or a rig.

    The grade is the worst of the checks that are known. If one of those that are needed could not be made, it is
    "usable" at best: three photos, or a single one of an icosahedron, may determine a camera well, but nothing in them
    tells whether their standard deviations hold, and no careful person calls good what was never checked. Other
    checks that could not be made, such as agreement with models that were not solved, change nothing.
    """
    checks = checks_of(evidence, criteria)
    known = [check.grade for check in checks if check.grade != "unknown"]
    grade = max(known, key=WORSE.index) if known else "usable"
    missing = missing_of(evidence, checks)
    if missing and grade == "good":
        grade = "usable"
    sentence, leads_with = _reason(evidence, checks, missing, grade)
    model = evidence.model if isinstance(evidence, CameraEvidence) else OF_A_RIG
    return Verdict(grade, model, sentence, checks, tuple(advice), leads_with)


def _reason(evidence: Evidence, checks: Sequence[Check], missing: Sequence[Check], grade: Grade) -> tuple[str, str]:
    """The main reason of a grade, and the check that it is the sentence of."""
    if grade == "good":
        of = camera_checks.why_good(evidence) if isinstance(evidence, CameraEvidence) else rig_checks.why_good(evidence)
        return of, ""
    faults = faults_of(checks, grade)
    if not faults:
        return f"no fault was found, but not everything could be checked: {missing[0].sentence}", missing[0].name
    names = {check.name for check in faults}
    is_narrow = grade == "bad" and "coverage" in names and names <= {"uncertainty", "coverage"}
    if is_narrow and isinstance(evidence, CameraEvidence):
        limit = next((check.usable for check in faults if check.name == "uncertainty"), math.inf)
        if narrow := camera_checks.good_inside(evidence, limit):
            return narrow, ""
    also = ", ".join(check.title.lower() for check in faults[1:])
    return faults[0].sentence + (f" (also: {also})" if also else ""), faults[0].name


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
def judge_cameras(
    calibrations: Sequence[Calibration],
    best: int,
    halves: HalfSplit,
    criteria: Criteria,
    target: TargetGeometry | None,
    inputs: Inputs = DETECTED,
) -> tuple[Judged, tuple[NextView, ...]]:
    """Judge the recommended camera of a run, and find the photos that would make it better; nothing is solved.

    Args:
        calibrations: of the same photos by different models.
        best: row of the one that is judged.
        halves: of that one, by `calib.judge.halves.half_split`.
        criteria: the limits.
        target: that the photos show; None: points from elsewhere.
        inputs: the files it was solved from, which the advice names.
    """
    evidence = evidence_of(calibrations, best, halves)
    judged = calibrations[best]
    views = () if evidence.reading or is_hopeless(judged) else next_views(
        judged, goal_px=criteria["uncertainty"].good, goal_covered=criteria["coverage"].good / 100,
        factor=evidence.uncertainty.factor, opened=left_open(without_surface(judged), stated_prior(judged, target)),
    )  # fmt: skip
    return judged_by(judged, evidence, halves, criteria, views, inputs), views


def judged_by(
    calibration: Calibration,
    evidence: CameraEvidence,
    halves: HalfSplit,
    criteria: Criteria,
    views: Sequence[NextView] | None,
    inputs: Inputs = DETECTED,
) -> Judged:
    """The verdict by what was measured of a camera, and by the photos to take next; None: nobody looked for any."""
    advice = advice_of(calibration, evidence, criteria, views, inputs)
    reason, pairs = (halves.reason, None) if isinstance(halves, NoHalves) else (None, halves.pairs)
    return Judged(judge(evidence, criteria, advice), applied(criteria, evidence), pairs, reason)


def inputs_of(settings: Sequence[tuple[str, str]]) -> Inputs:
    """What a camera was solved from, as its command was told; `calib run` detects into a file of its own."""
    named = dict(settings)
    return Inputs(
        named.get("detections", DETECTED.detections), named.get("target", DETECTED.target), named.get("points", "")
    )
