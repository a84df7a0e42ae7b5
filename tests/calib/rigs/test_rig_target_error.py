"""What errors of the target do to a rig: stated against true, the target's size above all."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose
from calib.core.types import RigObservations
from calib.observe.observations import known_points
from calib.rigs.problem import FREE_SIZE, CameraChoice, Carrier, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from designer.base.arrays import Array
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import EXACT, Made, how_made
from designer.tolerance.model import perturb
from designer.tolerance.prior import ShapePrior
from tests.support.as_built_scenes import solid
from tests.support.rig_views import RigScene, residuals_of, ring
from tests.support.solver_scenes import CAMERAS, observe, poses_around

AS_PRINTED = "fdm-dual"
TOO_LARGE = 1e-3


def _solved(made: TargetGeometry, seed: int = 0, frames: int = 8) -> tuple[RigScene, RigCalibration]:
    """Photos of a part by three cameras, solved as if it were as drawn."""
    scene = ring(known_points(made), count=3, frames=frames, noise_px=0.05, seed=seed)
    seen = scene.observations
    drawn = known_points(solid())
    seen = replace(seen, sightings=tuple(replace(one, points=drawn) for one in seen.sightings))
    scene = replace(scene, observations=seen)
    return scene, solve_rig(seen, [CameraChoice("opencv")] * 3)


def _size_prior() -> Made:
    """Of the size alone, and nothing else."""
    places = solid().center_mm
    return Made("a test", "", ShapePrior(TOO_LARGE * places[None], np.zeros((len(places), 3, 0))))


def _told_mm(found: RigCalibration, camera: int) -> Array:
    """Standard deviations of a camera's place by the target, least first; and along the line from the rig's frame."""
    assert found.target_covariance is not None
    rows = found.rig.pose_rows(camera)
    shift = found.target_covariance[rows, rows][3:, 3:]
    away = found.cam_from_rig[camera, :3, 3]
    return np.sqrt([*np.maximum(np.linalg.eigvalsh(shift), 0.0), away @ shift @ away / (away @ away)])


@pytest.mark.parametrize("is_at_minimum", [True, False])
def test_the_size_of_the_target_moves_all_cameras_apart_in_proportion(is_at_minimum: bool) -> None:
    """A size known to .1 % is .1 % of each baseline, along it alone; no lens, and no photo, knows it better.

    Nor does a solution that is not quite the least-squares one, as by a robust loss, tell anything of it.
    """
    scene, found = _solved(solid())
    if not is_at_minimum:
        sigma = np.sqrt(np.diagonal(found.covariance)[found.rig.pose_rows(1)][3:])
        cam_from_rig = np.array(found.cam_from_rig)
        cam_from_rig[1, :3, 3] += 0.3 * sigma
        frames, sightings = found.observations.frame[1], found.observations.sightings[1]
        moved = residuals_of(found.cameras[1], cam_from_rig[1], found.rig_from_target[frames], sightings)
        residuals = (found.residual_px[0], moved, *found.residual_px[2:])
        found = replace(found, cam_from_rig=cam_from_rig, residual_px=residuals)
    found = with_target_error(found, _size_prior())
    assert found.target_covariance is not None
    for camera in (1, 2):
        baseline = np.linalg.norm(scene.cam_from_rig[camera, :3, 3])
        _, across, along, in_line = _told_mm(found, camera)
        assert in_line == pytest.approx(TOO_LARGE * baseline, rel=1e-2)
        assert along == pytest.approx(in_line, rel=1e-4)
        assert across < 1e-3 * along
    lens = found.rig.params_rows(0)
    by_target, by_noise = np.diagonal(found.target_covariance)[lens], np.diagonal(found.covariance)[lens]
    assert (by_target < 1e-6 * by_noise).all()


def test_prints_of_a_way_of_making_are_covered() -> None:
    """Over drawn prints the cameras' places are off about as far as stated, and far more than the noise would tell."""
    stated, noise = [], []
    for seed in range(4):
        made = perturb(solid(), error_model(AS_PRINTED), np.random.default_rng(seed))
        scene, found = _solved(made, seed)
        told = with_target_error(found, how_made(solid(), AS_PRINTED))
        for camera in (1, 2):
            turn = scene.cam_from_rig[camera, :3, :3] @ found.cam_from_rig[camera, :3, :3].T
            shift = scene.cam_from_rig[camera, :3, 3] - found.cam_from_rig[camera, :3, 3]
            error = np.concatenate([log_rotation(turn), shift])
            rows = told.rig.pose_rows(camera)
            stated.append(error / np.sqrt(np.diagonal(told.stated_covariance)[rows]))
            noise.append(error / np.sqrt(np.diagonal(told.covariance)[rows]))
    assert 0.6 < np.sqrt(np.mean(np.square(stated))) < 1.5
    assert np.sqrt(np.mean(np.square(noise))) > 2.5


