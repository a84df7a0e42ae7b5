"""Whether enough was found in photos, and what to do about what was not."""

import shlex
from collections import Counter
from collections.abc import Sequence

from calib.report.detected_file import DetectedFile, DetectedPhoto
from calib.types import NOT_MEASURABLE
from designer.command import printable
from designer.page.blocks import Block, Command, Finding, Findings, Headline, Level, Section, Steps
from designer.words import capital

GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the rings that could have been measured, of the readable photos with the target, and of the photos that could be
read. From 95 % on, what is missing is what nobody can see to: a hair on a ring, a finger at the edge. Below a half,
something is wrong with target file, light or focus, and what was found is no fair sample of the image."""
RULE = f"good from {100 * GOOD_SHARE:.0f} %, usable from {100 * USABLE_SHARE:.0f} %"
LEVELS: tuple[Level, ...] = ("bad", "usable", "good")
WORDS: dict[Level, str] = {"good": "found", "usable": "found in part", "bad": "not found", "note": ""}


def readable(file: DetectedFile) -> list[DetectedPhoto]:
    """The photos that could be read and searched."""
    return [photo for photo in file.photos if not photo.record.failure]


def checks(file: DetectedFile) -> tuple[Finding, ...]:
    """What was found against what could have been."""
    searched = readable(file)
    showing = [photo for photo in searched if photo.record.features]
    found = sum(photo.record.features for photo in searched)
    expected = sum(photo.expected for photo in searched)
    asked = len(file.photos) + len(file.failures)
    rows = [_check("Photos that show the target", len(showing), len(searched), "Of the photos that could be read.")]
    if showing:
        flat = "Rings that are seen too flat are not counted."
        rows.insert(0, _check("Rings of the faces that show", found, expected, flat))
    if len(searched) < asked:
        rows.append(_check("Photos that could be read", len(searched), asked, "The others are listed with the reason."))
    return tuple(rows)


def _check(title: str, part: int, whole: int, text: str) -> Finding:
    share = part / whole if whole else 0.0
    return Finding(level_of(share), title, text, f"{part} of {whole} ({_percent(share)})", RULE)


def _percent(share: float) -> str:
    """Rounded down, so that 100 % are all."""
    return f"{int(1000 * share + 1e-9) / 10:g} %"


def level_of(share: float) -> Level:
    """Of a share of what should have been found."""
    return "good" if share >= GOOD_SHARE else "usable" if share >= USABLE_SHARE else "bad"


def detected_headline(file: DetectedFile, rows: Sequence[Finding]) -> Headline:
    """The worst of the checks, and the counts."""
    level = min((row.level for row in rows), key=LEVELS.index)
    searched = readable(file)
    showing = sum(bool(photo.record.features) for photo in searched)
    found, expected = sum(p.record.features for p in searched), sum(p.expected for p in searched)
    if not showing:
        sentence = f"The target was found in none of {_photos(len(file.photos))}."
        if reason := first_reason(file):
            sentence += f" {reason}"
    else:
        sentence = (
            f"The target was found in {showing} of {_photos(len(file.photos))}, with {found} of the {expected} rings "
            "that could have been measured."
        )
    failed = len(file.photos) - len(searched)
    if failed:
        sentence += f" {failed} could not be read."
    return Headline(level, WORDS[level], sentence)


def first_reason(file: DetectedFile) -> str:
    """What is said of a photo that does not show the target, as a sentence; "" if nothing is."""
    without = [photo.record for photo in readable(file) if not photo.record.features and photo.record.remarks]
    if not without:
        return ""
    words = printable("; ".join(without[0].remarks))
    if all(record.remarks == without[0].remarks for record in without):
        return f"{capital(words)}."
    return f"{printable(without[0].image)}: {words}."


def _photos(count: int) -> str:
    return "1 photo" if count == 1 else f"{count} photos"


def missing_of(photo: DetectedPhoto) -> Counter[str]:
    """Why rings of faces that show are missing, those seen too flat among them."""
    missing = Counter[str]()
    for face in photo.record.faces:
        if face.face is not None:
            missing.update(dict(face.missing))
    return missing


def missing_words(missing: Counter[str]) -> str:
    """The same in words, without what no photo can change."""
    lost = ((why, count) for why, count in missing.most_common() if count and why not in NOT_MEASURABLE)
    return ", ".join(f"{count} {printable(why)}" for why, count in lost)


def next_section(file: DetectedFile, level: Level) -> Section:
    """What to do with the detections."""
    blocks: list[Block] = []
    if any(photo.record.features for photo in file.photos):
        target, table = (shlex.quote(printable(path)) for path in (file.target, file.table))
        blocks.append(Command(
            f"calib solve {table} --target {target} -o DIR", "solves the camera; type it where calib detect was typed"
        ))  # fmt: skip
    if level != "good":
        blocks.append(Steps((
            "Open the overlays of photos without the target: is it the target of this file, sharp, and at least a "
            "quarter of the image wide?",
            "Where rings are missing, the reason is in the table: come nearer where they are small, avoid reflections "
            "where they are faint or covered.",
            "Leave out photos in which the target was found by a few rings only.",
        )))  # fmt: skip
    lead = {
        "good": "Look at some overlays, then solve the camera.",
        "usable": "Enough to go on with, if the rings that are missing are not all in one part of the image.",
        "bad": "Find out why before going on.",
    }
    return Section("Next", tuple(blocks), lead=lead.get(level, ""))


def checks_section(rows: tuple[Finding, ...]) -> Section:
    """The checks with their limits."""
    return Section("Was enough found?", (Findings(rows),), lead="The headline is the worst of these.")
