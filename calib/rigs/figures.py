"""What each camera and each pair of a solved rig leave over, and how cameras hang together."""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib.cameras.rig import Rig
from calib.rigs.epipolar import epipolar_distances, seen_by_both
from calib.rigs.relative import Relative, relative, worst
from calib.rigs.result import RigCalibration

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CameraFigures:
    """What one camera of a rig tells."""

    name: str
    frames: int  # in which it sees the target
    sightings: int  # that count
    left_out: int
    rms_px: float  # root mean square length of the residuals that count
    times_stated: float | None  # the noise over what the detector states; None: weights were not used


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


def camera_figures(found: RigCalibration) -> tuple[CameraFigures, ...]:
    """What each camera leaves over."""
    return tuple(
        CameraFigures(
            name, seen.view_count, int((~out).sum()), int(out.sum()), rms_length(residual[~out]),
            float(scale) if found.weighted and seen.cov_px2 is not None else None,
        )
        for name, seen, residual, out, scale in zip(
            found.observations.camera_names, found.observations.sightings, found.residual_px, found.is_outlier,
            found.scale, strict=True,
        )
    )  # fmt: skip


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


def ties_of(rig: Rig, shared: NDArray[np.int64]) -> tuple[CameraTie, ...]:
    """By what each camera hangs on the others; nothing of a single one.

    Args:
        rig: with its joint covariance.
        shared: in how many frames cameras see the target together (C, C).
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


def widest_chain(shared: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of the chains of cameras between two, the fewest frames in a link of the best one.  # (C, C)

    The algorithm of Floyd and Warshall, with the least for the sum and the most for the least.
    """
    widest = np.array(shared)
    for through in range(len(shared)):
        widest = np.maximum(widest, np.minimum(widest[:, through, None], widest[None, through]))
    return widest


def rms_length(residual: Array) -> float:
    """Root mean square length of vectors (N, 2); nan of none."""
    return float(np.sqrt((residual**2).sum(axis=1).mean())) if len(residual) else math.nan


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
