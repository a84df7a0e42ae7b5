"""Each check of one camera's lens: what was measured against its limits, and what that means in one sentence."""

import math

from calib.judge.evidence import FAR_OFF, LensEvidence, ModelApart
from calib.judge.halves import NoHalves
from calib.judge.target_shape import ShapeEffect
from calib.judge.verdict import LEAST_PX, Criteria, Found, Grade, Limits, at_most, px
from calib.solver.calibration import CaptureError, CircleDoubt, TargetError
from designer.base.words import figure
from designer.tolerance.made import EXACT, MEASURED

BY_CHANCE = 2.0
"""Sigmas of the effect of the target's shape that chance exceeds in about 1 of 100 honest runs (simulated)."""
SURE = 3.0
"""Sigmas beyond which the target is to blame, as is usual for a claim."""
REFUTED = 1.05
"""A model that leaves over so many times as much as the judged one does not fit the lens: its dissent tells nothing."""
OWN_ROTATION = "its own rotation removed"
"""Said of the covered area: the rotation is that which fits it, not the whole image, best."""
LEAVE_PRIOR_OUT = "leave the prior that the photos contradict out, or give the value that the lens has"
MOST_EFFECTS = 2
"""That a sentence tells of what is alike in all photos, the surest."""
IRRELEVANT = 0.25
"""Of what good models may differ by: halves that differ by less do no harm, whatever they should."""
LARGE_SHARE = 0.5
"""Of the residuals: a systematic part that is worth a word although it is small."""


def reading(evidence: LensEvidence, _: Criteria) -> Found | None:
    """Observations that are another thing than they are taken for."""
    return Found("bad", None, evidence.reading) if evidence.reading else None


