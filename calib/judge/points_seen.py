"""Which of a target's points a camera of a rig would see of it, held anywhere."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.se3 import invert, transform
from calib.core.types import KnownPoints
from calib.rigs.result import RigCalibration

Array = NDArray[np.float64]

POINTS = 150
"""Of the target, by which candidates are compared."""
LEAST_FACING = 0.34
"""Cosine of the largest angle from which rings are read."""
NEW_SHARE = 0.1
"""Of the target, seen where a camera has seen nothing: what it then tells is not known well."""


def some_points(found: RigCalibration) -> KnownPoints:
    """A few of the points, spread over their order, on planes whose normals point to where they were seen from."""
    points, faces = found.observations.points, len(found.observations.points.plane)
    seen_from = np.zeros(faces)
    for pose, seen, frames in zip(
        found.cam_from_rig, found.observations.sightings, found.observations.frame, strict=True
    ):
        center = invert(pose @ found.rig_from_target[frames])[:, :3, 3]
        above = np.sign(center @ points.plane[:, :3].T - points.plane[:, 3])  # (V, F)
        face = points.face[seen.point]
        rows = np.flatnonzero(face >= 0)
        np.add.at(seen_from, face[rows], above[seen.view[rows], face[rows]])
    points = replace(points, plane=np.where(seen_from < 0, -1.0, 1.0)[:, None] * points.plane)
    rows = np.unique(np.linspace(0, len(points.face) - 1, POINTS).astype(np.int64))
    return replace(points, position_mm=points.position_mm[rows], face=points.face[rows])


def that_look(
    in_camera: Array, cam_from_target: Array, points: KnownPoints, least: float = LEAST_FACING
) -> NDArray[np.bool_]:
    """Which points (K, S) lie on planes that look at the camera, or on none."""
    if not len(points.plane):
        return np.ones(in_camera.shape[:2], dtype=bool)
    normal = points.plane[points.face, :3] @ cam_from_target[:, :3, :3].transpose(0, 2, 1)
    cosine = -(in_camera * normal).sum(axis=2) / np.maximum(np.linalg.norm(in_camera, axis=2), 1e-9)
    looks: NDArray[np.bool_] = (cosine > least) | (points.face < 0)
    return looks


def is_new(found: RigCalibration, camera: int, pose: Array) -> bool:
    """Whether a camera would see much of the target where it has seen none of it so far, and knows its lens badly."""
    pixel = found.cameras[camera].project(
        transform(found.cam_from_rig[camera] @ pose, found.observations.points.position_mm)
    )
    seen = found.observations.sightings[camera].center_px
    with np.errstate(invalid="ignore"):
        beyond = ((pixel < seen.min(axis=0)) | (pixel > seen.max(axis=0))).any(axis=1)
    return bool(found.is_refined[camera] and beyond.mean() > NEW_SHARE)
