"""What is told of a measured print: how far it is off, and whether the measured target is better."""

import math
from typing import TYPE_CHECKING

import numpy as np

from calib.coupon_reading.ink_of_rings import InkBleed
from calib.draw.measured_picture import axes_words, cameras_table, faces_table, gains_table, rings_table
from calib.draw.measured_scene import measure_view
from calib.draw.print_errors import (
    degrees,
    errors_table,
    is_plastic,
    next_print,
    percent,
    seat_findings,
    seats_sentence,
    told,
    whole_rows,
)
from calib.measure_target.deviations import JUDGED, Estimate, WholePrint
from calib.measure_target.record import AsBuiltRecord
from designer.base.units import format_mm
from designer.base.words import capital, counted, cut, figure, printable
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Fold,
    Headline,
    Page,
    Paragraph,
    Section,
)
from designer.page.folders import notes
from designer.page.pictures import raster_of
from designer.page.terminal import quoted

if TYPE_CHECKING:
    from calib.app.measured_print import MeasuredPrint, RescaledTarget

LEAST_SPREAD_MM = 0.001
HAND_MM = 0.001
"""Least standard deviation of the ink's width that a sentence tells."""
LONGEST_SETTING = 300
TOLD_ELSEWHERE = ("length", "model")
"""Settings that the facts tell at more length."""
UNJUDGED = (
    "Nothing shows whether the measured target is better than the drawing: leave --held-out 0 away to know before you "
    "use it."
)


def measured_page(measured: "MeasuredPrint", *, is_drawn: bool) -> Page:
    """The page, or what a screen says."""
    record, target, ink = measured.record, measured.target, measured.ink_bleed
    faces, rings = faces_table(record), rings_table(record, target) if is_drawn else None
    moved, gains = face_sentence(record), gains_table(record)
    view = measure_view(record, target) if is_drawn else None
    blocks: list[Block] = []
    one = target.feature_word[:-1]
    if is_drawn:
        image = raster_of(measured.picture)
        blocks.append(
            Figure(
                "The target as it was printed",
                image,
                f"Faces: {len(record.face_verdict)}. {deviation_sentence(record)}",
                is_wide=True,
            )
        )
    blocks += [] if faces is None else [faces]
    blocks += [] if rings is None else [Fold(f"{capital(one)} by {one} ({len(rings.rows)})", (rings,))]
    whole = whole_rows(record.whole)
    advice = _advice(measured)
    findings = (
        *(() if record.seats is None else seat_findings(record.seats)),
        *(() if ink is None else (ink_finding(ink),)),
        *(Finding("note", "", one.text) for one in advice if isinstance(one, Paragraph)),
        *(Finding("note", "", line) for line in record.remarks),
        *(Finding("note", "cross-validation", line) for line in (record.held_out.remarks if record.held_out else ())),
    )
    sections = (
        Section(
            "The whole print",
            (*((errors_table("Size and shape", whole, axes_words(target)),) if whole else ()), Findings(findings)),
        ),
        Section(f"Faces and {target.feature_word}", tuple(blocks), lead=f"{capital(moved)}." if moved else ""),
        Section(
            "Cross-validation",
            (*(() if gains is None else (gains,)), cameras_table(record)),
            lead=gain_sentence(record),
        ),
        Section("Settings", (_settings(record),)),
    )
    name = "" if measured.file is None else printable(measured.file.name.removesuffix(".target.json"))
    return Page(
        name, "", headline_of(record), sections, lead=(*(() if view is None else (view,)), _facts(record)),
        next_steps=tuple(one for one in advice if isinstance(one, Command)),
    )  # fmt: skip


