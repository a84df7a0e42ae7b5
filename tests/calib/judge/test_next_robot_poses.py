"""The robot's next poses, and plans of photos: what they promise is what a solution with them gives."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import exp_rotation, invert, look_at, make_pose
from calib.core.types import KnownPoints, keep_frames
from calib.judge.checks import read_criteria
from calib.judge.coverage import lit_part, sigma_over_lit_px
from calib.judge.halves import NoHalves, RigHalves, RigSplit, half_split
from calib.judge.judge import Judged
from calib.judge.next_robot_poses import next_robot_poses
from calib.judge.next_views import NextView, next_views
from calib.judge.planned_views import (
    FEWEST,
    PlannedViews,
    PlanWish,
    calibration_before,
    planned_views,
    tried_plan,
    usual_hold,
)
from calib.judge.views import shape_of
from calib.observe.observations import known_points
from calib.observe.robot_poses import read_robot_poses, robot_poses_to_csv
from calib.rigs.problem import FREE_SIZE, CameraChoice, Mechanism, RigOptions
from calib.rigs.relative import center_sigma_mm
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import expected_information, frame_information
from calib.solver.calibration import Calibration
from calib.solver.free_shape import free_directions
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.tolerance.made import how_made
from tests.support import rig_views, solver_scenes
from tests.support.guided_scenes import board_target
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, observe, poses_around
from tests.support.verdict_cases import judge_run

ALONE = NoHalves("not compared")
HAND, TARGET = "robot, camera in hand", "robot, target in hand"
NOISE = 1e-3, 0.1
"""Of the robot: rad, mm."""


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot before a board, as it truly is."""

    kind: str
    cam_from_rig: Array
    carrier_from_target: Array
    base_from_flange: Array  # (V, 4, 4) where it was sent

    def solved(
        self, more: Array | None = None, *, seed: int = 0, is_free: bool = False, allows_offsets: bool = False,
        priors: tuple[ParameterPrior, ...] = (), is_bent: bool = False,
    ) -> RigCalibration:  # fmt: skip
        """By photos from its poses, and from some more."""
        rng = np.random.default_rng(seed)
        sent = self.base_from_flange if more is None else np.concatenate([self.base_from_flange, more])
        told = invert(sent) if self.kind == HAND else sent
        size = (len(sent), 3)
        wobble = make_pose(exp_rotation(rng.normal(0, NOISE[0], size)), rng.normal(0, NOISE[1], size))
        true = wobble @ told if self.kind == HAND else told @ wobble
        poses, lens = self.cam_from_rig @ true @ self.carrier_from_target, rig_views.camera()
        points = solver_scenes.board(9, 7, 20.0)
        scene = rig_views.scene_of(("cam",), (lens,), np.eye(4)[None], poses, points, rng, 0.05)
        rows = scene.observations.frame[0]
        seen = keep_frames(scene.observations, np.isin(np.arange(len(sent)), rows))
        carrier = Mechanism(
            self.kind, told[rows], is_camera_in_hand=self.kind == HAND, sigma_rad=NOISE[0], sigma_mm=NOISE[1],
            size_sigma=FREE_SIZE if is_free else 0.0,
        )  # fmt: skip
        choice = CameraChoice("opencv", None if priors else lens, is_refined=is_free, priors=priors)
        return solve_rig(seen, [choice], RigOptions(carrier=carrier, allows_offsets=allows_offsets, free_bend=is_bent))


def robot(kind: str, *, turns: Array | None = None, seed: int = 4) -> Robot:
    """A robot that turns the camera, or the target, in ten poses; by given rotation vectors (10, 3)."""
    rng = np.random.default_rng(seed)
    x = make_pose(exp_rotation(rng.normal(0, 0.5, 3)), rng.uniform(-60, 60, 3))
    z = make_pose(exp_rotation(rng.normal(0, 0.5, 3)), rng.uniform(-300, 300, 3))
    first = look_at(np.array([0.0, -500.0, 0.0]), np.zeros(3)) @ make_pose(
        exp_rotation(np.array([1.9, 0.2, 0.0])), np.zeros(3)
    )
    turned = rng.uniform(-0.4, 0.4, (10, 3)) if turns is None else turns
    carried = invert(x) @ make_pose(exp_rotation(turned), rng.uniform(-60, 60, (10, 3))) @ first @ invert(z)
    return Robot(kind, x, z, invert(carried) if kind == HAND else carried)


