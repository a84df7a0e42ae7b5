"""What is stated of a rig beyond noise, against what is true: errors of the target, bends, what photos share."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras import project
from calib.core.se3 import exp_rotation, invert, make_pose, steps_between, transform
from calib.core.types import Observations, RigObservations
from calib.judge.folders import write_rig
from calib.observe.calibration_file import Provenance, read_calibration
from calib.observe.observations import known_points
from calib.observe.robot_poses import RobotPoses
from calib.rigs.problem import FREE_SIZE, CameraChoice, Mechanism, RigOptions
from calib.rigs.relative import carried_error
from calib.rigs.result import RigCalibration, as_given
from calib.rigs.shared_errors import with_shared_errors
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import with_target_error
from calib.solver.calibration import plane_bend
from calib.solver.metrics.errors import summarise
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions
from calib.solver.start import solve_poses
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import EXACT, Made, how_made
from designer.tolerance.model import perturb
from designer.tolerance.prior import ShapePrior
from tests.support import rig_views, solver_scenes
from tests.support.as_built_scenes import solid
from tests.support.rig_views import RigScene, residuals_of, ring, stereo_pair
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
            error = steps_between(found.cam_from_rig, scene.cam_from_rig)[camera]
            rows = told.rig.pose_rows(camera)
            stated.append(error / np.sqrt(np.diagonal(told.stated_covariance)[rows]))
            noise.append(error / np.sqrt(np.diagonal(told.covariance)[rows]))
    assert 0.6 < np.sqrt(np.mean(np.square(stated))) < 1.5
    assert np.sqrt(np.mean(np.square(noise))) > 2.5


def test_of_an_exact_target_nothing_is_added() -> None:
    """Exact is said to be so; of what nobody knows nothing is said."""
    _, found = _solved(solid())
    exact = with_target_error(found, how_made(solid(), EXACT))
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
    carrier = Mechanism("robot, camera in hand", said, is_camera_in_hand=True)
    found = with_target_error(solve_rig(rig, [CameraChoice("opencv")], RigOptions(carrier=carrier)), _size_prior())
    error = np.abs(found.cam_from_rig[0, :3, 3] - cam_from_flange[0, :3, 3])
    stated, noise = (
        np.sqrt(np.diagonal(one)[found.rig.pose_rows(0)][3:]) for one in (found.stated_covariance, found.covariance)
    )
    assert (error < 3 * stated).all()
    assert (error > 3 * noise).any()
    assert stated.max() < 0.7 * TOO_LARGE * 500.0
    free = solve_rig(rig, [CameraChoice("opencv")], RigOptions(carrier=replace(carrier, size_sigma=FREE_SIZE)))
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


CAM_FROM_FLANGE = make_pose(exp_rotation(np.array([0.1, -0.2, 1.0])), np.array([30.0, -20.0, 60.0]))
BASE_FROM_TARGET = make_pose(exp_rotation(np.array([0.3, 0.1, -0.4])), np.array([400.0, 100.0, 50.0]))
HEIGHT_MM = (-0.6, 0.9)


def _bent_pair(frames: int = 14) -> tuple[RigScene, Observations]:
    """Two cameras and a board that bows, and what the first of them sees; the sightings name the flat points."""
    flat = solver_scenes.board(9, 7, 20.0)
    bend = replace(plane_bend(flat), height_mm=(*HEIGHT_MM, 0.2, 0.0, -0.1))
    shape_mm = np.tensordot(bend.height_mm, bend.modes_mm(flat.position_mm), 1)
    scene = rig_views.stereo_pair(
        replace(flat, position_mm=flat.position_mm + shape_mm), frames=frames, noise_px=0.05, seed=3
    )
    sightings = tuple(replace(one, points=flat) for one in scene.observations.sightings)
    return replace(scene, observations=replace(scene.observations, sightings=sightings)), sightings[0]


def test_a_free_bend_puts_the_camera_where_it_sits() -> None:
    """On a robot, with the bend as an unknown, the truth is within what is stated; the bend is told."""
    scene, seen = _bent_pair()
    rows = scene.observations.frame[0]
    flange_from_base = invert(CAM_FROM_FLANGE) @ scene.rig_from_target[rows] @ invert(BASE_FROM_TARGET)
    rng = np.random.default_rng(5)
    wobble = make_pose(exp_rotation(rng.normal(0, 1e-4, (len(rows), 3))), rng.normal(0, 0.05, (len(rows), 3)))
    poses = RobotPoses(seen.view_names, invert(wobble @ flange_from_base), "robot.csv")
    found = calib.hand_eye(None, table=seen, robot=poses, model="opencv", free_bend=True)
    covariance = found.hand_eye.covariance
    assert covariance is not None
    (off,) = steps_between(CAM_FROM_FLANGE[None], invert(found.hand_eye.flange_from_cam)[None])
    assert off @ np.linalg.solve(covariance, off) < 25
    assert any("the target is bent" in remark for remark in found.remarks)


def test_a_rig_has_the_bend_among_its_unknowns() -> None:
    """The bend and the pair are within what is stated, which they are not of a flat board; the points are moved."""
    scene, _ = _bent_pair()
    choices = [CameraChoice("opencv")] * 2
    found, flat = (solve_rig(scene.observations, choices, RigOptions(free_bend=free)) for free in (True, False))
    bend = found.target_bend
    assert bend is not None
    off = np.subtract(bend.height_mm, (*HEIGHT_MM, 0.2, 0.0, -0.1))
    assert off @ np.linalg.solve(bend.covariance, off) < 25
    rows = found.rig.pose_rows(1)
    for one, most in ((found, 25.0), (flat, np.inf)):
        (off,) = steps_between(one.cam_from_rig[1:], scene.cam_from_rig[1:])
        square = off @ np.linalg.solve(one.covariance[rows, rows], off)
        assert square < most
    assert square > 25
    assert (flat.scale > 2 * found.scale).all()
    again = solve_rig(found.observations, choices)
    assert again.scale == pytest.approx(found.scale, rel=0.01)
    assert np.allclose(as_given(found).points.position_mm, scene.observations.points.position_mm, atol=1e-9)


def test_a_camera_of_a_rig_is_held_out_as_it_was_solved(tmp_path: Path) -> None:
    """By its folder: with the board's bend, what was kept and what was known; all of a lens that was given is kept."""
    scene, _ = _bent_pair()
    known = ParameterPrior("fx_px", float(scene.cameras[0].params[0]), 0.01)
    choices = [
        CameraChoice("opencv", fixed=(("k3", 0.0),), priors=(known,)),
        CameraChoice(scene.cameras[1].model, scene.cameras[1], is_refined=False),
    ]
    found = solve_rig(scene.observations, choices, RigOptions(free_bend=True))
    write_rig(tmp_path, found, Provenance("test 1", options=SolveOptions(loss="huber")))
    for camera, one in enumerate(found.alone):
        folder = tmp_path / "cameras" / found.observations.camera_names[camera]
        options = read_calibration(folder / "calibration.json")[1].options
        assert options.loss == "huber"
        assert options.priors == choices[camera].priors
        assert options.fixed == tuple((name, one.camera.parameters[name]) for name in one.fixed)
        errors = calib.evaluate(folder, held_out=4)
        assert errors.held_out is not None
        held_px, solved_px = (summarise(on.errors[0]).rmse for on in (errors.held_out, errors.solved_from))
        assert held_px < 1.5 * solved_px


