"""What a frame would add to what is known, as a part of what the proposed view would; and where the first photos help.

Where the part of the image that is covered is to grow, it is a part of that growth. While nothing is known of the
camera, a few photos are to tell it: a solid shows planes at many slants at once; of a board each photo tells two
numbers of a camera, if it is tilted, and those that are tilted to the same side tell the same two.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import COMMON, project
from calib.cameras.camera import Camera
from calib.cameras.refit import plain_camera
from calib.core.linear_algebra import covariance_with_prior
from calib.core.se3 import make_pose, transform
from calib.core.types import KnownPoints
from calib.judge.candidate_views import faces_seen, shown_in, side_turn, tilt_rotation
from calib.judge.coverage import Coverage, area_of
from calib.judge.information import Knowledge, image_change, knowledge_of, sigma_px, view_information
from calib.judge.next_views import NextView
from calib.judge.view_search import COARSE_MAP
from calib.judge.views import TargetShape, habits_of
from calib.solver.accuracy import SHARE_PERCENT
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Rows

MOST_POINTS = 300
"""Of a view, that its worth is told by."""
LITTLE = 1e-3
"""Of the deviation, or of the image: a proposal that gains less is no measure of others."""


@dataclass(frozen=True, eq=False)
class ViewGains:
    """What views are measured against, and what they are worth of the view that is proposed."""

    known: Knowledge
    coarse: Array  # (N, 2, Q) how what is known moves a coarse map
    points: KnownPoints  # of the target
    covered: Coverage
    is_for_accuracy: bool  # else the proposal is to show a part of the image first
    sigma_px: float = 0.0  # that 95 % of the map stays within now
    proposed: float = 0.0  # what the proposal gains: px off that, or a part of the image

    def worth(self, pose: Array, rows: Rows, pixel: Array) -> float:
        """What a view is worth of the proposal, 0 to 1.

        Args:
            pose: of the view (4, 4).
            rows: of the points it shows (N,).
            pixel: where (N, 2).
        """
        is_measure = self.proposed > LITTLE * (self.sigma_px if self.is_for_accuracy else 1.0)
        return min(self.gain(pose, rows, pixel) / self.proposed, 1.0) if is_measure else 0.0

    def gain(self, pose: Array, rows: Rows, pixel: Array) -> float:
        """What a view takes off the deviation (px), or of the image what it shows first."""
        if not self.is_for_accuracy:
            shown = area_of(self.covered.image_size, pixel, self.points.face[rows])
            return self.covered.share_of(shown & ~self.covered.is_covered)
        some = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
        if not len(some):
            return 0.0
        weight = np.full((1, len(some)), len(rows) / len(some))
        told = view_information(self.known, pose[None], self.points.position_mm[some], weight)[0]
        return max(self.sigma_px - self.within_px(covariance_with_prior(told)), 0.0)

    def within_px(self, covariance: Array) -> float:
        """What 95 % of the map stays within, by a covariance of q (Q, Q)."""
        return float(np.percentile(sigma_px(self.coarse, covariance), SHARE_PERCENT)) if len(self.coarse) else 0.0


def gains_of(
    calibration: Calibration, shape: TargetShape, covered: Coverage, view: NextView, *, is_for_accuracy: bool
) -> ViewGains:
    """What views of a calibration's target are measured against, with one that is proposed."""
    known, points = knowledge_of(calibration), calibration.observations.points
    gains = ViewGains(known, image_change(known, *COARSE_MAP), points, covered, is_for_accuracy)
    gains = replace(gains, sigma_px=gains.within_px(np.eye(known.basis.shape[1])))
    pose, every = view.cam_from_target, np.arange(len(shape.face))
    shown = shown_in(known.camera, shape, habits_of(calibration, shape), pose[None], every)
    rows, pixel = np.flatnonzero(points.face >= 0)[shown.is_read[0]], shown.pixel[0, shown.is_read[0]]
    return replace(gains, proposed=gains.gain(pose, rows, pixel))


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
    turn = side_turn(number)
    if shape.is_flat:
        turn = tilt_rotation(math.radians(TILT_DEG), np.array(TO_SIDES[number % len(TO_SIDES)])) @ shape.level
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
