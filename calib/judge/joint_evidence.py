"""What is measured of cameras in space before anything is judged: of several, or of one that something moved."""

import math
from dataclasses import replace

import numpy as np

from calib.cameras import project
from calib.core.se3 import transform
from calib.judge.coverage import coverage_of
from calib.judge.evidence import ByCircles, CameraEvidence, JointEvidence
from calib.judge.halves import NoHalves, RigHalves
from calib.judge.rig_halves import enlarged
from calib.rigs.figures import pair_figures, rms_length, ties_of
from calib.rigs.relative import carried_error, middle_error
from calib.rigs.result import RigCalibration


def joint_evidence(found: RigCalibration, halves: RigHalves | NoHalves) -> JointEvidence:
    """What a rig and halves of its frames tell."""
    told = enlarged(found, halves)
    seen = found.observations
    return JointEvidence(
        status=found.status,
        status_reason=found.remarks[0] if found.remarks else "",
        frames=len(found.rig_from_target),
        cameras=tuple(_camera(found, row) for row in range(len(found.cameras))),
        pairs=pair_figures(told),
        ties=ties_of(told.rig, seen.shared),
        halves=halves,
        middle=middle_error(told) if found.status != "degenerate" else None,
        carrier=found.carrier,
        carried=carried_error(enlarged(found, halves, as_target=True)) if found.status != "degenerate" else None,
        delay_px=_delay_px(told),
        by_circles=_by_circles(found),
    )


def _camera(found: RigCalibration, row: int) -> CameraEvidence:
    seen, out = found.observations.sightings[row], found.is_outlier[row]
    return CameraEvidence(
        name=found.observations.camera_names[row],
        frames=seen.view_count,
        sightings=int((~out).sum()),
        left_out=int(out.sum()),
        rms_px=rms_length(found.residual_px[row][~out]),
        times_stated=float(found.scale[row]) if found.weighted and seen.cov_px2 is not None else None,
        coverage=coverage_of(found.alone[row]) if found.is_refined[row] else None,
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
