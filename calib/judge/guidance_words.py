"""What is known after a photo, as it is told: headline, bars, map, ghost, photos."""

import math
from collections.abc import Sequence

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.types import Detections
from calib.judge.coverage import lit_part
from calib.judge.guidance import Bar, Ghost, GuideSettings, Line, SensorMap, Stage, TakenPhoto
from calib.judge.guide_state import FEWEST_PHOTOS, MAP, Insight, Proposal, Standing
from calib.judge.next_view_words import place_of, place_words, thing_word, tilt_words
from calib.judge.next_views import outline_px
from calib.judge.target_hints import held_at, short_of, side_words
from calib.judge.verdict import Check, Grade, px
from calib.judge.views import TargetShape
from calib.solver.accuracy import projected_sigma_px
from designer.base.arrays import Array, Rows
from designer.base.words import counted, figure

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


def ghost_of(proposal: Proposal, camera: Camera, shape: TargetShape, *, is_rough: bool) -> Ghost:
    """A proposed view in words."""
    view, sentence, gain = proposal.view, "", ""
    if view is not None:
        sentence, gain = view.sentence, f"{100 * view.covered_before:.0f} -> {100 * view.covered_after:.0f} % covered"
        if proposal.is_for_accuracy:
            before = f"{figure(view.sigma_px_before, 2)} -> " if math.isfinite(view.sigma_px_before) else ""
            gain = f"{before}{figure(view.sigma_px_after, 2)} px"
    return ghost_at(proposal.cam_from_target, camera, shape, sentence, gain, is_rough=is_rough)


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
            remark = f"only {rings[number]} rings, usually {usual:.0f}"
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