ONE = robot(HAND)


@pytest.fixture(scope="module")
def by_one() -> RigCalibration:
    """What the photos of one robot tell."""
    return ONE.solved()


def place_sigma_mm(found: RigCalibration) -> float:
    return float(center_sigma_mm(found.rig)[0].max())


def turn_sigma_rad(found: RigCalibration) -> float:
    return float(np.sqrt(np.diagonal(found.covariance)[found.rig.pose_rows(0)][:3].max()))


def test_frames_tell_what_the_solution_knows() -> None:
    """The information of all frames together is the inverse of the covariance that the adjustment states.

    With the lens and the target's size as unknowns, and with errors that all of a photo share.
    """
    found = robot(TARGET).solved(is_free=True, allows_offsets=True)
    assert found.slack
    basis = free_directions(found.covariance)
    count = basis.shape[1]
    told = frame_information(found, basis).sum(axis=0) + expected_information(found, count)
    covariance = symmetric_inverse(told).inverse
    stated = np.sqrt(np.diagonal(found.covariance))
    assert np.sqrt(np.diagonal(basis @ covariance[:count, :count] @ basis.T)) == pytest.approx(stated, rel=1e-3)
    assert np.sqrt(covariance[count, count]) == pytest.approx(found.carrier.size_sigma, rel=0.01)


@pytest.mark.parametrize("kind", [HAND, TARGET])
def test_poses_give_what_they_promise_and_more_than_others_in_reach(kind: str) -> None:
    """Solved with photos from there, direction and place are as sure as was said, and surer than by as many others.

    The others are the poses used so far, turned by up to 40 degrees about random axes.
    """
    one = robot(kind)
    found = one.solved()
    poses = next_robot_poses(found, ALONE)
    assert len(poses) >= 3
    assert poses[0].place_sigma_mm_before == pytest.approx(place_sigma_mm(found), rel=1e-3)
    again = one.solved(np.stack([pose.base_from_flange for pose in poses]))
    assert len(again.rig_from_target) == 10 + len(poses)
    assert place_sigma_mm(again) == pytest.approx(poses[-1].place_sigma_mm_after, rel=0.15)
    assert turn_sigma_rad(again) == pytest.approx(poses[-1].turn_sigma_rad_after, rel=0.15)
    rng = np.random.default_rng(1)
    like = one.base_from_flange[rng.choice(10, len(poses), replace=False)].copy()
    like[:, :3, :3] = like[:, :3, :3] @ exp_rotation(rng.uniform(-0.4, 0.4, (len(poses), 3)))
    assert place_sigma_mm(again) < 0.9 * place_sigma_mm(one.solved(like))


@pytest.mark.parametrize("is_bent", [False, True])
def test_poses_start_from_what_is_known_of_a_lens_and_of_a_bend(*, is_bent: bool) -> None:
    """Places are said as they are stated, and come out: with focal lengths known, and with a bend unknown."""
    fx, fy = rig_views.camera().params[:2].tolist()
    known = () if is_bent else (ParameterPrior("fx_px", fx, 0.05), ParameterPrior("fy_px", fy, 0.05))
    one = robot(HAND)
    found = one.solved(is_free=is_bent, priors=known, is_bent=is_bent)
    poses = next_robot_poses(found, ALONE)
    assert poses[0].place_sigma_mm_before == pytest.approx(place_sigma_mm(found), rel=1e-3)
    more = np.stack([pose.base_from_flange for pose in poses])
    again = one.solved(more, is_free=is_bent, priors=known, is_bent=is_bent)
    assert place_sigma_mm(again) == pytest.approx(poses[-1].place_sigma_mm_after, rel=0.15)


@pytest.mark.parametrize("kind", [HAND, TARGET])
def test_what_turns_about_one_axis_leave_open_the_first_pose_ends(kind: str) -> None:
    """A robot that only turned about one axis is sent to turn about another; the camera still sees the target there."""
    turns = np.linspace(-0.6, 0.6, 10)[:, None] * np.array([0.3, 0.2, 1.0])
    one = robot(kind, turns=turns)
    found = one.solved()
    assert found.carrier.undetermined
    pose = next_robot_poses(found, ALONE)[0]
    assert not pose.place_sigma_mm_before < 10
    assert pose.place_sigma_mm_after < 1
    again = one.solved(pose.base_from_flange[None])
    assert len(again.rig_from_target) == 11
    assert place_sigma_mm(again) < 1.15 * pose.place_sigma_mm_after


