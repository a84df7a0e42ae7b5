"""Plans of photos before any photo."""

import numpy as np
import pytest

from calib.core.types import KnownPoints
from calib.judge.coverage import lit_part, sigma_over_lit_px
from calib.judge.planned_views import FEWEST, PlannedViews, calibration_before, planned_views, usual_hold
from calib.judge.views import shape_of
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.solver_scenes import CAMERAS, NOISE_PX, board, icosahedron, observe

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
