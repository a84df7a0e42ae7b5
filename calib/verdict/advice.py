"""What to do better next time, in sentences: each rests on a number of these photos, the most useful comes first.

What spoils the photos comes before what is missing in them: more photos of a bent target make nothing better.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.results.evaluation_table import figure
from calib.solver.outliers import deviations
from calib.types import Calibration
from calib.verdict.checks import BY_CHANCE
from calib.verdict.coverage import region_words
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import FAR_OFF, Evidence, HalvesFound
from calib.verdict.next_view_words import distance_words, short
from calib.verdict.next_views import NextView, photos_needed
from calib.verdict.view_facts import ViewFacts, view_facts

SMALL_TILT_DEG, GOOD_TILT_DEG = 15.0, 20.0
"""Tilts below the first hardly tell focal length from distance; those from the second on do."""
TILTED_VIEWS, TILTED_SHARE = 3, 0.3
ONE_DISTANCE = 1.1
"""Distances that differ by less than this factor are one."""
SMALL_SIZE = 0.33
"""Of the image: a target that fills less of it in the median photo is small."""
FEW_RINGS = 20
FEW_PHOTOS, ENOUGH_PHOTOS = 6, 10
MANY_TIMES = 5
"""So many times as many photos as there are will not be taken."""
HOPELESS_TIMES = 100
"""A number that large tells nobody anything."""
LARGE_SHARE, NOTICEABLE = 0.5, 3.0
"""A part of what is left over that is worth a word: so much of it, and so many times the detector's noise."""
WORSE, SPREADS = 2.0, 5.0
"""A photo stands out if its residuals are so many times the median, and beyond it by so many robust deviations."""
HARMLESS = 0.5
"""Of the limit of the residuals: a photo within it does no harm, however good the others are."""
FEWEST_TO_COMPARE = 5
SIGMA_OF_MAD = 1.4826
FEWEST_FAR = 3
"""Sightings far off that are no chance."""
MOST_NAMES = 4
MAP_MISSING = 0.05
"""Of the image: a learned map that leaves more open is worth a word."""


def advice_of(
    calibration: Calibration, evidence: Evidence, criteria: Criteria, views: Sequence[NextView] = ()
) -> tuple[str, ...]:
    """What to do better, the most useful first; nothing if there is nothing.

    Args:
        calibration: the one that is judged.
        evidence: of it.
        criteria: the limits it is judged by.
        views: the next photos that were found for it.
    """
    facts = view_facts(calibration)
    faults = (
        (_undetermined(evidence),)
        if evidence.status == "degenerate"
        else (
            _target(evidence, criteria),
            _odd_photos(facts, criteria),
            _far_off(calibration, evidence, criteria, facts),
            _few_photos(facts),
            _tilts(evidence, criteria, facts),
        )
    )
    found = (
        *faults,
        _sigma(evidence, criteria, views, len(facts.name)),
        _uncovered(evidence, criteria),
        _lens(evidence, criteria, calibration.camera.model),
        "" if any(map(_is_to_measure, faults)) else _target_share(evidence, criteria),
        _small(facts),
        _few_rings(facts),
        _one_distance(facts),
        _map(evidence),
    )
    return tuple(sentence for sentence in found if sentence)


def _is_to_measure(sentence: str) -> bool:
    """Whether a sentence says already what to do about the target."""
    return "calib measure" in sentence


def _px(value: float) -> str:
    return f"{figure(value, 2)} px"