def test_each_pose_is_in_reach_and_says_how_to_get_there(by_one: RigCalibration) -> None:
    """It is a used pose turned about one axis of the flange, not far beside where that has been; none comes twice."""
    poses = next_robot_poses(by_one, ALONE)
    assert len({pose.base_from_flange.tobytes() for pose in poses}) == len(poses)
    low, high = (end(ONE.base_from_flange[:, :3, 3], axis=0) for end in (np.min, np.max))
    for pose in poses:
        where = pose.base_from_flange[:3, 3]
        assert (low - 250 < where).all()
        assert (where < high + 250).all()
        assert pose.sentence.startswith("from the pose of frame0")
        assert f"{where[0]:.1f}, {where[1]:.1f}, {where[2]:.1f} mm in the base" in pose.sentence
        start = ONE.base_from_flange[int(pose.sentence.split()[4].removeprefix("frame"))]
        turn = start[:3, :3].T @ pose.base_from_flange[:3, :3]
        if "rotate" in pose.sentence:
            word = pose.sentence.split("rotate the flange ")[1].split()
            axis = np.eye(3)["xyz".index(word[4])]
            assert np.abs(turn - exp_rotation(np.deg2rad(float(word[0])) * axis)).max() < 0.01


def test_deviations_are_told_as_halves_enlarge_them_and_nothing_where_no_robot_is(by_one: RigCalibration) -> None:
    """What a pose gives is told in the sigmas that the page tells; a rig that nothing carries has no poses."""
    wide = RigHalves((RigSplit("by turns", 2.0, 600, 1.0, ()),))
    once, twice = next_robot_poses(by_one, ALONE)[0], next_robot_poses(by_one, wide)[0]
    assert twice.place_sigma_mm_after == pytest.approx(2 * once.place_sigma_mm_after)
    assert next_robot_poses(replace(by_one, carrier=None), ALONE) == ()
    assert next_robot_poses(replace(by_one, rig_frame="table"), ALONE) == ()
    assert next_robot_poses(replace(by_one, status="stopped"), ALONE) == ()


def test_lenses_of_hundreds_of_numbers_are_left_alone(by_one: RigCalibration, monkeypatch: pytest.MonkeyPatch) -> None:
    """What would take minutes and gigabytes proposes nothing."""
    monkeypatch.setattr("calib.judge.next_robot_poses.MOST_UNKNOWNS", 5)
    assert next_robot_poses(by_one, ALONE) == ()


def test_poses_are_read_as_they_were_written(tmp_path: Path) -> None:
    """The robot's table is one that its own reader takes."""
    poses = ONE.base_from_flange
    (tmp_path / "next.csv").write_bytes(robot_poses_to_csv([f"a, {k}" for k in range(10)], poses))
    read = read_robot_poses(tmp_path / "next.csv")
    assert read.images[3] == "a, 3"
    assert np.allclose(read.base_from_flange, poses, atol=1e-6)


CAMERA = CAMERAS["opencv"]


def _plan(points: KnownPoints, goal_px: float) -> PlannedViews:
    before = calibration_before(CAMERA, points, NOISE_PX)
    shape = shape_of(before)
    assert shape is not None
    plan = planned_views(PlanWish(before, shape, usual_hold(before, shape), goal_px, 0.7), goal_px)
    assert plan is not None
    return plan


@pytest.mark.parametrize("points", [board(), icosahedron()])
def test_planned_photos_reach_what_they_promise(points: KnownPoints) -> None:
    """A camera that is solved from the planned photos states what the plan promised, to a quarter."""
    plan = _plan(points, 0.05)
    assert plan.is_accurate
    assert plan.views[-1].sigma_px_after <= 0.05
    assert plan.views[-1].covered_after >= 0.7
    seen = observe(
        CAMERA,
        points,
        np.stack([one.cam_from_target for one in plan.views]),
        np.random.default_rng(1),
        noise_px=NOISE_PX,
        incidence_deg=70,
    )
    solved = solve(seen, "opencv", SolveOptions())
    stated = sigma_over_lit_px(lit_part(solved), solved.param_covariance)
    assert stated == pytest.approx(plan.views[-1].sigma_px_after, rel=0.25)


def test_exchanges_never_need_more_photos() -> None:
    """The plan is no longer than the list it was made from, and no shorter than halves need."""
    plan = _plan(board(), 0.03)
    assert FEWEST <= len(plan.views) <= plan.greedy_count


