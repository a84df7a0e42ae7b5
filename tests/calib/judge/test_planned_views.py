"""Plans of photos before any photo; and whoever follows the proposed photos gets to a camera that can be used."""

import numpy as np
import pytest

from calib.cameras.camera import Camera
from calib.core.types import KnownPoints
from calib.judge.coverage import lit_part, sigma_over_lit_px
from calib.judge.criteria import read_criteria
from calib.judge.halves import half_split
from calib.judge.judge import Judged
from calib.judge.next_views import NextView, next_views
from calib.judge.planned_views import FEWEST, PlannedViews, calibration_before, planned_views, usual_hold
from calib.judge.views import shape_of
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, observe, poses_around
from tests.support.verdict_cases import judge_run

CAMERA = CAMERAS["opencv"]


def _plan(points: KnownPoints, goal_px: float) -> PlannedViews:
    before = calibration_before(CAMERA, points, NOISE_PX)
    shape = shape_of(before)
    assert shape is not None
    plan = planned_views(before, usual_hold(before, shape), goal_px=goal_px, goal_covered=0.7)
    assert plan is not None
    return plan


@pytest.mark.parametrize("points", [board(), icosahedron()])
def test_planned_photos_reach_what_they_promise(points: KnownPoints) -> None:
    """A camera that is solved from the planned photos states what the plan promised, to a quarter."""
    plan = _plan(points, 0.05)
    assert plan.is_reached
    assert plan.views[-1].sigma_px_after <= 0.05
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
    plan = planned_views(before, usual_hold(before, shape), goal_px=1e-4, goal_covered=0.7, most=7)
    assert plan is not None
    assert not plan.is_reached
    assert len(plan.views) == 7


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
        assert percent is not None
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
