"""What a view would add to what is known: its information on the camera, and the part of the image it shows first.

A view is worth what it takes off the deviation that 95 % of the image stays within, as a part of what the proposed view
would take off; where the part of the image that is covered is to grow, as a part of that growth.

Where to hold a target while nothing is known of the camera: so that a first few photos tell it.

A solid shows planes at many slants at once. Of a board each photo tells two numbers of a camera, if it is tilted, and
those that are tilted to the same side tell the same two.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import COMMON, project
from calib.cameras.camera import Camera
from calib.cameras.refit import plain_camera
from calib.core.linear_algebra import covariance_with_prior
from calib.core.se3 import exp_rotation, make_pose, transform
from calib.judge.candidate_views import faces_seen, shown_in, tilt_rotation
from calib.judge.coverage import Coverage, coverage
from calib.judge.information import Knowledge, image_change, knowledge_of, sigma_px, view_information
from calib.judge.next_views import NextView
from calib.judge.views import TargetShape, habits_of
from calib.solver.accuracy import SHARE_PERCENT
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Rows

COARSE_MAP = (16, 12)
MOST_POINTS = 300
"""Of a view, that its worth is told by."""
LITTLE = 1e-3
"""Of the deviation, or of the image: a proposal that gains less is no measure of others."""


@dataclass(frozen=True, eq=False)
class ViewGains:
    """What views are measured against."""

    known: Knowledge
    change: Array  # (N, 2, Q) how what is known moves a coarse map
    position_mm: Array  # (K, 3) of the target
    face: Rows  # (K,)
    covered: Coverage
    sigma_px: float  # that 95 % of the map stays within now
    by_accuracy: float  # what the proposal takes off that; 0: it is for the area
    by_area: float  # of the image, that the proposal shows first; 0: it is for accuracy


def gains_of(
    calibration: Calibration, shape: TargetShape, covered: Coverage, view: NextView, *, is_for_accuracy: bool
) -> ViewGains:
    """What views of a calibration's target are measured against, with one that is proposed."""
    known, points = knowledge_of(calibration), calibration.observations.points
    change = image_change(known, *COARSE_MAP)
    before = _within_px(change, np.eye(change.shape[2]))
    none = ViewGains(known, change, points.position_mm, points.face, covered, before, 0.0, 0.0)
    pose, every = view.cam_from_target, np.arange(len(shape.face))
    shown = shown_in(known.camera, shape, habits_of(calibration, shape), pose[None], every)
    rows, pixel = np.flatnonzero(points.face >= 0)[shown.is_read[0]], shown.pixel[0, shown.is_read[0]]
    if is_for_accuracy:
        return replace(none, by_accuracy=_accuracy(none, pose, rows))
    return replace(none, by_area=_area(none, rows, pixel))


def worth_of(gains: ViewGains, pose: Array, rows: Rows, pixel: Array) -> float:
    """What a view is worth of the proposal, 0 to 1.

    Args:
        gains: what it is measured against.
        pose: of the view (4, 4).
        rows: of the points it shows (N,).
        pixel: where (N, 2).
    """
    if gains.by_accuracy > LITTLE * gains.sigma_px:
        return min(_accuracy(gains, pose, rows) / gains.by_accuracy, 1.0)
    return min(_area(gains, rows, pixel) / gains.by_area, 1.0) if gains.by_area > LITTLE else 0.0


def _accuracy(gains: ViewGains, pose: Array, rows: Rows) -> float:
    """What a view takes off the deviation (px)."""
    some = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
    if not len(some):
        return 0.0
    weight = np.full((1, len(some)), len(rows) / len(some))
    told = view_information(gains.known, pose[None], gains.position_mm[some], weight)[0]
    return max(gains.sigma_px - _within_px(gains.change, covariance_with_prior(told)), 0.0)


def _area(gains: ViewGains, rows: Rows, pixel: Array) -> float:
    """Of the image, what a view shows first."""
    face, covered = gains.face[rows], gains.covered
    shown = coverage(covered.image_size, pixel, np.zeros(len(rows), dtype=np.int64), face).is_covered
    return covered.share_of(shown & ~covered.is_covered)