def rescaled_page(made: "RescaledTarget") -> Page:
    """Its size, and what is next."""
    size = made.size
    what = (
        ("size", f"{percent(size)} against the design; the shape is taken as designed")
        if size is not None
        else ("shape", "as designed but for the distance of its two faces")
    )
    use = "measured.target.json" if made.file is None else quoted(made.file)
    advice = next_print(WholePrint(size, {}, {}), made.made_with, plastic=is_plastic(made.nominal))
    steps = (Command(f"calib run {use} photos -o camera", "with the folder of your photos"), *advice)
    return Page(
        "", "", None,
        (Section("Next print", notes((*made.remarks, *(one.text for one in steps if isinstance(one, Paragraph))))),),
        lead=(Facts((("length", made.length.text), what)),),
        next_steps=tuple(one for one in steps if isinstance(one, Command)),
    )  # fmt: skip


def _advice(measured: "MeasuredPrint") -> tuple[Command | Paragraph, ...]:
    """The next calibration with what was judged better, and the next print."""
    record, not_to_be_used = measured.record, measured.why_not
    first: Command | Paragraph = Command(measured.use, "calibrates with the target as it was printed")
    if not_to_be_used:
        first = Paragraph(f"{capital(not_to_be_used)}.")
    elif record.judged_gain is None:
        first = Paragraph(UNJUDGED)
    if record.status == "degenerate":
        return (first,)
    return (first, *next_print(record.whole, record.made_with, plastic=is_plastic(measured.target)))


def _facts(record: AsBuiltRecord) -> Facts:
    """What was measured from."""
    views, seen, left_out = (
        sum(getattr(one, name) for one in record.cameras) for name in ("views", "observations", "left_out")
    )
    outliers = f", {left_out} left out" if left_out else ""
    models = ", ".join(dict.fromkeys(one.model for one in record.cameras))
    cameras = f"{counted(len(record.cameras), 'camera')} ({models})"
    unit = "times the stated sigma" if record.weighted else "px"
    sigma = f"{record.observation_sigma:.4f} {unit}" if math.isfinite(record.observation_sigma) else "not known"
    rows = [
        ("photos", f"{views}, of {cameras}; {seen} observations{outliers}"),
        ("solution", f"{record.status}; standard deviation of an observation {sigma}"),
    ]
    by_name: dict[str, list[str]] = {}
    for one in record.lengths:
        text = f"{one.value_mm:g} ± {one.sigma_mm:g} mm ({one.residual_sigma:+.1f} sigma)"
        by_name.setdefault(one.name, []).append(text)
    rows += [(f"length, {name}", "; ".join(readings)) for name, readings in by_name.items()]
    return Facts(tuple(rows))


def _settings(record: AsBuiltRecord) -> Facts:
    """How it was asked to be measured."""
    rows = []
    for name, text in record.settings.items():
        value = {"True": "yes", "False": "no"}.get(text, printable(text))
        if value.strip() and name not in TOLD_ELSEWHERE:
            rows.append((name.replace("-", " "), cut(value, LONGEST_SETTING)))
    return Facts(tuple(rows))


def headline_of(record: AsBuiltRecord) -> Headline:
    """How far the print is off, and whether the measured target is better."""
    if record.status == "degenerate":
        reason = record.remarks[0] if record.remarks else "the photos do not determine camera and target"
        return Headline("bad", "do not use", f"Not measured: {reason}.")
    sentence = f"{deviation_sentence(record)} {gain_sentence(record)}"
    gain = record.judged_gain
    if record.status != "converged":
        return Headline("usable", "not finished", f"The solution was stopped before it converged. {sentence}")
    if gain is None:
        return Headline("note", "measured, not judged", sentence)
    if not gain.is_better:
        return Headline("usable", "no better than the drawing", sentence)
    return Headline("good", "measured target is better", sentence)


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


def deviation_sentence(record: AsBuiltRecord) -> str:
    """How far the print is off its design."""
    whole, size = record.whole, record.whole.known_size
    if size is None:
        parts = ["The size of the print is not known, as no length was given, and taken as designed"]
    else:
        larger = "larger" if size.value >= 0 else "smaller"
        sure = "" if size.is_significant else ", which may be noise"
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
        parts.append(f"points are off by {much} (1 sigma) in their plane")
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


def gain_sentence(record: AsBuiltRecord) -> str:
    """What the measured target is worth."""
    gain = record.judged_gain
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