def test_a_goal_out_of_reach_is_told() -> None:
    """A plan that ends at the most photos before the goal is not called reached."""
    before = calibration_before(CAMERA, board(), NOISE_PX)
    shape = shape_of(before)
    assert shape is not None
    plan = planned_views(PlanWish(before, shape, usual_hold(before, shape), 1e-4, 0.7, 7), 1e-4)
    assert plan is not None
    assert not plan.is_accurate
    assert len(plan.views) == 7


def test_plans_are_tried_with_a_board_that_may_be_bent() -> None:
    """As the photos will be solved: its bend is an unknown, so that the same noise leaves more of the camera open."""
    target = board_target()
    before = calibration_before(CAMERA, known_points(target), NOISE_PX)
    shape = shape_of(before)
    assert shape is not None
    poses = poses_around(20, np.random.default_rng(7), distance_mm=200.0)
    flat, bent = (
        tried_plan(
            PlanWish(before, shape, usual_hold(before, shape), 1.0, 0.5, 12, how_made(target, made)), poses,
            np.random.default_rng(0),
        )
        for made in ("exact", "fdm-board")
    )  # fmt: skip
    assert bent.by_noise_px > 1.01 * flat.by_noise_px


def judged(calibration: Calibration) -> tuple[Judged, tuple[NextView, ...]]:
    """The verdict, and the photos that are proposed with it."""
    criteria = read_criteria()
    views = next_views(calibration, goal_px=criteria["uncertainty"].good, goal_covered=criteria["coverage"].good / 100)
    return judge_run([calibration], 0, half_split(calibration, SolveOptions()), criteria, views), views


@pytest.mark.parametrize(
    ("points", "distance_mm", "half_angle_deg"),
    [(icosahedron(80.0, 5), 420.0, 180.0), (board(14, 12, 10.0), 450.0, 30.0)],
    ids=["icosahedron", "board"],
)
def test_following_the_proposals_leads_to_a_usable_camera(
    points: KnownPoints, distance_mm: float, half_angle_deg: float
) -> None:
    """After photos around the middle only, the first round of what is proposed makes the camera usable, three good.

    A round is taken by the true camera, solved with all photos so far, and judged; it covers what was said.
    """
    rng = np.random.default_rng(7)
    poses = poses_around(12, rng, half_angle_deg=half_angle_deg, distance_mm=distance_mm, aim_mm=5.0)
    said, promised = [], 0.0
    for _ in range(4):
        seen = observe(CAMERA, points, poses, rng, noise_px=0.02, incidence_deg=70.0)
        run, views = judged(solve(seen, "opencv", SolveOptions()))
        said.append(run.verdict.grade)
        percent = next(check.value for check in run.verdict.checks if check.name == "coverage")
        assert percent > 100 * promised - 6
        if not views:
            break
        assert all(any(view.sentence in line for line in run.verdict.advice) for view in views)
        poses, promised = np.concatenate([poses, np.stack([v.cam_from_target for v in views])]), views[-1].covered_after
    assert said[0] == "bad"
    assert "bad" not in said[1:]
    assert said[-1] == "good", run.verdict.sentence


def test_a_board_whose_edge_bulges_out_of_the_image_is_held_elsewhere() -> None:
    """A wide lens bends a board's edge beyond its corners: where it is not read whole, another photo is proposed."""
    wide = Camera("opencv", np.array([620.0, 620, 508, 391, -0.3, 0.1, 6e-4, -4e-4, -0.012]), (1024, 768))
    rng = np.random.default_rng(2)
    poses = poses_around(14, rng, half_angle_deg=40.0, distance_mm=300.0, aim_mm=15.0)
    seen = observe(wide, board(21, 21, 10.0), poses, rng, noise_px=0.008, incidence_deg=70.0)
    whole = np.bincount(seen.view) == 21 * 21
    seen = observe(wide, board(21, 21, 10.0), poses[whole], rng, noise_px=0.008, incidence_deg=70.0)
    calibration = solve(seen, "opencv", SolveOptions())
    _, views = judged(calibration)
    assert views
    more = np.stack([view.cam_from_target for view in views])
    shown = observe(wide, board(21, 21, 10.0), more, rng, incidence_deg=70.0)
    assert (np.bincount(shown.view, minlength=len(more)) >= 0.95 * 21 * 21).all()
