"""Lenses that see farther off the axis than a lens polynomial can show."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from calib.cameras import MODELS, project, rays, wide_models
from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation, look_at, make_pose, rotation_between, transform
from calib.core.types import Observations
from calib.judge import solutions as solving
from calib.judge.solutions import Solution, SolveTask, best_of, solve_models
from calib.solver.blocks import RobustLoss, view_blocks
from calib.solver.calibration import Calibration, ImageField
from calib.solver.metrics.evaluation import evaluate
from calib.solver.plan import ALL, SolvePlan, lens_kind, plan_from_words, ruled_out
from calib.solver.problem import SolveOptions, pack, tie_parameters
from calib.solver.schur import damped_step
from calib.solver.solve import solve
from designer.base.errors import InputError
from tests.support.lenses import conventional
from tests.support.solver_scenes import CAMERAS, board, observe, poses_around, rows_of

SIZE = (1280, 960)
VIEWS, LEAST_SEEN = 10, 40
BOARD = board(12, 9, 20.0)


@cache
def seen_through_a_wide_lens(half_angle_deg: float, seed: int) -> Observations:
    """Views of a board through an equidistant lens `r = f angle`; coordinates as cv2 has them, in 32 bits."""
    rng = np.random.default_rng(seed)
    focal = 0.5 * np.hypot(*SIZE) / np.radians(half_angle_deg)
    middle = 0.5 * (np.array(SIZE) - 1) + rng.uniform(-5, 5, 2)
    view, point, pixel = [], [], []
    while len(view) < VIEWS:
        tilt, turn = np.radians(rng.uniform(0, 40)), rng.uniform(0, 2 * np.pi)
        across = np.sin(tilt) * np.array([np.cos(turn), np.sin(turn)])
        eye = rng.uniform(110, 260) * np.array([*across, np.cos(tilt)])
        pose = look_at(eye, np.array([*rng.normal(0, 55, 2), 0.0]), rng.uniform(-np.pi, np.pi))
        x, y, z = transform(pose, BOARD.position_mm).T
        off_axis, across_mm = np.arctan2(np.hypot(x, y), z), np.hypot(x, y)
        shown = focal * (off_axis / across_mm)[:, None] * np.stack([x, y], axis=1) + middle
        is_in_image = ((shown > 0) & (shown < np.array(SIZE) - 1)).all(axis=1)
        inside = (off_axis < np.radians(half_angle_deg)) & is_in_image
        if inside.sum() >= LEAST_SEEN:
            rows = np.flatnonzero(inside)
            point.append(rows)
            pixel.append(shown[rows] + 0.1 * rng.standard_normal((len(rows), 2)))
            view.append(np.full(len(rows), len(view)))
    exact = np.concatenate(pixel).astype(np.float32).astype(np.float64)
    names = tuple(f"{n}.png" for n in range(VIEWS))
    return Observations(SIZE, names, np.concatenate(view), np.concatenate(point), exact, None, BOARD)


def rms_of_opencv(seen: Observations) -> float:
    """What `cv2.calibrateCamera` reaches with its five coefficients."""
    views = [np.flatnonzero(seen.view == view) for view in range(seen.view_count)]
    position = [seen.points.position_mm[seen.point[rows]].astype(np.float32) for rows in views]
    pixel = [seen.center_px[rows].astype(np.float32) for rows in views]
    return float(cv2.calibrateCamera(position, pixel, seen.image_size, None, None)[0])


def rms_of(solved: Calibration) -> float:
    """Root mean square distance of the observations that count."""
    return float(np.sqrt((solved.residual_px[~solved.is_outlier] ** 2).sum(axis=1).mean()))


def promised(solved: Calibration) -> float:
    """What an undamped step would still take off the squared sum, as a part of it."""
    problem = replace(pack(solved.observations, weighted=solved.weighted), is_used=~solved.is_outlier)
    poses = np.array(solved.cam_from_target)
    poses[:, :3, 3] += poses[:, :3, :3] @ problem.origin_mm
    blocks = view_blocks(problem, solved.camera, poses, RobustLoss())
    tie = tie_parameters(solved.camera.model, SolveOptions())
    return damped_step(blocks.products, tie.row, 0.0).predicted / float(blocks.cost.sum())


@pytest.mark.parametrize(("half_angle_deg", "seed"), [(55, 0), (65, 1), (72, 2), (78, 3), (85, 4), (100, 5)])
def test_a_minimum_no_worse_than_that_of_opencv(half_angle_deg: float, seed: int) -> None:
    """Of the points that count the squared sum is least: no step promises less, and cv2 finds none with less.

    The points that do not count are said, with what to do, and most of them the camera indeed cannot show.
    """
    seen = seen_through_a_wide_lens(half_angle_deg, seed)
    solved = solve(seen, "opencv")
    assert solved.status == "converged"
    assert promised(solved) < 1e-9
    used = solved.observations
    assert rms_of(solved) <= rms_of_opencv(rows_of(used, ~solved.is_outlier)) * (1 + 1e-6)
    position = transform(solved.cam_from_target[used.view], used.points.position_mm[used.point])
    is_shown = np.isfinite(project(solved.camera, position)).all(axis=1)
    assert is_shown[~solved.is_outlier].all()
    count = int(solved.is_outlier.sum())
    assert count < 0.15 * len(used.view)
    said = [remark for remark in solved.remarks if "lie beyond what the opencv model can show" in remark]
    assert len(said) == (count > 0)
    if count:
        assert said[0].startswith(f"{count} of {len(used.view)} observations in ")
        assert said[0].endswith(MODELS["opencv"].remedy)
        assert is_shown[solved.is_outlier].mean() < 0.5


def test_a_polynomial_that_goes_backward_reaches_farther() -> None:
    """What is advised instead shows all points, with less error."""
    seen = seen_through_a_wide_lens(78, 3)
    forward, backward = solve(seen, "opencv"), solve(seen, "luhmann")
    assert forward.is_outlier.any()
    assert not backward.is_outlier.any()
    assert promised(backward) < 1e-9
    assert rms_of(backward) < rms_of(forward)


def test_outliers_are_rejected_beside_what_is_beyond() -> None:
    """With --reject both are left out, each is counted and said on its own, and the minimum is one again."""
    seen = seen_through_a_wide_lens(85, 4)
    wrong = np.array(seen.center_px)
    wrong[::100] += 30.0
    solved = solve(replace(seen, center_px=wrong), "opencv", SolveOptions(reject_sigma=6.0))
    assert solved.status == "converged"
    assert promised(solved) < 1e-9
    assert solved.is_outlier[::100].all()
    said = [int(remark.split()[0]) for remark in solved.remarks if "left out" in remark]
    assert len(said) == 2
    assert sum(said) == solved.is_outlier.sum()


def test_a_view_with_nothing_else_is_left_out_by_name() -> None:
    """Where all that a view shows lies beyond the lens model, the others are solved without it."""
    seen = seen_through_a_wide_lens(100, 5)
    beyond = solve(seen, "opencv").is_outlier
    inner = (seen.view == np.argmax(np.bincount(seen.view[beyond]))) & ~beyond
    solved = solve(rows_of(seen, ~inner), "opencv")
    assert solved.status == "converged"
    assert solved.observations.view_count == VIEWS - 1
    assert any(".png: left out: " in remark for remark in solved.remarks)


CIRCLES = ("half space", "beyond the half space", "wide ellipsoid", "wide sphere", "wide division")


@cache
def seen_all_around(lens: str) -> tuple[Camera, Observations]:
    """Views of a board all over the field of a wide lens, to its edge, of which a quarter is near the axis."""
    camera, rng = conventional(lens), np.random.default_rng(7)
    edge = rays(camera, np.array([[0.0, 400.0]]))[0]
    widest = 0.9 * np.arctan2(np.hypot(*edge[:2]), edge[2])
    poses = []
    for theta in np.linspace(0, widest, VIEWS):
        phi = rng.uniform(0, 2 * np.pi)
        sight = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        look = rotation_between(np.array([0.0, 0, 1]), sight)
        tilt = exp_rotation(np.array([*rng.uniform(-0.6, 0.6, 2), 0.0]))
        turn = np.diag([1.0, -1, -1]) @ exp_rotation(np.array([0, 0, rng.uniform(-3, 3)]))
        poses.append(make_pose(look @ tilt @ turn, 180 * sight))
    return camera, observe(camera, BOARD, np.array(poses), rng, noise_px=0.1)


@pytest.mark.parametrize("lens", CIRCLES)
def test_a_wide_lens_is_found_from_nothing(lens: str) -> None:
    """Every photo is used, and the camera is the true one within what is stated (chi-square of all parameters)."""
    truth, seen = seen_all_around(lens)
    solved = solve(seen, truth.model)
    assert solved.status == "converged"
    assert solved.observations.view_count == VIEWS
    assert not solved.is_outlier.any()
    off = solved.camera.params - truth.params
    assert off @ np.linalg.solve(solved.param_covariance, off) < chi2.ppf(0.9999, len(off))


def test_a_wide_lens_is_told_from_an_ordinary_one() -> None:
    """By how far off the axis points are seen; the ordinary model is ruled out in a line that names others."""
    truth, seen = seen_all_around("beyond the half space")
    sight = rays(truth, seen.center_px)
    farthest = np.arctan2(np.hypot(sight[:, 0], sight[:, 1]), sight[:, 2]).max()
    kind = lens_kind(seen)
    assert kind.is_wide
    assert kind.off_axis_rad == pytest.approx(farthest, abs=0.02)
    line = ruled_out("opencv", None, seen, SolveOptions())
    assert line == f"model opencv cannot show all that was seen: {kind.sentence}; give --model fisheye or ds or eucm"
    assert ruled_out("luhmann", solve(seen, "luhmann"), seen, SolveOptions())  # squeezes all in, badly
    assert not ruled_out("fisheye", None, seen, SolveOptions())
    ordinary = observe(CAMERAS["opencv"], BOARD, poses_around(8, np.random.default_rng(2)), np.random.default_rng(2))
    assert not lens_kind(ordinary).is_wide
    head_on = np.tile(np.diag([1.0, -1, -1, 1]), (6, 1, 1))
    head_on[:, 2, 3] = np.linspace(400, 600, 6)  # determines no focal length but that of a formula
    assert not lens_kind(observe(CAMERAS["opencv"], BOARD, head_on, np.random.default_rng(2))).is_wide
    assert not ruled_out("opencv", None, ordinary, SolveOptions())


def test_all_models_are_those_that_suit_the_lens() -> None:
    """Without an option a wide lens is solved by wide models, said in a line; the best has least in photos held out."""
    truth, seen = seen_all_around("half space")
    asked = plan_from_words(ALL, fix=(), share=(), focal_px=None, loss="squares", reject=None, weighted=True)
    plan, seen = asked.suited(seen)
    solutions = list(solve_models(SolveTask(seen, plan)))
    assert {one.model for one in solutions} == set(wide_models())
    left_px = {one.model: one.held_out_px for one in solutions if one.held_out_px is not None}
    best = best_of(solutions)
    assert best.model == truth.model == min(left_px, key=lambda name: left_px[name])
    assert sum(remark.startswith("the lens is a wide one") for remark in best.calibration.remarks) == 1
    assert any(f"{truth.model} leaves the least over" in remark for remark in best.calibration.remarks)


@pytest.mark.parametrize("model", wide_models())
def test_a_first_field_of_view_that_a_model_has_not_is_passed_over(model: str) -> None:
    """Where outliers leave no start good, all fields of view are tried, of which some models reach not all."""
    _, seen = seen_all_around("beyond the half space")
    off = np.array(seen.center_px)
    off[::20] += 40.0
    solved = solve(replace(seen, center_px=off), model)
    assert solved.observations.view_count == VIEWS


def test_what_no_formula_follows_is_solved_by_the_model_of_any_lens(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried where all formulas leave errors that are fixed in the image, and only there."""
    truth, seen = seen_all_around("half space")
    solved = solve(seen, truth.model)
    field = ImageField(0.1, np.zeros((8, 8)))
    asked: list[str] = []

    def solution(task: SolveTask, model: str) -> Solution:
        asked.append(model)
        left = replace(solved, image_field=field if model in with_field else None)
        return Solution(model, evaluate(left, None))

    monkeypatch.setattr(solving, "_solution", solution)
    monkeypatch.setattr(solving, "compared", lambda solutions, plan: solutions)
    plan = SolvePlan(("ds", "eucm"), SolveOptions(), is_compared=True)
    for with_field in (("ds", "eucm"), ("ds",), ()):
        asked.clear()
        found = [one.model for one in solve_models(SolveTask(seen, plan))]
        assert found == asked == ["ds", "eucm", *(["splined"] if len(with_field) == 2 else [])]


