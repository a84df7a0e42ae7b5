"""A board that bows, before a robot's camera."""

from dataclasses import replace

import numpy as np
import pytest

import calib
from calib.core.se3 import exp_rotation, invert, log_rotation, make_pose
from calib.core.types import Observations
from calib.observe.robot_poses import RobotPoses
from calib.rigs.bent import bent_alone, with_bend_error
from calib.rigs.problem import CameraChoice, Carrier, RigOptions
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.solver.plane_bend import plane_bend
from designer.base.errors import InputError
from tests.support import rig_views, solver_scenes

CAM_FROM_FLANGE = make_pose(exp_rotation(np.array([0.1, -0.2, 1.0])), np.array([30.0, -20.0, 60.0]))
BASE_FROM_TARGET = make_pose(exp_rotation(np.array([0.3, 0.1, -0.4])), np.array([400.0, 100.0, 50.0]))
HEIGHT_MM = (-0.6, 0.9)


def _seen_bent() -> tuple[Observations, RobotPoses]:
    """What a robot's camera sees of a board that bows, and the robot's poses; the sightings name the flat points."""
    flat = solver_scenes.board(9, 7, 20.0)
    bend = replace(plane_bend(flat), height_mm=HEIGHT_MM)
    scene = rig_views.stereo_pair(
        replace(flat, position_mm=flat.position_mm + np.tensordot(HEIGHT_MM, bend.modes_mm(flat.position_mm), 1)),
        frames=14, noise_px=0.05, seed=3,
    )  # fmt: skip
    seen, rows = scene.observations.sightings[0], scene.observations.frame[0]
    flange_from_base = invert(CAM_FROM_FLANGE) @ scene.rig_from_target[rows] @ invert(BASE_FROM_TARGET)
    rng = np.random.default_rng(5)
    wobble = make_pose(exp_rotation(rng.normal(0, 1e-4, (len(rows), 3))), rng.normal(0, 0.05, (len(rows), 3)))
    poses = RobotPoses(seen.view_names, invert(wobble @ flange_from_base), "robot.csv")
    return replace(seen, points=flat), poses


def test_a_free_bend_puts_the_camera_where_it_sits() -> None:
    """With the bend as an unknown the truth is within what is stated, which has the bend's share; the bend is told."""
    seen, poses = _seen_bent()
    found = calib.hand_eye(None, table=seen, robot=poses, model="opencv", free_bend=True)
    covariance = found.hand_eye.covariance
    assert covariance is not None
    pose = invert(found.hand_eye.flange_from_cam)
    off = np.concatenate([log_rotation(pose[:3, :3] @ CAM_FROM_FLANGE[:3, :3].T), pose[:3, 3] - CAM_FROM_FLANGE[:3, 3]])
    assert off @ np.linalg.solve(covariance, off) < 25
    rows = found.rig.pose_rows(0)
    assert found.calibration.target_covariance is not None
    assert (np.diagonal(found.calibration.target_covariance)[rows] > 0).all()
    assert any("the target is bent" in remark for remark in found.remarks)


def test_what_a_bend_is_unsure_by_moves_the_rig_as_solving_again_does() -> None:
    """To first order: two solutions with points bent a little more and less."""
    seen, poses = _seen_bent()
    one, bend = bent_alone(seen, CameraChoice("opencv"))
    assert bend.height_mm == pytest.approx(HEIGHT_MM, abs=5 * max(bend.sigma_mm))
    step_mm = 0.02
    sure = replace(bend, covariance_mm2=(step_mm**2, 0.0, 0.0))
    carrier = Carrier(
        "robot, camera in hand", invert(poses.base_from_flange), is_camera_in_hand=True, sigma_rad=1e-4, sigma_mm=0.05
    )

    def solved(height_mm: float) -> RigCalibration:
        moved = replace(bend, height_mm=(height_mm, 0.0)).bent(one)
        frames = np.arange(one.view_count)
        every = rig_views.RigObservations(("camera",), one.view_names, (moved,), (frames,))
        return solve_rig(every, [CameraChoice("opencv")], RigOptions(carrier=carrier, allows_slack=False))

    found = solved(0.0)
    told = with_bend_error(found, sure).target_covariance
    assert told is not None
    rows = found.rig.pose_rows(0)
    ahead, behind = (solved(height).cam_from_rig[0] for height in (step_mm, -step_mm))
    moved_mm = 0.5 * (ahead[:3, 3] - behind[:3, 3])
    assert np.sqrt(np.diagonal(told)[rows][3:]) == pytest.approx(np.abs(moved_mm), rel=0.1, abs=2e-3)


def test_a_solid_has_no_bend() -> None:
    """It is refused in a line."""
    scene = rig_views.ring(frames=8, count=2)
    with pytest.raises(InputError, match="lie in no plane"):
        bent_alone(scene.observations.sightings[0], CameraChoice("opencv"))
