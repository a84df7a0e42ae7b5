"""What each camera and each pair of a solved rig leave over, and how cameras hang together.

Epipolar errors of two cameras of any model: how far a point is seen from where the other's ray leads.

A ray of one camera and the line between the centres span a plane; what the other sees of it is a curve in its image, on
which the point must lie. Nothing is said of how far along: that is its depth. No pose of the target is used.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.cameras import linearise, rays
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.core.linear_algebra import rms_length
from calib.core.se3 import compose, invert
from calib.rigs.relative import Relative, relative, worst
from calib.rigs.result import RigCalibration
from designer.base.arrays import Array, Rows

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


def seen_by_both(found: RigCalibration, a: int, b: int) -> tuple[Rows, Rows]:
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


@dataclass(frozen=True, eq=False)
class PairFigures:
    """Two cameras of a rig."""

    a: int
    b: int
    names: tuple[str, str]
    relative: Relative
    frames: int  # that both see the target in
    points: int  # seen by both in one frame, over all frames
    rms_px: float  # root mean square length of both's residuals in these frames
    epipolar_px: float  # root mean square distance from the epipolar curves, in both images; nan: none is known


@dataclass(frozen=True, eq=False)
class CameraTie:
    """By what a camera hangs on the rest: the other that it is best known to."""

    camera: int
    partner: int
    joining_frames: int  # the least on the best chain to any other camera
    place_sigma_mm: float  # of its centre as the partner sees it, along the least known direction
    place_axis: Array  # (3,) that direction, in the camera's axes
    turn_sigma_rad: float
    turn_axis: Array  # (3,) about which it is least known


def pair_figures(found: RigCalibration) -> tuple[PairFigures, ...]:
    """Each pair of cameras, in their order."""
    rig, names = found.rig, found.observations.camera_names
    shared = found.observations.shared
    pairs = []
    for a, b in combinations(range(len(names)), 2):
        distance = epipolar_distances(found, a, b)
        known = distance[np.isfinite(distance).all(axis=1)]
        epipolar = float(np.sqrt((known**2).mean())) if len(known) else math.nan
        pairs.append(
            PairFigures(
                a, b, (names[a], names[b]), relative(rig, a, b), int(shared[a, b]), len(seen_by_both(found, a, b)[0]),
                _rms_together(found, a, b), epipolar,
            )
        )  # fmt: skip
    return tuple(pairs)


def ties_of(rig: Rig, shared: Rows) -> tuple[CameraTie, ...]:
    """By what each camera hangs on the others; nothing of a single one.

    `shared` is in how many frames cameras see the target together (C, C).
    """
    count = len(rig.names)
    widest = widest_chain(shared)
    ties = []
    for camera in range(count):
        to = {other: relative(rig, other, camera) for other in range(count) if other != camera}
        if not to:
            return ()
        partner = min(to, key=lambda other: (_unknown_last(to[other].place_sigma_mm), -shared[camera, other]))
        place, axis = worst(to[partner].center_covariance_mm2)
        turn, about = worst(to[partner].covariance[:3, :3])
        joining = int(max(widest[camera, other] for other in to))
        ties.append(CameraTie(camera, partner, joining, place, axis, turn, about))
    return tuple(ties)


def widest_chain(shared: Rows) -> Rows:
    """Of the chains of cameras between two, the fewest frames in a link of the best one.  # (C, C)

    The algorithm of Floyd and Warshall, with the least for the sum and the most for the least.
    """
    widest = np.array(shared)
    for through in range(len(shared)):
        widest = np.maximum(widest, np.minimum(widest[:, through, None], widest[None, through]))
    return widest


def _rms_together(found: RigCalibration, a: int, b: int) -> float:
    """Of both cameras' residuals in the frames that both see."""
    seen = found.observations
    common = np.intersect1d(seen.frame[a], seen.frame[b])
    parts = [
        found.residual_px[k][np.isin(seen.frame[k], common)[seen.sightings[k].view] & ~found.is_outlier[k]]
        for k in (a, b)
    ]
    return rms_length(np.concatenate(parts))


def _unknown_last(value: float) -> float:
    return value if math.isfinite(value) else math.inf
