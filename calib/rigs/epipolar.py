"""Epipolar errors of two cameras of any model: how far a point is seen from where the other's ray leads.

A ray of one camera and the line between the centres span a plane; what the other sees of it is a curve in its image, on
which the point must lie. Nothing is said of how far along: that is its depth. No pose of the target is used.
"""

import numpy as np
from numpy.typing import NDArray

from calib.cameras import linearise, rays
from calib.cameras.camera import Camera
from calib.core.se3 import compose, invert
from calib.rigs.result import RigCalibration

Array = NDArray[np.float64]

NO_BASELINE = 1e-9
"""Of a unit vector: two rays that are parallel to the baseline span no plane."""


def epipolar_distances(found: RigCalibration, a: int, b: int) -> Array:
    """Of each point that both see in a frame, its distance (px) from the curve in a's image and in b's.  # (N, 2)

    Cameras whose time stamps lie apart saw a moving target in two places, of which there is no such distance: none.
    """
    if found.delay_s is not None:
        return np.zeros((0, 2))
    rows_a, rows_b = seen_by_both(found, a, b)
    b_from_a = compose(found.cam_from_rig[b], invert(found.cam_from_rig[a]))
    pixel = [found.observations.sightings[k].center_px[rows] for k, rows in ((a, rows_a), (b, rows_b))]
    ray = [rays(found.cameras[k], one) for k, one in zip((a, b), pixel, strict=True)]
    return np.stack(
        [
            _distance_px(found.cameras[a], ray[0], ray[1], invert(b_from_a)),
            _distance_px(found.cameras[b], ray[1], ray[0], b_from_a),
        ],
        axis=1,
    )


def seen_by_both(found: RigCalibration, a: int, b: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of the sightings of two cameras that show the same points in the same frames, without outliers.  # (N,)"""
    seen, count = found.observations, len(found.observations.points.position_mm)
    used = [np.flatnonzero(~found.is_outlier[k]) for k in (a, b)]
    keys = [
        seen.frame[k][seen.sightings[k].view[rows]] * count + seen.sightings[k].point[rows]
        for k, rows in zip((a, b), used, strict=True)
    ]
    _, first, second = np.intersect1d(keys[0], keys[1], assume_unique=True, return_indices=True)
    return used[0][first], used[1][second]


def _distance_px(camera: Camera, own: Array, other: Array, own_from_other: Array) -> Array:
    """Of pixels with rays `own` (N, 3), their distance from the curves of the rays of another camera.  # (N,)"""
    turned, baseline = other @ own_from_other[:3, :3].T, own_from_other[:3, 3]
    normal = np.cross(baseline, turned)
    length = np.linalg.norm(normal, axis=1)
    spans = length > NO_BASELINE * max(float(np.linalg.norm(baseline)), 1e-300)
    unit = normal / np.where(spans, length, 1.0)[:, None]
    out_of_plane = np.arcsin(np.clip((own * unit).sum(axis=1), -1.0, 1.0))
    by_point = linearise(camera, np.ascontiguousarray(own.T)).by_point.transpose(2, 0, 1)
    off = np.einsum("nij,nj->ni", by_point, unit * out_of_plane[:, None])
    along = np.einsum("nij,nj->ni", by_point, np.cross(unit, own))
    speed = np.linalg.norm(along, axis=1)
    across = np.abs(off[:, 0] * along[:, 1] - off[:, 1] * along[:, 0]) / np.where(speed > 0, speed, 1.0)
    return np.where(spans & (speed > 0), across, np.nan)
