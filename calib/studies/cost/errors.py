"""What a camera that was solved by some cost is worth: against the truth, and in photos that it was not solved from."""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.core.se3 import transform
from calib.core.types import Observations, keep_sightings, keep_views, sightings_per_view
from calib.solver.blocks import RobustLoss
from calib.solver.costs import COSTS, IMAGE
from calib.solver.in_space import in_space
from calib.solver.levenberg import minimise_poses
from calib.solver.metrics.errors import centers_mm, is_known
from calib.solver.problem import origin_poses, pack, target_poses
from calib.solver.start import solve_poses
from designer.base.arrays import Array
from designer.base.errors import InputError

MOST_STEPS = 50
LEAST_SIGHTINGS = 12
"""Of a photo held out: a pose is found from half of them."""


@dataclass(frozen=True)
class Estimator:
    """A way to solve."""

    name: str
    minimise: str
    weighted: bool = False  # by the covariances of observations


WEIGHTED = "image, weighted"
ESTIMATORS: tuple[Estimator, ...] = (
    Estimator(IMAGE, IMAGE),
    Estimator(WEIGHTED, IMAGE, weighted=True),
    *(Estimator(name, name) for name in COSTS if name != IMAGE),
)
"""Each cost, all observations alike, as mm know nothing of covariances; and what those bring to the image's."""

Pair = tuple[float, float]
NOTHING: Pair = (math.nan, math.nan)


def held_out(camera: Camera, estimator: Estimator, held: Observations) -> Pair:
    """Root mean square errors in photos held out: px in the image, and mm between rays and rings.

    The pose of a photo minimises the same distances over every second ring; the errors are those of the others.
    """
    shown = keep_sightings(held, is_known(rays(camera, held.center_px)))
    shown = keep_views(shown, sightings_per_view(shown) >= LEAST_SIGHTINGS)
    if not len(shown.view):
        return NOTHING
    is_for_pose = np.arange(len(shown.view)) % 2 == 0
    poses = _poses(camera, estimator, keep_sightings(shown, is_for_pose))
    rest = keep_sightings(shown, ~is_for_pose)
    place = transform(poses[rest.view], rest.points.position_mm[rest.point])
    ray = rays(camera, rest.center_px)
    off_px = project(camera, place) - rest.center_px
    off_mm = place - (ray * place).sum(axis=1, keepdims=True) * ray
    return _root_mean_square(off_px), _root_mean_square(off_mm)


def _root_mean_square(off: Array) -> float:
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def _poses(camera: Camera, estimator: Estimator, seen: Observations) -> Array:
    """Of photos whose camera is known (V, 4, 4)."""
    poses = solve_poses(camera, seen, weighted=estimator.weighted).cam_from_target
    if estimator.minimise == IMAGE or not np.isfinite(poses).all():
        return poses
    problem = pack(seen, weighted=estimator.weighted)
    space = in_space(problem, estimator.minimise, seen.points, seen.point)
    found = minimise_poses(space, camera, origin_poses(problem, poses), RobustLoss(), max_iterations=MOST_STEPS)
    return target_poses(problem, found.cam_from_target)


def pose_error_mm(found: Array, true: Array) -> float:
    """Root mean square distance of the cameras from where they stood, of poses (V, 4, 4)."""
    if len(found) != len(true):
        raise InputError("not all photos have a pose")
    return _root_mean_square(centers_mm(found) - centers_mm(true))
