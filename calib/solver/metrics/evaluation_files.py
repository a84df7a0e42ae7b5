"""`metrics.json` and CSV files of an evaluation: for other programs, and for looking closer."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.cameras import told_parameters
from calib.core.csv_table import ANY_NAME, csv_cell
from calib.solver.metrics.errors import Errors, ErrorSummary, summarise, summarise_groups
from calib.solver.metrics.evaluation import Evaluation
from designer.base.arrays import Array, Rows
from designer.base.file_kind import FileKind
from designer.base.marks import INLINE, LEFT_OUT, Count, Gap

METRICS_FILE = "metrics.json"
VIEWS_FILE, POINTS_FILE, FACES_FILE = "metrics_views.csv", "metrics_points.csv", "metrics_faces.csv"
OBSERVATIONS_FILE = "metrics_observations.csv"


@dataclass(frozen=True)
class FoundParameter:
    """One parameter of the camera."""

    value: float
    sigma: Gap
    unit: str
    fixed: bool
    true: Annotated[float | None, LEFT_OUT] = None  # of rendered photos


@dataclass(frozen=True)
class MetricSummary:
    """The summary of one metric's errors, and why others do not count."""

    unit: str
    errors: Annotated[ErrorSummary, INLINE]
    left_out: Mapping[str, Count] = field(default_factory=dict)


@dataclass(frozen=True)
class Metrics:
    """What `metrics.json` says beyond what a calibration tells: true values, and errors of poses."""

    model: str
    status: str
    views: Count
    observations: Count
    outliers: Count
    of: str
    parts: Count  # in how many the views were held out in turn; 0: they were not
    remarks: tuple[str, ...]
    parameters: Mapping[str, FoundParameter]
    metrics: Mapping[str, MetricSummary]
    on: Annotated[str, LEFT_OUT] = ""  # what the sightings are called if they are others than those solved from

    @property
    def is_of_others(self) -> bool:
        """Whether the errors are of views that the camera was not solved from."""
        return bool(self.parts or self.on)


METRICS = FileKind(Metrics, "metrics", "a metrics file", "calib evaluate writes it again", largest_bytes=2**20)

METRICS_FILES: Mapping[str, str] = {
    METRICS_FILE: METRICS.format, VIEWS_FILE: "image,reprojection_count", POINTS_FILE: "point,face",
    FACES_FILE: "face,reprojection_count", OBSERVATIONS_FILE: "image,point",
}  # fmt: skip
"""The files of an evaluation, and how each says what it is: by its format, or its first columns."""
_STATISTICS = (
    ("rmse", "rmse"), ("mean", "mean"), ("median", "median"), ("percentile_95", "p95"), ("largest", "largest"),
)  # fmt: skip


def evaluation_files(evaluation: Evaluation, folder: Path) -> dict[Path, bytes]:
    """The files of an evaluation and their contents."""
    seen = evaluation.calibration.observations
    points = seen.points
    images = [csv_cell(name) for name in seen.view_names]
    places = [
        f"{n},{face},{x:.6f},{y:.6f},{z:.6f}"
        for n, (face, (x, y, z)) in enumerate(zip(points.face.tolist(), points.position_mm.tolist(), strict=True))
    ]
    faces = [str(n) for n in range(len(points.plane))]
    views, by_view = _groups(evaluation, len(images), lambda errors: errors.view)
    rings, by_point = _groups(evaluation, len(places), lambda errors: errors.point)
    planes, by_face = _groups(
        evaluation, len(faces), lambda errors: None if errors.point is None else points.face[errors.point]
    )
    return {
        folder / METRICS_FILE: METRICS.text(metrics_of(evaluation)),
        folder / VIEWS_FILE: _csv(["image", *views], images, by_view),
        folder / POINTS_FILE: _csv(["point", "face", "X", "Y", "Z", *rings], places, by_point),
        folder / FACES_FILE: _csv(["face", *planes], faces, by_face),
        folder / OBSERVATIONS_FILE: _observations(evaluation, images),
    }


def metrics_of(evaluation: Evaluation) -> Metrics:
    """The summaries over everything, and the camera's parameters with their standard deviations."""
    calibration = evaluation.calibration
    return Metrics(
        model=calibration.camera.model,
        status=calibration.status,
        views=calibration.observations.view_count,
        observations=len(calibration.observations.view),
        outliers=int(calibration.is_outlier.sum()),
        of=_of(evaluation),
        parts=evaluation.folds,
        remarks=(*calibration.remarks, *evaluation.remarks),
        parameters=_parameters(evaluation),
        metrics={one.metric: MetricSummary(one.unit, summarise(one), dict(one.left_out)) for one in evaluation.errors},
        on=evaluation.on,
    )


