"""Rigs with a covariance and points that they see, for what is triangulated and budgeted."""

from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import POSE, Rig
from calib.core.se3 import exp_rotation, invert, make_pose, transform
from calib.space.propagate import PointSightings
from designer.base.arrays import Array
from tests.support.rig_views import SIZE, camera

NOISE_PX = 0.1
PARAMS_SIGMA = {
    "opencv": (0.2, 0.2, 0.3, 0.3, 2e-4, 5e-4, 5e-5, 5e-5, 5e-4),
    "fisheye": (0.2, 0.2, 0.3, 0.3, *[2e-4] * 4),
}
TURN_SIGMA_RAD, SHIFT_SIGMA_MM = 1e-4, 0.03


def row_of_cameras(
    count: int = 2, *, baseline_mm: float = 150.0, models: tuple[str, ...] = ("opencv",), seed: int = 4
) -> Rig:
    """Cameras beside each other, turned a little inwards, the third above; correlated errors of all of them."""
    cameras = tuple(camera(model=models[row % len(models)]) for row in range(count))
    eyes = np.array(
        [[baseline_mm * (row - (count - 1) / 2), -0.6 * baseline_mm * (row == 2), 0] for row in range(count)]
    )
    turns = np.array([[0.01 * row, -1e-3 * eye[0] / 4, 0.02] for row, eye in enumerate(eyes)])
    poses = invert(make_pose(exp_rotation(turns), eyes))
    poses = poses @ invert(poses[0])
    sigma = np.concatenate([
        np.array([*PARAMS_SIGMA[one.model], *[TURN_SIGMA_RAD * (row > 0)] * 3, *[SHIFT_SIGMA_MM * (row > 0)] * 3])
        for row, one in enumerate(cameras)
    ])  # fmt: skip
    mixing = np.random.default_rng(seed).standard_normal((len(sigma), 2 * len(sigma)))
    mixing /= np.linalg.norm(mixing, axis=1, keepdims=True)
    covariance = sigma[:, None] * (mixing @ mixing.T) * sigma
    names = tuple("abcdefgh"[:count])
    return Rig(names, cameras, poses, covariance, np.full(count, NOISE_PX))


def moved(rig: Rig, step: Array) -> Rig:
    """A rig whose unknowns, in the rows of its covariance, are a step off."""
    cameras, poses = [], []
    for row, one in enumerate(rig.cameras):
        turn_shift = step[rig.pose_rows(row)]
        cameras.append(replace(one, params=one.params + step[rig.params_rows(row)]))
        turned = exp_rotation(turn_shift[:3]) @ rig.cam_from_rig[row, :3, :3]
        poses.append(make_pose(turned, rig.cam_from_rig[row, :3, 3] + turn_shift[3:]))
    return replace(rig, cameras=tuple(cameras), cam_from_rig=np.array(poses))


def drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig as another calibration might have found it."""
    assert rig.covariance is not None
    value, vector = np.linalg.eigh(rig.covariance)
    step = vector @ (np.sqrt(value.clip(min=0)) * rng.standard_normal(len(value)))
    return moved(rig, step)


def points_before(
    rig: Rig, count: int, rng: np.random.Generator, *, near_mm: float = 700, far_mm: float = 1600
) -> Array:
    """Points that all cameras of a rig see.  # (count, 3)"""
    middle = rig.center_mm.mean(axis=0)
    some = middle + rng.uniform([-400, -300, near_mm], [400, 300, far_mm], (20 * count, 3))
    seen = np.ones(len(some), dtype=bool)
    for one, pose in zip(rig.cameras, rig.cam_from_rig, strict=True):
        pixel = one.project(transform(pose, some))
        seen &= np.isfinite(pixel).all(axis=1) & (pixel >= 0).all(axis=1) & (pixel <= np.array(SIZE) - 1).all(axis=1)
    kept: Array = some[seen][:count]
    assert len(kept) == count
    return kept


def sighted(
    rig: Rig, points_mm: Array, rng: np.random.Generator | None = None, noise_px: float = NOISE_PX
) -> PointSightings:
    """What all cameras see of points, in one frame; without a generator exactly."""
    count, cameras = len(points_mm), len(rig.names)
    pixel = np.stack(
        [one.project(transform(pose, points_mm)) for one, pose in zip(rig.cameras, rig.cam_from_rig, strict=True)]
    )
    if rng is not None:
        pixel = pixel + noise_px * rng.standard_normal(pixel.shape)
    return PointSightings(
        ("f",), tuple(f"p{row}" for row in range(count)), np.zeros(count, dtype=np.int64), np.arange(count),
        np.repeat(np.arange(cameras), count), np.tile(np.arange(count), cameras), pixel.reshape(-1, 2),
    )  # fmt: skip


def without_errors(rig: Rig) -> Rig:
    """The rig as if it were known exactly."""
    size = rig.first_row[-1]
    assert size == sum(len(one.params) + POSE for one in rig.cameras)
    return replace(rig, covariance=np.zeros((size, size)))


def wide_camera() -> Camera:
    """A fisheye that sees behind itself."""
    return Camera("fisheye", np.array([300.0, 300.0, 640.0, 480.0, 0.0, 0.0, 0.0, 0.0]), SIZE)
