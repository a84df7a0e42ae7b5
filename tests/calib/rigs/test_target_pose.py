"""The pose of a target in a rig's frame: right, as sure as it says by noise and rig, whatever cameras saw it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation, log_rotation, make_pose
from calib.core.types import Detections
from calib.observe.target_poses import target_poses
from calib.rigs.target_pose import CameraSight, RigPose, pose_in_rig
from calib.space.linear import calibration_factor
from designer.target import TargetGeometry
from tests.support.calibrations import board, icosahedron
from tests.support.rig_views import RigScene, ring, solved_slowly, stereo_pair
from calib.observe.observations import known_points

Array = NDArray[np.float64]

ICO, BOARD = icosahedron("100mm"), board()
NOISE_PX = 0.1


@cache
def solved(kind: str) -> tuple[TargetGeometry, Rig, Array]:
    """A target, a rig with its joint covariance, and poses of the target in its frame."""
    target = ICO if kind == "ring" else BOARD
    scene: RigScene = (ring if kind == "ring" else stereo_pair)(known_points(target), frames=8, noise_px=NOISE_PX)
    found = solved_slowly(scene)
    return target, replace(found.rig, geometry_id=""), found.rig_from_target


def drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """A rig as it may truly be, by its covariance."""
    factor = calibration_factor(rig)
    assert factor is not None
    error = factor @ rng.normal(size=factor.shape[1])
    poses = []
    for row, pose in enumerate(rig.cam_from_rig):
        step = error[rig.pose_rows(row)]
        poses.append(make_pose(exp_rotation(step[:3]) @ pose[:3, :3], pose[:3, 3] + step[3:]))
    cameras = tuple(
        replace(one, params=one.params + error[rig.params_rows(row)]) for row, one in enumerate(rig.cameras)
    )
    return replace(rig, cameras=cameras, cam_from_rig=np.stack(poses))


def sights_of(
    target: TargetGeometry, rig: Rig, pose: Array, rng: np.random.Generator | None, starts: Rig | None = None
) -> list[CameraSight]:
    """What cameras see of the rings that look at them, with the poses of each alone."""
    points = known_points(target)
    normal = target.target_from_face[target.ring_face, :3, 2]
    sights = []
    for row, camera in enumerate(rig.cameras):
        cam_from_target = rig.cam_from_rig[row] @ pose
        place = points.position_mm @ cam_from_target[:3, :3].T + cam_from_target[:3, 3]
        faces = -(place * (normal @ cam_from_target[:3, :3].T)).sum(axis=1) / np.linalg.norm(place, axis=1)
        pixel = camera.project(place)
        inside = (pixel > 0).all(axis=1) & (pixel < camera.image_size).all(axis=1)
        ring = np.flatnonzero((faces > 0.3) & inside)
        noise = 0.0 if rng is None else rng.normal(0, NOISE_PX, (len(ring), 2))
        seen = Detections(
            f"{row}.png", camera.image_size, target.layout_id, target.geometry_id, ring, points.position_mm[ring],
            pixel[ring] + noise, np.tile(NOISE_PX**2 * np.eye(2), (len(ring), 1, 1)),
            np.tile([0, 0, 30.0, 20.0, 0.3], (len(ring), 1)), (),
        )  # fmt: skip
        alone = target_poses([seen], target, (starts or rig).cameras[row], weighted=True).poses
        sights.append(CameraSight(row, seen, alone[0].cam_from_target if alone else None))
    return sights


def found_of(target: TargetGeometry, rig: Rig, sights: list[CameraSight], *, weighted: bool = True) -> RigPose:
    found = pose_in_rig(rig, sights, target.center_mm, weighted=weighted)
    assert found is not None
    return found


def off(found: Array, true: Array) -> Array:
    """The error of a pose as covariances have it."""
    return np.concatenate([log_rotation(found[:3, :3] @ true[:3, :3].T), found[:3, 3] - true[:3, 3]])


@pytest.mark.parametrize("kind", ["ring", "pair"])
@pytest.mark.parametrize("missing", [None, 0])
def test_without_noise_the_pose_is_the_truth(kind: str, missing: int | None) -> None:
    """From all cameras, or without the one whose frame the rig's is."""
    target, rig, poses = solved(kind)
    for pose in poses[:3]:
        sights = [one for one in sights_of(target, rig, pose, None) if one.camera != missing]
        found = found_of(target, rig, sights)
        assert np.abs(off(found.rig_from_target, pose)).max() < 1e-7
        assert max(float(np.nanmax(np.abs(one))) for one in found.residual_px) < 1e-6


@pytest.mark.parametrize(("kind", "missing"), [("ring", None), ("pair", None), ("ring", 1)])
def test_ellipsoids_hold_the_truth_as_often_as_they_say(kind: str, missing: int | None) -> None:
    """Rigs that are drawn from the covariance see the target with noise: 95 % ellipsoids of the pose hold the truth in
    93 to 97 % of all, those of its place alone too; by the noise alone they would not."""
    target, rig, poses = solved(kind)
    rng = np.random.default_rng(4)
    inside, places, alone = 0, 0, 0
    count = 300
    for number in range(count):
        pose = poses[number % len(poses)]
        sights = [one for one in sights_of(target, drawn(rig, rng), pose, rng, rig) if one.camera != missing]
        found = found_of(target, rig, sights)
        error = off(found.rig_from_target, pose)
        inside += error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.95, 6)
        places += error[3:] @ np.linalg.solve(found.covariance[3:, 3:], error[3:]) < chi2.ppf(0.95, 3)
        alone += error @ np.linalg.solve(found.noise, error) < chi2.ppf(0.95, 6)
    print(kind, missing, inside / count, places / count, alone / count)
    assert 0.93 <= inside / count <= 0.97
    assert 0.92 <= places / count <= 0.98
    assert alone / count < 0.8
