"""What photos of a rig share beyond noise is named, and in what is stated."""

from dataclasses import replace

import numpy as np

from calib.core.se3 import steps_between
from calib.rigs.problem import CameraChoice
from calib.rigs.result import RigCalibration
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from designer.base.arrays import Array
from tests.support.rig_views import RigScene, stereo_pair

REACH_PX, FRAMES, RUNS = 150.0, 16, 6


def solved(scene: RigScene) -> RigCalibration:
    """With what its photos share."""
    return with_shared_errors(solve_rig(scene.observations, [CameraChoice("opencv")] * 2))


def moved(scene: RigScene, camera: int, by_px: Array) -> RigScene:
    """With the centres of one camera elsewhere."""
    sightings = list(scene.observations.sightings)
    sightings[camera] = replace(sightings[camera], center_px=sightings[camera].center_px + by_px)
    return replace(scene, observations=replace(scene.observations, sightings=tuple(sightings)))


def alike(scene: RigScene, seed: int) -> RigScene:
    """With errors that neighbouring centres of a photo share."""
    rng = np.random.default_rng([seed, 1])
    for camera, seen in enumerate(scene.observations.sightings):
        error_px = np.zeros_like(seen.center_px)
        for view in range(seen.view_count):
            own = seen.view == view
            apart = np.linalg.norm(seen.center_px[own][:, None] - seen.center_px[own], axis=2) / REACH_PX
            root = np.linalg.cholesky(np.exp(-(apart**2) / 2) + 1e-6 * np.eye(len(apart)))
            error_px[own] = 0.1 * root @ rng.standard_normal((len(apart), 2))
        scene = moved(scene, camera, error_px)
    return scene


def mean_square(scenes: list[RigScene], found: list[RigCalibration], *, alone: bool) -> float:
    """Of the second camera's pose in deviations, by the noise alone or as they are stated; 1 if they are honest."""
    squares = []
    for scene, one in zip(scenes, found, strict=True):
        rows = one.rig.pose_rows(1)
        step = steps_between(one.cam_from_rig[1:], scene.cam_from_rig[1:])[0]
        covariance = (one.covariance if alone else one.stated_covariance)[rows, rows]
        squares.append(float(step @ np.linalg.solve(covariance, step)) / 6)
    return float(np.mean(squares))


def test_errors_that_centres_of_a_photo_share_are_stated_and_others_are_not() -> None:
    """Of independent errors nothing is said or added; of shared ones that, and the stated deviations hold."""
    scenes = [stereo_pair(frames=FRAMES, seed=seed) for seed in range(RUNS)]
    found = [solved(scene) for scene in scenes]
    assert all(one.stated_covariance is one.covariance and not one.remarks for one in found)
    scenes = [alike(scene, seed) for seed, scene in enumerate(scenes)]
    found = [solved(scene) for scene in scenes]
    assert all("centres of a frame's photos err together" in one.remarks[-1] for one in found)
    assert mean_square(scenes, found, alone=True) > 4
    assert mean_square(scenes, found, alone=False) < 2.5


def test_a_lens_that_changes_with_time_is_named_alone_and_its_effect_stated() -> None:
    """Of the camera whose lens does, with its amount; no other cause is named for it."""
    scenes = []
    for seed in range(RUNS):
        scene = stereo_pair(frames=FRAMES, seed=seed)
        seen = scene.observations.sightings[1]
        late = np.linspace(-1, 1, seen.view_count)[seen.view, None]
        scenes.append(moved(scene, 1, 1e-3 * late * (seen.center_px - scene.cameras[1].params[2:4])))
    found = [solved(scene) for scene in scenes]
    for one in found:
        (said,) = one.remarks
        assert said.startswith("the photos of right show what looks like a focal length that changes with time: ")
        assert 0.8 < float(said.split(": ")[1].split(" ")[0]) < 1.2
    assert mean_square(scenes, found, alone=False) < 2