def test_views_that_are_all_behind_the_camera_are_refused_by_a_model_that_shows_none() -> None:
    """Nothing of what was seen counts: one line, not a camera whose residuals are those of no observation."""
    rng, view, pixel, views = np.random.default_rng(1), [], [], 8
    for index in range(views):
        off_axis, around = np.radians(rng.uniform(150, 170)), 2 * np.pi * index / views
        aside = np.sin(off_axis) * np.array([np.cos(around), np.sin(around)])
        ahead = np.array([*aside, np.cos(off_axis)])
        turn = rotation_between(np.array([0.0, 0, -1]), -ahead) @ np.diag([1.0, -1, -1])
        pose = make_pose(turn @ exp_rotation(rng.normal(0, 0.4, 3)), 250 * ahead)
        x, y, z = transform(pose, BOARD.position_mm).T
        shown = 500 * (np.arctan2(np.hypot(x, y), z) / np.hypot(x, y))[:, None] * np.stack([x, y], axis=1) + 1500
        pixel.append(shown + rng.normal(0, 0.1, shown.shape))
        view.append(np.full(len(shown), index))
    names = tuple(f"{index}.png" for index in range(views))
    point = np.tile(np.arange(len(BOARD.position_mm)), views)
    seen = Observations((3000, 3000), names, np.concatenate(view), point, np.concatenate(pixel), None, BOARD)
    with pytest.raises(InputError, match="fisheye shows none of the"):
        solve(seen, "fisheye")
