"""Photos to take of a camera that nobody has photos of: as few as make it known as well as wanted.

They are chosen one after the other as `calib.judge.next_views` chooses, and exchanged (`calib.judge.greedy`). What is
known of a camera before any photo is told as a calibration from no photos: `calibration_before(camera, points, 0.05)`.

A plan is tried: photos are simulated as somebody takes them after it, and the camera is solved from them. That says
what it is worth where nobody holds a target quite as it says, and what the target's making adds. The shortest plan that
reaches what is wanted each time it is tried is `plan_that_holds(PlanWish(...))`.
"""

import math
from dataclasses import dataclass, replace
from functools import cache, partial, reduce
from itertools import accumulate, pairwise
from typing import Annotated

import numpy as np

from calib.cameras import COMMON, WIDE, fitted_models, project
from calib.cameras.camera import Camera
from calib.cameras.refit import refit
from calib.cameras.surface import surface_model
from calib.core.parallel import one_thread
from calib.core.se3 import exp_rotation, make_pose, rotation_of_quaternion, transform
from calib.core.types import KnownPoints, Observations, keep_views
from calib.judge.candidate_views import candidates_at, candidates_of, held_ahead, shown_in
from calib.judge.coverage import coverage_of, lit_part
from calib.judge.evidence import uncertainty_of
from calib.judge.greedy import Exchange, one_by_one
from calib.judge.halves import half_split, halves_apart
from calib.judge.information import LENS_UNSURE, knowledge_of
from calib.judge.next_view_words import ViewGain
from calib.judge.next_views import MAX_PX, NextView, proposed_view
from calib.judge.view_search import CandidatePhoto, SoFar, ViewGoal, view_search
from calib.judge.views import READABLE_PITCH_PX, Habits, TargetShape
from calib.solver.calibration import Calibration
from calib.solver.plan import SolvePlan
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from calib.solver.target_error import with_target_error
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.marks import AtLeast, AtMost, NullIs
from designer.base.words import figure
from designer.target import TargetGeometry
from designer.tolerance.made import Made

FEWEST = 6
"""So that halves of three photos each tell whether the stated deviations hold."""
MOST = 40
LITTLE_AREA = 0.001


@dataclass(frozen=True, eq=False)
class PlannedViews:
    """The photos of a plan, in the order to take them."""

    views: tuple[NextView, ...]  # deviations by the noise alone
    distance_mm: Array  # (V,)
    tilt_deg: Array  # (V,) of a flat target; nan: a solid
    greedy_count: int  # photos before any was left out
    is_accurate: bool  # the image is known as well as wanted


@dataclass(frozen=True, eq=False)
class PlanWish:
    """What is asked for."""

    before: Calibration  # of `calib.judge.planned_views.calibration_before`
    shape: TargetShape
    held: Habits
    goal_px: float  # what 95 % of the image is to stay within, 1 sigma
    goal_covered: float  # of the image, 0 to 1
    most: int = MOST  # photos
    made: Made | None = None  # how the target was; None: nobody knows
    at: Array | None = None  # (C, 4, 4) the only poses that the target can have; None: any
    is_held_exactly: bool = False  # by a robot or a turntable


def planned_views(wish: PlanWish, goal_px: float) -> PlannedViews | None:
    """The fewest photos that reach both goals, or the best `most` of them; None if the target cannot be held so.

    Goals are those of the wish, but 95 % of the image is to be known so well (1 sigma) by the noise alone.
    """
    before, shape, held, goal_covered = wish.before, wish.shape, wish.held, wish.goal_covered
    candidates = candidates_of(before, shape, held, (1.0, 1.0)) if wish.at is None else candidates_at(shape, wish.at)
    search = view_search(before, shape, held, candidates, knowledge_of(before))
    if search is None:
        return None
    goal = ViewGoal(goal_px, goal_covered, math.inf, LITTLE_AREA, wish.most, FEWEST)
    start = search.start()
    photos = tuple(
        step.choice for step in one_by_one(start, partial(search.choose, goal=goal), SoFar.with_photo, wish.most)
    )

    @cache
    def after(some: tuple[CandidatePhoto, ...]) -> SoFar:
        return reduce(SoFar.with_photo, some, start)

    def is_met(some: tuple[CandidatePhoto, ...]) -> bool:
        return len(some) >= FEWEST and after(some).covered >= reach and after(some).within_px <= goal_px

    # What cannot be covered is not asked for any more, so that photos are no more than the rest needs.
    greedy_count, reach = len(photos), min(goal_covered, after(photos).covered)
    if is_met(photos):
        photos = Exchange[CandidatePhoto](
            is_met,
            lambda some: after(some).within_px,
            lambda rest: next(search.for_accuracy(after(rest)), None),
            FEWEST,
        ).improved(photos)
    states = accumulate(photos, SoFar.with_photo, initial=start)
    views = tuple(
        proposed_view(search, photo, ViewGain(a.within_px, b.within_px, a.covered, b.covered, tells_area=True))
        for photo, (a, b) in zip(photos, pairwise(states), strict=True)
    )
    rows, is_accurate = [photo.row for photo in photos], after(photos).within_px <= goal_px
    taken = search.candidates[np.array(rows, dtype=np.int64)]
    return PlannedViews(views, taken.distance_mm, taken.tilt_deg, greedy_count, is_accurate)


