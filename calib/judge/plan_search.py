"""The shortest plan of photos that reaches what is wanted each time it is tried: `plan_that_holds(PlanWish(...))`."""

import math
from dataclasses import dataclass

import numpy as np

from calib.core.parallel import one_thread
from calib.judge.plan_tried import TriedPlan, tried_plan
from calib.judge.planned_views import PlannedViews, planned_views
from calib.judge.views import Habits, TargetShape
from calib.solver.calibration import Calibration
from designer.base.arrays import Array
from designer.tolerance.made import Made

TRIES = 5
ROUNDS = 5
"""Of planning for less noise, where photos that were tried did not reach the goal."""
TIGHTER, SPARE = 0.5, 0.97


@dataclass(frozen=True, eq=False)
class PlanWish:
    """What is asked for."""

    before: Calibration  # of `calib.judge.before_photos.calibration_before`
    shape: TargetShape
    held: Habits
    goal_px: float  # what 95 % of the image is to stay within, 1 sigma
    goal_covered: float  # of the image, 0 to 1
    most: int  # photos
    made: Made | None  # how the target was; None: nobody knows
    at: Array | None = None  # (C, 4, 4) the only poses that the target can have; None: any
    is_held_exactly: bool = False  # by a robot or a turntable


@one_thread
def plan_that_holds(wish: PlanWish) -> tuple[PlannedViews, tuple[TriedPlan, ...]] | None:
    """The shortest of a few plans that reach the goal each time they are tried; the last one if none does.

    Plans are made for goals between one that was too easy and one that was hard enough. None: the target is read in no
    pose that it can have.
    """
    goal_px, passed_px, failed_px = wish.goal_px, 0.0, 0.0
    for _ in range(ROUNDS):
        found = planned_views(
            wish.before, wish.held, goal_px=goal_px, goal_covered=wish.goal_covered, most=wish.most, at=wish.at
        )
        if found is None or not found.views:
            return None
        tried = _tried(wish, np.stack([one.cam_from_target for one in found.views]))
        if max(one.stated_px for one in tried) <= wish.goal_px:
            best, passed_px = (found, tried), goal_px
            if not failed_px:
                break
        else:
            failed_px = goal_px
            if not passed_px:
                best = found, tried
                if not found.is_accurate:
                    break
        goal_px = math.sqrt(passed_px * failed_px) if passed_px else _tighter(wish, found, tried, goal_px)
    return best


def _tighter(wish: PlanWish, found: PlannedViews, tried: tuple[TriedPlan, ...], goal_px: float) -> float:
    """By the noise alone, what leaves as much for the target's making as it took."""
    by_target_px = max(one.by_target_px for one in tried)
    room_px = math.sqrt(max(wish.goal_px**2 - by_target_px**2, 0.0))
    done_px = min(goal_px, found.views[-1].sigma_px_after)
    return done_px * max(TIGHTER, SPARE * room_px / max(one.by_noise_px for one in tried))


def _tried(wish: PlanWish, poses: Array) -> tuple[TriedPlan, ...]:
    before = wish.before
    return tuple(
        tried_plan(
            before.camera, before.observations.points, wish.shape, wish.held, poses, before.scale, wish.made,
            np.random.default_rng(number), is_held_exactly=wish.is_held_exactly,
        )
        for number in range(TRIES)
    )  # fmt: skip
