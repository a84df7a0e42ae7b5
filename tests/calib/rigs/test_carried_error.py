"""What is stated of a target that a camera on a robot sees, and what simulated robots are off."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras import project
from calib.core.se3 import exp_rotation, invert, make_pose, transform
from calib.core.types import RigObservations
from calib.rigs.problem import FREE_SIZE, CameraChoice, Carrier, RigOptions
from calib.rigs.relative import carried_error
from calib.rigs.solve import solve_rig
from calib.solver.start import solve_poses
from tests.support import rig_views, solver_scenes

CAM_FROM_FLANGE = make_pose(exp_rotation(np.array([0.1, -0.2, 1.0])), np.array([30.0, -20.0, 60.0]))


def robot_mm(seed: int) -> tuple[float, float]:
    """How far a camera on a robot places a target wrong, and what is stated of that."""
    rng = np.random.default_rng(seed)
    scene = rig_views.stereo_pair(solver_scenes.board(6, 5, 30.0), frames=12, noise_px=0.1, seed=seed)
    seen, rows = scene.observations.sightings[0], scene.observations.frame[0]
    true, points = scene.rig_from_target[rows], seen.points  # the rig's frame is the first camera's
    wobble = make_pose(exp_rotation(rng.normal(0, 5e-4, (len(rows), 3))), rng.normal(0, 0.2, (len(rows), 3)))
    carrier = Carrier(
        "robot, camera in hand", wobble @ invert(CAM_FROM_FLANGE) @ true, is_camera_in_hand=True, size_sigma=FREE_SIZE
    )
    one = RigObservations(("cam",), seen.view_names, (seen,), (np.arange(len(rows)),))
    found = solve_rig(one, [CameraChoice("opencv")], RigOptions(carrier=carrier))
    error = carried_error(found)
    assert error is not None
    clean = project(scene.cameras[0], transform(true[seen.view], points.position_mm[seen.point]))
    again = solve_poses(found.cameras[0], replace(seen, center_px=clean)).cam_from_target
    off = transform(invert(found.cam_from_rig[0]) @ again, points.middle_mm) - transform(
        invert(CAM_FROM_FLANGE) @ true, points.middle_mm
    )
    return float(np.sqrt(np.square(off).sum(axis=1).mean())), error.sigma_mm


def test_what_is_stated_of_a_seen_target_is_what_robots_are_off() -> None:
    """Lens and direction of a camera are off together, and undo each other at the target."""
    off_mm, stated_mm = np.array([robot_mm(seed) for seed in range(12)]).T
    assert np.sqrt(np.mean((off_mm / stated_mm) ** 2)) == pytest.approx(1, abs=0.3)
