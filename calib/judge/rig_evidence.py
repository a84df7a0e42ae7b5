"""What is known of a solved rig when it is judged."""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import project
from calib.core.se3 import transform
from calib.judge.coverage import Coverage, coverage_of
from calib.rigs.figures import CameraFigures, CameraTie, PairFigures, camera_figures, pair_figures, ties_of
from calib.rigs.halves import NoRigHalves, RigHalves, enlarged
from calib.rigs.relative import CarriedError, MiddleError, carried_error, middle_error
from calib.rigs.result import CarrierFit, RigCalibration, camera_alone
from calib.solver.calibration import CircleDoubt, Status


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
    halves: RigHalves | NoRigHalves
    middle: MiddleError | None  # None: no two cameras see the middle
    carrier: CarrierFit | None  # what carried the cameras or the target; None: nothing that says how
    carried: CarriedError | None  # None: no such, or more cameras than one
    delay_px: tuple[float, ...]  # (C,) what the delays' standard deviations move a sighting by; (): no delays
    by_circles: ByCircles | None = None  # None: what the points are is known

    @property
    def factor(self) -> float:
        """What the noise's part of standard deviations is to be multiplied with."""
        return self.halves.factor if isinstance(self.halves, RigHalves) else 1.0


def rig_evidence(found: RigCalibration, halves: RigHalves | NoRigHalves) -> RigEvidence:
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
