"""What a camera predicts of its observations, the errors of one metric, and what is said of many of them.

Only `calib.cameras.rays`, `calib.cameras.project` and the poses enter, so every camera model has every metric.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import relinear
from calib.core.types import freeze
from calib.solver.calibration import Calibration
from designer.base.arrays import Array, Flags, Rows
from designer.base.marks import Count, Gap

COUNTED = ""
"""The reason of an error that is not left out."""
OUTLIER = "outlier"


@dataclass(frozen=True, eq=False)
class Errors:
    """N error vectors of D components, and why some of them do not count."""

    metric: str
    subject: str  # what one error is of
    unit: str
    axes: tuple[str, ...]  # (D,) names of the components
    vector: Array  # (N, D) nan where there is none
    reason: Rows  # (N,) row of `reasons`
    reasons: tuple[str, ...]  # why an error is left out of summaries; the first is COUNTED
    view: Rows | None = None  # (N,) None: an error is of no single view
    point: Rows | None = None  # (N,) None: of no single point
    sighting: Rows | None = None  # (N,) row of the observations; None: of no single one

    def __post_init__(self) -> None:
        freeze(self, "vector")
        freeze(self, "reason", "view", "point", "sighting", dtype=np.int64)

    @cached_property
    def size(self) -> Array:
        """Euclidean norms.  # (N,)"""
        size: Array = np.sqrt(np.einsum("nd,nd->n", self.vector, self.vector))
        return size

    @property
    def is_counted(self) -> Flags:
        """Which errors enter summaries.  # (N,)"""
        counted: Flags = self.reason == 0
        return counted

    @property
    def left_out(self) -> tuple[tuple[str, int], ...]:
        """Why errors do not count, and how many."""
        counts = np.bincount(self.reason, minlength=len(self.reasons))
        return tuple((reason, int(n)) for reason, n in zip(self.reasons[1:], counts[1:].tolist(), strict=True) if n)


def is_known(vector: Array) -> Flags:
    """Which vectors are finite numbers.  # (N, D) -> (N,)"""
    known: Flags = np.isfinite(vector.sum(axis=1))
    return known


def first_reason(count: int, *faults: tuple[str, Flags]) -> tuple[Rows, tuple[str, ...]]:
    """The first fault of each of `count` errors: its row in the reasons, and the reasons with COUNTED first."""
    rows = np.zeros(count, dtype=np.int64)
    for row, (_, is_faulty) in reversed(list(enumerate(faults, start=1))):
        rows[is_faulty] = row
    return rows, (COUNTED, *(reason for reason, _ in faults))


@dataclass(frozen=True)
class ErrorSummary:
    """What is said of `count` errors; nan if there are none."""

    count: Count
    rmse: Gap
    """Root of the mean squared Euclidean norm, as in the paper."""
    mean: Gap  # of the norms, as the others
    median: Gap
    percentile_95: Gap
    largest: Gap


def summarise(errors: Errors) -> ErrorSummary:
    """The summary of all errors that count."""
    return summarise_groups(errors, np.zeros(len(errors.reason), dtype=np.int64), 1)[0]


def summarise_groups(errors: Errors, group: Rows, group_count: int) -> tuple[ErrorSummary, ...]:
    """The summary of each group, numbered from 0, of errors (N,); -1: in none."""
    rows = np.flatnonzero(errors.is_counted & (group >= 0))
    size, group = errors.size[rows], group[rows]
    count = np.bincount(group, minlength=group_count)
    total = np.bincount(group, weights=size, minlength=group_count)
    square = np.bincount(group, weights=size**2, minlength=group_count)
    ascending = np.split(size[np.lexsort((size, group))], np.cumsum(count)[:-1])
    return tuple(map(_summary, ascending, total.tolist(), square.tolist()))


def _summary(ascending: Array, total: float, square: float) -> ErrorSummary:
    """The summary of sorted errors with their sum and the sum of their squares."""
    count = len(ascending)
    if not count:
        return ErrorSummary(0, *[math.nan] * 5)
    median, percentile_95 = _quantile(ascending, 0.5), _quantile(ascending, 0.95)
    return ErrorSummary(count, math.sqrt(square / count), total / count, median, percentile_95, float(ascending[-1]))


def _quantile(ascending: Array, share: float) -> float:
    """Linear between the nearest two of sorted values, as numpy's default."""
    place = share * (len(ascending) - 1)
    below = int(place)
    above = min(below + 1, len(ascending) - 1)
    return float(ascending[below] + (place - below) * (ascending[above] - ascending[below]))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Pixels and rays of M observations in V views, the rays in the target's frame."""

    calibration: Calibration
    position_mm: Array  # (M, 3) where the observed point is
    predicted_px: Array  # (M, 2) where it should be seen; nan where the camera model has no pixel
    center_mm: Array  # (V, 3) of the cameras, where their rays begin
    direction: Array  # (M, 3) unit vectors of the rays; nan where the camera model has none
    true_cam_from_target: Array | None = None  # (V, 4, 4) if known; nan for views of which it is not

    def __post_init__(self) -> None:
        freeze(self, "position_mm", "predicted_px", "center_mm", "direction", "true_cam_from_target")


def predict(calibration: Calibration, true_cam_from_target: Array | None = None) -> Prediction:
    """The prediction of a calibration; true poses (V, 4, 4) are nan where they are not known."""
    seen = calibration.observations
    position = seen.points.position_mm[seen.point]
    rotation, shift = calibration.cam_from_target[:, :3, :3], calibration.cam_from_target[:, :3, 3]
    in_camera = np.einsum("mij,mj->mi", rotation[seen.view], position) + shift[seen.view]
    camera, measured, predicted = calibration.camera, seen.center_px, project(calibration.camera, in_camera)
    if calibration.linear is not None:  # of each photo's own
        own = calibration.linear[seen.view]
        measured, predicted = (
            relinear(measured, own, camera.params[:4]), relinear(predicted, camera.params[:4], own)
        )  # fmt: skip
    ray = rays(camera, measured)
    return Prediction(
        calibration,
        position,
        predicted,
        centers_mm(calibration.cam_from_target),
        np.einsum("mji,mj->mi", rotation[seen.view], ray),
        true_cam_from_target,
    )


def centers_mm(cam_from_target: Array) -> Array:
    """Where cameras (V, 4, 4) stand in the target's frame.  # (V, 3)"""
    center: Array = -np.einsum("vji,vj->vi", cam_from_target[:, :3, :3], cam_from_target[:, :3, 3])
    return center


@dataclass(frozen=True)
class ErrorMetric:
    """A metric, as its file holds it."""

    name: str
    errors_of: Callable[[Prediction], Errors | None]  # None: what it compares with is not known
    needs_truth: bool = False  # which is known of rendered photos only
