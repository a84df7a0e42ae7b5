"""The verdict on a rig: the worst of what is known, and no praise where nothing independent was checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from calib.judge.judge import WORSE
from calib.judge.next_robot_poses import MOST_POSES, NextPose, next_robot_poses
from calib.judge.rig_checks import RIG_CHECKS, rig_checks, rig_faults
from calib.judge.rig_evidence import RigEvidence, rig_evidence
from calib.judge.rig_next_frames import NextFrame, next_frames
from calib.judge.verdict import Check, Criteria, Grade, Verdict
from calib.rigs.halves import NoRigHalves, RigHalves
from calib.rigs.result import RigCalibration
from designer.base.file_kind import FileKind
from designer.base.marks import LEFT_OUT, Hash, Length, Line
from designer.base.words import figure, printable

MENDED_BY_FRAMES = ("frames", "baselines", "space", "halves")
"""Checks that more frames may make good."""
SPOILT = ("solution", "carrier", "residuals", "halves")
"""Checks that more frames like these mend in no way; a robot's next poses may mend what its poses so far leave open."""
NOT_COMPARED = NoRigHalves("halves of the frames were not compared")
OF_A_RIG = "rig"
"""What a verdict says in the place of a camera's model."""


@dataclass(frozen=True, eq=False)
class JudgedRig:
    """A verdict on a rig, and what it rests on."""

    verdict: Verdict
    criteria: Criteria
    halves: Annotated[RigHalves | None, LEFT_OUT] = None
    no_halves: Annotated[Line, LEFT_OUT] = ""  # why there are none
    next_frames: Annotated[tuple[NextFrame, ...], Length(0, 16)] = ()  # that would make the rig better
    next_poses: Annotated[
        tuple[NextPose, ...], Length(0, MOST_POSES)
    ] = ()  # of a robot that carries the camera or the target
    solution_sha256: Annotated[Hash, LEFT_OUT] = ""  # of the file that keeps the judged rig; "" before that is written

    @property
    def compared(self) -> RigHalves | NoRigHalves:
        """The halves, or why there are none."""
        return self.halves or (NoRigHalves(self.no_halves) if self.no_halves else NOT_COMPARED)


RIG_VERDICT_FILE = "rig_verdict.json"
RIG_VERDICT = FileKind(JudgedRig, "rig_verdict", "a rig_verdict.json", "solve the rig again", largest_bytes=16 * 2**20)


def judge_rig(found: RigCalibration, halves: RigHalves | NoRigHalves, criteria: Criteria) -> JudgedRig:
    """Judge a solved rig; nothing is solved.

    Args:
        found: the rig.
        halves: of its frames, by `calib.rigs.halves.rig_halves`.
        criteria: the limits, of `calib.judge.criteria.read_rig_criteria`.
    """
    verdict = rig_verdict(rig_evidence(found, halves), criteria)
    spoilt = {check.name for check in verdict.checks if check.grade == "bad" and check.name in SPOILT}
    is_sure = all(check.grade == "good" for check in verdict.checks if check.name in MENDED_BY_FRAMES)
    frames = () if is_sure or spoilt else next_frames(found, halves)
    poses = () if spoilt - {"solution"} else next_robot_poses(found, halves)
    if isinstance(halves, NoRigHalves):
        return JudgedRig(verdict, criteria, no_halves=halves.reason, next_frames=frames, next_poses=poses)
    return JudgedRig(verdict, criteria, halves, next_frames=frames, next_poses=poses)


def rig_verdict(evidence: RigEvidence, criteria: Criteria) -> Verdict:
    """The worst of the checks that are known; "usable" at best if one of those that are needed could not be made."""
    checks = rig_checks(evidence, criteria)
    known = [check.grade for check in checks if check.grade != "unknown"]
    grade = max(known, key=WORSE.index) if known else "usable"
    missing = tuple(check for check in checks if check.grade == "unknown" and RIG_CHECKS[check.name].is_needed)
    if missing and grade == "good":
        grade = "usable"
    sentence, leads_with = _reason(evidence, checks, missing, grade)
    return Verdict(grade, OF_A_RIG, sentence, checks, _advice(evidence, criteria), leads_with)


def _reason(evidence: RigEvidence, checks: Sequence[Check], missing: Sequence[Check], grade: Grade) -> tuple[str, str]:
    """The main reason of a grade, and the check that it is the sentence of."""
    if grade == "good":
        return _why_good(evidence), ""
    faults = rig_faults(checks, grade)
    if not faults:
        return f"no fault was found, but not everything could be checked: {missing[0].sentence}", missing[0].name
    also = ", ".join(check.title.lower() for check in faults[1:])
    return faults[0].sentence + (f" (also: {also})" if also else ""), faults[0].name


def _why_good(evidence: RigEvidence) -> str:
    parts = []
    if evidence.pairs:
        worst = max(pair.relative.baseline_sigma_mm for pair in evidence.pairs)
        parts.append(f"the distances of the cameras are known to {figure(worst, 2)} mm or better")
    if evidence.middle is not None:
        parts.append(f"a point in the middle to {figure(evidence.middle.sigma_mm, 2)} mm")
    if evidence.carried is not None:
        parts.append(f"the target is placed to {figure(evidence.carried.sigma_mm, 2)} mm")
    parts.append("halves of the frames agree")
    return f"{', '.join(parts[:-1])}{',' if len(parts) > 2 else ''} and {parts[-1]}" if parts[1:] else parts[0]


def _advice(evidence: RigEvidence, criteria: Criteria) -> tuple[str, ...]:
    """What to do better, what would change the verdict first."""
    steps = []
    halves = evidence.halves
    if isinstance(halves, RigHalves) and halves.has_moved:
        steps.append(
            "fix the cameras, their focus and zoom, and take all frames again: the first frames give another rig than "
            "the last ones"
        )
    elif isinstance(halves, RigHalves) and halves.ratio > criteria["halves"].good:
        steps.append(
            "find what differs between the frames before taking more: cameras that are not taken at once while the "
            "target moves, a target that bends or is not as its file says, autofocus or image stabilisation"
        )
    loud = [one for one in evidence.cameras if one.rms_px > criteria["residuals"].good]
    if len(loud) == len(evidence.cameras) > 1 and not evidence.delay_px:
        steps.append(
            "look at what all cameras have in common, as each leaves over more than it should: photos that were not "
            "taken at once while the target moved (time stamps and --delays, or stop and go), or a target that is not "
            "as its file says"
        )
    elif loud:
        names = ", ".join(printable(one.name) for one in loud)
        steps.append(f"look at the photos of {names}: blur, motion, or a lens that the camera model does not fit")
    few = [tie for tie in evidence.ties if tie.joining_frames < criteria["frames"].good]
    if few:
        names = ", ".join(printable(evidence.names[tie.camera]) for tie in few)
        steps.append(
            f"take more frames in which these see the target together with another camera: {names}; "
            f"{criteria['frames'].good:g} or more"
        )
    return tuple(steps)
