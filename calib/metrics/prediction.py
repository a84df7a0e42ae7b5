"""What a calibrated camera predicts of its observations: all that metrics are computed from.

Only `calib.cameras.rays`, `calib.cameras.project` and the poses enter, so every camera model has every metric.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras import project, rays
from calib.core.types import frozen_array
from calib.solver.calibration import Calibration

Array = NDArray[np.float64]


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
        for name in ("position_mm", "predicted_px", "center_mm", "direction", "true_cam_from_target"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_array(getattr(self, name)))


def predict(calibration: Calibration, true_cam_from_target: Array | None = None) -> Prediction:
    """The prediction of a calibration; true poses (V, 4, 4) are nan where they are not known."""
    seen = calibration.observations
    position = seen.points.position_mm[seen.point]
    rotation, shift = calibration.cam_from_target[:, :3, :3], calibration.cam_from_target[:, :3, 3]
    in_camera = np.einsum("mij,mj->mi", rotation[seen.view], position) + shift[seen.view]
    ray = rays(calibration.camera, seen.center_px)
    direction = np.einsum("mji,mj->mi", rotation[seen.view], ray)
    return Prediction(
        calibration,
        position,
        project(calibration.camera, in_camera),
        centers_mm(calibration.cam_from_target),
        direction / np.linalg.norm(ray, axis=1, keepdims=True),
        true_cam_from_target,
    )


def centers_mm(cam_from_target: Array) -> Array:
    """Where cameras (V, 4, 4) stand in the target's frame.  # (V, 3)"""
    center: Array = -np.einsum("vji,vj->vi", cam_from_target[:, :3, :3], cam_from_target[:, :3, 3])
    return center