FOCAL_UNSURE = 0.3
CENTRE_UNSURE = 0.05
"""Of the focal length, and of the image's longer side: what a person knows of a camera beforehand."""
FACE_SHARE = 0.5
FEWEST_RINGS = 12
FINE_PITCH_PX = 24.0
"""Between rings of 8 px radius or so."""
FILLS = (0.3, 0.9)
"""Of the image's width or height, in the direction that the target fills more of: farthest and nearest."""
SIZING_STEPS = 12


def planned_camera(camera: Camera, goal_px: float) -> tuple[Camera, str]:
    """The camera in a model that few photos determine, and what is to be said of the lens."""
    if camera.model in fitted_models():
        return camera, "the lens is taken to be one that its model follows, and photos to be sharp; calib run tells"
    surface = surface_model(camera.model)
    plain = {COMMON, WIDE} if surface is None else {COMMON, WIDE, surface.base.name}
    found = min((refit(camera, model) for model in sorted(plain)), key=lambda one: one.max_px)
    near, model = figure(found.max_px, 2), found.camera.model
    said = f"planned for a camera of the model {model}, from which this one, {camera.model}, differs by up to {near} px"
    if found.max_px > goal_px:
        said += ", more than is wanted: what is promised is of that model, not of this camera"
    return found.camera, said


def front_of(target: TargetGeometry, points: KnownPoints) -> KnownPoints:
    """The points of what is photographed: of a board with two sides those of the front; the others lie on no face."""
    if not target.is_plate or target.is_planar:
        return points
    return replace(points, face=np.where(points.face == 0, 0, -1))


def calibration_before(camera: Camera, points: KnownPoints, noise_px: float) -> Calibration:
    """A calibration from no photos: the camera as a person takes it to be.

    Args:
        camera: about as it is.
        points: of the target.
        noise_px: standard deviation of a coordinate of an observation to come.
    """
    none = np.zeros(0, dtype=np.int64)
    deviation = np.full(len(camera.params), LENS_UNSURE)
    deviation[:2] = FOCAL_UNSURE * camera.params[:2]
    deviation[2:4] = CENTRE_UNSURE * max(camera.image_size)
    return Calibration(
        camera=camera, observations=Observations(camera.image_size, (), none, none, np.zeros((0, 2)), None, points),
        cam_from_target=np.zeros((0, 4, 4)), residual_px=np.zeros((0, 2)), is_outlier=np.zeros(0, dtype=np.bool_),
        scale=noise_px, param_covariance=np.diag(deviation**2), pose_covariance=np.zeros((0, 6, 6)), fixed=(),
        weighted=False, status="converged", remarks=(), iterations=0, seconds=0.0,
    )  # fmt: skip


def usual_hold(before: Calibration, shape: TargetShape, distance_mm: tuple[float, float] | None = None) -> Habits:
    """How a target may be held: so that it fills a good part of the lit image, or between two distances.

    Args:
        before: of `calibration_before`.
        shape: of the target.
        distance_mm: nearest and farthest; None: by what it fills.
    """
    first, last = lit_part(before).box_px
    size_px = last - first + 1
    fills = (_distance_mm(before.camera, shape, fill, size_px) for fill in FILLS[::-1])
    near, far = fills if distance_mm is None else distance_mm
    return Habits((near, far), FACE_SHARE, READABLE_PITCH_PX, FEWEST_RINGS, FINE_PITCH_PX)


