"""Photos to take of a camera that nobody has photos of: as few as make it known as well as wanted.

They are chosen one after the other as `calib.judge.next_views` chooses; then each is left out, or exchanged for a
better one, as long as that helps (Fedorov 1972).

What is known of a camera before any photo: `calibration_before(camera, points, 0.05)`.

It is told as a calibration from no photos, so that what chooses photos after photos chooses the first ones, too.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import COMMON, WIDE, fitted_models, project
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid, refit
from calib.cameras.surface import surface_model
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import make_pose, transform
from calib.core.types import KnownPoints, Observations
from calib.judge.choose_views import (
    CandidatePhoto,
    SoFar,
    ViewChoice,
    for_accuracy,
    for_coverage,
    new_area,
    scene_of,
    start_of,
    with_photo,
)
from calib.judge.coverage import LitPart, lit_part
from calib.judge.information import LENS_UNSURE, image_change, sigma_px
from calib.judge.next_view_words import ViewGain
from calib.judge.next_views import NextView, proposed_view
from calib.judge.views import READABLE_PITCH_PX, Habits, TargetShape
from calib.solver.accuracy import share_px
from calib.solver.calibration import Calibration
from designer.base.arrays import Array
from designer.base.words import figure
from designer.target import TargetGeometry

FEWEST = 6
"""So that halves of three photos each tell whether the stated deviations hold."""
MOST = 40
LITTLE_AREA = 0.001
WORTH_A_SWAP = 0.98
ROUNDS = 3
"""Of exchanges, through all photos."""


@dataclass(frozen=True, eq=False)
class PlannedViews:
    """The photos of a plan, in the order to take them."""

    views: tuple[NextView, ...]  # deviations by the noise alone
    gains: tuple[ViewGain, ...]  # the same in numbers
    distance_mm: Array  # (V,)
    tilt_deg: Array  # (V,) of a flat target; nan: a solid
    greedy_count: int  # photos before any was left out
    is_accurate: bool  # the image is known as well as wanted
    is_covered: bool  # and so much of it is covered

    @property
    def is_reached(self) -> bool:
        """Whether both goals are."""
        return self.is_accurate and self.is_covered


@dataclass(frozen=True, eq=False)
class _Goal:
    scene: ViewChoice
    lit: LitPart
    start: SoFar
    change: Array  # (N, 2, Q)
    pixels: int
    goal_px: float
    goal_covered: float

    def after(self, photos: Sequence[CandidatePhoto]) -> SoFar:
        so_far = self.start
        for photo in photos:
            so_far = with_photo(so_far, photo)
        return so_far

    def within_px(self, so_far: SoFar) -> float:
        """What 95 % of the image stays within, by the photos alone; infinite if they leave something open."""
        found = symmetric_inverse(so_far.told)
        if int(found.rank) < len(so_far.told):
            return float("inf")
        return share_px(sigma_px(self.change, found.inverse), self.pixels)

    def is_met(self, photos: Sequence[CandidatePhoto]) -> bool:
        so_far = self.after(photos)
        enough = len(photos) >= FEWEST and so_far.covered >= self.goal_covered
        return enough and self.within_px(so_far) <= self.goal_px


def planned_views(
    before: Calibration, held: Habits, *, goal_px: float, goal_covered: float, most: int = MOST, at: Array | None = None
) -> PlannedViews | None:
    """The fewest photos that reach both goals, or the best `most` of them; None if the target cannot be held so.

    Args:
        before: of `calib.judge.planned_views.calibration_before`.
        held: how the target may be held.
        goal_px: 95 % of the image is to be known so well (1 sigma), by the noise of the photos.
        goal_covered: so much of the image is to be surrounded by sightings, 0 to 1.
        most: photos at most.
        at: the only poses that the target can have (C, 4, 4); None: any.
    """
    scene = scene_of(before, None, held=held, at=at)
    if scene is None or not len(scene.candidates.distance_mm):
        return None
    lit = lit_part(before)
    pixels = int(lit.is_lit(image_grid(before.camera.image_size)).sum())
    goal = _Goal(scene, lit, start_of(scene, before), image_change(scene.known), pixels, goal_px, goal_covered)
    greedy = _greedy(goal, most)
    # What cannot be covered is not asked for any more, so that photos are no more than the rest needs.
    reach = replace(goal, goal_covered=min(goal_covered, goal.after(greedy).covered))
    photos = _exchanged(reach, greedy) if reach.is_met(greedy) else greedy
    so_far = goal.after(photos)
    one_by_one = scene.candidates[np.array([photo.row for photo in photos], dtype=np.int64)]
    gains = _gains(goal, photos)
    views = (proposed_view(scene, before, lit, photo, gain) for photo, gain in zip(photos, gains, strict=True))
    return PlannedViews(
        tuple(views), gains, one_by_one.distance_mm, one_by_one.tilt_deg, len(greedy),
        goal.within_px(so_far) <= goal_px, so_far.covered >= goal_covered,
    )  # fmt: skip


def _gains(goal: _Goal, photos: Sequence[CandidatePhoto]) -> tuple[ViewGain, ...]:
    """What is known and covered before and after each photo."""
    gains, so_far = [], goal.start
    for photo in photos:
        then = with_photo(so_far, photo)
        gains.append(
            ViewGain(goal.within_px(so_far), goal.within_px(then), so_far.covered, then.covered, tells_area=True)
        )
        so_far = then
    return tuple(gains)


def _greedy(goal: _Goal, most: int) -> tuple[CandidatePhoto, ...]:
    photos: list[CandidatePhoto] = []
    while len(photos) < most and not goal.is_met(photos):
        so_far = goal.after(photos)
        wants_area = len(photos) >= FEWEST - 1 and goal.within_px(so_far) <= goal.goal_px
        photo = for_coverage(goal.scene, so_far) if wants_area and so_far.covered < goal.goal_covered else None
        if photo is not None and new_area(so_far, photo.area) < LITTLE_AREA:
            break
        photo = photo or next(for_accuracy(goal.scene, so_far), None)
        if photo is None:
            break
        photos.append(photo)
    return tuple(photos)


def _exchanged(goal: _Goal, photos: tuple[CandidatePhoto, ...]) -> tuple[CandidatePhoto, ...]:
    """As few as still meet the goal: photos left out, and others put in their place."""
    photos = _without_spare(goal, photos)
    for _ in range(ROUNDS):
        before = photos
        for number in range(len(photos)):
            rest = (*photos[:number], *photos[number + 1 :])
            best = next(for_accuracy(goal.scene, goal.after(rest)), None)
            if best is None:
                continue
            swapped = (*photos[:number], best, *photos[number + 1 :])
            is_better = goal.within_px(goal.after(swapped)) < WORTH_A_SWAP * goal.within_px(goal.after(photos))
            if is_better and goal.is_met(swapped):
                photos = swapped
        photos = _without_spare(goal, photos)
        if photos == before:
            break
    return photos


def _without_spare(goal: _Goal, photos: tuple[CandidatePhoto, ...]) -> tuple[CandidatePhoto, ...]:
    """Without those that are not needed, the least useful first."""
    while len(photos) > FEWEST:
        fewer = [(*photos[:number], *photos[number + 1 :]) for number in range(len(photos))]
        met = [some for some in fewer if goal.is_met(some)]
        if not met:
            break
        photos = min(met, key=lambda some: goal.within_px(goal.after(some)))
    return photos


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
        camera, Observations(camera.image_size, (), none, none, np.zeros((0, 2)), None, points), np.zeros((0, 4, 4)),
        np.zeros((0, 2)), np.zeros(0, dtype=np.bool_), noise_px, np.diag(deviation**2), np.zeros((0, 6, 6)), (),
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
    turn = np.stack([shape.axes[0], shape.axes[1], -shape.axes[2]]) if shape.is_flat else np.eye(3)
    extent = float(np.ptp(shape.position_mm, axis=0).max())
    near, far = 0.6 * extent, 1000.0 * extent
    for _ in range(SIZING_STEPS):
        middle = math.sqrt(near * far)
        pose = make_pose(turn, np.array([0.0, 0.0, middle]) - turn @ shape.center_mm)
        pixel = project(camera, transform(pose, shape.position_mm))
        is_all = bool(np.isfinite(pixel).all())
        if is_all and float((np.ptp(pixel, axis=0) / size_px).max()) < fill:
            far = middle
        else:
            near = middle
    return far
