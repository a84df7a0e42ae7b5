"""The quantities of one solution, against the drawing and against the target's true shape.

A calibration puts the made target where the drawing fits it best, so a rigid motion of the whole target changes
nothing but the frame. The true shape is therefore moved onto the drawing by least squares of the rings' distances,
each ring counting as often as it is seen (Kabsch 1976), and true poses are re-expressed in that frame.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.core.se3 import invert, make_pose, transform
from calib.core.types import KnownPoints
from calib.solver.metrics.errors import centers_mm as camera_centers_mm
from calib.solver.metrics.rotation import turns_of_views
from calib.studies.sample_metrics import Sample, sample_errors
from calib.studies.tolerance.anchor import AnchoredMinimum
from calib.studies.tolerance.map_error import map_error_px
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.setting import Setting
from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, centers_mm


@dataclass(frozen=True, eq=False)
class TrueShape:
    """R rings of a made target, moved onto the drawing."""

    center_mm: Array  # (R, 3)
    plane: Array  # (R, 4) unit normal n and offset d (mm) of the plane n X = d through each ring, parallel to its face
    moved_from_made: Array  # (4, 4) the motion


def true_shape(shape: MadeShape, weight: Array) -> TrueShape:
    """The true shape.

    Args:
        shape: of the made target, in its own frame.
        weight: how often each ring is seen (R,).
    """
    return moved_onto(centers_mm(shape), _normals(shape), shape.nominal.center_mm, weight)


def moved_onto(center_mm: Array, normal: Array, onto_mm: Array, weight: Array) -> TrueShape:
    """Rings (R, 3) with the normals of their faces (R, 3), moved onto others by least squares with weights (R,)."""
    share = weight[:, None] / weight.sum()
    middle, aim = (share * center_mm).sum(axis=0), (share * onto_mm).sum(axis=0)
    left, _, right = np.linalg.svd((share * (onto_mm - aim)).T @ (center_mm - middle))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    motion = make_pose(rotation, aim - rotation @ middle)
    center, turned = transform(motion, center_mm), normal @ rotation.T
    return TrueShape(center, np.column_stack([turned, (turned * center).sum(axis=1)]), motion)


def _normals(shape: MadeShape) -> Array:
    """Outward normals of the rings' faces after all errors; bow and warp do not turn them.  # (R, 3)"""
    frame = shape.nominal.target_from_face[:, :3, :3] @ shape.nominal_from_moved[:, :3, :3]
    stretch = shape.bed_axes.T @ shape.bed_affine @ shape.bed_axes
    axes = stretch @ frame[:, :, :2]
    normal = np.cross(axes[:, :, 0], axes[:, :, 1])
    unit: Array = (normal / np.linalg.norm(normal, axis=1, keepdims=True))[shape.nominal.ring_face]
    return unit


def measures(setting: Setting, found: AnchoredMinimum, measured_px: Array, true: TrueShape) -> Array:
    """All quantities (Q,), in the order of `QUANTITIES`; nan where one is not defined.

    Args:
        setting: what is photographed.
        found: the camera and poses that the drawing gave.
        measured_px: what was seen of the made target (2, M).
        true: its shape.
    """
    problem = replace(setting.anchor.problem, measured_px=measured_px)
    views = np.arange(problem.view_count)
    plain = Sample(setting.observations, problem, views, np.ones_like(views), found.camera, found.cam_from_target)
    drawn = sample_errors(plain, None, None if setting.options.weighted else found.cost)
    true_pose = setting.cam_from_target @ invert(true.moved_from_made)
    made = sample_errors(_against_true(plain, true), camera_centers_mm(true_pose), 0.0)
    focal, centre = _camera_errors(setting, found)
    return np.array([
        drawn.reprojection_px, drawn.intersection_mm, drawn.reconstruction_mm, made.intersection_mm,
        made.reconstruction_mm, made.pose_mm, _turn_deg(found.cam_from_target, true_pose), focal, centre,
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


def _turn_deg(cam_from_target: Array, true: Array) -> float:
    """Root mean square turn of the views after the turn they share."""
    if len(true) < 2:
        return math.nan
    angle = turns_of_views(cam_from_target[:, :3, :3], true[:, :3, :3])
    return math.degrees(math.sqrt(float((angle**2).sum(axis=1).mean())))


def _camera_errors(setting: Setting, found: AnchoredMinimum) -> tuple[float, float]:
    """Of the focal lengths and of the principal point, in px."""
    dfx, dfy, dcx, dcy = (found.camera.params[:4] - setting.reference.params[:4]).tolist()
    return math.sqrt(0.5 * (dfx * dfx + dfy * dfy)), math.hypot(dcx, dcy)
