"""The next photos that would make a camera better known: of many that could be taken, those that tell most.

As long as the camera is not known as well as wanted, the next is the one after which the deviation that 95 % of the
image stays within is least (`calib.judge.greedy`); then the one that shows most of what no photo has shown.

What a frame would add to what is known is told as a part of what the proposed view would; where the part of the image
that is covered is to grow, as a part of that growth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from calib.cameras import learned_models, project
from calib.cameras.camera import Camera
from calib.core.linear_algebra import covariance_with_prior
from calib.core.se3 import rigid_fault, transform
from calib.core.types import KnownPoints, freeze, frozen_array
from calib.judge.candidate_views import LONG, candidates_of, faces_seen, shown_in
from calib.judge.coverage import Coverage, area_of
from calib.judge.greedy import one_by_one
from calib.judge.information import ImageGoal, Knowledge, image_goal, knowledge_of, stated_error, view_information
from calib.judge.next_view_words import (
    ViewGain,
    distance_words,
    gain_words,
    place_of,
    place_words,
    short,
    thing_word,
    tilt_words,
)
from calib.judge.view_search import COARSE_MAP, CandidatePhoto, SoFar, ViewGoal, ViewSearch, view_search
from calib.judge.views import TargetShape, habits_of, shape_of
from calib.solver.accuracy import NO_FIT
from calib.solver.calibration import Calibration, without_surface
from calib.solver.target_error import LeftOpen
from designer.base.arrays import Array, Flags, Rows
from designer.base.file_kind import FileKind
from designer.base.marks import ONE_LINE, AtLeast, AtMost, Length, NullIs, Shape

MOST_VIEWS = 8
ROUGH_PX = 3.0
"""Where the image is no better known than this, the lens may be another one, and what a photo will show with it."""
SAME_FROM_ANY_SIDE = 1.15
STEPS_ALONG_EDGE = 8
FEWEST_OF_LINE = 8
"""Places of an outline: of a face that is mostly beyond what a lens sees there is none."""


MAX_PX = 1e7
"""Of a place in the image or a deviation."""
_Sigma = Annotated[float, AtLeast(0), AtMost(MAX_PX)]
_Share = Annotated[float, AtLeast(0), AtMost(1)]
_Line = Annotated[Array, Shape(None, 2), Length(2, 5000), AtLeast(-MAX_PX), AtMost(MAX_PX)]


@dataclass(frozen=True, eq=False)
class NextView:
    """A photo to take, and what it would do."""

    cam_from_target: Annotated[Array, Shape(4, 4)]
    sentence: Annotated[str, Length(1, 500), ONE_LINE]
    sigma_px_before: Annotated[_Sigma, NullIs(math.inf)]  # what 95 % of the image stays within
    sigma_px_after: Annotated[_Sigma, NullIs(math.inf)]  # with this photo and those proposed before it
    covered_before: _Share = 0.0  # of the image
    covered_after: _Share = 0.0  # with this photo and those proposed before it
    outline_px: Annotated[tuple[_Line, ...], Length(0, 1000)] = ()  # of the faces that look at the camera, closed

    def __post_init__(self) -> None:
        freeze(self, "cam_from_target")
        object.__setattr__(self, "outline_px", tuple(frozen_array(line) for line in self.outline_px))
        if fault := rigid_fault(self.cam_from_target[None]):
            raise ValueError(f"cam_from_target {fault[1]}")


@dataclass(frozen=True)
class NextViews:
    """What a folder keeps of them."""

    views: Annotated[tuple[NextView, ...], Length(0, 16)]


NEXT_VIEWS_FILE = "next_views.json"
NEXT_VIEWS = FileKind(NextViews, "next_views", "a next_views.json", "run again", largest_bytes=8 * 2**20)


def why_no_next_views(calibration: Calibration) -> str:
    """Why nothing can be proposed, in a line; empty if it can."""
    if calibration.camera.model in learned_models():  # a learned map's covariance takes it as exact
        return (
            f"the {calibration.camera.model} model's accuracy takes its learned map as exact; "
            "see the next photos of another model"
        )
    if not math.isfinite(calibration.scale) or not calibration.scale > 0:
        return "the solution states no accuracy of an observation"
    typical = float(np.sqrt(np.median((calibration.residual_px**2).sum(axis=1))))
    if not typical < NO_FIT * max(calibration.camera.image_size):
        return "the solution does not fit its photos"
    if int((calibration.observations.points.face >= 0).sum()) < 3:
        return "the points lie on no known plane, so which of them a photo would show is not known"
    return ""


def next_views(
    calibration: Calibration, *, most: int = MOST_VIEWS, goal_px: float = 0.0, goal_covered: float = 0.0,
    factor: float = 1.0, opened: LeftOpen | None = None,
) -> tuple[NextView, ...]:  # fmt: skip
    """The photos to take next, the most useful first; none if both goals are reached, or `why_no_next_views` says why.

    Args:
        calibration: what is known so far.
        most: so many photos at most; fewer if more do little.
        goal_px: 95 % of the image is to be known so well.
        goal_covered: so much of the image is to be surrounded by observations, 0 to 1.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
        opened: what photos so far leave open of the target's shape; None: not known, or no matter.
    """
    search = next_view_search(calibration, factor=factor, opened=opened)
    return () if search is None else proposed_views(search, ViewGoal(goal_px, goal_covered), most)


def next_view_search(
    calibration: Calibration, *, factor: float = 1.0, opened: LeftOpen | None = None,
    is_avoided: Callable[[Array], Flags] | None = None, shape: TargetShape | None = None,
) -> ViewSearch | None:  # fmt: skip
    """What photos that could be taken next tell; None if nothing can be proposed.

    Args:
        calibration: what is known so far.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
        opened: what photos so far leave open of the target's shape; None: not known, or no matter.
        is_avoided: which of poses (C, 4, 4) are not to be proposed (C,).
        shape: of the target, if it is known already.
    """
    calibration = without_surface(calibration)  # what tells most of the base tells most of what lies around it
    if why_no_next_views(calibration) or (shape := shape or shape_of(calibration)) is None:
        return None
    habits = habits_of(calibration, shape)
    candidates = candidates_of(calibration, shape, habits)
    if is_avoided is not None:
        candidates = candidates[~is_avoided(candidates.cam_from_target)]
    known = knowledge_of(calibration)
    error = stated_error(known, calibration, factor, opened)
    return view_search(calibration, shape, habits, candidates, known, error)


def proposed_views(search: ViewSearch, goal: ViewGoal, most: int) -> tuple[NextView, ...]:
    """So many photos at most towards a goal, as they are told."""
    start = search.start()
    is_rough = not search.is_whole or start.within_px > ROUGH_PX
    views = []
    for step in one_by_one(start, partial(search.choose, goal=goal), SoFar.with_photo, most):
        before, after = step.before, step.after
        shown_px = before.within_px if search.is_whole or before.chosen else math.inf
        gain = ViewGain(
            shown_px, after.within_px, before.covered, after.covered, is_rough=is_rough,
            tells_sigma=before.wants_accuracy(goal) and after.within_px <= goal.little_gain * shown_px,
            tells_area=before.covered < goal.covered and before.new_area(step.choice.area) > goal.little_area,
        )  # fmt: skip
        views.append(proposed_view(search, step.choice, gain))
    return tuple(views)


def proposed_view(search: ViewSearch, photo: CandidatePhoto, gain: ViewGain) -> NextView:
    """A photo that was chosen, as it is told."""
    pose = search.candidates.cam_from_target[photo.row]
    outline = outline_px(search.calibration.camera, search.shape, pose)
    before, after = round(gain.covered_before, 6), round(gain.covered_after, 6)
    lines = tuple(np.array([[round(u, 2), round(v, 2)] for u, v in line.tolist()]) for line in outline)
    sentence = f"{_hold_words(search, photo.row, outline)}: {gain_words(gain)}"
    return NextView(pose, sentence, gain.before_px, gain.after_px, before, after, lines)


def photos_needed(photos: int, sigma_px_now: float, limit_px: float) -> int:
    """How many photos like those so far, these included, until a deviation is within a limit.

    Photos like each other add information alike, so that deviations fall with the square root of their number.
    """
    if not (photos > 0 and limit_px > 0 and math.isfinite(sigma_px_now)):
        raise ValueError(f"{photos} photos, {sigma_px_now} px, limit {limit_px} px: there is no such number")
    return max(photos, math.ceil(photos * (sigma_px_now / limit_px) ** 2 - 1e-9))


def _hold_words(search: ViewSearch, row: int, outline: tuple[Array, ...]) -> str:
    """How a candidate is to be held, all that a person must do."""
    one, shape, calibration = search.candidates, search.shape, search.calibration
    like, distance_mm = int(one.like_view[row]), float(one.distance_mm[row])
    first, last = search.lit.box_px
    place = place_of(outline, (last - first + 1).tolist(), first.tolist())
    parts = [f"hold the {thing_word(is_flat=shape.is_flat)} {place_words(place)}"]
    if search.lit.off_axis_rad is not None and any(place):
        x, y, z = transform(one.cam_from_target[row], shape.center_mm).tolist()
        parts.append(f"{math.degrees(math.atan2(math.hypot(x, y), z)):.0f} deg off the axis")
    if shape.aspect > LONG and like < 0:
        parts.append(f"its long side {'upright' if one.is_upright[row] else 'level'}")
    if shape.is_flat:
        right, down = one.away[row].tolist()
        parts.append(tilt_words(float(one.tilt_deg[row]), (right, down)))
    else:
        # Whether a solid tells about as much at a place, whichever of its sides is shown.
        alike = (one.place == one.place[row]).all(axis=1) & np.isclose(one.distance_mm, distance_mm)
        share = search.coarse.compared_px(covariance_with_prior(search.information[alike]))
        any_side = like < 0 or float(share.max()) <= SAME_FROM_ANY_SIDE * float(share.min())
        names = calibration.observations.view_names
        parts.append("any side to the camera" if any_side else f"turned as in {short(names[like])}")
    away_mm = np.linalg.norm(transform(calibration.cam_from_target, shape.center_mm), axis=1)
    # Where the lens is not determined, only the ratio of distances is known.
    usual_mm = None if search.known.is_determined else float(np.median(away_mm))
    return ", ".join([*parts, f"at about {distance_words(distance_mm, usual_mm)}"])


def outline_px(camera: Camera, shape: TargetShape, cam_from_target: Array) -> tuple[Array, ...]:
    """Closed lines (K, 2) in the image around the outermost rings of each face that looks at the camera."""
    looks = faces_seen(shape, cam_from_target[None])[0][0]
    lines = []
    for face in np.flatnonzero(looks).tolist():
        corner = shape.position_mm[shape.corner[face]]
        if len(corner) < 3:
            continue
        step = np.linspace(0, 1, STEPS_ALONG_EDGE, endpoint=False)[:, None]
        edges = corner[:, None] + step * (np.roll(corner, -1, axis=0) - corner)[:, None]
        line = edges.reshape(-1, 3)
        pixel = project(camera, transform(cam_from_target, np.concatenate([line, line[:1]])))
        seen = pixel[np.isfinite(pixel).all(axis=1)]
        if len(seen) > FEWEST_OF_LINE:
            lines.append(seen)
    return tuple(lines)


MOST_POINTS = 300
"""Of a view, that its worth is told by."""
LITTLE = 1e-3
"""Of the deviation, or of the image: a proposal that gains less is no measure of others."""


@dataclass(frozen=True, eq=False)
class ViewGains:
    """What views are measured against, and what they are worth of the view that is proposed."""

    known: Knowledge
    coarse: ImageGoal
    points: KnownPoints  # of the target
    covered: Coverage
    is_for_accuracy: bool  # else the proposal is to show a part of the image first
    sigma_px: float = 0.0  # that 95 % of the map stays within now
    proposed: float = 0.0  # what the proposal gains: px off that, or a part of the image

    def worth(self, pose: Array, rows: Rows, pixel: Array) -> float:
        """What a view is worth of the proposal, 0 to 1.

        Args:
            pose: of the view (4, 4).
            rows: of the points it shows (N,).
            pixel: where (N, 2).
        """
        is_measure = self.proposed > LITTLE * (self.sigma_px if self.is_for_accuracy else 1.0)
        return min(self.gain(pose, rows, pixel) / self.proposed, 1.0) if is_measure else 0.0

    def gain(self, pose: Array, rows: Rows, pixel: Array) -> float:
        """What a view takes off the deviation (px), or of the image what it shows first."""
        if not self.is_for_accuracy:
            shown = area_of(self.covered.image_size, pixel, self.points.face[rows])
            return self.covered.share_of(shown & ~self.covered.is_covered)
        some = rows[:: max(1, -(-len(rows) // MOST_POINTS))]
        if not len(some):
            return 0.0
        weight = np.full((1, len(some)), len(rows) / len(some))
        told = view_information(self.known, pose[None], self.points.position_mm[some], weight)[0]
        return max(self.sigma_px - float(self.coarse.compared_px(covariance_with_prior(told))), 0.0)


def gains_of(
    calibration: Calibration, shape: TargetShape, covered: Coverage, view: NextView, *, is_for_accuracy: bool
) -> ViewGains:
    """What views of a calibration's target are measured against, with one that is proposed."""
    known, points = knowledge_of(calibration), calibration.observations.points
    coarse = image_goal(known, *COARSE_MAP)
    now_px = float(coarse.compared_px(np.eye(known.basis.shape[1])))
    gains = ViewGains(known, coarse, points, covered, is_for_accuracy, now_px)
    pose, every = view.cam_from_target, np.arange(len(shape.face))
    shown = shown_in(known.camera, shape, habits_of(calibration, shape), pose[None], every)
    rows, pixel = np.flatnonzero(points.face >= 0)[shown.is_read[0]], shown.pixel[0, shown.is_read[0]]
    return replace(gains, proposed=gains.gain(pose, rows, pixel))
