"""The verdict: the worst of what is known, and no praise where nothing independent was checked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.cameras.formats import reading
from calib.core.parallel import one_thread
from calib.judge import joint_checks, lens_checks
from calib.judge.advice import DETECTED, Inputs, advice_of, is_hopeless
from calib.judge.checks import applied, checks_of, faults_of, missing_of
from calib.judge.evidence import Evidence, JointEvidence, LensEvidence, evidence_of, lens_evidence
from calib.judge.halves import NOT_COMPARED, Half, HalfSplit, Halves, NoHalves, RigHalves, RigSplit
from calib.judge.next_views import NextView, next_views
from calib.judge.verdict import MOST_POSES, Check, Criteria, Grade, NextFrame, NextPose, Verdict
from calib.solver.calibration import Calibration, without_surface
from calib.solver.target_error import left_open, stated_prior
from designer.base.file_kind import FileKind
from designer.base.files import JsonValue
from designer.base.marks import LEFT_OUT, Key, Length, Line, Word
from designer.target import TargetGeometry

if TYPE_CHECKING:
    from calib.rigs.result import RigCalibration

WORSE: tuple[Grade, ...] = ("good", "usable", "bad")
OF_A_RIG = "rig"
"""What a verdict says in the place of a camera's model."""


def judge(evidence: Evidence, criteria: Criteria, advice: Sequence[str] = ()) -> Verdict:
    """The verdict on cameras; of several, or of one that something moved, the advice follows from the evidence.

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
    if isinstance(evidence, JointEvidence):
        advice = joint_checks.steps_of(evidence, criteria)
    model = OF_A_RIG if evidence.lens is None else evidence.lens.model
    return Verdict(grade, model, sentence, checks, tuple(advice), leads_with)


def _reason(evidence: Evidence, checks: Sequence[Check], missing: Sequence[Check], grade: Grade) -> tuple[str, str]:
    """The main reason of a grade, and the check that it is the sentence of."""
    if grade == "good":
        if isinstance(evidence, JointEvidence):
            return joint_checks.why_good(evidence), ""
        return lens_checks.why_good(evidence.lens) if evidence.lens else "", ""
    faults = faults_of(checks, grade)
    if not faults:
        return f"no fault was found, but not everything could be checked: {missing[0].sentence}", missing[0].name
    names = {check.name for check in faults}
    is_narrow = grade == "bad" and "coverage" in names and names <= {"uncertainty", "coverage"}
    if is_narrow and evidence.lens is not None:
        limit = next((check.usable for check in faults if check.name == "uncertainty"), math.inf)
        if narrow := lens_checks.good_inside(evidence.lens, limit):
            return narrow, ""
    also = ", ".join(check.title.lower() for check in faults[1:])
    return faults[0].sentence + (f" (also: {also})" if also else ""), faults[0].name


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and what it rests on."""

    verdict: Verdict
    criteria: Criteria
    pairs: Annotated[tuple[tuple[Half, Half], ...] | None, Key("halves")] = None  # of the photos of one camera
    no_halves: Line | None = None  # why there are none
    solution_sha256: Annotated[Word, Key("observations_sha256")] = ""
    """Of what was judged: as the camera's calibration states it, or of the file that keeps a rig; "" before that is."""
    splits: Annotated[Annotated[tuple[RigSplit, ...], Length(1, 10)] | None, LEFT_OUT] = None  # of the frames of a rig
    next_frames: Annotated[Annotated[tuple[NextFrame, ...], Length(0, 16)], LEFT_OUT] = ()  # that would make it better
    next_poses: Annotated[Annotated[tuple[NextPose, ...], Length(0, MOST_POSES)], LEFT_OUT] = ()  # likewise, of a robot

    def __post_init__(self) -> None:
        if self.pairs is not None:
            Halves(self.pairs)

    @property
    def halves(self) -> HalfSplit:
        """The half solutions of a camera, or why there are none."""
        return NoHalves(self.no_halves or "no half solutions are stored") if self.pairs is None else Halves(self.pairs)

    @property
    def rig_halves(self) -> RigHalves | NoHalves:
        """What came of halves of a rig's frames, or why there are none."""
        return NoHalves(self.no_halves) if self.no_halves else RigHalves(self.splits) if self.splits else NOT_COMPARED