def uncertainty(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Of the camera over the lit image, and what the largest parts of it are."""
    found, limits, area = evidence.uncertainty, criteria["uncertainty"], evidence.coverage.area
    if not found.is_estimated:
        return Found("unknown", None, "no parameter was estimated, so none is uncertain")
    inside = ""
    if found.covered_px is not None:
        inside = f"; where the target was seen, {px(found.covered_px)} ({OWN_ROTATION})"
    if found.factor > 1:
        inside += (
            f"; the part of the noise is {figure(found.factor, 2)} times what the solution states, as halves of the "
            "photos differ"
        )
    if found.photo_error is not None:
        inside += (
            f"; the centres of a photo err alike, so that parameters are {figure(found.photo_error.times, 2)} times "
            "(RMS) as uncertain as by independent errors, which is in it"
        )
    if found.target_error is not None and found.by_target:
        inside += f"; {px(found.target_px)} of it is what a target {made_as(found.target_error)} may be off"
    if found.image_field is not None and found.by_field and found.field_px >= LEAST_PX:
        inside += (
            f"; {px(found.field_px)} of it is what is fixed in the image and the lens model does not follow, "
            f"{px(found.image_field.left_px)} RMS, with what the camera took of it"
        )
    if found.by_circles and found.circle_px >= LEAST_PX:
        inside += f"; {px(found.circle_px)} of it is what the camera may be off if its points are centres of circles"
    if found.is_map_exact:
        sentence = f"not known: the learned map is taken as exact, and covers {100 * found.known:.0f} % of the image"
        return Found("unknown", None, sentence)
    if found.image_px is None:
        what = (
            "the lens model breaks down in the outer"
            if found.known < 1
            else "the photos do not determine the camera in"
        )
        sentence = f"{what} {100 * max(1 - found.known, 0.05):.0f} % of the {area}{inside}"
        return Found("bad", None, sentence)
    value = found.image_px
    sentence = f"the camera is uncertain by up to {px(value)} in 95 % of the {area} (1 sigma){inside}"
    return Found(at_most(value, limits), value, sentence)


def circle_words(doubt: CircleDoubt, what: str, off: str) -> str:
    """What photos tell of points that nobody said are corners or centres of circles, and what is off by that."""
    if doubt.told_mm is None:
        return (
            "not known: nobody said whether the points are corners or centres of circles, and the photos do not tell "
            f"it; {what} may be {off} by that, which its uncertainty contains (--points says what they are)"
        )
    return (
        f"the points fit as the centres of circles of about {diameter_words(*doubt.told_mm)} diameter "
        f"({figure(doubt.sigmas, 2)} sigma), and taken for points they leave {what} {off}; --points says what they are"
    )


def diameter_words(diameter_mm: float, sigma_mm: float) -> str:
    """A diameter that photos tell: `13 ± 1.2 mm`."""
    return f"{figure(diameter_mm, 2)} ± {figure(sigma_mm, 2)} mm"


def points(evidence: LensEvidence, criteria: Criteria) -> Found | None:
    """Points that nobody said are corners or centres of circles, where that matters."""
    found, limits = evidence.uncertainty, criteria["uncertainty"]
    if not found.by_circles or found.circle_px < LEAST_PX or found.circle_doubt is None:
        return None
    sentence = circle_words(found.circle_doubt, "the camera", f"off by up to {px(found.circle_px)}")
    is_told = found.circle_doubt.told_mm is not None
    return Found(at_most(found.circle_px, limits) if is_told else "unknown", None, sentence)


def halves(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Within the limit of the ratio it is good; beyond, what matters is how far the halves are apart in pixels.

    If that is irrelevant, it is good too: the ratio enlarges the stated standard deviations, and that is all.

    How far apart two cameras from the same photos may be, the limits on models say. Halves that agree as well as good
    models do make a camera usable, though its standard deviations are not; halves that differ by more than usable ones
    do not. Those that may differ by more than that by noise alone show nothing by agreeing.
    """
    found, limits = evidence.halves, criteria["halves"]
    if isinstance(found, NoHalves):
        return Found("unknown", None, found.reason)
    grade, is_stated = at_most(found.ratio, limits), evidence.uncertainty.photo_error is not None
    times = figure(found.ratio, 2)
    if grade != "good" and found.percentile_95_px <= IRRELEVANT * criteria["models"].good:
        sentence = (
            f"cameras solved from halves of the photos differ {times} times more than their standard "
            f"deviations let expect, but only by {px(found.percentile_95_px)} in 95 % of where the target was seen: "
            + (
                "which the stated uncertainty contains"
                if is_stated
                else "take the standard deviations so many times as large"
            )
        )
        return Found("good", found.ratio, sentence)
    if grade == "good" and found.stated_px > criteria["models"].usable:
        sentence = (
            f"halves of the photos are so uncertain that {px(found.stated_px)} between them is expected, "
            f"more than {criteria['models'].usable:g} px, so that they differ by {px(found.rms_px)} (RMS) shows "
            "neither good nor bad"
        )
        return Found("unknown", found.ratio, sentence)
    if grade != "good":
        within = criteria["models"].good if grade == "bad" else criteria["models"].usable
        grade = "usable" if found.percentile_95_px <= within else "bad"
    sentence = (
        f"cameras solved from halves of the photos differ by {px(found.rms_px)} (RMS) where the target was seen, "
        f"{times} times what their standard deviations let expect"
    )
    if grade != "good":
        limit = criteria["models"].usable
        within_words = "within" if found.percentile_95_px <= limit else "more than"
        told = (
            "what they differ by is in the stated ones"
            if is_stated
            else f"take the noise's part of standard deviations {times} times as large"
        )
        sentence += (
            f": {told}; something is systematic (target, lens model, focus). Beyond {limits.good:g} sigma the "
            f"difference itself decides: in 95 % of it by {px(found.percentile_95_px)}, {within_words} {limit:g} px"
        )
    return Found(grade, found.ratio, sentence)


def systematic(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Of that what is the same in all photos, at a place in the image or of a point of the target."""
    limits = criteria["systematic"]
    found = evidence
    known = [value for value in (found.image_px, found.target_px) if value is not None]
    if not known:
        return Found("unknown", None, "too few observations for means")
    value = max(known)
    on_target = found.target_px is not None and found.target_px == value
    where = "of a point of the target in all photos" if on_target else "of a place in the image"
    grade = at_most(value, limits)
    # Where it cannot be told that the target has another shape, its rings' means say it.
    is_other_shape = evidence.shape is None or evidence.shape.ratio > SURE
    is_certain = grade != "good" and (not on_target or is_other_shape)
    cause = (
        f"the target {'is not' if is_certain else 'may not be'} quite as given"
        if on_target
        else f"the model {'does' if is_certain else 'may'} not fit the lens, or the target bends"
    )
    if value <= LEAST_PX:
        sentence = "the mean residuals of places in the image, and of the target's points, are no larger than noise"
        return Found(grade, value, sentence)
    sentence = f"the mean residual {where} is {px(value)} beyond what noise gives (RMS)"
    if value > limits.good or value > LARGE_SHARE * found.rms_px:
        sentence += f": {cause}"
    return Found(grade, value, sentence)


def outliers(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Outliers that were left out do no harm by themselves, but many tell that something is amiss.

    So those come on top of the limit within which a solution is usable.
    """
    limits = criteria["outliers"]
    found = evidence
    percent = 100 * (found.far_share + found.left_out_share)
    usable = limits.usable + 100 * found.left_out_share
    grade = at_most(percent, Limits(limits.good, usable))
    far = figure(100 * found.far_share, 2)
    sentence = f"{far} % of the observations are off by more than {FAR_OFF:g} robust standard deviations"
    if found.stated_sigma_px is not None:
        sentence += ", both in pixels and of the stated noise"
    if found.left_out_share > 0:
        sentence += (
            f", and {figure(100 * found.left_out_share, 2)} % were left out, which come on top of what is usable"
        )
    elif grade != "good":
        sentence += f": look at them, and solve with --reject {FAR_OFF:g}"
    return Found(grade, percent, sentence, usable)


def target(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Beyond chance, the change of the camera counts, but only what is sure makes a camera unusable.

    Below, the photos must be able to tell a change from none.
    """
    limits = criteria["target"]
    found = evidence.shape
    if found is None:
        is_learned = evidence.uncertainty.is_map_exact
        why = "a learned map takes up the target's shape" if is_learned else "too little is known of the target's faces"
        return Found("unknown", None, why)
    if found.ratio <= BY_CHANCE:
        return _target_by_chance(evidence, found, limits)
    grade, is_sure = at_most(found.percentile_95_px, limits), found.ratio > SURE
    blamed = "may not be" if not is_sure or evidence.may_be_lens else "is not"
    other = ", or the model does not fit the lens" if evidence.may_be_lens else ""
    sentence = (
        f"the target {blamed} quite as given{other} ({figure(found.ratio, 2)} sigma; "
        f"bent by about {figure(found.bow_mm, 2)} mm): allowed for, it moves the camera by up to "
        f"{px(found.percentile_95_px)} in 95 % of the covered image"
    )
    if grade == "bad" and not is_sure:
        grade = "usable"
        sentence += (
            f"; more than {limits.usable:g} px, but below {SURE:g} sigma a suspicion: it makes no camera unusable"
        )
    return Found(grade, found.percentile_95_px, sentence)


def _target_by_chance(evidence: LensEvidence, found: ShapeEffect, limits: Limits) -> Found:
    """Nothing shows that the target is not as its file says: it is not, or the photos could not show it."""
    error, by_target = evidence.uncertainty.target_error, evidence.uncertainty.target_px
    if found.sigma_px <= limits.good:
        sentence = (
            "nothing speaks against the target as given: one that may bend and stretch explains the photos no better"
        )
        if error is not None:
            sentence += f"; it is taken to be {made_as(error)}"
        return Found("good", found.percentile_95_px, sentence)
    told = f"a target of another shape could change the camera by {px(found.sigma_px)} (1 sigma)"
    if error is None:
        sentence = f"not known: {told}, and how this one was made is not known (--made tells it)"
        return Found("unknown", None, sentence)
    if by_target < LEAST_PX:
        sentence = f"not known: {told}; this one is taken to be {made_as(error)}"
        return Found("unknown", None, sentence)
    sentence = (
        f"the photos do not tell the target's shape: {made_as(error)}, it may be off so far that the camera is off by "
        f"{px(by_target)} (1 sigma), which the camera's uncertainty contains"
    )
    return Found("good" if by_target <= limits.good else "usable", by_target, sentence)


def made_words(error: TargetError) -> str:
    """How the target is taken to be made."""
    return error.made if error.made in (EXACT, MEASURED) else f"made as '{error.made}'"


def made_as(error: TargetError) -> str:
    """How the target is taken to be made, and what says so."""
    made = made_words(error)
    assumed = "" if error.made in (EXACT, MEASURED) else "assumed: "
    return f"{made} ({assumed}{error.because}; --made tells otherwise)" if error.because else made


def models(evidence: LensEvidence, criteria: Criteria) -> Found:
    """Models that fit the same photos alike and yet differ show what the photos leave open.

    A learned map rests on few photos, so its dissent alone makes no camera unusable.
    """
    limits = criteria["models"]
    judged_px = evidence.rms_px
    refuted = [one for one in evidence.models if not one.is_learned and one.rmse_px > REFUTED * judged_px]
    known = [
        (one, one.percentile_95_px)
        for one in evidence.models
        if one.percentile_95_px is not None and one not in refuted
    ]
    others = [f"{one.model} {one.reason}" for one in evidence.models if one.percentile_95_px is None]
    others += [
        f"{one.model} does not fit the lens (residuals of {px(one.rmse_px)}, {evidence.model} {px(judged_px)})"
        for one in refuted
    ]
    if not known:
        return Found("unknown", None, "; ".join(others) or "no other model was solved")
    graded: list[tuple[ModelApart, float, Grade]] = []
    for one, value in known:
        grade = at_most(value, limits)
        graded.append((one, value, "usable" if grade == "bad" and one.is_learned else grade))
    worst, value, grade = max(graded, key=lambda one: (one[2] == "bad", one[1]))
    up_to = "" if value < LEAST_PX else "up to "
    sentence = f"{worst.model} differs by {up_to}{px(value)} in 95 % of the covered image"
    if worst.is_learned:
        sentence += f", where its map is known ({100 * worst.shared:.0f} % of it)"
    rest = [f"{one.model} by {px(other)}" for one, other in known if one is not worst] + others
    sentence += f"; {', '.join(rest)}" if rest else ""
    return Found(grade, value, sentence)


def capture(evidence: LensEvidence, criteria: Criteria) -> Found | None:
    """By what is beyond chance; nothing is said of cameras that are not told by few parameters."""
    error = evidence.uncertainty.capture_error
    if error is None:
        return None
    if not error.effects:
        sentence = (
            "nothing moves with the rows, and focal length and centres follow neither distance, time nor tilt beyond "
            f"chance; {px(evidence.uncertainty.capture_px)} of the camera's uncertainty (1 sigma) is what the photos "
            f"leave open of it, {taken_as(error)}"
        )
        return Found("good", 0.0, sentence)
    value = max(effect.camera_px for effect in error.effects)
    shown = "; ".join(
        f"{effect.name} ({figure(effect.amount, 2)} ± {figure(effect.sigma, 1)} {effect.unit}), which moved the camera "
        f"by up to {px(effect.camera_px)} in 95 % of the image"
        for effect in error.effects[:MOST_EFFECTS]
    ) + f"; and {len(error.effects) - MOST_EFFECTS} less sure" * (len(error.effects) > MOST_EFFECTS)
    grade = at_most(value, criteria["capture"])
    if all(effect.explains for effect in error.effects) and not evidence.is_of_target:
        return Found(grade, value, f"the photos show {shown}; its uncertainty contains it")
    sentence = (
        f"something looks like {shown}; it does not explain all that is left over, or parameters were fixed or "
        "shared, so it may be another cause"
    )
    # Of a cause that is not sure the uncertainty decides, which contains it.
    return Found("usable" if grade == "bad" else grade, value, sentence)


def taken_as(error: CaptureError) -> str:
    """How the photos are taken to be made, and what says so."""
    words = {"still": "camera and target at rest", "handheld": "held by hand", "moving": "with a target that moves"}
    return words[error.capture] + (f" ({error.because}; --capture tells otherwise)" if error.because else "")


def good_inside(evidence: LensEvidence, limit_px: float) -> str:
    """Why a camera is not to be used that is good where the target was seen; "" if it is not."""
    inside, outside = evidence.uncertainty.covered_px, evidence.uncertainty.image_px
    if inside is None or inside > limit_px or evidence.uncertainty.is_map_exact:
        return ""
    seen = f"{100 * evidence.coverage.share:.0f} % of the {evidence.coverage.area}"
    covered = f"the observations surround only {seen}, where it is known to"
    if math.isinf(limit_px):
        elsewhere = "the lens model only continues what it learned there"
    elif outside is None:
        elsewhere = "the lens model breaks down"
    else:
        elsewhere = f"it is uncertain by up to {px(outside)} (1 sigma)"
    return f"{covered} {px(inside)} ({OWN_ROTATION}); elsewhere {elsewhere}, and nothing was seen to check it"


def why_good(evidence: LensEvidence) -> str:
    """The main reason of a camera that is good."""
    uncertain, area = evidence.uncertainty.image_px, evidence.coverage.area
    parts = [f"{100 * evidence.coverage.share:.0f} % of the {area} is covered"]
    if uncertain is not None:
        parts.insert(0, f"the camera is uncertain by at most {px(uncertain)} in 95 % of the {area} (1 sigma)")
    if not isinstance(evidence.halves, NoHalves):
        parts.append("two halves of the photos agree")
    return f"{', '.join(parts[:-1])}, and {parts[-1]}"
