"""A sample as anyone would solve it: each view as often as it was drawn, from the first guess, and all metrics."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import make_pose
from calib.core.selection import keep_sightings
from calib.core.types import Observations
from calib.metrics.errors import Errors, summarise
from calib.metrics.intersection import intersection
from calib.metrics.pose import pose
from calib.metrics.prediction import predict
from calib.metrics.reconstruction import reconstruction
from calib.metrics.reprojection import reprojection
from calib.pipeline.solving import calibrate
from calib.solver.calibration import Calibration
from calib.studies.pool import Pool
from calib.studies.sample import SampleResult
from designer.base.errors import InputError

Array = NDArray[np.float64]


def solve_from_scratch(pool: Pool, counts: NDArray[np.int64], number: int) -> SampleResult:
    """The result of a sample.

    Args:
        pool: the views.
        counts: (V,) how often each is drawn.
        number: of the sample.
    """
    drawn = np.repeat(np.arange(len(counts)), counts)
    distinct = int((counts > 0).sum())
    try:
        found = calibrate(expanded(pool.observations, drawn), pool.model, pool.options)
    except (InputError, np.linalg.LinAlgError) as error:
        nothing = (math.nan,) * len(pool.calibration.camera.params)
        nan = math.nan
        return SampleResult(number, "failed", distinct, nan, nan, nan, nan, nothing, 0, str(error))
    prediction = predict(found, _true_poses(pool, found))
    says = found.status != "converged" or found.observations.view_count < len(drawn)
    return SampleResult(
        number, found.status, distinct, _rmse(reprojection(prediction)), _rmse(intersection(prediction)),
        _rmse(reconstruction(prediction)), _rmse(pose(prediction)), tuple(found.camera.params.tolist()),
        found.iterations, "; ".join(found.remarks) if says else "",
    )  # fmt: skip


def expanded(observations: Observations, drawn: NDArray[np.int64]) -> Observations:
    """The observations of views (N,), one that is named twice as two views that look alike."""
    start = np.searchsorted(observations.view, np.arange(observations.view_count + 1))
    length = np.diff(start)[drawn]
    place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
    rows = np.repeat(start[drawn], length) + place
    names = tuple(observations.view_names[view] for view in drawn.tolist())
    return replace(keep_sightings(observations, rows), view_names=names, view=np.repeat(np.arange(len(drawn)), length))


def _true_poses(pool: Pool, found: Calibration) -> Array | None:
    """Poses with the true centres of the views that were solved; their axes mean nothing, and no metric here asks."""
    if pool.true_center_mm is None:
        return None
    row = {name: view for view, name in enumerate(pool.observations.view_names)}
    center = pool.true_center_mm[[row[name] for name in found.observations.view_names]]
    return make_pose(np.eye(3), -center)


def _rmse(errors: Errors | None) -> float:
    return math.nan if errors is None else summarise(errors).rmse
