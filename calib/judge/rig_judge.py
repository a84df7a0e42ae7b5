"""What is known of a solved rig, and the verdict on it."""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.cameras import project
from calib.core.se3 import transform
from calib.judge.checks import applied
from calib.judge.coverage import Coverage, coverage_of
from calib.judge.halves import NoHalves
from calib.judge.judge import judge
from calib.judge.next_frames import NextFrame, next_frames
from calib.judge.next_robot_poses import MOST_POSES, NextPose, next_robot_poses
from calib.judge.rig_halves import RigHalves, enlarged
from calib.judge.verdict import Criteria, Verdict
from calib.rigs.figures import CameraFigures, CameraTie, PairFigures, camera_figures, pair_figures, ties_of
from calib.rigs.relative import CarriedError, MiddleError, carried_error, middle_error
from calib.rigs.result import CarrierFit, RigCalibration, camera_alone
from calib.solver.calibration import CircleDoubt, Status
from designer.base.file_kind import FileKind
from designer.base.marks import LEFT_OUT, Hash, Length, Line
from designer.base.words import printable


@dataclass(frozen=True)
class ByCircles:
    """What a place in space may be off as nobody said what the points are."""

    doubt: CircleDoubt
    sigma_mm: float
    noise_mm: float  # by the noise alone
    away_mm: float  # from the camera


@dataclass(frozen=True, eq=False)
class RigEvidence:
    """Of a rig of C cameras, all that its checks look at; deviations enlarged as halves of the frames tell."""

    status: Status
    status_reason: str
    names: tuple[str, ...]  # (C,)
    frames: int
    cameras: tuple[CameraFigures, ...]  # (C,)
    pairs: tuple[PairFigures, ...]
    ties: tuple[CameraTie, ...]  # (C,) or none
    coverages: tuple[Coverage | None, ...]  # (C,) None: its lens was given
    halves: RigHalves | NoHalves
    middle: MiddleError | None  # None: no two cameras see the middle
    carrier: CarrierFit | None  # what carried the cameras or the target; None: nothing that says how
    carried: CarriedError | None  # None: no such, or more cameras than one
    delay_px: tuple[float, ...]  # (C,) what the delays' standard deviations move a sighting by; (): no delays
    by_circles: ByCircles | None = None  # None: what the points are is known


def rig_evidence(found: RigCalibration, halves: RigHalves | NoHalves) -> RigEvidence:
    """What a rig and halves of its frames tell."""
    told = enlarged(found, halves)
    return RigEvidence(
        status=found.status,
        status_reason=found.remarks[0] if found.remarks else "",
        names=found.observations.camera_names,
        frames=len(found.rig_from_target),
        cameras=camera_figures(found),
        pairs=pair_figures(told),
        ties=ties_of(told.rig, found.observations.shared),
        coverages=tuple(
            coverage_of(camera_alone(found, row)) if found.is_refined[row] else None
            for row in range(len(found.cameras))
        ),
        halves=halves,
        middle=middle_error(told) if found.status != "degenerate" else None,
        carrier=found.carrier,
        carried=carried_error(enlarged(found, halves, as_target=True)) if found.status != "degenerate" else None,
        delay_px=_delay_px(told),
        by_circles=_by_circles(found),
    )


def _by_circles(found: RigCalibration) -> ByCircles | None:
    """The error of the carried target, or of a point in the middle, by that doubt and by noise."""
    doubt = found.circle_doubt
    if doubt is None or found.status == "degenerate":
        return None
    sigmas = []
    for covariance in (doubt.param_covariance, found.covariance):
        one = replace(found, covariance=covariance, target_covariance=None, circle_doubt=None)
        carried, middle = carried_error(one), middle_error(one)
        if carried is not None:
            away_mm, sigma_mm = carried.away_mm, carried.sigma_mm
        elif middle is not None:
            away_mm, sigma_mm = middle.away_mm, middle.rig_mm
        else:
            return None
        sigmas.append(sigma_mm)
    return ByCircles(doubt, sigmas[0], sigmas[1], away_mm)


def _delay_px(found: RigCalibration) -> tuple[float, ...]:
    """Standard deviations of delays times how fast the target moved through each image, its median speed."""
    seen = found.observations
    if found.delay_sigma_s is None or seen.time_s is None:
        return ()
    moved = []
    for row, (camera, sigma) in enumerate(zip(found.cameras, found.delay_sigma_s.tolist(), strict=True)):
        place = transform(found.cam_from_rig[row] @ found.rig_from_target[seen.frame[row]], seen.points.middle_mm)
        step = np.linalg.norm(np.diff(project(camera, place), axis=0), axis=1)
        time = np.diff(seen.time_s[row])
        speed = step[time > 0] / time[time > 0]
        known = speed[np.isfinite(speed)]
        moved.append(sigma * float(np.median(known)) if len(known) else math.nan)
    return tuple(moved)


MENDED_BY_FRAMES = ("frames", "baselines", "space", "halves")
"""Checks that more frames may make good."""
SPOILT = ("solution", "carrier", "residuals", "halves")
"""Checks that more frames like these mend in no way; a robot's next poses may mend what its poses so far leave open."""
NOT_COMPARED = NoHalves("halves of the frames were not compared")


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
    def compared(self) -> RigHalves | NoHalves:
        """The halves, or why there are none."""
        return self.halves or (NoHalves(self.no_halves) if self.no_halves else NOT_COMPARED)


RIG_VERDICT_FILE = "rig_verdict.json"
RIG_VERDICT = FileKind(JudgedRig, "rig_verdict", "a rig_verdict.json", "solve the rig again", largest_bytes=16 * 2**20)


def judge_rig(found: RigCalibration, halves: RigHalves | NoHalves, criteria: Criteria) -> JudgedRig:
    """Judge a solved rig; nothing is solved.

    Args:
        found: the rig.
        halves: of its frames, by `calib.judge.rig_halves.rig_halves`.
        criteria: the limits.
    """
    evidence = rig_evidence(found, halves)
    verdict = rig_verdict(evidence, criteria)
    spoilt = {check.name for check in verdict.checks if check.grade == "bad" and check.name in SPOILT}
    is_sure = all(check.grade == "good" for check in verdict.checks if check.name in MENDED_BY_FRAMES)
    frames = () if is_sure or spoilt else next_frames(found, halves)
    poses = () if spoilt - {"solution"} else next_robot_poses(found, halves)
    kept, reason = (None, halves.reason) if isinstance(halves, NoHalves) else (halves, "")
    return JudgedRig(verdict, applied(criteria, evidence), kept, reason, frames, poses)


def rig_verdict(evidence: RigEvidence, criteria: Criteria) -> Verdict:
    """The verdict with what to do better, what would change it first."""
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
    return judge(evidence, criteria, steps)
