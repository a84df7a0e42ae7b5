"""The pinhole behind a learned map: solved on the sensor, its residuals told in measured pixels."""

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.cameras import LINEAR
from calib.cameras.camera import Camera, LearnedMap
from calib.cameras.learned import known_at, to_image, to_sensor
from calib.cameras.virtual import VIRTUAL
from calib.core.linear_algebra import solve_square
from calib.core.selection import keep_sightings, without_empty_views
from calib.core.types import Observations
from calib.solver.calibration import Calibration
from calib.solver.options import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError

Array = NDArray[np.float64]

MARGIN_PX = 1.0
"""The map is known so far around a sighting that is used, so that its prediction is known too."""
MIN_SIGHTINGS = 6
"""Of a view that is used: its pose has six unknowns."""


@dataclass(frozen=True, eq=False)
class OnSensor:
    """Observations whose pixels are points of the sensor."""

    observations: Observations  # covariances: those that a measured pixel with the covariance 1, or its own, has there
    jacobian: Array  # (M, 2, 2) derivative of the sensor's point by the pixel


def move_to_sensor(observations: Observations, learned: LearnedMap, *, weighted: bool) -> OnSensor:
    """Take observations to the sensor; weighted by the covariances there, they count as in the image."""
    there = to_sensor(learned, observations.image_size, observations.center_px)
    cov = np.broadcast_to(np.eye(2), there.jacobian.shape)
    if weighted and observations.cov_px2 is not None:
        cov = observations.cov_px2
    cov = there.jacobian @ cov @ there.jacobian.transpose(0, 2, 1)
    return OnSensor(replace(observations, center_px=there.point, cov_px2=cov), there.jacobian)


def solve_on_sensor(observations: Observations, learned: LearnedMap, options: SolveOptions) -> Calibration:
    """Solve the pinhole of a virtual camera whose map is known; the map's own uncertainty is not in the covariances.

    Sightings where the map is not known are left out, and the remarks say so.
    """
    begin = time.perf_counter()
    kept, remarks = _known_part(observations, learned)
    moved = move_to_sensor(kept, learned, weighted=options.weighted)
    noise = None
    if kept.cov_px2 is not None:  # what is far off is told by what the detector states, not by the weights
        noise = moved.jacobian @ kept.cov_px2 @ moved.jacobian.transpose(0, 2, 1)
    solved = solve(moved.observations, LINEAR, replace(options, weighted=True), noise_px2=noise)
    rows = rows_of_views(kept, solved.observations.view_names)
    kept = without_empty_views(keep_sightings(kept, rows))
    return replace(
        solved,
        camera=Camera(VIRTUAL, solved.camera.params, kept.image_size, learned),
        observations=kept,
        residual_px=_in_image(learned, kept, solved, moved.jacobian[rows]),
        weighted=options.weighted and kept.cov_px2 is not None,
        remarks=(*solved.remarks, *remarks),
        seconds=time.perf_counter() - begin,
    )


def _in_image(learned: LearnedMap, observations: Observations, solved: Calibration, jacobian: Array) -> Array:
    """Residuals in measured pixels, by inverting the map where a point is predicted.  # (M, 2)"""
    predicted = solved.observations.center_px + solved.residual_px
    residual = to_image(learned, observations.image_size, predicted) - observations.center_px
    # Far outside the map, as the prediction of a grossly wrong sighting may be, there is only its tangent.
    tangent = solve_square(jacobian, solved.residual_px[:, :, None])[:, :, 0]
    return np.where(np.isfinite(residual), residual, tangent)


def _known_part(observations: Observations, learned: LearnedMap) -> tuple[Observations, tuple[str, ...]]:
    """The sightings where the map is known, in views that keep enough of them, and what is left out."""
    known = np.ones(len(observations.view), dtype=bool)
    for step in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        known &= known_at(learned, observations.image_size, observations.center_px + MARGIN_PX * np.array(step))
    counts = np.bincount(observations.view[known], minlength=observations.view_count)
    enough = counts >= MIN_SIGHTINGS
    if not enough.any():
        raise InputError(
            f"no view has {MIN_SIGHTINGS} sightings where the learned map is known; "
            "learn it from a photo whose board fills the image"
        )
    kept = known & enough[observations.view]
    remarks = []
    if not kept.all():
        remarks.append(f"{(~kept).sum()} of {len(kept)} sightings left out: the learned map is not known there")
    if not enough.all():
        few = f"with fewer than {MIN_SIGHTINGS} sightings on the known map"
        remarks.append(f"{(~enough).sum()} of {len(enough)} views left out, {few}")
    return without_empty_views(keep_sightings(observations, kept)), tuple(remarks)


def rows_of_views(observations: Observations, view_names: tuple[str, ...]) -> NDArray[np.bool_]:
    """Which observations are of the views named.  # (M,)"""
    kept = np.array([name in set(view_names) for name in observations.view_names], dtype=bool)
    rows: NDArray[np.bool_] = kept[observations.view]
    return rows
