"""A plan of photos, tried: photos are simulated as somebody takes them after it, and the camera is solved from them.

That says what a plan is worth where nobody holds a target quite as it says, and what the target's making adds.

The shortest plan of photos that reaches what is wanted each time it is tried: `plan_that_holds(PlanWish(...))`.
"""

import math
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from calib.cameras.camera import Camera
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, make_pose, rotation_of_quaternion, transform
from calib.core.types import KnownPoints, Observations, keep_views
from calib.judge.candidate_views import shown_in
from calib.judge.coverage import coverage_of
from calib.judge.evidence import uncertainty_of
from calib.judge.halves import HalvesApart, half_split, halves_apart
from calib.judge.next_views import MAX_PX
from calib.judge.planned_views import PlannedViews, planned_views
from calib.judge.views import Habits, TargetShape
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.solver.target_error import with_target_error
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import AtLeast, AtMost, NullIs
from designer.tolerance.made import Made

TURNED_RAD, SHIFTED_MM, OF_DISTANCE = math.radians(5), 20.0, 0.1
"""Standard deviations of how a person holds a target who was told where, whichever shift is less; twice at most."""
STILL_READ = 0.25
"""Of a face: rings are named by their neighbours, so that a part of it is read which nobody would plan for."""


_Sigma = Annotated[float, AtLeast(0), AtMost(MAX_PX), NullIs(math.inf)]


@dataclass(frozen=True)
class TriedPlan:
    """What a camera states that was solved from photos taken after a plan: what 95 % of the image stays within."""

    stated_px: _Sigma  # 1 sigma, as the verdict states it: with what the target's making may do; infinite: unknown
    by_noise_px: _Sigma  # by the noise alone, enlarged as halves of the photos differ
    by_target_px: _Sigma  # by the target's making alone


NOT_DETERMINED = TriedPlan(math.inf, math.inf, 0.0)


def tried_plan(
    camera: Camera, points: KnownPoints, shape: TargetShape, held: Habits, cam_from_target: Array, noise_px: float,
    made: Made | None, rng: np.random.Generator, *, is_held_exactly: bool,
) -> TriedPlan:  # fmt: skip
    """Take the photos of a plan (V, 4, 4) once, and solve.

    Args:
        camera: that takes them; its model is solved.
        points: of the target.
        shape: of the same.
        held: which points are read.
        cam_from_target: where the plan has the target.
        noise_px: of a coordinate of an observation.
        made: how the target was; None: nobody knows.
        rng: of noise and of how the target is held.
        is_held_exactly: a robot or a turntable holds it.
    """
    poses = cam_from_target if is_held_exactly else held_by_hand(cam_from_target, shape, rng)
    seen = _photographed(camera, points, shape, held, poses, noise_px, rng)
    if not seen.view_count:
        return NOT_DETERMINED
    try:
        found = solve(seen, camera.model, SolveOptions())
    except InputError:
        return NOT_DETERMINED
    if found.status != "converged":
        return NOT_DETERMINED
    return _stated(with_target_error(found, made))


def _stated(found: Calibration) -> TriedPlan:
    """As the verdict on these photos has it."""
    covered = coverage_of(found)
    halves = halves_apart(half_split(found, SolveOptions()), covered)
    factor = halves.factor if isinstance(halves, HalvesApart) else 1.0
    known = uncertainty_of(found, covered, factor)
    if known.image_px is None or known.noise_px is None:
        return NOT_DETERMINED
    return TriedPlan(known.image_px, factor * known.noise_px, known.target_px)


def held_by_hand(cam_from_target: Array, shape: TargetShape, rng: np.random.Generator) -> Array:
    """The poses as a person holds them: a solid with any side to the camera, as a plan says."""
    count = len(cam_from_target)
    sides = np.eye(3) if shape.is_flat else rotation_of_quaternion(rng.standard_normal((count, 4)))
    turn = TURNED_RAD * rng.standard_normal((count, 3)).clip(-2, 2)
    middle = transform(cam_from_target, shape.center_mm)
    most_mm = np.minimum(SHIFTED_MM, OF_DISTANCE * np.linalg.norm(middle, axis=1))
    there = middle + most_mm[:, None] * rng.standard_normal(middle.shape).clip(-2, 2)
    rotation = exp_rotation(turn) @ cam_from_target[:, :3, :3] @ sides
    return make_pose(rotation, there - rotation @ shape.center_mm)


def _photographed(
    camera: Camera, points: KnownPoints, shape: TargetShape, held: Habits, poses: Array, noise_px: float,
    rng: np.random.Generator,
) -> Observations:  # fmt: skip
    """What is found in the photos."""
    still = replace(held, face_share=min(held.face_share, STILL_READ))
    shown = shown_in(camera, shape, still, poses, np.arange(len(shape.face)))
    is_read = shown.is_read & (shown.is_read.sum(axis=1, keepdims=True) >= held.rings)
    view, row = np.nonzero(is_read)
    point = np.flatnonzero(points.face >= 0)[row]
    sigma_px = noise_px / np.sqrt(shown.weight[view, row])
    pixel = shown.pixel[view, row] + sigma_px[:, None] * rng.standard_normal((len(view), 2))
    names = tuple(map(str, range(1, len(poses) + 1)))
    covariance = sigma_px[:, None, None] ** 2 * np.eye(2)
    seen = Observations(camera.image_size, names, view, point, pixel, covariance, points)
    return keep_views(seen, is_read.any(axis=1))


TRIES = 5
ROUNDS = 5
"""Of planning for less noise, where photos that were tried did not reach the goal."""
TIGHTER, SPARE = 0.5, 0.97


@dataclass(frozen=True, eq=False)
class PlanWish:
    """What is asked for."""

    before: Calibration  # of `calib.judge.planned_views.calibration_before`
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