def test_a_solid_has_no_bend() -> None:
    """It is refused in a line."""
    scene = rig_views.ring(frames=8, count=2)
    with pytest.raises(InputError, match="lie in no plane"):
        solve_rig(scene.observations, [CameraChoice("opencv")] * 2, RigOptions(free_bend=True))


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
    assert all(one.photo_covariance is None and one.capture_covariance is None and not one.remarks for one in found)
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


def test_no_remedy_of_one_camera_is_named_for_rigs() -> None:
    """A focal length that follows the distance, which a camera by itself may have solved, is to be mended."""
    scene = stereo_pair(frames=FRAMES)
    seen = scene.observations.sightings[1]
    depth = (scene.cam_from_rig[1] @ scene.rig_from_target)[scene.observations.frame[1], 2, 3]
    far = ((depth - depth.mean()) / np.ptp(depth))[seen.view, None]
    (said,) = solved(moved(scene, 1, 2e-3 * far * (seen.center_px - scene.cameras[1].params[2:4]))).remarks
    assert "a focal length that changes with the distance" in said
    assert "focus by hand" in said
    assert "--" not in said


def robot_mm(seed: int) -> tuple[float, float]:
    """How far a camera on a robot places a target wrong, and what is stated of that."""
    rng = np.random.default_rng(seed)
    scene = rig_views.stereo_pair(solver_scenes.board(6, 5, 30.0), frames=12, noise_px=0.1, seed=seed)
    seen, rows = scene.observations.sightings[0], scene.observations.frame[0]
    true, points = scene.rig_from_target[rows], seen.points  # the rig's frame is the first camera's
    wobble = make_pose(exp_rotation(rng.normal(0, 5e-4, (len(rows), 3))), rng.normal(0, 0.2, (len(rows), 3)))
    carrier = Mechanism(
        "robot, camera in hand", wobble @ invert(CAM_FROM_FLANGE) @ true, is_camera_in_hand=True, size_sigma=FREE_SIZE
    )
    one = RigObservations(("cam",), seen.view_names, (seen,), (np.arange(len(rows)),))
    found = solve_rig(one, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    error = carried_error(found)
    clean = project(scene.cameras[0], transform(true[seen.view], points.position_mm[seen.point]))
    again = solve_poses(found.cameras[0], replace(seen, center_px=clean)).cam_from_target
    off = transform(invert(found.cam_from_rig[0]) @ again, points.middle_mm) - transform(
        invert(CAM_FROM_FLANGE) @ true, points.middle_mm
    )
    return float(np.sqrt(np.square(off).sum(axis=1).mean())), error.sigma_mm


def test_what_is_stated_of_a_seen_target_is_what_robots_are_off() -> None:
    """Lens and direction of a camera are off together, and undo each other at the target."""
    off_mm, stated_mm = np.array([robot_mm(seed) for seed in range(8)]).T
    assert np.sqrt(np.mean((off_mm / stated_mm) ** 2)) == pytest.approx(1, abs=0.3)
