"""What is said of a measured print: how far it is off, and whether the measured target is better."""

import math

import numpy as np

from calib.as_built.cross_validation import Gain
from calib.as_built.deviations import JUDGED, Estimate
from calib.coupons.ink_of_rings import InkBleed
from calib.draw.print_errors import degrees, percent, told
from calib.records.as_built_file import AsBuiltRecord
from calib.show.measured.seats import seat_findings, seats_sentence
from designer.base.number_text import figure
from designer.base.units import format_mm
from designer.page.blocks import Facts, Finding, Findings, Headline
from designer.spec.build import BUILDS, builds_of
from designer.target import TargetGeometry

LEAST_SPREAD_MM = 0.001
HAND_MM = 0.001
"""Least standard deviation of the ink's width that a sentence tells."""
UNJUDGED = (
    "Nothing shows whether the measured target is better than the drawing: leave --held-out 0 away to know before you "
    "use it."
)


def is_plastic(target: TargetGeometry) -> bool:
    """Whether it is of ours and printed in plastic, so that `design` corrects size and angles; else on paper, or so."""
    build = target.build or (None if target.spec is None else builds_of(target.form)[0])
    return build is not None and BUILDS[build].has_body


def axes_words(target: TargetGeometry) -> str:
    """What the axes of a print are."""
    if not is_plastic(target):
        return "Axes are the print's: x along its longer side."
    return (
        f"Axes are the bed's with the target as design lays it: face {target.face_count - 1} down, the longer side "
        "along x; give --bed-turn if it was turned."
    )


def headline_of(record: AsBuiltRecord) -> Headline:
    """How far the print is off, and whether the measured target is better."""
    if record.status == "degenerate":
        reason = record.remarks[0] if record.remarks else "the photos do not determine camera and target"
        return Headline("bad", "do not use", f"Not measured: {reason}.")
    sentence = f"{deviation_sentence(record)} {gain_sentence(record)}"
    gain = judged_gain(record)
    if record.status != "converged":
        return Headline("usable", "not finished", f"The solution was stopped before it converged. {sentence}")
    if gain is None:
        return Headline("note", "measured, not judged", sentence)
    if not gain.is_better:
        return Headline("usable", "no better than the drawing", sentence)
    return Headline("good", "measured target is better", sentence)


def facts_of(record: AsBuiltRecord) -> Facts:
    """What was measured from."""
    views, seen, left_out = (
        sum(getattr(one, name) for one in record.cameras) for name in ("views", "observations", "left_out")
    )
    outliers = f", {left_out} left out" if left_out else ""
    models = ", ".join(dict.fromkeys(one.model for one in record.cameras))
    cameras = f"{len(record.cameras)} camera{'s' * (len(record.cameras) != 1)} ({models})"
    worth = "times the stated sigma" if record.weighted else "px"
    sigma = f"{record.observation_sigma:.4f} {worth}" if math.isfinite(record.observation_sigma) else "not known"
    rows = [
        ("photos", f"{views}, of {cameras}; {seen} observations{outliers}"),
        ("solution", f"{record.status}; standard deviation of an observation {sigma}"),
    ]
    for one in record.lengths:
        size = f"{one.name} {one.value_mm:g} ± {one.sigma_mm:g} mm"
        rows.append(("length", f"{size}; residual of the length {one.residual_sigma:+.1f} sigma"))
    return Facts(tuple(rows))


def findings_of(record: AsBuiltRecord) -> Findings:
    """What a person must know, a line each."""
    seats = () if record.seats is None else seat_findings(record.seats)
    ink = () if record.ink_bleed is None else (ink_finding(record.ink_bleed),)
    return Findings((*seats, *ink, *(Finding("note", "", line) for line in record.remarks)))


def ink_finding(ink: InkBleed) -> Finding:
    """How much wider the ink is, and what to print the next one with."""
    bleed, offset_mm = ink.bleed_mm, ink.more_offset_mm
    much = f"{told(Estimate(abs(bleed.value), max(bleed.sigma, HAND_MM)), signed=False)} mm"
    sentence = f"{much} {'wider' if bleed.value >= 0 else 'narrower'} at each edge than designed"
    if not offset_mm:
        return Finding(
            "note", "ink", f"{sentence}: {'too little to correct' if bleed.is_significant else 'it may be noise'}."
        )
    remedy = f"next print: --ink-offset {format_mm(offset_mm)}, added to what this one was made with"
    return Finding("note", "ink", f"{sentence}; {remedy}.")


