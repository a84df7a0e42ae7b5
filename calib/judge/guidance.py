"""What a guide tells while photos are taken: how well the camera is known, where to hold the target, what a frame adds.

Each is a value, told anew: `Guidance` after a photo was taken or deleted, `Look` for every frame. And how it is put:
headline, bars, map, ghost, photos.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.types import Detections, freeze
from calib.judge.coverage import lit_part
from calib.judge.guide_state import FEWEST_PHOTOS, MAP, GuideSettings, Insight, Standing
from calib.judge.next_view_words import place_of, place_words, thing_word, tilt_words
from calib.judge.next_views import outline_px
from calib.judge.target_hints import Line, held_at, short_of, side_words
from calib.judge.verdict import Check, Grade, px
from calib.judge.views import TargetShape
from calib.solver.accuracy import projected_sigma_px
from designer.base.arrays import Array, Flags, Rows
from designer.base.marks import OR_NULL, Gap
from designer.base.words import counted, figure

Stage = Literal["first", "guiding", "good", "exhausted"]
"""No camera is known yet; it is, and photos are proposed; it is good; more photos would not make it better."""


@dataclass(frozen=True)
class Bar:
    """How far one of the verdict's checks is."""

    name: str  # of the check: "uncertainty"
    title: str  # "uncertainty"
    text: str  # "0.31 px, 0.05 px wanted"
    share: float  # of what is wanted, 0 to 1
    grade: Grade | Literal["unknown"]


