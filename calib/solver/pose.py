"""Poses of a target for a known camera."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.types import Observations
from calib.solver.blocks import RobustLoss
from calib.solver.levenberg import minimise_poses
from calib.solver.poses import first_poses
from calib.solver.problem import pack, target_covariance, target_poses

Array = NDArray[np.float64]

STEPS = 50


@dataclass(frozen=True, eq=False)
class Poses:
    """Where the target stands before the camera, view by view; nan where no pose was found."""

    cam_from_target: Array  # (V, 4, 4)
    covariance: Array  # (V, 6, 6) rotation vector (rad), translation (mm), in the camera's axes
    residual_px: Array  # (M, 2) predicted - measured
    scale: (
        float  # posterior standard deviation of an observation; px, or with weights in units of the stated covariance
    )


def solve_poses(camera: Camera, observations: Observations, *, weighted: bool = True) -> Poses:
    """The pose of each view that minimises the squared distances in the image, the camera as it is.

    Args:
        camera: the known camera.
        observations: what it saw; each view has four points or more.
        weighted: by the covariances of the observations, where they are known.
    """
    problem = pack(observations, weighted=weighted)
    first = first_poses(problem, camera, is_robust=False)
    start = np.where(first.found[:, None, None], first.cam_from_target, np.eye(4))
    minimum = minimise_poses(problem, camera, start, RobustLoss(), max_iterations=STEPS)
    found = first.found & np.isfinite(minimum.blocks.cost)
    redundancy = 2 * int(found[observations.view].sum()) - 6 * int(found.sum())
    squares = float(minimum.blocks.products[found, -1, -1].sum())
    scale = float(np.sqrt(squares / redundancy)) if redundancy > 0 else float("nan")
    normal = np.where(found[:, None, None], minimum.blocks.products[:, -7:-1, -7:-1], np.eye(6))
    lost = ~found
    poses = minimum.cam_from_target
    covariance = target_covariance(problem, poses, scale**2 * symmetric_inverse(normal).covariance)
    return Poses(
        np.where(lost[:, None, None], np.nan, target_poses(problem, poses)),
        np.where(lost[:, None, None], np.nan, covariance),
        np.where(lost[observations.view][:, None], np.nan, minimum.blocks.residual_px.T),
        scale,
    )
