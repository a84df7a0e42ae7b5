"""Parts of observations: some sightings, or those of some views."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.types import Observations

SUREST = 0.25
"""Of the median standard deviation; what states a smaller one, such as 1e-6 px, would own the pose of its photo."""

Rows = NDArray[np.bool_] | NDArray[np.int64]


def keep_sightings(observations: Observations, rows: Rows) -> Observations:
    """Some sightings, by a mask (M,) or by their rows; all views stay, also empty ones."""
    return replace(
        observations,
        view=observations.view[rows],
        point=observations.point[rows],
        center_px=observations.center_px[rows],
        cov_px2=None if observations.cov_px2 is None else observations.cov_px2[rows],
    )


def keep_views(observations: Observations, keep: NDArray[np.bool_]) -> Observations:
    """The sightings of some views (V,), which are numbered anew."""
    if keep.all():
        return observations
    names = zip(observations.view_names, keep.tolist(), strict=True)
    kept = keep_sightings(observations, keep[observations.view])
    return replace(kept, view_names=tuple(name for name, ok in names if ok), view=(np.cumsum(keep) - 1)[kept.view])


def sightings_per_view(observations: Observations) -> NDArray[np.int64]:
    """How many sightings each view has.  # (V,)"""
    count: NDArray[np.int64] = np.bincount(observations.view, minlength=observations.view_count)
    return count


def without_empty_views(observations: Observations) -> Observations:
    """The observations without the views that have no sighting."""
    return keep_views(observations, sightings_per_view(observations) > 0)


def with_sound_covariances(observations: Observations) -> tuple[Observations, int]:
    """The observations with no axis of a covariance surer than a quarter of the median, and how many were.

    The median is of the surest axes, whose standard deviations differ by factors of two or three in one set of photos.
    """
    covariance = observations.cov_px2
    if covariance is None or not len(covariance):
        return observations, 0
    value, axis = np.linalg.eigh(covariance)
    least = (SUREST * np.sqrt(np.median(value[:, 0].clip(min=0.0)))) ** 2
    (rows,) = np.nonzero(value[:, 0] < least)
    if not len(rows):
        return observations, 0
    sound = covariance.copy()
    sound[rows] = (axis[rows] * value[rows, None].clip(min=least)) @ axis[rows].transpose(0, 2, 1)
    return replace(observations, cov_px2=sound), len(rows)
