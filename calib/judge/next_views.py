"""The next photos that would make a camera better known: of many that could be taken, those that tell most.

As long as the camera is not known as well as wanted, the next is the one after which the deviation that 95 % of the
image stays within is least (`calib.judge.greedy`); then the one that shows most of what no photo has shown.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np

from calib.cameras import learned_models, project
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import covariance_with_prior
from calib.core.se3 import rigid_fault, transform
from calib.core.types import freeze, frozen_array
from calib.judge.candidate_views import LONG, faces_seen
from calib.judge.greedy import LITTLE_GAIN, one_by_one
from calib.judge.information import image_change, sigma_px
from calib.judge.next_view_words import Hold, ViewGain, place_of, sentence_of
from calib.judge.view_search import CandidatePhoto, SoFar, ViewSearch, view_search
from calib.judge.views import TargetShape
from calib.solver.accuracy import NO_FIT, SHARE_PERCENT, share_px
from calib.solver.calibration import Calibration, without_surface
from calib.solver.target_error import LeftOpen
from designer.base.arrays import Array, Flags
from designer.base.file_kind import FileKind
from designer.base.marks import ONE_LINE, AtLeast, AtMost, Length, NullIs, Shape

MOST_VIEWS = 8
MOST_FOR_ACCURACY = 4
"""What is known after so many photos is to be solved before more are chosen by it."""
LITTLE_AREA = 0.01
"""Of the image: a photo that adds less than this to what is covered adds nothing."""
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
    calibration: Calibration,
    *,
    most: int = MOST_VIEWS,
    goal_px: float = 0.0,
    goal_covered: float = 0.0,
    face_share: float | None = None,
    factor: float = 1.0,
    opened: LeftOpen | None = None,
    little_gain: float = LITTLE_GAIN,
    is_avoided: Callable[[Array], Flags] | None = None,
    shape: TargetShape | None = None,
) -> tuple[NextView, ...]:
    """The photos to take next, the most useful first; none if both goals are reached, or `why_no_next_views` says why.

    Args:
        calibration: what is known so far.
        most: so many photos at most; fewer if more do little.
        goal_px: 95 % of the image is to be known so well.
        goal_covered: so much of the image is to be surrounded by sightings, 0 to 1.
        face_share: so much of a face must be seen for its rings to be read; None: as in the photos taken so far.
        factor: that halves of the photos enlarge the standard deviations of the noise by.
        opened: what photos so far leave open of the target's shape; None: not known, or no matter.
        little_gain: a photo that leaves more than this of the deviation is not worth taking.
        is_avoided: which of poses (C, 4, 4) are not to be proposed (C,).
        shape: of the target, if it is known already.
    """
    calibration = without_surface(calibration)  # what tells most of the base tells most of what lies around it
    is_able = not why_no_next_views(calibration)
    search = view_search(calibration, face_share, factor, opened, shape=shape) if is_able else None
    if search is None:
        return ()
    search = search if is_avoided is None else search.without(is_avoided)
    change = image_change(search.known)
    if not len(change) or not len(search):
        return ()
    everywhere = int(search.lit.is_lit(image_grid(calibration.camera.image_size)).sum())
    is_whole = search.known.is_determined and len(change) >= SHARE_PERCENT / 100 * everywhere
    # Where the lens model breaks down in more than the rest, numbers can only be of what it reaches.
    pixels = everywhere if is_whole else len(change)

    @cache
    def within_px(so_far: SoFar) -> float:
        return share_px(sigma_px(change, search.stated.after(so_far.told)), pixels)

    def choose(so_far: SoFar) -> CandidatePhoto | None:
        before = within_px(so_far)
        photos = search.for_accuracy(so_far) if len(so_far.chosen) < MOST_FOR_ACCURACY and wants(so_far, before) else ()
        for photo in photos:
            if within_px(so_far.with_photo(photo)) <= little_gain * before:
                return photo
        new = search.for_coverage(so_far) if so_far.covered < goal_covered else None
        return None if new is None or so_far.new_area(new.area) <= LITTLE_AREA else new

    def wants(so_far: SoFar, before: float) -> bool:
        return before > goal_px or (not is_whole and not so_far.chosen)

    start = search.start()
    is_rough = not is_whole or within_px(start) > ROUGH_PX
    views = []
    for step in one_by_one(start, choose, SoFar.with_photo, most):
        before, after = within_px(step.before), within_px(step.after)
        shown = before if is_whole or step.before.chosen else math.inf
        gain = ViewGain(
            shown, after, step.before.covered, step.after.covered, is_rough=is_rough,
            tells_sigma=wants(step.before, before) and after <= little_gain * shown,
            tells_area=step.before.covered < goal_covered and step.before.new_area(step.choice.area) > LITTLE_AREA,
        )  # fmt: skip
        views.append(proposed_view(search, step.choice, gain))
    return tuple(views)


def proposed_view(search: ViewSearch, photo: CandidatePhoto, gain: ViewGain) -> NextView:
    """A photo that was chosen, as it is told."""
    pose = search.candidates.cam_from_target[photo.row]
    outline = outline_px(search.calibration.camera, search.shape, pose)
    before, after = round(gain.covered_before, 6), round(gain.covered_after, 6)
    lines = tuple(np.array([[round(u, 2), round(v, 2)] for u, v in line.tolist()]) for line in outline)
    sentence = sentence_of(_hold(search, photo.row, outline), gain)
    return NextView(pose, sentence, gain.before_px, gain.after_px, before, after, lines)


def photos_needed(photos: int, sigma_px_now: float, limit_px: float) -> int:
    """How many photos like those so far, these included, until a deviation is within a limit.

    Photos like each other add information alike, so that deviations fall with the square root of their number.
    """
    if not (photos > 0 and limit_px > 0 and math.isfinite(sigma_px_now)):
        raise ValueError(f"{photos} photos, {sigma_px_now} px, limit {limit_px} px: there is no such number")
    return max(photos, math.ceil(photos * (sigma_px_now / limit_px) ** 2 - 1e-9))


def _hold(search: ViewSearch, row: int, outline: tuple[Array, ...]) -> Hold:
    """How a candidate is to be held, as plain numbers."""
    one, shape, calibration = search.candidates, search.shape, search.calibration
    like, distance_mm = int(one.like_view[row]), float(one.distance_mm[row])
    first, last = search.lit.box_px
    away_mm = np.linalg.norm(transform(calibration.cam_from_target, shape.center_mm), axis=1)
    x, y, z = transform(one.cam_from_target[row], shape.center_mm).tolist()
    # Whether a solid tells about as much at a place, whichever of its sides is shown.
    alike = (one.place == one.place[row]).all(axis=1) & np.isclose(one.distance_mm, distance_mm)
    share = search.compared_px(covariance_with_prior(search.information[alike]))
    any_side = like < 0 or float(share.max()) <= SAME_FROM_ANY_SIDE * float(share.min())
    return Hold(
        place=place_of(outline, (last - first + 1).tolist(), first.tolist()),
        off_axis_deg=None if search.lit.off_axis_rad is None else math.degrees(math.atan2(math.hypot(x, y), z)),
        distance_mm=distance_mm,
        usual_distance_mm=None if search.known.is_determined else float(np.median(away_mm)),
        tilt_deg=float(one.tilt_deg[row]),
        away=(float(one.away[row, 0]), float(one.away[row, 1])),
        long_side="" if shape.aspect <= LONG or like >= 0 else "upright" if one.is_upright[row] else "level",
        like_photo="" if any_side else calibration.observations.view_names[like],
        is_flat=shape.is_flat,
    )


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
