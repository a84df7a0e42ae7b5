"""The pose of a target in a rig's frame: right, as sure as it says by noise and rig, whatever cameras saw it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from calib.cameras.rig import Rig
from calib.core.se3 import steps_between
from calib.core.types import Detections
from calib.observe.observations import known_points
from calib.observe.target_poses import target_poses
from calib.rigs.target_pose import CameraSight, RigPose, pose_in_rig
from designer.base.arrays import Array
from designer.target import TargetGeometry
from tests.support.calibrations import board, icosahedron
from tests.support.rig_views import RigScene, ring, solved_slowly, stereo_pair
from tests.support.space_scenes import drawn

ICO, BOARD = icosahedron("100mm"), board()
NOISE_PX = 0.1


@cache
def solved(kind: str) -> tuple[TargetGeometry, Rig, Array]:
    """A target, a rig with its joint covariance, and poses of the target in its frame."""
    target = ICO if kind == "ring" else BOARD
    points = known_points(target)
    scene: RigScene = ring(points, count=3, frames=5) if kind == "ring" else stereo_pair(points, frames=6)
    found = solved_slowly(scene, steps=1)
    return target, replace(found.rig, geometry_id=""), found.rig_from_target


@cache
def shown_of(target: TargetGeometry) -> tuple[Array, Array]:
    """The rings' places and the normals of their faces."""
    return known_points(target).position_mm, target.target_from_face[target.ring_face, :3, 2]


def sights_of(
    target: TargetGeometry, rig: Rig, pose: Array, rng: np.random.Generator | None, known: Rig | None = None,
    noise_px: float = NOISE_PX,
) -> list[CameraSight]:  # fmt: skip
    """What cameras of a rig, which is known as another, see of the rings that look at them, with a start from each.

    Without a generator there is no noise, and starts are searched; else they are near.
    """
    position, normal = shown_of(target)
    sights = []
    for row, camera in enumerate(rig.cameras):
        cam_from_target = rig.cam_from_rig[row] @ pose
        place = position @ cam_from_target[:3, :3].T + cam_from_target[:3, 3]
        faces = -(place * (normal @ cam_from_target[:3, :3].T)).sum(axis=1) / np.linalg.norm(place, axis=1)
        pixel = camera.project(place)
        inside = (pixel > 0).all(axis=1) & (pixel < camera.image_size).all(axis=1)
        ring = np.flatnonzero((faces > 0.3) & inside)
        noise = 0.0 if rng is None else rng.normal(0, noise_px, (len(ring), 2))
        seen = Detections(
            f"{row}.png", camera.image_size, target.layout_id, target.geometry_id, ring, position[ring],
            pixel[ring] + noise, np.tile(NOISE_PX**2 * np.eye(2), (len(ring), 1, 1)),
            np.tile([0, 0, 30.0, 20.0, 0.3], (len(ring), 1)), (),
        )  # fmt: skip
        if rng is None:
            start = target_poses([seen], target, camera, weighted=True).poses[0].cam_from_target
        else:
            start = (known or rig).cam_from_rig[row] @ pose
        sights.append(CameraSight(row, seen, start))
    return sights


def found_of(target: TargetGeometry, rig: Rig, sights: list[CameraSight], *, weighted: bool = True) -> RigPose:
    found = pose_in_rig(rig, sights, target.center_mm, weighted=weighted)
    assert found is not None
    return found


def off(found: Array, true: Array) -> Array:
    """The error of a pose as covariances have it."""
    return steps_between(true[None], found[None])[0]


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


@pytest.mark.parametrize(("kind", "missing"), [("ring", 1), ("pair", None)])
def test_ellipsoids_hold_the_truth_as_often_as_they_say(kind: str, missing: int | None) -> None:
    """Of rigs drawn from the covariance 95 % ellipsoids hold the truth in 93 to 97 %, those of noise in far less."""
    target, rig, poses = solved(kind)
    rng = np.random.default_rng(6)
    inside, by_noise, enlarged, count = 0, 0, 0, 200
    for number in range(count):
        pose = poses[number % len(poses)]
        sights = [one for one in sights_of(target, drawn(rig, rng), pose, rng, rig) if one.camera != missing]
        found = found_of(target, rig, sights)
        error = off(found.rig_from_target, pose)
        inside += error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.95, 6)
        by_noise += error @ np.linalg.solve(found.noise, error) < chi2.ppf(0.95, 6)
        enlarged += found.excess > 1
    assert 0.93 <= inside / count <= 0.97
    assert by_noise / count < 0.8
    assert enlarged / count < 0.05


def test_of_an_exact_rig_the_pose_scatters_as_noise_lets_it() -> None:
    """Weighted or not; the noise that is not stated is what is left over."""
    target, rig, poses = solved("pair")
    exact, rng = replace(rig, covariance=None), np.random.default_rng(5)
    for weighted, times in ((True, 1.0), (False, 1.0), (False, 3.0)):
        found = []
        for _ in range(80):
            sights = sights_of(target, exact, poses[0], rng, noise_px=times * NOISE_PX)
            found.append(found_of(target, exact, sights, weighted=weighted))
        error = np.array([off(one.rig_from_target, poses[0]) for one in found])
        assert found[0].calibration is None
        assert error.std(axis=0) == pytest.approx(np.sqrt(np.diag(found[0].noise)), rel=0.3)


def test_a_camera_that_was_moved_is_told_and_makes_the_pose_less_sure() -> None:
    """What neither noise nor the rig's covariance lets expect is in the stated covariance, and not called good."""
    target, rig, poses = solved("ring")
    moved = rig.cam_from_rig.copy()
    moved[1, 0, 3] += 3.0
    rng = np.random.default_rng(6)
    sights = sights_of(target, replace(rig, cam_from_rig=moved), poses[0], rng, rig)
    found = found_of(target, rig, sights)
    assert found.excess > 3.0
    assert found.covariance == pytest.approx(found.excess**2 * (found.noise + found.calibration))


def test_what_tells_no_pose_gives_none() -> None:
    """Cameras that see three rings each, and the start of none."""
    target, rig, poses = solved("pair")
    few = [
        replace(one, seen=one.seen.keep(slice(3)), cam_from_target=None)
        for one in sights_of(target, rig, poses[0], None)
    ]
    assert pose_in_rig(rig, few, target.center_mm) is None