def validation_findings(record: AsBuiltRecord) -> Findings:
    """What to know of the cross-validation, a line each."""
    lines = () if record.held_out is None else record.held_out.remarks
    return Findings(tuple(Finding("note", "cross-validation", line) for line in lines))


def deviation_sentence(record: AsBuiltRecord) -> str:
    """How far the print is off its design."""
    whole, size = record.whole, record.whole.known_size
    if size is None:
        parts = ["The size of the print is not known, as no length was given, and taken as designed"]
    else:
        larger, sure = (
            ("larger" if size.value >= 0 else "smaller"),
            "" if size.is_significant else ", which may be noise",
        )
        text = percent(Estimate(abs(size.value), size.sigma), signed=False)
        parts = [f"The print is {text} {larger} than designed{sure}"]
    parts += [
        f"axis {name} is {percent(one)} beyond the mean" for name, one in whole.axes.items() if one.is_significant
    ]
    parts += [f"skew {name} is {degrees(one)}" for name, one in whole.skews_rad.items() if one.is_significant]
    if moved := face_sentence(record):
        parts.append(moved)
    if record.ring_sigma_mm is not None:
        plane_mm = record.ring_sigma_mm[0]
        much = f"{figure(plane_mm, 2)} mm" if plane_mm >= LEAST_SPREAD_MM else f"less than {LEAST_SPREAD_MM:g} mm"
        parts.append(f"rings are off by {much} (1 sigma) in their plane")
    bow_mm = record.face_bow_mm[np.isfinite(record.face_bow_mm).all(axis=1)]
    if bow_mm.any():
        faces = "its face is" if len(record.face_bow_mm) == 1 else "its faces are"
        parts.append(f"{faces} bent by up to {figure(float(np.abs(bow_mm).max()), 2)} mm")
    return f"{'; '.join(parts)}."


def face_sentence(record: AsBuiltRecord) -> str:
    """How many faces moved, and how far, and how many the photos do not judge; "" of a single one."""
    if record.seats is not None:
        return seats_sentence(record.seats)
    verdicts = record.face_verdict
    unjudged = sum(verdict not in JUDGED for verdict in verdicts)
    if unjudged == len(verdicts):
        return "no face is judged" if unjudged else ""
    besides = f" ({unjudged} not judged)" if unjudged else ""
    moved = [face for face, verdict in enumerate(verdicts) if verdict == "moved"]
    if not moved:
        return f"no face moved by more than noise{besides}"
    shift_mm = np.linalg.norm(record.motion[moved, :3], axis=1).max()
    turn_deg = np.degrees(np.linalg.norm(record.motion[moved, 3:], axis=1)).max()
    return (
        f"{len(moved)} of {len(verdicts)} faces moved, by up to {figure(float(shift_mm), 2)} mm and "
        f"{figure(float(turn_deg), 2)} deg{besides}"
    )


def judged_gain(record: AsBuiltRecord) -> Gain | None:
    """The error in cross-validation that says most."""
    return None if record.held_out is None else record.held_out.judged_by


def gain_sentence(record: AsBuiltRecord) -> str:
    """What the measured target is worth."""
    gain = judged_gain(record)
    if gain is None:
        return (
            "Not judged, as --held-out 0 asked."
            if record.held_out is None
            else "Too few photos could be held out to judge it."
        )
    numbers = f"{figure(gain.nominal, 3)} {gain.unit} with the drawing, {figure(gain.measured, 3)} {gain.unit} measured"
    if not gain.is_better:
        return f"In cross-validation it is no better than the drawing beyond chance: {gain.metric} error {numbers}."
    times = figure(gain.factor, 2) if math.isfinite(gain.factor) else "any number of"
    return f"In cross-validation the {gain.metric} error is {times} times smaller: {numbers}."


def why_not(record: AsBuiltRecord) -> str:
    """Why the measured target is not to be used, in a line; "" if it is better, or if nobody asked."""
    if record.status == "degenerate":
        return "no camera is determined: do what the remarks say, and measure again"
    gain = judged_gain(record)
    if record.held_out is None or (gain is not None and gain.is_better):
        return ""
    if gain is None:
        return "too few photos to judge the measured target by: keep the drawing, and take more photos, from all sides"
    return "keep the drawing, which the measured target is no better than, or take more photos, from more sides"
