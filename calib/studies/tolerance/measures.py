"""The quantities of one solution."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import invert, log_rotation
from calib.core.types import KnownPoints
from calib.metrics.prediction import centers_mm
from calib.studies.sample_metrics import Sample, sample_errors
from calib.studies.tolerance.anchor import AnchoredMinimum
from calib.studies.tolerance.map_error import map_error_px
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.setting import Setting
from calib.studies.tolerance.true_shape import TrueShape

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MadeSolution:
    """What was seen of a made target, and the camera and poses that the drawing gave."""

    found: AnchoredMinimum
    measured_px: Array  # (2, M)
    true: TrueShape


def measures(setting: Setting, solution: MadeSolution) -> Array:
    """All quantities (Q,), in the order of `QUANTITIES`; nan where one is not defined."""
    anchor, found, true = setting.anchor, solution.found, solution.true
    problem = replace(anchor.problem, measured_px=solution.measured_px)
    views = np.arange(problem.view_count)
    plain = Sample(setting.observations, problem, views, np.ones_like(views), found.camera, found.cam_from_target)
    drawn = sample_errors(plain, None, None if setting.options.weighted else found.cost)
    true_pose = setting.cam_from_target @ invert(true.moved_from_made)
    made = sample_errors(_against_true(plain, true), centers_mm(true_pose), 0.0)
    focal, centre = _camera_errors(setting, found)
    return np.array([
        drawn.reprojection_px, drawn.intersection_mm, drawn.reconstruction_mm, made.intersection_mm,
        made.reconstruction_mm, made.pose_mm, _rotation_deg(found.cam_from_target, true_pose), focal, centre,
        map_error_px(setting.grid, found.camera),
    ])  # fmt: skip


NONE: Array = np.full(len(QUANTITIES), np.nan)
"""Of a case without a solution."""


def _against_true(sample: Sample, true: TrueShape) -> Sample:
    """The sample with the rings where they truly are, each on a plane of its own."""
    points = KnownPoints(true.center_mm, np.arange(len(true.plane)), true.plane)
    position = (true.center_mm - sample.problem.origin_mm)[sample.observations.point].T
    return replace(
        sample,
        observations=replace(sample.observations, points=points),
        problem=replace(sample.problem, position_mm=np.ascontiguousarray(position)),
    )


def _rotation_deg(cam_from_target: Array, true: Array) -> float:
    """Root mean square turn of the views after the turn they share, as `calib.metrics.rotation`."""
    if len(true) < 2:
        return math.nan
    turn = cam_from_target[:, :3, :3] @ true[:, :3, :3].transpose(0, 2, 1)
    left, _, right = np.linalg.svd(turn.sum(axis=0))
    common = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    angle = log_rotation(common.T @ turn)
    return math.degrees(math.sqrt(float((angle**2).sum(axis=1).mean())))


def _camera_errors(setting: Setting, found: AnchoredMinimum) -> tuple[float, float]:
    """Of the focal lengths and of the principal point, in px."""
    dfx, dfy, dcx, dcy = (found.camera.params[:4] - setting.reference.params[:4]).tolist()
    return math.sqrt(0.5 * (dfx * dfx + dfy * dfy)), math.hypot(dcx, dcy)
