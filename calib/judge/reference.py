"""What photos are held against that tell whether cameras changed: a calibration, or a file that states less."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import ALONE, POSE, Rig, rig_of_one
from calib.core.types import Observations, RigObservations, keep_sightings, without_empty_views
from calib.rigs.result import RigCalibration
from calib.solver.calibration import Calibration
from designer.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Reference:
    """What cameras are said to be, and what else their calibration knows of their photos."""

    rig: Rig  # with the covariance that its file states, if it does
    photo_covariance: Array | None = None  # (N, N) of what errors do that a single photo's centres share
    field_px: Array | None = None  # (C,) of what is fixed in the image and no lens of the model follows
    scale: Array | None = None  # (C,) noise of its photos, in standard deviations that are stated, or px
    is_stated: bool = False  # whether they state them
    photos: RigObservations | None = None  # that it was solved from
    solved: Rig | None = None  # if its file says something else

    @property
    def states_nothing(self) -> bool:
        """Whether nobody says how sure the cameras are, nor what they leave over."""
        return self.rig.covariance is None and self.scale is None

    @property
    def own(self) -> "Reference":
        """The cameras as they were solved, beside their own photos: nothing of them is to be expected."""
        return replace(self, rig=replace(self.solved or self.rig, covariance=None))


def of_one_camera(seen: Observations) -> RigObservations:
    """What a camera saw, each view a frame."""
    return RigObservations((ALONE,), seen.view_names, (seen,), (np.arange(seen.view_count),))


def reference_of(known: "Calibration | RigCalibration | Rig | Camera") -> Reference:
    """Cameras, with as much of their calibration as is known."""
    if isinstance(known, Camera):
        return Reference(rig_of_one(known))
    if isinstance(known, Rig):
        return Reference(known)
    if isinstance(known, RigCalibration):
        rig = replace(known.rig, covariance=known.stated_covariance)
        photo = known.photo_covariance
        share = None if photo is None else photo * known.observations.frame_count
        return Reference(rig, share, None, known.scale, known.weighted, _used(known))
    error, field, count = known.photo_error, known.image_field, known.observations.view_count
    rig = replace(rig_of_one(known.camera), covariance=_with_pose(known.stated_covariance))
    photos = without_empty_views(keep_sightings(known.observations, ~known.is_outlier))
    return Reference(
        rig, None if error is None else _with_pose(count * error.param_covariance),
        None if field is None else np.array([field.left_px]), np.array([known.scale]),
        known.weighted, of_one_camera(photos),
    )  # fmt: skip


def _with_pose(covariance: Array) -> Array:
    return np.pad(covariance, ((0, POSE), (0, POSE)))


def _used(known: RigCalibration) -> RigObservations:
    """The sightings that count."""
    each: Sequence[Observations] = tuple(
        keep_sightings(seen, ~outlier)
        for seen, outlier in zip(known.observations.sightings, known.is_outlier, strict=True)
    )
    return replace(known.observations, sightings=tuple(each))
