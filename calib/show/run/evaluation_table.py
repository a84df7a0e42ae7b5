"""An evaluation on the screen."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from rich.table import Table
from rich.text import Text

from calib.cameras import MODELS
from calib.core.number_text import figure, with_digits
from calib.metrics.errors import Errors, ErrorSummary, summarise
from calib.metrics.evaluation import Evaluation, by_face, by_point, by_view
from calib.solver.calibration import Calibration
from designer.base.words import printable

WORST = 5
OF_ITS_OWN_SENSOR = (
    "fx of the virtual camera is left out: it belongs to the sensor that its map leads to, not to the photos"
)
LEAST_SIGHTINGS = 3
"""Of a ring that is called bad: the largest of thousands of single errors is always large."""
_STATISTICS = (("RMSE", "rmse"), ("mean", "mean"), ("median", "median"), ("95 %", "percentile_95"), ("max", "largest"))


def metrics_table(evaluation: Evaluation) -> Table:
    """A line a metric."""
    table = _table("error", "unit", "of", left=("error", "unit", "of"))
    for name in ("n", *(title for title, _ in _STATISTICS)):
        table.add_column(name, justify="right")
    for errors in evaluation.errors:
        summary = summarise(errors)
        cells = [figure(getattr(summary, field)) for _, field in _STATISTICS]
        table.add_row(errors.metric, errors.unit, errors.subject, str(summary.count), *cells)
    return table


def parameters_table(evaluation: Evaluation) -> Table:
    """A line a parameter, with its standard deviation and the truth if that is of the same model."""
    calibration, truth = evaluation.calibration, evaluation.truth
    camera = calibration.camera
    known = None if truth is None or truth.camera.model != camera.model else truth.camera.params
    table = _table("parameter", "value", "sigma", "unit", left=("parameter", "unit"))
    if known is not None:
        table.add_column("true", justify="right")
        table.add_column("off by", justify="right")
    sigmas = np.sqrt(np.diagonal(calibration.stated_covariance)).tolist()
    for n, (parameter, sigma) in enumerate(zip(MODELS[camera.model].parameters, sigmas, strict=True)):
        value, is_fixed = float(camera.params[n]), parameter.name in calibration.fixed
        unit = "" if parameter.unit == "1" else parameter.unit
        row = [parameter.name, with_digits(value, sigma), "fixed" if is_fixed else figure(sigma, 2), unit]
        if known is not None:
            difference = value - float(known[n])
            row += [with_digits(float(known[n]), sigma), _in_sigmas(difference, sigma)]
        table.add_row(*row)
    return table


def _in_sigmas(difference: float, sigma: float) -> str:
    return f"{difference / sigma:+.1f} sigma" if sigma > 0 else figure(difference, 2)


def worst_views_table(evaluation: Evaluation) -> Table:
    """The views with the largest reprojection errors."""
    names = [printable(name) for name in
             evaluation.calibration.observations.view_names]  # fmt: skip
    return _worst_table(evaluation, "worst photos", lambda row: names[row], by_view)


def worst_points_table(evaluation: Evaluation) -> Table:
    """The points of the target with the largest reprojection errors."""
    face = evaluation.calibration.observations.points.face.tolist()
    return _worst_table(
        evaluation, "worst rings", lambda row: f"{row}" + (f" on face {face[row]}" if face[row] >= 0 else ""), by_point
    )


def faces_table(evaluation: Evaluation) -> Table | None:
    """The faces with the largest reprojection errors; None if there are not two."""
    if len(evaluation.calibration.observations.points.plane) < 2:
        return None
    return _worst_table(evaluation, "worst faces", str, by_face)


Grouping = Callable[[Evaluation, Errors], tuple[ErrorSummary, ...] | None]


def _worst_table(evaluation: Evaluation, title: str, name_of: Callable[[int], str], grouping: Grouping) -> Table:
    """The groups with the largest RMSE by the first metric, and their others."""
    grouped = [(errors, found) for errors in evaluation.errors if (found := grouping(evaluation, errors)) is not None]
    table = _table(title, "sightings", left=(title,))
    for errors, _ in grouped:
        table.add_column(f"{errors.metric} {errors.unit}", justify="right")
    if not grouped:
        return table
    first = grouped[0][1]
    least = min(LEAST_SIGHTINGS, max(summary.count for summary in first))
    rows = [row for row, summary in enumerate(first) if summary.count >= max(least, 1)]
    for row in sorted(rows, key=lambda row: -first[row].rmse)[:WORST]:
        cells = [figure(summaries[row].rmse) for _, summaries in grouped]
        table.add_row(Text(name_of(row)), str(first[row].count), *cells)
    return table


def comparison_table(evaluations: Sequence[Evaluation]) -> Table:
    """Calibrations of the same photos side by side: RMSE of each metric, and the focal length with its sigma.

    The focal length of a learned map is no camera's, and is left out with a word below.
    """
    shown = dict.fromkeys(errors.metric for one in evaluations for errors in one.errors)
    table = _table("model", "photos", "sightings", left=("model",))
    for name in shown:
        unit = next(errors.unit for one in evaluations if (errors := one.of(name)))
        table.add_column(f"{name} {unit}", justify="right")
    table.add_column("fx px", justify="right")
    table.add_column("status")
    for one in evaluations:
        calibration = one.calibration
        cells = [figure(summarise(errors).rmse) if (errors := one.of(name)) else "" for name in shown]
        counted = int((~calibration.is_outlier).sum())
        table.add_row(
            calibration.camera.model, str(calibration.observations.view_count), str(counted), *cells,
            "" if calibration.camera.learned is not None else focal_length(calibration),
            Text(calibration.status, "" if calibration.status == "converged" else "yellow"),
        )  # fmt: skip
    if any(one.calibration.camera.learned is not None for one in evaluations):
        table.caption, table.caption_justify = Text(OF_ITS_OWN_SENSOR, "dim"), "left"
    return table


def focal_length(calibration: Calibration) -> str:
    """`fx` with its standard deviation."""
    value, variance = float(calibration.camera.params[0]), float(calibration.stated_covariance[0, 0])
    if not variance > 0:
        return f"{value:.2f}"
    sigma = math.sqrt(variance)
    return f"{with_digits(value, sigma)} +- {figure(sigma, 2)}"


def _table(*columns: str, left: Sequence[str]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in columns:
        table.add_column(name, justify="left" if name in left else "right", overflow="fold")
    return table
