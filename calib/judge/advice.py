"""What to do better next time, in sentences: each rests on a number of these photos, the most useful comes first.

What would change the verdict comes first, in the order in which the verdict names what is wrong. Of advice that mends
the same, what spoils the photos comes before what is missing in them: more photos of a bent target do not help.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.cameras import ANY_LENS, free_form_models
from calib.judge.checks import checks_of, faults_of, missing_of
from calib.judge.evidence import FAR_OFF, LensEvidence, evidence_of
from calib.judge.halves import HalvesApart
from calib.judge.lens_checks import BY_CHANCE, LEAVE_PRIOR_OUT, SURE, diameter_words, made_words
from calib.judge.next_view_words import distance_words, short
from calib.judge.next_views import NextView
from calib.judge.photo_advice import is_sure, photo_advice
from calib.judge.verdict import Criteria, px
from calib.judge.views import ViewFacts, shape_of, view_facts
from calib.solver.accuracy import is_parallel
from calib.solver.calibration import Calibration, is_flat
from calib.solver.free_bend import NOT_TOLD
from calib.solver.outliers import deviations
from designer.base.arrays import Rows
from designer.base.words import figure

SMALL_TILT_DEG, GOOD_TILT_DEG = 15.0, 20.0
"""Tilts below the first hardly tell focal length from distance; those from the second on do."""
TILTED_VIEWS, TILTED_SHARE = 3, 0.3
ONE_DISTANCE = 1.1
"""Distances that differ by less than this factor are one."""
SMALL_SIZE = 0.33
"""Of the image: a target that fills less of it in the median photo is small."""
FEW_RINGS = 20
FEW_PHOTOS, ENOUGH_PHOTOS = 6, 10
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


@dataclass(frozen=True)
class Inputs:
    """The files that a camera was solved from, as a person typed them."""

    detections: str = "detections.csv"
    target: str = "NAME.target.json"  # "": they hold their own points
    points: str = ""  # what these are, if that was said
    looks_alike: bool = False  # the target does, turned

    @property
    def solve(self) -> str:
        """The command that solves again."""
        target = f" --target {shlex.quote(self.target)}" if self.target else ""
        points = f" --points {self.points}" if self.points else ""
        return f"calib solve {shlex.quote(self.detections)}{target}{points} -o again"

    @property
    def measure(self) -> str:
        """How the target is measured, with the commands."""
        if self.looks_alike:
            return (
                "lay the board flat, or take one that tells which way up it is, such as a ChArUco board: this one "
                "looks the same turned, so that `calib measure` cannot tell its points apart"
            )
        target, detections = self.target or "NAME.target.json", shlex.quote(self.detections)
        made = "" if self.target else f"`calib target --from POINTS.csv -o {target}` with a table of its points, then "
        measured = shlex.quote(f"measured/{Path(target).name}")
        photos = " --photos FOLDER" if self.detections.endswith("detections.csv") else ""  # else of no photos we know
        return (
            f"measure the target, and solve with the measured one: {made}`calib measure {shlex.quote(target)} "
            f"{detections}{photos} -o {measured}`, then `calib solve {detections} --target {measured} -o again`"
        )


DETECTED = Inputs()
"""Of photos that were detected into the usual file."""


@dataclass(frozen=True)
class _Step:
    """Something to do, and the checks that it may change."""

    sentences: tuple[str, ...]
    mends: tuple[str, ...]
    measures: bool = False  # it says to measure the target, which need not be said twice


def advice_of(
    calibration: Calibration,
    evidence: LensEvidence,
    criteria: Criteria,
    views: Sequence[NextView] | None = None,
    inputs: Inputs = DETECTED,
) -> tuple[str, ...]:
    """What to do better, what would change the verdict first; nothing if there is nothing.

    Args:
        calibration: the one that is judged.
        evidence: of it.
        criteria: the limits it is judged by.
        views: the next photos that were found for it; None: nobody looked for any.
        inputs: what it was solved from, for the commands to type.
    """
    whole = evidence_of(calibration, evidence)
    if evidence.reading:  # of observations that are read wrongly nothing else is known; a wrong prior may look so
        if whole.contradicted:
            return LEAVE_PRIOR_OUT, f"if that does not do: {evidence.reading}"
        return (evidence.reading,)
    facts = view_facts(calibration)
    inputs = replace(inputs, looks_alike=calibration.observations.points.turned is not None)
    # What the solver says of photos that do not determine the camera; for a map that was learned it has no word.
    undetermined = "" if evidence.uncertainty.is_map_exact else next(iter(calibration.remarks), "")
    undetermined = undetermined or "take more photos, from different sides: these do not determine the camera"
    faults = (
        (_step(undetermined, "solution"),)
        if calibration.status == "degenerate"
        else (
            _step(LEAVE_PRIOR_OUT if whole.contradicted else "", "priors"),
            _step(_points(evidence, criteria, inputs), "points", "uncertainty"),
            _step(_alike(evidence), "capture"),
            _target(calibration, evidence, criteria, inputs),
            _step(_odd_photos(facts, criteria), "residuals", "outliers"),
            _step(_far_off(calibration, criteria, facts, inputs), "outliers"),
            _step(_few_photos(facts), "halves"),
            _step(_tilts(evidence, criteria, facts), "uncertainty"),
            _shape(calibration, evidence, criteria, inputs),
        )
    )
    is_to_measure = any(step.measures for step in faults)
    steps = (
        *faults,
        _Step(
            () if is_hopeless(calibration) else photo_advice(calibration, evidence, criteria, views),
            ("solution", "uncertainty", "coverage"),
        ),
        _step(_lens(evidence, criteria, calibration.camera.model, inputs), "systematic", "models"),
        _step("" if is_to_measure else _target_share(evidence, criteria, inputs)),
        _Step(_how_shown(calibration, facts), ()),
        _step(_map(evidence)),
    )
    # The checks that keep the verdict from being good, as the verdict names them, the worst first.
    checks = checks_of(whole, criteria)
    wanting = (*faults_of(checks, "bad"), *faults_of(checks, "usable"), *missing_of(whole, checks))
    order = [check.name for check in wanting]
    ranked = sorted(
        steps, key=lambda step: min((order.index(name) for name in step.mends if name in order), default=99)
    )
    return tuple(sentence for step in ranked for sentence in step.sentences)


def is_hopeless(calibration: Calibration) -> bool:
    """Whether no photo would tell more: the camera is not determined, and shows no perspective."""
    return calibration.status == "degenerate" and is_parallel(calibration.camera)


def _step(sentence: str, *mends: str, measures: bool = False) -> _Step:
    return _Step((sentence,) if sentence else (), mends, measures)


def _points(evidence: LensEvidence, criteria: Criteria, inputs: Inputs) -> str:
    """Points of which nobody said what they are, where that decides."""
    found = evidence.uncertainty
    if not found.by_circles or found.circle_px <= LARGE_SHARE * criteria["uncertainty"].good:
        return ""
    told = None if found.circle_doubt is None else found.circle_doubt.told_mm
    fits = "" if told is None else f", as it seems ({diameter_words(*told)} fits; give the true diameter)"
    return (
        f"say what the points are: `{replace(inputs, points='circle:DIAMETERmm').solve}` if they are centres of "
        f"circles from a blob or circle-grid detector{fits}, with --points corner if they are corners"
    )


def _names(facts: ViewFacts, rows: Rows) -> str:
    """Names of photos, the first few."""
    shown = [short(facts.name[row]) for row in rows[:MOST_NAMES].tolist()]
    more = len(rows) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")


def _alike(evidence: LensEvidence) -> str:
    """What moved or changed alike in all photos, and is named for sure."""
    error = evidence.uncertainty.capture_error
    effects = () if error is None or evidence.is_of_target else error.effects
    return "; ".join(dict.fromkeys(effect.remedy for effect in effects if effect.explains))


def _target(calibration: Calibration, evidence: LensEvidence, criteria: Criteria, inputs: Inputs) -> _Step:
    """A target that is not as its file says: its rings are off in all photos, or another shape explains them better."""
    on_target, shape, halves = evidence.target_px, evidence.shape, evidence.halves
    measure = inputs.measure
    is_learned = calibration.camera.learned is not None
    is_tried = calibration.target_bend is not None or NOT_TOLD in calibration.remarks
    if not is_tried and not is_learned and is_flat(calibration.observations.points):
        free = f"{inputs.solve} --model {calibration.camera.model} --free-bend"
        measure = f"solve with the bend of the board as an unknown: `{free}`; if that does not do, {measure}"
    if on_target is not None and on_target > criteria["systematic"].good:
        is_certain = shape is None or shape.ratio > SURE
        sentence = (
            f"{measure}; its points are off by {px(on_target)} in the same way in all photos, so it "
            f"{'is' if is_certain else 'may be'} not flat or not as given"
        )
        return _step(sentence, "target", "systematic", "halves", measures=True)
    if shape is not None and shape.ratio > BY_CHANCE and shape.percentile_95_px > criteria["target"].good:
        sentence = (
            f"{measure}; a target that may bend and stretch explains the photos better ({figure(shape.ratio, 2)} "
            f"sigma), and moves the camera by up to {px(shape.percentile_95_px)}"
            + (", unless it is the lens that the model does not fit" if evidence.may_be_lens else "")
        )
        return _step(sentence, "target", "halves", measures=True)
    is_enlarged = evidence.uncertainty.factor > 1 and not is_sure(evidence, criteria)
    if isinstance(halves, HalvesApart) and (halves.ratio > criteria["halves"].good or is_enlarged):
        sentence = (
            "find what differs between the photos before taking more: two halves of them give cameras that differ "
            f"{figure(halves.ratio, 2)} times more than noise explains; a target that is not flat (`calib measure` "
            "tells) or bends when held, or autofocus, zoom or image stabilisation that were on"
        )
        return _step(sentence, "halves", measures=True)
    return _step("")


def _target_share(evidence: LensEvidence, criteria: Criteria, inputs: Inputs) -> str:
    """A target whose error is within the limit, and yet most of what is left over."""
    on_target, sigma_px = evidence.target_px, evidence.stated_sigma_px
    if on_target is None or on_target > criteria["systematic"].good or on_target <= LARGE_SHARE * evidence.rms_px:
        return ""
    if sigma_px is None or on_target <= NOTICEABLE * sigma_px:
        return ""
    return (
        f"{inputs.measure}; of the residuals of {px(evidence.rms_px)}, {px(on_target)} are the "
        "same for a point of the target in all photos"
    )


def _lens(evidence: LensEvidence, criteria: Criteria, model: str, inputs: Inputs) -> str:
    """Mean residuals over the image that the target does not explain."""
    over_image, on_target = evidence.image_px, evidence.target_px or 0.0
    if over_image is None or over_image <= max(criteria["systematic"].good, on_target):
        return ""
    free, done = free_form_models(), [one.model for one in evidence.models if one.model in free_form_models()]
    if model in free:
        step = "try another camera model"
    elif ANY_LENS in done:
        step = f"compare with the {ANY_LENS} camera, which was solved too"
    else:
        step = f"try the {ANY_LENS} model, which follows any lens: `{inputs.solve} --model {ANY_LENS}`"
        step += f", and compare with the {done[0]} camera, which was solved too" if done else ""
    may_bend = evidence.shape is not None and evidence.shape.ratio > BY_CHANCE
    return (
        f"{step}; residuals at the same place in the image agree in all photos, by {px(over_image)} "
        f"beyond noise, so {model} does not fit this lens" + (", or the target bends" if may_bend else "")
    )


def _odd_photos(facts: ViewFacts, criteria: Criteria) -> str:
    """Photos with much larger residuals than the others."""
    known = np.flatnonzero(np.isfinite(facts.rms_px))
    if len(known) < FEWEST_TO_COMPARE:
        return ""
    rms = facts.rms_px[known]
    middle = float(np.median(rms))
    spread = SIGMA_OF_MAD * float(np.median(np.abs(rms - middle)))
    least = max(WORSE * middle, middle + SPREADS * spread, HARMLESS * criteria["residuals"].good)
    odd = known[rms > least]
    if not len(odd):
        return ""
    odd = odd[np.argsort(-facts.rms_px[odd], kind="stable")]
    whose, them = ("its", "it") if len(odd) == 1 else ("their", "them")
    return (
        f"look at {_names(facts, odd)}: {whose} residuals are up to {px(float(facts.rms_px[odd[0]]))}, the median "
        f"photo's {px(middle)}; blurred, moved, or points taken for others: take {them} again, or leave {them} out"
    )


def _far_off(calibration: Calibration, criteria: Criteria, facts: ViewFacts, inputs: Inputs) -> str:
    """Many sightings that are far off, or were left out."""
    seen, out = calibration.observations, calibration.is_outlier
    far = out | (deviations(calibration.residual_px.T, seen.cov_px2) > FAR_OFF)
    count, percent = int(far.sum()), 100 * float(far.mean())
    if percent <= criteria["outliers"].good or count < FEWEST_FAR:
        return ""
    per_view = np.bincount(seen.view[far], minlength=seen.view_count)
    rows = np.argsort(-per_view, kind="stable")
    rows = rows[per_view[rows] > 0]
    smeared = np.isin(seen.view_names, seen.smeared)[seen.view]
    if far[smeared].sum() > LARGE_SHARE * count and far[smeared].mean() > WORSE * far[~smeared].sum() / max(
        (~smeared).sum(), 1
    ):
        moved = rows[np.isin([seen.view_names[row] for row in rows.tolist()], seen.smeared)]
        return (
            f"take {_names(facts, moved)} again, held still or exposed for a shorter time: {int(far[smeared].sum())} "
            f"of the {count} observations that are far off or were left out are in these photos, which a motion blurred"
        )
    where = f"in {_names(facts, rows)}" if len(rows) <= MOST_NAMES else f"most in {_names(facts, rows[:MOST_NAMES])}"
    what = "were left out" if out[far].all() else "are far off or were left out" if out.any() else "are far off"
    leave = "" if out.any() else f"; to leave them out: `{inputs.solve} --reject {FAR_OFF:g}`"
    return (
        f"look at the photos for glare, shadows and fingers: {count} of {len(far)} observations "
        f"({figure(percent, 2)} %) {what}, {where}{leave}"
    )


def _few_photos(facts: ViewFacts) -> str:
    count = len(facts.name)
    if count >= FEW_PHOTOS:
        return ""
    return (
        f"take {ENOUGH_PHOTOS} photos or more, from different sides: with {count}, little tells whether the stated "
        "standard deviations hold"
    )


def _tilts(evidence: LensEvidence, criteria: Criteria, facts: ViewFacts) -> str:
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
    if is_sure(evidence, criteria) or tilted >= min(TILTED_VIEWS, TILTED_SHARE * count):
        return ""
    return (
        f"tilt the board more, by 30 to 50 deg to all sides by turns: {tilted or 'none'} of {count} photos "
        f"{'shows' if tilted == 1 else 'show'} it tilted by {GOOD_TILT_DEG:.0f} deg or more, the largest tilt is "
        f"{largest:.0f} deg; {means}"
    )


def _how_shown(calibration: Calibration, facts: ViewFacts) -> tuple[str, ...]:
    """A target that is small, or has few points, or was taken from one distance: what that does depends on it."""
    steps = []
    size, rings = float(np.nanmedian(facts.size)), float(np.median(facts.rings))
    if size < SMALL_SIZE and not calibration.camera.has_dark_corners:  # a quarter of 190 degrees is much
        steps.append(
            f"come closer, or use a larger target: in the median photo it fills {100 * size:.0f} % of the image's "
            "width or height, and a small target tells little of the lens"
        )
    if rings < FEW_RINGS:
        steps.append(
            f"use a target with more points: the median photo shows {rings:.0f}, whose {2 * rings:.0f} coordinates "
            "also pay for the 6 unknowns of its pose"
        )
    if len(facts.name) > 1 and facts.distance_ratio < ONE_DISTANCE:
        distance = float(np.median(facts.distance_mm))
        steps.append(
            "take some photos from nearer and some from farther away, as far as they stay sharp: all are from "
            f"{distance_words(distance)}, alike to {max(1.0, 100 * (facts.distance_ratio - 1)):.0f} %, so nothing "
            "shows whether the camera holds at other distances"
        )
    return tuple(steps)


def _map(evidence: LensEvidence) -> str:
    found = evidence.uncertainty
    if not found.is_map_exact or not 1 - found.known > MAP_MISSING:
        return ""
    return (
        f"use this camera only where its map is known, {100 * found.known:.0f} % of the image: learn the map from a "
        "photo in which the target fills more of it, or use another model elsewhere"
    )


ONE_AXIS = 0.1
"""Ratio of the mean squares of tilts along two axes below which they are about one."""
NOT_ROLLED = 0.8
"""Length of the mean direction of the target in the image, its angles doubled, above which all photos have one."""


def _shape(calibration: Calibration, evidence: LensEvidence, criteria: Criteria, inputs: Inputs) -> _Step:
    """A target that nobody measured, and that may be off so far that the camera is: photos that tell, or measure it."""
    uncertain = evidence.uncertainty
    is_open = uncertain.image_px is not None and uncertain.image_px > criteria["uncertainty"].good
    if not is_open or not uncertain.by_target or uncertain.target_error is None:
        return _step("")
    made = made_words(uncertain.target_error)
    reason = f"one {made} may be off so far that the camera is off by {px(uncertain.target_px)}"
    mends = ("uncertainty", "target")
    if photos := " and ".join(_missing(calibration)):
        return _step(f"{photos}: the photos so far do not tell the target's shape, and {reason}", *mends)
    return _step(f"{inputs.measure}; {reason}", *mends, measures=True)


def _missing(calibration: Calibration) -> tuple[str, ...]:
    """What photos of a flat target lack to tell its shape from the lens."""
    shape = shape_of(calibration)
    if shape is None or not shape.is_flat:
        return ()
    in_plane = np.linalg.svd(shape.normal[:1])[2][1:]  # (2, 3)
    rotation = calibration.cam_from_target[:, :3, :3]
    tilt = rotation[:, 2] @ in_plane.T
    least, most = np.linalg.eigvalsh(tilt.T @ tilt).tolist()
    side = rotation[:, :2] @ in_plane[0]
    direction = (side[:, 0] + 1j * side[:, 1]) ** 2
    found = []
    if abs(direction.sum()) > NOT_ROLLED * float(np.abs(direction).sum()):
        found.append("roll the camera, or the target in its plane, by 90 deg in half of the photos")
    if least < ONE_AXIS * most:
        found.append("tilt the target about its other axis too, by 30 to 50 deg")
    return tuple(found)
