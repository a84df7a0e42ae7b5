"""Poses of simulated robots as files hold them, in any of the ways in which these are written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.core.se3 import exp_rotation, invert, look_at, make_pose
from calib.observe.robot_poses import RobotPoses, read_robot_poses
from designer.base.arrays import Array

Written = tuple[str, Array, Array]  # columns of the rotation, positions in mm, rotations

QUATERNION = "qx,qy,qz,qw"


def quaternions(pose: Array) -> Written:
    """As most robots write."""
    return QUATERNION, pose[:, :3, 3], Rotation.from_matrix(pose[:, :3, :3]).as_quat()


def in_unit(factor: float) -> Callable[[Array], Written]:
    """Positions in another unit than mm."""
    return lambda pose: (QUATERNION, pose[:, :3, 3] * factor, quaternions(pose)[2])


def angles(columns: str, axes: str, *, degrees: bool = True) -> Callable[[Array], Written]:
    """Euler angles by scipy's axes, under some columns."""
    return lambda pose: (columns, pose[:, :3, 3], Rotation.from_matrix(pose[:, :3, :3]).as_euler(axes, degrees=degrees))


def mirrored(mirror: Array) -> Callable[[Array], Written]:
    """Both frames left-handed."""

    def written(pose: Array) -> Written:
        turned = Rotation.from_matrix(mirror @ pose[:, :3, :3] @ mirror.T)
        return QUATERNION, pose[:, :3, 3] @ mirror.T, turned.as_quat()

    return written


def a_row_on(by: int) -> Callable[[Array], Written]:
    """Each photo with the pose of another row."""
    return lambda pose: quaternions(np.roll(pose, by, axis=0))


def vectors(columns: str) -> Callable[[Array], Written]:
    """Rotation vectors in rad."""
    return lambda pose: (columns, pose[:, :3, 3], Rotation.from_matrix(pose[:, :3, :3]).as_rotvec())


def rolled(pose: Array, by: int) -> tuple[Array, Array]:
    _, shift, quaternion = quaternions(pose)
    return shift, np.roll(quaternion, by, axis=1)


def robot(seed: int, *, is_camera_in_hand: bool, is_orbit: bool = False) -> tuple[Array, Array]:
    """What a camera saw of a target, and where the flange was: (V, 4, 4) each, with noise of both."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(10, 22))
    toward = rng.normal(size=(count, 3)) * [0.4, 0.4, 0.0] - [0.0, 0.0, 1.0]
    away_mm = 500.0 * (1 + (0.0 if is_orbit else 0.15) * rng.normal(size=(count, 1)))
    aim = (0.0 if is_orbit else 30.0) * rng.normal(size=(count, 3))
    eye = aim + away_mm * toward / np.linalg.norm(toward, axis=1, keepdims=True)
    cam_from_target = look_at(eye, aim, rng.uniform(-1.0, 1.0, count))
    x = make_pose(exp_rotation(1.5 * rng.normal(size=3)), 60 * rng.normal(size=3))
    z = make_pose(exp_rotation(1.5 * rng.normal(size=3)), rng.normal(size=3) * [400, 400, 150])
    carried = invert(x) @ cam_from_target @ invert(z)
    base_from_flange = invert(carried) if is_camera_in_hand else carried
    return wobbling(rng, count, 1e-3, 0.3) @ cam_from_target, base_from_flange @ wobbling(rng, count, 3e-4, 0.1)


def wobbling(rng: np.random.Generator, count: int, rad: float, mm: float) -> Array:
    """Small motions (V, 4, 4)."""
    return make_pose(exp_rotation(rad * rng.normal(size=(count, 3))), mm * rng.normal(size=(count, 3)))


def read(written: Written, folder: Path) -> RobotPoses:
    """What a file of these numbers is read as."""
    columns, shift, rotation = written
    rows = [
        f"{number}.png,{','.join(f'{value:.8f}' for value in row)}"
        for number, row in enumerate(np.column_stack([shift, rotation]).tolist())
    ]
    path = folder / "robot.csv"
    path.write_text("\n".join([f"image,x_mm,y_mm,z_mm,{columns}", *rows]) + "\n")
    return read_robot_poses(path)
