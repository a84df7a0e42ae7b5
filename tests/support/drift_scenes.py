"""Cameras and rigs that were solved from some photos and are checked with others, with or without a change between."""

from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, make_pose
from calib.core.types import KnownPoints, Observations, RigObservations
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.calibration import Calibration
from calib.solver.solve import solve
from tests.support import rig_views, solver_scenes

CAMERA = solver_scenes.CAMERAS["opencv"]


def scaled(camera: Camera, focal: float) -> Camera:
    """The camera with other focal lengths."""
    return replace(camera, params=camera.params * np.where(np.arange(len(camera.params)) < 2, focal, 1.0))


def photos_of(
    camera: Camera, points: KnownPoints, count: int, rng: np.random.Generator, *, noise_px: float = 0.05,
    half_angle_deg: float = 35.0,
) -> Observations:  # fmt: skip
    """What it sees, with covariances that are true."""
    poses = solver_scenes.poses_around(count, rng, half_angle_deg=half_angle_deg)
    seen = solver_scenes.observe(camera, points, poses, rng, noise_px=noise_px)
    return replace(seen, cov_px2=np.tile(noise_px**2 * np.eye(2), (len(seen.view), 1, 1)))


def solved(points: KnownPoints, rng: np.random.Generator, *, noise_px: float = 0.05, photos: int = 20) -> Calibration:
    """A camera solved from photos of its own."""
    return solve(photos_of(CAMERA, points, photos, rng, noise_px=noise_px, half_angle_deg=50.0), "opencv")


def moved_camera(
    scene: rig_views.RigScene, turn_deg: tuple[float, float, float] = (0, 0, 0), *, focal: float = 1.0
) -> rig_views.RigScene:
    """The scene with its second camera turned about its own centre, or with another focal length."""
    poses, cameras = scene.cam_from_rig.copy(), list(scene.cameras)
    poses[1] = make_pose(exp_rotation(np.radians(turn_deg)), np.zeros(3)) @ poses[1]
    cameras[1] = scaled(cameras[1], focal)
    return replace(scene, cam_from_rig=poses, cameras=tuple(cameras))


def frames_of(scene: rig_views.RigScene, frames: slice, rng: np.random.Generator) -> RigObservations:
    """What its cameras see in some of its frames."""
    names, points = scene.observations.camera_names, scene.observations.points
    poses = scene.cam_from_rig[:, None] @ scene.rig_from_target[frames]
    return rig_views.seen_by_all(names, scene.cameras, poses, points, rng, scene.noise_px)


def solved_rig(scene: rig_views.RigScene, frames: int, rng: np.random.Generator) -> RigCalibration:
    """The rig from the first frames."""
    return solve_rig(frames_of(scene, slice(frames), rng), [CameraChoice(one.model) for one in scene.cameras])