@dataclass(frozen=True, eq=False)
class SensorMap:
    """What is known of each part of an image."""

    sigma_px: Annotated[Array, OR_NULL]  # (R, C) along the worse axis; nan: nothing is known
    is_covered: Flags  # (R, C) surrounded by sightings
    wanted_px: float

    def __post_init__(self) -> None:
        freeze(self, "sigma_px")
        freeze(self, "is_covered", dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Ghost:
    """Where to hold the target next."""

    cam_from_target: Array  # (4, 4); in a rig of the first camera that is to see it
    sentence: str  # all that is to be said: where, how tilted, how far, and what it gives
    short: str  # to be read from three metres: "bottom left, right side back, 0.45 m"
    distance_mm: float
    tilt_deg: Gap  # of a flat target; nan: a solid
    gain: str  # "0.21 -> 0.13 px"
    is_rough: bool  # the camera is hardly known: only about here


@dataclass(frozen=True, eq=False)
class CameraGuidance:
    """What concerns one camera of a rig, or the only one."""

    name: str
    image_size: tuple[int, int]  # width, height in px
    map: SensorMap | None  # None: the camera is not known yet
    ghost_px: tuple[Line, ...]  # (K, 2) closed lines around the ghost's faces in its image; none: not to be seen there


@dataclass(frozen=True, eq=False)
class TakenPhoto:
    """A photo that was taken; of a rig one of its frames."""

    name: str
    rings: int  # named in it, over all cameras
    is_counted: bool  # the camera is solved from it
    remark: str  # why not, or what to know of it; "" for nothing
    outline_px: tuple[Line, ...]  # (K, 2) around what it shows, in the first camera's image


@dataclass(frozen=True, eq=False)
class Guidance:
    """All that the page shows between two photos."""

    stage: Stage
    headline: str  # "0.31 px in 95 % of the image, 0.05 px wanted; 5 photos"
    bars: tuple[Bar, ...]
    cameras: tuple[CameraGuidance, ...]
    ghost: Ghost | None  # None: nothing is proposed
    photos: tuple[TakenPhoto, ...]  # in the order they were taken
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class FrameNote:
    """Something to say of a frame at once."""

    name: str  # "motion"
    sentence: str  # "hold still: blurred by 4 px"
    forbids: bool  # a frame is not taken by itself with it


@dataclass(frozen=True, eq=False)
class Look:
    """What one frame shows, and whether it is worth taking; stillness is another matter (`calib.judge.live_frame`)."""

    cam_from_target: Array | None  # (4, 4) by the camera as it is known; None: not to be told
    outline_px: tuple[Line, ...]  # (K, 2) around what was found
    worth: float  # what it would add, of what the ghost would: 0 to 1
    is_match: bool  # as the ghost, near enough
    hint: str  # how to come to the ghost from here: "closer, and tilt the right side away"; "" if there
    notes: tuple[FrameNote, ...]
    is_wanted: bool  # worth taking if it is still: a match or of worth, and nothing forbids it


ALWAYS = {"uncertainty": "uncertainty", "coverage": "coverage", "halves": "halves agree"}
"""Checks that have a bar from the first photo on; others only where they are not good."""
FEW_RINGS = 0.5
"""Of what the other photos show."""
LEAST_OF_FACE = 3


def map_of(known: Insight, wanted_px: float) -> SensorMap | None:
    """What is known of each part of the image; None: no camera is."""
    calibration, covered = known.calibration, known.coverage
    if calibration is None or covered is None:
        return None
    pixel = image_grid(calibration.camera.image_size, *MAP)
    flat, cells = pixel.reshape(-1, 2), covered.is_covered
    sigma = projected_sigma_px(lit_part(calibration).camera, known.covariance_of(calibration), flat)
    place = (flat + 0.5) / calibration.camera.image_size * cells.shape[::-1]
    column, row = np.clip(place.astype(np.int64), 0, np.array(cells.shape[::-1]) - 1).T
    shape = pixel.shape[:2]
    return SensorMap(sigma.reshape(shape), cells[row, column].reshape(shape), wanted_px)


def headline_of(stage: Stage, known: Insight, settings: GuideSettings) -> str:
    """The state in a line."""
    wanted, percent = settings.criteria["uncertainty"].good, settings.criteria["coverage"].good
    count = counted(known.photos, "photo") if known.photos else "no photo yet"
    if stage == "first":
        return f"no camera yet; {count}"
    is_told = math.isfinite(known.sigma_px)
    if known.standing is None:
        told = f"about {figure(known.sigma_px, 1)} px in 95 % of the image" if is_told else "hardly anything"
        more = "; no view is found that would help" if stage == "exhausted" else ""
        return f"{told} by a first camera, {wanted:g} px wanted; {count}{more}"
    told = f"{px(known.sigma_px)} in 95 % of the image" if is_told else "part of the image is not known"
    if stage == "good":
        return f"good: {told}, {100 * known.covered:.0f} % covered; {count} are enough"
    if stage == "exhausted":
        return f"{known.standing.verdict.grade}: {told}; {count}; {why_exhausted(known.standing)}"
    missing = [] if known.sigma_px <= wanted else [f"{wanted:g} px wanted"]
    if 100 * known.covered < percent:
        missing.append(f"{100 * known.covered:.0f} % covered, {percent:.0f} % wanted")
    missing = missing or [f"to be checked: {check.title.lower()}" for check in not_good(known.standing)[:1]]
    missing = missing or [f"at least {FEWEST_PHOTOS} photos wanted"]
    return "; ".join([", ".join([told, *missing]), count])


def not_good(standing: Standing) -> list[Check]:
    """The checks of a verdict that are not good, that of other models aside: only one model is solved."""
    return [check for check in standing.verdict.checks if check.grade != "good" and check.name != "models"]


def why_exhausted(standing: Standing) -> str:
    """Why more photos would help little: where the target limits it, four times as many halve its part."""
    uncertain = standing.evidence.uncertainty
    if uncertain.by_target:
        part = px(uncertain.target_px)
        return f"more would help little: what the target may be off limits it ({part}); measure it with calib measure"
    if uncertain.field_px and uncertain.by_field:
        return "more would not help: the lens does things that no formula follows; calib run tries a model that does"
    return f"more would help little: {standing.verdict.sentence}"


def bars_of(known: Insight, settings: GuideSettings) -> tuple[Bar, ...]:
    """How far the checks are."""
    if known.standing is None:
        limit, part = settings.criteria["uncertainty"].good, settings.criteria["coverage"].good
        sigma_px, percent = known.sigma_px, 100 * known.covered
        told = f"about {figure(sigma_px, 1)} px" if math.isfinite(sigma_px) else "not known yet"
        share = min(limit / sigma_px, 1.0) if sigma_px > 0 else 0.0
        area = min(percent / part, 1.0) if part > 0 else 1.0
        grade: Grade = "good" if area >= 1 else "bad"
        return (
            Bar("uncertainty", ALWAYS["uncertainty"], f"{told}, {limit:g} px wanted", share, "unknown"),
            Bar("coverage", ALWAYS["coverage"], f"{percent:.0f} %, {part:.0f} % wanted", area, grade),
            Bar("halves", ALWAYS["halves"], "not to be told yet", 0.0, "unknown"),
        )
    some = [check for check in known.standing.verdict.checks if check.name in ALWAYS]
    return tuple(bar_of(one) for one in [*some, *(one for one in not_good(known.standing) if one.name not in ALWAYS)])


def bar_of(check: Check) -> Bar:
    """How far a check is."""
    limit, value, share = check.good, check.value, float(check.grade == "good")
    if value and limit and not share:
        share = value / limit if check.is_at_least else limit / value
    wanted = f"{check.good:g} {check.unit}".rstrip()
    text = f"{check.measured}, {wanted} wanted" if check.measured else "not to be told yet"
    return Bar(check.name, ALWAYS.get(check.name, check.title.lower()), text, min(max(share, 0.0), 1.0), check.grade)


def ghost_at(pose: Array, camera: Camera, shape: TargetShape, sentence: str, gain: str, *, is_rough: bool) -> Ghost:
    """A target held at a pose (4, 4) in words, if none are given."""
    held = held_at(camera, shape, pose)
    outline = outline_px(camera, shape, pose)
    place = place_of(outline, camera.image_size, (0, 0)) if outline else (0.0, 0.0)
    if not sentence:
        how = "any side to the camera"
        if shape.is_flat:
            side = side_words(held.away)  # the nearest of eight
            right, down = ("right" in side) - ("left" in side), ("bottom" in side) - ("top" in side)
            how = tilt_words(5 * round(held.tilt_deg / 5), (float(right), float(down)))
        thing = thing_word(is_flat=shape.is_flat)
        sentence = f"hold the {thing} {place_words(place)}, {how}, so that it fills most of it"
    tilt = held.tilt_deg if shape.is_flat else math.nan
    return Ghost(pose, sentence, short_of(held, place, is_flat=shape.is_flat), held.distance_mm, tilt, gain, is_rough)


def photos_of(photos: Sequence[Detections], insight: Insight, face: Rows) -> tuple[TakenPhoto, ...]:
    """The photos with what is to be known of each."""
    left_out = dict(insight.left_out)
    rings = np.array([len(one.ring) for one in photos])
    told = []
    for number, one in enumerate(photos):
        others = np.delete(rings, number)
        usual = float(np.median(others)) if len(others) else 0.0
        remark = left_out.get(one.image, "")
        if not remark and rings[number] < FEW_RINGS * usual:
            remark = f"only {rings[number]} points, usually {usual:.0f}"
        is_counted = one.image not in left_out
        told.append(TakenPhoto(one.image, int(rings[number]), is_counted, remark, outlines_of(one, face)))
    return tuple(told)


def outlines_of(found: Detections, face: Rows) -> tuple[Line, ...]:
    """Closed lines around what was found of each face."""
    import cv2

    lines = []
    of_ring = face[np.minimum(found.ring, len(face) - 1)]
    for one in np.unique(of_ring).tolist():
        place = found.center_px[of_ring == one]
        if len(place) >= LEAST_OF_FACE:
            hull = cv2.convexHull(place.astype(np.float32))[:, 0].astype(np.float64)
            lines.append(np.concatenate([hull, hull[:1]]).round(1))
    return tuple(lines)