def _count(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _names(facts: ViewFacts, rows: NDArray[np.int64]) -> str:
    """Names of photos, the first few."""
    shown = [short(facts.name[row]) for row in rows[:MOST_NAMES].tolist()]
    more = len(rows) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _target(evidence: Evidence, criteria: Criteria) -> str:
    """A target that is not as its file says: its rings are off in all photos, or another shape explains them better."""
    on_target, shape, halves = evidence.leftover.target_px, evidence.shape, evidence.halves
    remedy = "measure the target with `calib measure`, and solve with the measured one"
    if on_target is not None and on_target > criteria.systematic_px.good:
        return (
            f"{remedy}: its rings are off by {_px(on_target)} in the same way in all photos, so it is not flat or not "
            "as its file says"
        )
    if shape is not None and shape.ratio > BY_CHANCE and shape.percentile_95_px > criteria.target_px.good:
        return (
            f"{remedy}: a target that may bend and stretch explains the photos better, and moves the camera by up to "
            f"{_px(shape.percentile_95_px)}"
        )
    if isinstance(halves, HalvesFound) and halves.ratio > criteria.halves_sigma.good:
        return (
            "find what differs between the photos before taking more: two halves of them give cameras that differ "
            f"{figure(halves.ratio, 2)} times more than noise explains; a target that is not flat (`calib measure` "
            "tells) or bends when held, or autofocus, zoom or image stabilisation that were on"
        )
    return ""


def _target_share(evidence: Evidence, criteria: Criteria) -> str:
    """A target whose error is within the limit, and yet most of what is left over."""
    found = evidence.leftover
    on_target = found.target_px
    if on_target is None or on_target > criteria.systematic_px.good or on_target <= LARGE_SHARE * found.rmse_px:
        return ""
    if found.stated_sigma_px is None or on_target <= NOTICEABLE * found.stated_sigma_px:
        return ""
    return (
        f"measure the target with `calib measure`: of the {_px(found.rmse_px)} left over, {_px(on_target)} are the "
        "same for a ring in all photos"
    )


def _lens(evidence: Evidence, criteria: Criteria, model: str) -> str:
    """Mean residuals over the image that the target does not explain."""
    over_image, on_target = evidence.leftover.image_px, evidence.leftover.target_px or 0.0
    if over_image is None or over_image <= max(criteria.systematic_px.good, on_target):
        return ""
    other = "another camera model" if model == "virtual" else "`--model virtual`"
    return (
        f"try {other}: residuals at the same place in the image agree in all photos, by {_px(over_image)} beyond "
        f"noise, so {model} does not fit this lens"
    )


def _undetermined(evidence: Evidence) -> str:
    """What the solver says of photos that do not determine the camera; for a map that was learned it has no word."""
    if evidence.status_reason and not evidence.uncertainty.is_map_exact:
        return evidence.status_reason
    return "take more photos, from different sides: these do not determine the camera"


def _odd_photos(facts: ViewFacts, criteria: Criteria) -> str:
    """Photos with much larger residuals than the others."""
    known = np.flatnonzero(np.isfinite(facts.rms_px))
    if len(known) < FEWEST_TO_COMPARE:
        return ""
    rms = facts.rms_px[known]
    middle = float(np.median(rms))
    spread = SIGMA_OF_MAD * float(np.median(np.abs(rms - middle)))
    least = max(WORSE * middle, middle + SPREADS * spread, HARMLESS * criteria.residuals_px.good)
    odd = known[rms > least]
    if not len(odd):
        return ""
    odd = odd[np.argsort(-facts.rms_px[odd], kind="stable")]
    worst = float(facts.rms_px[odd[0]])
    return (
        f"look at {_names(facts, odd)}: {'its' if len(odd) == 1 else 'their'} residuals are up to {_px(worst)}, the "
        f"median photo's {_px(middle)}; blurred, moved, or rings taken for others: take {_them(odd)} again, or leave "
        f"{_them(odd)} out"
    )


def _them(rows: NDArray[np.int64]) -> str:
    return "it" if len(rows) == 1 else "them"


def _far_off(calibration: Calibration, evidence: Evidence, criteria: Criteria, facts: ViewFacts) -> str:
    """Many sightings that are far off, or were left out."""
    seen, out = calibration.observations, calibration.is_outlier
    far = out | (deviations(calibration.residual_px.T, seen.cov_px2) > FAR_OFF)
    count, percent = int(far.sum()), 100 * float(far.mean())
    if percent <= criteria.outliers_percent.good or count < FEWEST_FAR:
        return ""
    per_view = np.bincount(seen.view[far], minlength=seen.view_count)
    rows = np.argsort(-per_view, kind="stable")
    rows = rows[per_view[rows] > 0]
    where = f"in {_names(facts, rows)}" if len(rows) <= MOST_NAMES else f"most in {_names(facts, rows[:MOST_NAMES])}"
    what = "were left out" if out[far].all() else "are far off or were left out" if out.any() else "are far off"
    return (
        f"look at the overlays for glare, shadows and fingers: {count} of {len(far)} sightings "
        f"({figure(percent, 2)} %) {what}, {where}"
    )


def _few_photos(facts: ViewFacts) -> str:
    count = len(facts.name)
    if count >= FEW_PHOTOS:
        return ""
    return (
        f"take {ENOUGH_PHOTOS} photos or more, from different sides: with {count}, little tells whether the stated "
        "standard deviations hold"
    )


def _tilts(evidence: Evidence, criteria: Criteria, facts: ViewFacts) -> str:
    """A flat target that was hardly tilted."""
    if not facts.is_flat:
        return ""
    largest, tilted = facts.largest_tilt_deg, facts.tilted_by(GOOD_TILT_DEG)
    means = "focal length and distance are then hard to tell apart"
    if largest < SMALL_TILT_DEG:
        return (
            f"tilt the board by {GOOD_TILT_DEG:.0f} to 50 deg, to all sides by turns: none of the photos shows it "
            f"tilted by more than {largest:.0f} deg; {means}"
        )
    count = len(facts.name)
    if _is_sure(evidence, criteria) or tilted >= min(TILTED_VIEWS, TILTED_SHARE * count):
        return ""
    return (
        f"tilt the board more, by 30 to 50 deg to all sides by turns: {tilted or 'none'} of {count} photos "
        f"{'shows' if tilted == 1 else 'show'} it tilted by {GOOD_TILT_DEG:.0f} deg or more, the largest tilt is "
        f"{largest:.0f} deg; {means}"
    )


def _is_sure(evidence: Evidence, criteria: Criteria) -> bool:
    """Whether the camera is known as well as it should be."""
    sigma = evidence.uncertainty.image_px
    return evidence.uncertainty.is_map_exact or (sigma is not None and sigma <= criteria.uncertainty_px.good)


def _sigma(evidence: Evidence, criteria: Criteria, views: Sequence[NextView], photos: int) -> str:
    """A camera that is not known well enough: the next photo, what it gives, and how many like the others would."""
    if _is_sure(evidence, criteria) or not evidence.uncertainty.is_estimated:
        return ""
    sigma, limit = evidence.uncertainty.image_px, criteria.uncertainty_px.good
    alike = ""
    if sigma is not None and evidence.status == "converged":
        alike = f"; {_photos_alike(photos, sigma, limit)}"
    if not views:
        return f"take photos that fill the image and show the target from other sides{alike}"
    enough = next((n for n, view in enumerate(views, start=1) if view.sigma_px_after <= limit), len(views))
    last = views[enough - 1].sigma_px_after
    more = f"; with {enough} as proposed {_px(last)}" if enough > 1 else ""
    return f"next photo: {views[0].sentence}{more} (wanted: {_px(limit)}){alike}"


def _photos_alike(photos: int, sigma_px: float, limit_px: float) -> str:
    """What more photos like those so far would do."""
    needed = photos_needed(photos, sigma_px, limit_px)
    if needed > HOPELESS_TIMES * photos:
        return f"more photos like the {photos} so far will not do it"
    if needed > MANY_TIMES * photos:
        return f"more photos like the {photos} so far will not do it: {_round_up(needed)} would be needed"
    return f"or {_count(needed - photos, 'more photo')} like the {photos} so far"


def _round_up(count: int) -> str:
    """A large number of photos, to two digits."""
    step = 10 ** max(len(str(count)) - 2, 0)
    return f"about {-(-count // step) * step}"


def _uncovered(evidence: Evidence, criteria: Criteria) -> str:
    """Parts of the image without the target."""
    percent = 100 * evidence.coverage.share
    names = tuple(region.name for region in evidence.coverage.not_covered)
    if percent >= criteria.coverage_percent.good or not names:
        return ""
    beyond = "the map is not known" if evidence.uncertainty.is_map_exact else "the lens is a guess of its model"
    return (
        f"show the target in {region_words(names)} too: the rings surround {percent:.0f} % of the image, "
        f"{criteria.coverage_percent.good:.0f} % is wanted, and beyond them {beyond}"
    )


def _small(facts: ViewFacts) -> str:
    size = float(np.nanmedian(facts.size))
    if size >= SMALL_SIZE:
        return ""
    return (
        f"come closer, or use a larger target: in the median photo it fills {100 * size:.0f} % of the image's width or "
        "height, and a small target tells little of the lens"
    )


def _few_rings(facts: ViewFacts) -> str:
    rings = float(np.median(facts.rings))
    if rings >= FEW_RINGS:
        return ""
    return (
        f"use a target with more rings: the median photo shows {rings:.0f}, whose {2 * rings:.0f} coordinates also pay "
        "for the 6 unknowns of its pose"
    )


def _one_distance(facts: ViewFacts) -> str:
    """All photos from one distance: what that does depends on the target."""
    if len(facts.name) < 2 or facts.distance_ratio >= ONE_DISTANCE:
        return ""
    distance = float(np.median(facts.distance_mm))
    return (
        "take some photos from nearer and some from farther away, as far as they stay sharp: all are from "
        f"{distance_words(distance)}, alike to {max(1.0, 100 * (facts.distance_ratio - 1)):.0f} %, so nothing shows "
        "whether the camera holds at other distances"
    )


def _map(evidence: Evidence) -> str:
    found = evidence.uncertainty
    if not found.is_map_exact or not 1 - found.known > MAP_MISSING:
        return ""
    return (
        f"use this camera only where its map is known, {100 * found.known:.0f} % of the image: learn the map from a "
        "photo in which the target fills more of it, or use another model elsewhere"
    )