VERDICT_FILE, EARLIER_RIG_VERDICT_FILE = reading.VERDICT_FILE, "rig_verdict.json"
VERDICT = FileKind(Judged, "verdict", "a verdict.json", "solve again", largest_bytes=reading.LARGEST_VERDICT)
"""With the calibrations beside it the halves suffice to judge again by other limits without solving anything."""


def read_verdict(folder: Path) -> Judged | None:
    """The verdict of a folder, of a rig's as earlier versions wrote it too; None: nobody judged.

    Raises:
        InputError: it cannot be read.
    """
    path = folder / EARLIER_RIG_VERDICT_FILE
    if (folder / VERDICT_FILE).exists() or not path.exists():
        return VERDICT.read_if_there(folder / VERDICT_FILE)
    keys = replace(VERDICT, kind="rig_verdict", what="a rig_verdict.json").keys(path)
    halves = keys.pop("halves", None)
    told = {
        "halves": None, "no_halves": None, "splits": halves.get("splits") if isinstance(halves, dict) else None,
        "observations_sha256": keys.pop("solution_sha256", ""), **keys,
    }  # fmt: skip
    head: dict[str, JsonValue] = {"format": VERDICT.format, "version": VERDICT.version}
    return VERDICT.of({**head, **told}, str(path))


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
    lens = lens_evidence(calibrations, best, halves)
    judged = calibrations[best]
    views = () if lens.reading or is_hopeless(judged) else next_views(
        judged, goal_px=criteria["uncertainty"].good, goal_covered=criteria["coverage"].good / 100,
        factor=lens.uncertainty.factor, opened=left_open(without_surface(judged), stated_prior(judged, target)),
    )  # fmt: skip
    return judged_by(judged, lens, halves, criteria, views, inputs), views


def judged_by(
    calibration: Calibration,
    lens: LensEvidence,
    halves: HalfSplit,
    criteria: Criteria,
    views: Sequence[NextView] | None,
    inputs: Inputs = DETECTED,
) -> Judged:
    """The verdict by what was measured of a camera, and by the photos to take next; None: nobody looked for any."""
    evidence, advice = evidence_of(calibration, lens), advice_of(calibration, lens, criteria, views, inputs)
    reason, pairs = (halves.reason, None) if isinstance(halves, NoHalves) else (None, halves.pairs)
    return Judged(judge(evidence, criteria, advice), applied(criteria, evidence), pairs, reason)


MENDED_BY_FRAMES = ("frames", "baselines", "space", "halves")
"""Checks that more frames may make good."""
SPOILT = ("solution", "priors", "carrier", "residuals", "halves")
"""Checks that more frames like these mend in no way; a robot's next poses may mend what its poses so far leave open."""


def judge_rig(found: "RigCalibration", halves: RigHalves | NoHalves, criteria: Criteria) -> Judged:
    """Judge cameras that were solved together, or with what moved one; nothing is solved.

    Args:
        found: the rig.
        halves: of its frames, by `calib.judge.joint_halves.rig_halves`.
        criteria: the limits.
    """
    from calib.judge.evidence import joint_evidence
    from calib.judge.next_frames import next_frames
    from calib.judge.next_robot_poses import next_robot_poses

    evidence = joint_evidence(found, halves)
    verdict = judge(evidence, criteria)
    spoilt = {check.name for check in verdict.checks if check.grade == "bad" and check.name in SPOILT}
    is_sure = all(check.grade == "good" for check in verdict.checks if check.name in MENDED_BY_FRAMES)
    return Judged(
        verdict, applied(criteria, evidence),
        no_halves=halves.reason if isinstance(halves, NoHalves) else None,
        splits=None if isinstance(halves, NoHalves) else halves.splits,
        next_frames=() if is_sure or spoilt else next_frames(found, halves),
        next_poses=() if spoilt - {"solution"} else next_robot_poses(found, halves),
    )  # fmt: skip


def inputs_of(settings: Sequence[tuple[str, str]]) -> Inputs:
    """What a camera was solved from, as its command was told; `calib run` detects into a file of its own."""
    named = dict(settings)
    return Inputs(
        named.get("detections", DETECTED.detections), named.get("target", DETECTED.target), named.get("points", "")
    )
