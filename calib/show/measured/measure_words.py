"""What the page of a measured print says in words."""

import math
from collections.abc import Iterator

import numpy as np

from calib.as_built_report.as_built_file import AsBuiltRecord
from calib.as_built_report.deviations import JUDGED
from calib.as_built_report.held_out import Gain, judged_by
from calib.as_built_report.words import degrees, next_print_lines, percent, spread_mm
from calib.core.number_text import figure
from designer.base.words import capital
from designer.page.blocks import Command, Finding, Headline, Level

PREFIX = "next print: "
LEVEL_OF_BETTER: dict[bool | None, Level] = {True: "good", False: "usable", None: "note"}


def measure_headline(record: AsBuiltRecord) -> Headline:
    """How far the print is off, and whether the measured target is better."""
    sentence = f"{deviation_sentence(record)} {gain_sentence(record)}".strip()
    if record.status == "degenerate":
        reason = record.remarks[0] if record.remarks else "the photos do not determine camera and target"
        return Headline("bad", "do not use", f"Not measured: {reason}.")
    gain = judged_gain(record)
    if record.status != "converged":
        return Headline("usable", "not finished", f"The solution was stopped before it converged. {sentence}")
    if gain is None:
        return Headline("note", "measured, not judged", sentence)
    if not gain.is_better:
        return Headline("usable", "no better than the drawing", sentence)
    return Headline("good", "measured target is better", sentence)


def judged_gain(record: AsBuiltRecord) -> Gain | None:
    """The error of photos held out that says most."""
    gains = () if record.held_out is None else record.held_out.gains
    return judged_by(gains)


def deviation_sentence(record: AsBuiltRecord) -> str:
    """How far the print is off its design."""
    parts = [_size_words(record)]
    whole = record.whole
    parts += [f"axis {name} is {percent(one)} beyond the mean" for name, one in whole.axes if one.is_significant]
    parts += [f"skew {name} is {degrees(one)}" for name, one in whole.skews if one.is_significant]
    if (moved := face_sentence(record)) and record.verdicts:
        parts.append(moved)
    if record.ring_sigma_mm is not None:
        plane = record.ring_sigma_mm[0]
        parts.append(f"rings are off by {spread_mm(plane)} (1 sigma) in their plane")
    if (bow := largest_bow_mm(record)) is not None:
        parts.append(f"its face is bent by up to {figure(bow, 2)} mm")
    return f"{'; '.join(parts)}.".replace("+-", "±")


def _size_words(record: AsBuiltRecord) -> str:
    size = record.whole.size
    if size is None:
        return "The size of the print is not known, as no length was given"
    larger = "larger" if size.value >= 0 else "smaller"
    text = percent(size).lstrip("+-")
    sure = "" if size.is_significant else ", which may be noise"
    return f"The print is {text} {larger} than designed{sure}"


def face_sentence(record: AsBuiltRecord) -> str:
    """How many faces moved, and how far, and how many the photos do not judge."""
    unjudged = sum(verdict not in JUDGED for verdict in record.verdicts)
    if unjudged == len(record.verdicts):
        return "no face is judged" if unjudged else ""
    besides = f" ({unjudged} not judged)" if unjudged else ""
    moved = [place for place, verdict in enumerate(record.verdicts) if verdict == "moved"]
    if not moved:
        return f"no face moved by more than noise{besides}"
    shift = np.linalg.norm(record.motion[moved, :3], axis=1).max()
    turn = np.degrees(np.linalg.norm(record.motion[moved, 3:], axis=1)).max()
    return (
        f"{len(moved)} of {record.face_count} faces moved, by up to {figure(float(shift), 2)} mm and "
        f"{figure(float(turn), 2)} deg{besides}"
    )


def largest_bow_mm(record: AsBuiltRecord) -> float | None:
    """The largest number of a face's bow, at its rim; None if faces are flat."""
    known = record.face_bow_mm[np.isfinite(record.face_bow_mm).all(axis=1)]
    largest = float(np.abs(known).max()) if len(known) else 0.0
    return largest if largest > 0 else None


def gain_sentence(record: AsBuiltRecord) -> str:
    """What the measured target is worth."""
    gain = judged_gain(record)
    if gain is None:
        few = record.held_out is not None and record.held_out.gains
        return "Too few photos were held out to judge it." if few else "No photos were held out to judge it."
    numbers = f"{figure(gain.nominal, 3)} {gain.unit} with the drawing, {figure(gain.measured, 3)} {gain.unit} measured"
    if not gain.is_better:
        return f"In photos held out it is no better than the drawing beyond chance: {gain.metric} error {numbers}."
    times = figure(gain.factor, 2) if math.isfinite(gain.factor) else "any number of"
    return f"In photos held out the {gain.metric} error is {times} times smaller: {numbers}."


def gain_findings(record: AsBuiltRecord) -> Iterator[Finding]:
    """Each error of photos held out, with the drawing and with the measured target."""
    if record.held_out is None:
        return
    for gains, against in ((record.held_out.gains, ""), (record.held_out.against_truth, " against the truth")):
        for one in gains:
            times = f"{figure(one.factor, 3)} times less" if math.isfinite(one.factor) else "gone"
            yield Finding(
                LEVEL_OF_BETTER[one.is_better], f"{one.metric} error{against}",
                f"{times} with the measured target than with the drawing, over {one.count} of photos held out",
                f"{figure(one.measured, 3)} {one.unit}", f"{figure(one.nominal, 3)} {one.unit} with the drawing",
            )  # fmt: skip


def next_print(record: AsBuiltRecord, *, plastic: bool) -> tuple[tuple[Command, ...], tuple[str, ...]]:
    """What to dial into the next print: commands, and other lines."""
    if not record.can_be_corrected:
        return (), ("Size or shape is off by more than a printer can be: nothing to dial in against it.",)
    lines = next_print_lines(
        record.whole, record.made_with_shrink_compensation_percent, record.made_with_skew, plastic=plastic
    )
    commands, others = [], []
    for line in lines:
        text = line.removeprefix(PREFIX).strip()
        if text.startswith("design ..."):
            command, _, rest = text.partition("   # ")
            commands.append(Command(command, f"the next print of the same design: {rest}"))
        else:
            others.append(f"{capital(text)}.".replace("+-", "±"))
    return tuple(commands), tuple(others)