def _of(evaluation: Evaluation) -> str:
    """Which views the errors are of."""
    if evaluation.on:
        return "views the camera was not solved from"
    return "views held out of the solution" if evaluation.folds else "the views the camera was solved from"


def _parameters(evaluation: Evaluation) -> dict[str, FoundParameter]:
    """Value and standard deviation of each parameter; the true value too if the true camera is of the same model."""
    calibration = evaluation.calibration
    camera, truth = calibration.camera, evaluation.truth
    known = truth.camera.parameters if truth is not None and truth.camera.model == camera.model else {}
    sigmas = np.sqrt(np.diagonal(calibration.stated_covariance)).tolist()
    return {
        one.name: FoundParameter(
            camera.parameters[one.name], sigma, one.unit, one.name in calibration.fixed, known.get(one.name)
        )
        for one, sigma in zip(told_parameters(camera.model), sigmas, strict=False)  # they come first
    }


def _groups(
    evaluation: Evaluation, count: int, group_of: Callable[[Errors], Rows | None]
) -> tuple[list[str], list[str]]:
    """Names of columns, and a row of cells for each group: statistics of each metric, and its mean vector."""
    names: list[str] = []
    columns: list[Iterable[str]] = []
    for errors in evaluation.errors:
        group = group_of(errors)
        if group is None:
            continue
        summaries = summarise_groups(errors, group, count)
        names.append(f"{errors.metric}_count")
        columns.append(str(summary.count) for summary in summaries)
        for statistic, name in _STATISTICS:
            names.append(f"{errors.metric}_{name}_{errors.unit}")
            columns.append(_cells(summaries, statistic))
        for axis, values in zip(errors.axes, _mean_vectors(errors, group, count).T, strict=True):
            names.append(f"{errors.metric}_mean_{axis}_{errors.unit}")
            columns.append(map(_cell, values.tolist()))
    return names, [",".join(cells) for cells in zip(*columns, strict=True)] if columns else [""] * count


def _cells(summaries: Sequence[ErrorSummary], statistic: str) -> list[str]:
    return [_cell(getattr(summary, statistic)) for summary in summaries]


def _cell(number: float) -> str:
    """A number, or nothing for nan."""
    return f"{number:.6g}" if math.isfinite(number) else ""


def _mean_vectors(errors: Errors, group: Rows, count: int) -> Array:
    """The mean error vector of each group: what is systematic in it.  # (count, D)"""
    rows = np.flatnonzero(errors.is_counted & (group >= 0))
    number = np.bincount(group[rows], minlength=count)
    sums = [np.bincount(group[rows], weights=values, minlength=count) for values in errors.vector[rows].T]
    mean: Array = np.stack(sums, axis=1) / np.where(number > 0, number, np.nan)[:, None]
    return mean


def _csv(columns: Sequence[str], heads: Sequence[str], rows: Sequence[str]) -> bytes:
    lines = (f"{head},{row}" for head, row in zip(heads, rows, strict=True))
    return "\n".join([",".join(columns), *lines, ""]).encode("utf-8", ANY_NAME)


def _observations(evaluation: Evaluation, images: Sequence[str]) -> bytes:
    """Error vectors of all sightings, also of those that do not count, and why they do not."""
    seen = evaluation.calibration.observations
    names = ["image", "point", "face", "u", "v"]
    columns: list[Iterable[str]] = [
        (images[row] for row in seen.view.tolist()),
        map(str, seen.point.tolist()),
        map(str, seen.points.face[seen.point].tolist()),
        *(map("{:.6f}".format, values) for values in seen.center_px.T.tolist()),
    ]
    for errors in evaluation.errors:
        if errors.sighting is None:
            continue
        names += [f"{errors.metric}_{axis}_{errors.unit}" for axis in errors.axes]
        names += [f"{errors.metric}_{errors.unit}", f"{errors.metric}_left_out"]
        vector, reason = _of_all(errors, len(seen.view))
        columns += [map(_cell, values) for values in vector.T.tolist()]
        columns += [map(_cell, np.sqrt((vector**2).sum(axis=1)).tolist()), reason]
    lines = map(",".join, zip(*columns, strict=True))
    return "\n".join([",".join(names), *lines, ""]).encode("utf-8", ANY_NAME)


def _of_all(errors: Errors, count: int) -> tuple[Array, list[str]]:
    """The errors of all of a calibration's sightings, and why they do not count: those without a pose have none."""
    vector, row = np.full((count, len(errors.axes)), np.nan), np.full(count, len(errors.reasons))
    vector[errors.sighting], row[errors.sighting] = errors.vector, errors.reason
    return vector, [(*errors.reasons, "its view has no pose")[n] for n in row.tolist()]
