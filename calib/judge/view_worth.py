"""What a view would add to what is known: its information on the camera, and the part of the image it shows first.

A view is worth what it takes off the deviation that 95 % of the image stays within, as a part of what the proposed view
would take off; where the part of the image that is covered is to grow, as a part of that growth.
"""

from dataclasses import dataclass, replace

import numpy as np

from calib.core.linear_algebra import covariance_with_prior
from calib.judge.candidate_views import shown_in
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
