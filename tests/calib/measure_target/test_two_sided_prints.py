"""Boards with two faces as they were printed: what photos tell of them, what a caliper does, and facing cameras."""

from dataclasses import replace

import numpy as np
import pytest

from calib.app.measure import rescale
from calib.core.se3 import invert, log_rotation, look_at, make_pose
from calib.core.types import Observations
from calib.measure_target.back import back_covariance, with_thickness
from calib.measure_target.lengths import CaliperLength
from calib.measure_target.solve import measure
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.observations import known_points
from calib.solver.solve import solve
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from designer.tolerance.error_file import error_model
from designer.tolerance.made import how_made
from designer.tolerance.model import displaced, perturb
from tests.support.as_built_scenes import frame_errors, mahalanobis
from tests.support.solver_scenes import CAMERAS, observe, poses_around

NOISE_PX = 0.02


def plate() -> TargetGeometry:
    """7 x 6 rings of 14 mm on each side of 5 mm."""
    spec = BoardSpec((150.0, 130.0), 5.0, 7, 6, "square", 14.0, 0.45, 20.0, 0.0, 1.0, dots=True, two_sided=True)
    return replace(lay_out(spec), build="one-piece")


def from_both_sides(print_: TargetGeometry, rng: np.random.Generator, views: int = 20) -> Observations:
    """Every second photo is of the back."""
    poses = poses_around(views, rng)
    turn = make_pose(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    poses[1::2] = poses[1::2] @ turn
    return observe(CAMERAS["opencv"], known_points(print_), poses, rng, noise_px=NOISE_PX, incidence_deg=70)


def test_the_print_is_measured_and_the_back_stays_as_designed() -> None:
    """A skewed print of another thickness: skew is found; the back is as uncertain as it was made."""
    target, rng = plate(), np.random.default_rng(3)
    model = error_model("fdm-board-two-sided")
    values = {"skew": np.array([[3e-3, 0, 0]]), "face_offset": np.array([[0.0], [0.08]])}
    print_ = displaced(target, values, model=model)
    found = measure([from_both_sides(print_, rng)], target, "opencv", AsBuiltOptions(made=how_made(target)))
    assert found.status == "converged"
    assert found.is_determined.all()
    assert 2 * abs(found.strain[0, 1]) == pytest.approx(3e-3, rel=0.05)
    assert found.target.target_from_face[1, 2, 3] == pytest.approx(-5.0, abs=0.01)
    assert found.motion_covariance[11, 11] == pytest.approx(2 * 0.05**2, rel=0.1)
    assert "--length 'face 0 to face 1:READING'" in found.remarks[-1]


def test_a_caliper_tells_the_thickness_and_nothing_else() -> None:
    """The back moves to the reading, with its sigma; rings keep their distances; with and without photos."""
    target, rng = plate(), np.random.default_rng(4)
    length = CaliperLength("face 0 to face 1", 5.08, 0.02)
    seen = [from_both_sides(target, rng)]
    plain, told = (
        measure(seen, target, "opencv", AsBuiltOptions(made=how_made(target)), lengths) for lengths in ((), (length,))
    )
    back = target.ring_face == 1
    assert told.target.center_mm[~back] == pytest.approx(plain.target.center_mm[~back], abs=1e-9)
    assert (told.target.center_mm - plain.target.center_mm)[back] == pytest.approx(
        np.tile([0, 0, -0.08], (int(back.sum()), 1)), abs=1e-3
    )
    assert not told.scale_known
    assert told.motion_covariance[11, 11] ** 0.5 == pytest.approx(0.02, rel=0.05)
    quick = rescale(target, length)
    assert quick.size is None
    assert np.array_equal(quick.target.center_mm, with_thickness(target, 5.08).center_mm)
    assert np.array_equal(quick.target.center_mm[~back], target.center_mm[~back])
    wide = rescale(target, CaliperLength("ring 0 to ring 6", 120.6, 0.02))
    assert wide.size is not None
    assert wide.size.value == pytest.approx(0.005)


def test_the_backs_uncertainty_is_that_of_prints() -> None:
    """Prints drawn from the errors put the back against the front as the covariance says (chi-square of 6 numbers)."""
    target, model, rng = plate(), error_model("sheet-two-sided"), np.random.default_rng(5)
    model = replace(model, amounts=tuple(one for one in model.amounts if one[0].startswith("face_")))
    covariance = back_covariance(target, model)
    squares = []
    for _ in range(300):
        print_ = perturb(target, model, rng)
        frame = print_.target_from_face
        laid = target.target_from_face[0] @ invert(frame[:1])[0] @ frame[1]
        moved = replace(target, target_from_face=np.stack([target.target_from_face[0], laid]))
        squares.append(mahalanobis(frame_errors(moved, target)[1:], covariance[None])[0])
    assert np.mean(squares) == pytest.approx(6, rel=0.15)


def test_cameras_that_face_each_other_are_placed_by_the_board_between_them() -> None:
    """Each sees its own side at the same moments: where they stand to each other follows, thickness included."""
    target, rng = plate(), np.random.default_rng(6)
    camera, views = CAMERAS["opencv"], 60
    first = look_at(np.array([[0.0, 0.0, 450.0]]), np.zeros((1, 3)), np.zeros(1))[0]
    second = look_at(np.array([[20.0, 10.0, -430.0]]), np.zeros((1, 3)), np.ones(1))[0]
    wander = poses_around(views, rng, half_angle_deg=45.0, distance_mm=1.0, aim_mm=0.2)  # of the board in the rig
    wander[:, :3, 3] = rng.uniform(-25, 25, (views, 3))
    upright = np.diag([1.0, -1.0, -1.0, 1.0])
    true = second @ invert(first[None])[0]

    def second_from_first(thickness_mm: float) -> np.ndarray:
        points = known_points(with_thickness(target, thickness_mm))
        poses = []
        for cam_from_rig in (first, second):
            seen = observe(camera, known_points(target), cam_from_rig @ upright @ wander, rng, noise_px=NOISE_PX)
            poses.append(solve(replace(seen, points=points), "opencv").cam_from_target)
        return np.asarray(poses[1] @ invert(poses[0]))

    for thickness_mm, off_mm in ((5.0, 0.0), (5.5, 0.5)):
        error = second_from_first(thickness_mm) @ invert(true[None])
        shift = np.linalg.norm(np.median(error[:, :3, 3], axis=0))
        assert shift == pytest.approx(off_mm, abs=0.15)
        assert np.degrees(np.linalg.norm(log_rotation(error[:, :3, :3]), axis=1)).max() < 0.05