def test_of_an_exact_target_nothing_is_added() -> None:
    """Exact is said to be so; of what nobody knows nothing is said."""
    _, found = _solved(solid())
    exact = with_target_error(found, how_made(solid(), EXACT))
    assert exact.target_covariance is not None
    assert not exact.target_covariance.any()
    assert with_target_error(found, None).target_covariance is None


def test_a_robot_tells_the_size_in_part_and_what_is_left_is_stated() -> None:
    """Of a target .1 % too large before a camera on a robot, places are off as stated: less than without the robot.

    Where the size was an unknown, its error does nothing more.
    """
    poses = poses_around(12, np.random.default_rng(0), half_angle_deg=100.0, distance_mm=500.0)
    cam_from_flange = make_pose(exp_rotation(np.array([[0.05, 0.02, 0.1]])), np.array([[10.0, 20.0, 30.0]]))
    base_from_target = make_pose(np.eye(3), np.array([500.0, 100.0, 50.0]))
    drawn = known_points(solid())
    made = replace(drawn, position_mm=(1 + TOO_LARGE) * drawn.position_mm)
    seen = observe(CAMERAS["opencv"], made, poses, np.random.default_rng(1), noise_px=0.05)
    seen = replace(seen, points=drawn, cov_px2=np.tile(0.05**2 * np.eye(2), (len(seen.view), 1, 1)))
    rig = RigObservations(("camera",), seen.view_names, (seen,), (np.arange(12),))
    flange_from_base = invert(cam_from_flange) @ poses @ invert(base_from_target)
    off = np.random.default_rng(2).normal(0, 1, (12, 6)) * np.repeat([1e-5, 0.02], 3)
    said = make_pose(exp_rotation(off[:, :3]), off[:, 3:]) @ flange_from_base
    carrier = Carrier("robot, camera in hand", said, is_camera_in_hand=True)
    found = with_target_error(solve_rig(rig, [CameraChoice("opencv")], RigOptions(carrier=carrier)), _size_prior())
    error = np.abs(found.cam_from_rig[0, :3, 3] - cam_from_flange[0, :3, 3])
    stated, noise = (
        np.sqrt(np.diagonal(one)[found.rig.pose_rows(0)][3:]) for one in (found.stated_covariance, found.covariance)
    )
    assert (error < 3 * stated).all()
    assert (error > 3 * noise).any()
    assert stated.max() < 0.7 * TOO_LARGE * 500.0
    free = solve_rig(rig, [CameraChoice("opencv")], RigOptions(carrier=replace(carrier, size_sigma=FREE_SIZE)))
    assert free.carrier is not None
    assert free.carrier.size == pytest.approx(1 + TOO_LARGE, abs=4 * free.carrier.size_sigma)
    by_target, by_noise = (
        np.sqrt(np.diagonal(one)[free.rig.pose_rows(0)])
        for one in (with_target_error(free, _size_prior()).stated_covariance, free.covariance)
    )
    assert by_target == pytest.approx(by_noise, rel=0.05)


def test_some_frames_stand_for_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of more sightings than equations are made of, every other frame tells what all of them do, but for its chance."""
    made = perturb(solid(), error_model(AS_PRINTED), np.random.default_rng(0))
    _, found = _solved(made, frames=24)
    whole = with_target_error(found, how_made(solid(), AS_PRINTED))
    monkeypatch.setattr("calib.rigs.target_error.MOST_SIGHTINGS", sum(map(len, found.residual_px)) // 2 + 1)
    part = with_target_error(found, how_made(solid(), AS_PRINTED))
    for camera in (1, 2):
        rows = found.rig.pose_rows(camera)
        some, every = (np.sqrt(np.diagonal(one.stated_covariance)[rows][3:].sum()) for one in (part, whole))
        assert some == pytest.approx(every, rel=0.3)
        assert some != every
