"""The next photos that would make a camera better known: of many that could be taken, those that tell most.

Photos are chosen one after the other. As long as the camera is not known as well as wanted, the next is the one after
which the deviation that 95 % of the image stays within is least, with all chosen before it taken (greedy optimal
design; as guidance in Richardson et al. 2013, "AprilCal"); then the one that shows most of what no photo has shown.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from calib.cameras import learned_models, project
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import covariance_with_prior
from calib.core.se3 import rigid_fault, transform
from calib.core.types import frozen_array
from calib.judge.candidate_views import CandidateViews, faces_seen
from calib.judge.choose_views import (
    CandidatePhoto,
    SoFar,
    ViewChoice,
    compared_px,
    for_accuracy,
    for_coverage,
    new_area,
    of_candidates,
    scene_of,
    start_of,
    with_photo,
)
from calib.judge.coverage import LitPart, lit_part
from calib.judge.information import image_change, sigma_px
from calib.judge.next_view_words import Hold, ViewGain, place_of, sentence_of
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
LITTLE_GAIN = 0.97
"""A photo that leaves more than this of the deviation is not worth taking."""
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
        object.__setattr__(self, "cam_from_target", frozen_array(self.cam_from_target))
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
    scene = scene_of(calibration, face_share, factor, opened, shape=shape) if is_able else None
    if scene is None:
        return ()
    if is_avoided is not None:
        scene = of_candidates(scene, ~is_avoided(scene.candidates.cam_from_target))
    change = image_change(scene.known)
    if not len(change) or not len(scene.candidates.distance_mm):
        return ()
    lit = lit_part(calibration)
    everywhere = int(lit.is_lit(image_grid(calibration.camera.image_size)).sum())
    is_known = scene.known.is_determined and len(change) >= SHARE_PERCENT / 100 * everywhere
    # Where the lens model breaks down in more than the rest, numbers can only be of what it reaches.
    pixels = everywhere if is_known else len(change)

    def within_px(told: Array) -> float:
        return share_px(sigma_px(change, scene.stated.after(told)), pixels)

    so_far = start_of(scene, calibration)
    before = within_px(so_far.told)
    is_rough = not is_known or before > ROUGH_PX
    chosen: list[NextView] = []
    while len(chosen) < most:
        wants_accuracy = not is_known or before > goal_px
        photo = _more_accurate(scene, so_far, within_px, little_gain * before) if wants_accuracy else None
        if photo is None and so_far.covered < goal_covered:
            photo = for_coverage(scene, so_far)
            photo = None if photo is None or new_area(so_far, photo.area) <= LITTLE_AREA else photo
        if photo is None:
            break
        then = with_photo(so_far, photo)
        after = within_px(then.told)
        shown = before if is_known else math.inf
        wants_area = so_far.covered < goal_covered
        gain = ViewGain(
            shown, after, so_far.covered, then.covered, is_rough=is_rough,
            tells_sigma=wants_accuracy and after <= little_gain * shown,
            tells_area=wants_area and new_area(so_far, photo.area) > LITTLE_AREA,
        )  # fmt: skip
        chosen.append(proposed_view(scene, calibration, lit, photo, gain))
        so_far, before, is_known = then, after, True
    return tuple(chosen)


def _more_accurate(
    scene: ViewChoice, so_far: SoFar, within_px: Callable[[Array], float], worth_px: float
) -> CandidatePhoto | None:
    """The photo after which the camera is known better than something, by information; None if none is worth it."""
    photos = for_accuracy(scene, so_far) if len(so_far.chosen) < MOST_FOR_ACCURACY else ()
    return next((photo for photo in photos if within_px(so_far.told + photo.information) <= worth_px), None)


def proposed_view(
    scene: ViewChoice, calibration: Calibration, lit: LitPart, photo: CandidatePhoto, gain: ViewGain
) -> NextView:
    """A photo that was chosen, as it is told."""
    one = scene.candidates[np.array([photo.row])]
    pose = one.cam_from_target[0]
    outline = outline_px(calibration.camera, scene.shape, pose)
    sentence = sentence_of(_hold(scene, one, calibration, lit, outline), gain)
    before, after = round(gain.covered_before, 6), round(gain.covered_after, 6)
    lines = tuple(np.array([[round(u, 2), round(v, 2)] for u, v in line.tolist()]) for line in outline)
    return NextView(pose, sentence, gain.before_px, gain.after_px, before, after, lines)


def photos_needed(photos: int, sigma_px_now: float, limit_px: float) -> int:
    """How many photos like those so far, these included, until a deviation is within a limit.

    Photos like each other add information alike, so that deviations fall with the square root of their number.
    """
    if not (photos > 0 and limit_px > 0 and math.isfinite(sigma_px_now)):
        raise ValueError(f"{photos} photos, {sigma_px_now} px, limit {limit_px} px: there is no such number")
    return max(photos, math.ceil(photos * (sigma_px_now / limit_px) ** 2 - 1e-9))


def _hold(
    scene: ViewChoice, one: CandidateViews, calibration: Calibration, lit: LitPart, outline: tuple[Array, ...]
) -> Hold:
    """How a candidate is to be held, as plain numbers."""
    like = int(one.like_view[0])
    (left, top), (width, height) = (part.tolist() for part in (lit.box_px[0], lit.box_px[1] - lit.box_px[0] + 1))
    away_mm = np.linalg.norm(transform(calibration.cam_from_target, scene.shape.center_mm), axis=1)
    any_side = like < 0 or _is_same_from_any_side(scene, one)
    return Hold(
        place=place_of(outline, (width, height), (left, top)),
        off_axis_deg=_off_axis_deg(scene, one) if lit.off_axis_rad is not None else None,
        distance_mm=float(one.distance_mm[0]),
        usual_distance_mm=None if scene.known.is_determined else float(np.median(away_mm)),
        tilt_deg=float(one.tilt_deg[0]),
        away=(float(one.away[0, 0]), float(one.away[0, 1])),
        long_side="" if scene.shape.aspect <= 1.15 or like >= 0 else "upright" if one.is_upright[0] else "level",
        like_photo="" if any_side else calibration.observations.view_names[like],
        is_flat=scene.shape.is_flat,
    )


def _off_axis_deg(scene: ViewChoice, one: CandidateViews) -> float:
    """The angle between the axis and the target's middle."""
    x, y, z = transform(one.cam_from_target[0], scene.shape.center_mm).tolist()
    return math.degrees(math.atan2(math.hypot(x, y), z))


def _is_same_from_any_side(scene: ViewChoice, one: CandidateViews) -> bool:
    """Whether a solid tells about as much at a place, whichever of its sides is shown."""
    all_of = scene.candidates
    alike = (all_of.place == one.place).all(axis=1) & np.isclose(all_of.distance_mm, one.distance_mm[0])
    share = compared_px(scene, covariance_with_prior(scene.information[alike]))
    return float(share.max()) <= SAME_FROM_ANY_SIDE * float(share.min())


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