def _within_px(change: Array, covariance: Array) -> float:
    return float(np.percentile(sigma_px(change, covariance), SHARE_PERCENT)) if len(change) else 0.0


USUAL_FOCAL = 0.9
"""Focal length over the image's longer side of most cameras with an ordinary lens: 58 degrees from side to side. That
of a webcam or a telephone is from .7 to 1, that of a machine-vision camera from .8 to 2."""
FILLS = 0.7
"""Of the image, in the direction that a target fills more of."""
TILT_DEG = 30.0
TO_SIDES = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0))
"""Sides of a board to be held away, right and down, one photo after the other."""
TILTED_BY_DEG = 12.0
OTHERWISE_DEG = 20.0
"""Photos of a board that are turned by so much tell other numbers."""
NEW = 0.6
"""Of that: a view is told from those taken."""
SIZING_STEPS = 4


def guessed_camera(image_size: tuple[int, int], guess: Camera | None) -> Camera:
    """The camera by which a first proposal is drawn: the one given, if it has the images' size, or a usual one."""
    if guess is not None and guess.image_size == image_size:
        return guess
    return plain_camera(COMMON, image_size, USUAL_FOCAL * max(image_size))


def first_pose(camera: Camera, shape: TargetShape, taken: Array) -> Array:
    """Where to hold a target for one of the first photos, otherwise than in those taken (V, 4, 4).  # (4, 4)"""
    for number in range(len(TO_SIDES)):
        pose = _turned_pose(camera, shape, number)
        if novelty(shape, pose, taken) > NEW:
            return pose
    return _turned_pose(camera, shape, len(taken))


def _turned_pose(camera: Camera, shape: TargetShape, number: int) -> Array:
    if shape.is_flat:
        facing = np.stack([shape.axes[0], shape.axes[1], -shape.axes[2]])
        turn = tilt_rotation(math.radians(TILT_DEG), np.array(TO_SIDES[number % len(TO_SIDES)])) @ facing
    else:
        turn = exp_rotation(np.array([0.6 + 0.7 * number, 0.4 + 0.9 * number, 0.0]))
    extent = float(np.ptp(shape.position_mm, axis=0).max())
    distance = extent * float(camera.params[0]) / max(camera.image_size)
    pose = _ahead(shape, turn, distance)
    for _ in range(SIZING_STEPS):
        distance = max(distance * _filled(camera, shape, pose) / FILLS, 0.7 * extent)
        pose = _ahead(shape, turn, distance)
    return pose


def _ahead(shape: TargetShape, turn: Array, distance_mm: float) -> Array:
    """The pose in the middle of the image."""
    return make_pose(turn, np.array([0.0, 0.0, distance_mm]) - turn @ shape.center_mm)


def _filled(camera: Camera, shape: TargetShape, pose: Array) -> float:
    """Of the image's width or height, what the target fills of the one that it fills more of."""
    seen = faces_seen(shape, pose[None])[0][0]
    pixel = project(camera, transform(pose, shape.position_mm[seen[shape.face]]))
    pixel = pixel[np.isfinite(pixel).all(axis=1)]
    return float((np.ptp(pixel, axis=0) / camera.image_size).max()) if len(pixel) > 1 else FILLS


def novelty(shape: TargetShape, pose: Array, taken: Array) -> float:
    """What a view tells that the photos taken (V, 4, 4) do not, by how it is turned: 0 to 1.

    Args:
        shape: the target.
        pose: of the view (4, 4), by a guessed camera.
        taken: of the photos, by the same.
    """
    turn = pose[:3, :3]
    if shape.is_flat:
        normal = turn @ shape.axes[2]
        enough = min(math.degrees(math.acos(min(max(-float(normal[2]), -1.0), 1.0))) / TILTED_BY_DEG, 1.0)
        cosine = (taken[:, :3, :3] @ shape.axes[2]) @ normal
    else:
        enough = 1.0
        cosine = 0.5 * (np.trace(taken[:, :3, :3].transpose(0, 2, 1) @ turn, axis1=1, axis2=2) - 1)
    nearest = np.degrees(np.arccos(np.clip(cosine.max(initial=-1.0), -1.0, 1.0)))
    return enough * min(float(nearest) / OTHERWISE_DEG, 1.0)