def _distance_mm(camera: Camera, shape: TargetShape, fill: float, size_px: Array) -> float:
    """From where a target that faces the camera fills so much of the image."""
    turn = shape.level if shape.is_flat else np.eye(3)
    extent = float(np.ptp(shape.position_mm, axis=0).max())
    near, far = 0.6 * extent, 1000.0 * extent
    for _ in range(SIZING_STEPS):
        middle = math.sqrt(near * far)
        pixel = project(camera, transform(held_ahead(shape, turn, middle), shape.position_mm))
        is_all = bool(np.isfinite(pixel).all())
        if is_all and float((np.ptp(pixel, axis=0) / size_px).max()) < fill:
            far = middle
        else:
            near = middle
    return far


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


def tried_plan(wish: PlanWish, cam_from_target: Array, rng: np.random.Generator) -> TriedPlan:
    """Take the photos of a plan (V, 4, 4) once, with noise and as they are held, and solve the camera from them."""
    poses = cam_from_target if wish.is_held_exactly else held_by_hand(cam_from_target, wish.shape, rng)
    seen, model = _photographed(wish, poses, rng), wish.before.camera.model
    options = SolvePlan((model,), SolveOptions()).for_target(wish.made, seen.points).options_of(model)
    try:
        found = solve(seen, model, options) if seen.view_count else None
    except InputError:
        found = None
    if found is None or found.status != "converged":
        return NOT_DETERMINED
    stated = with_target_error(found, wish.made)  # as the verdict on these photos has it
    covered = coverage_of(stated)
    halves = halves_apart(half_split(stated, options), covered)
    known = uncertainty_of(stated, covered, halves.factor)
    if known.image_px is None or known.noise_px is None:
        return NOT_DETERMINED
    return TriedPlan(known.image_px, halves.factor * known.noise_px, known.target_px)


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


def _photographed(wish: PlanWish, poses: Array, rng: np.random.Generator) -> Observations:
    """What is found in the photos."""
    camera, points, held = wish.before.camera, wish.before.observations.points, wish.held
    still = replace(held, face_share=min(held.face_share, STILL_READ))
    shown = shown_in(camera, wish.shape, still, poses, np.arange(len(wish.shape.face)))
    is_read = shown.is_read & (shown.is_read.sum(axis=1, keepdims=True) >= held.rings)
    view, row = np.nonzero(is_read)
    sigma_px = wish.before.scale / np.sqrt(shown.weight[view, row])
    pixel = shown.pixel[view, row] + sigma_px[:, None] * rng.standard_normal((len(view), 2))
    names, point = tuple(map(str, range(1, len(poses) + 1))), np.flatnonzero(points.face >= 0)[row]
    covariance = sigma_px[:, None, None] ** 2 * np.eye(2)
    seen = Observations(camera.image_size, names, view, point, pixel, covariance, points)
    return keep_views(seen, is_read.any(axis=1))


TRIES = 5
ROUNDS = 5
"""Of planning for less noise, where photos that were tried did not reach the goal."""
TIGHTER, SPARE = 0.5, 0.97


@one_thread
def plan_that_holds(wish: PlanWish) -> tuple[PlannedViews, tuple[TriedPlan, ...]] | None:
    """The shortest of a few plans that reach the goal each time they are tried; the last one if none does.

    Plans are made for goals between one that was too easy and one that was hard enough. None: the target is read in no
    pose that it can have.
    """
    goal_px, passed_px, failed_px = wish.goal_px, 0.0, 0.0
    for _ in range(ROUNDS):
        found = planned_views(wish, goal_px)
        if found is None or not found.views:
            return None
        poses = np.stack([one.cam_from_target for one in found.views])
        tried = tuple(tried_plan(wish, poses, np.random.default_rng(number)) for number in range(TRIES))
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
        if passed_px:
            goal_px = math.sqrt(passed_px * failed_px)
            continue
        # By the noise alone, what leaves as much for the target's making as it took.
        by_target_px = max(one.by_target_px for one in tried)
        room_px = math.sqrt(max(wish.goal_px**2 - by_target_px**2, 0.0))
        tighter = max(TIGHTER, SPARE * room_px / max(one.by_noise_px for one in tried))
        goal_px = tighter * min(goal_px, found.views[-1].sigma_px_after)
    return best
