"""The page of `design tolerance --rig`: what errors of a target cost the rig that is solved with it."""

import math
from pathlib import Path

from calib.show.parts.origin import Origin
from calib.show.studies.tolerance_words import amount, source_title
from calib.studies.tolerance.rig_costs import RigCost
from calib.studies.tolerance.rig_record import RIG_TOLERANCE, RigToleranceStudy
from designer.base.number_text import figure as digits
from designer.base.words import capital, printable
from designer.page.blocks import (
    Cell,
    Column,
    Command,
    Finding,
    Findings,
    Headline,
    Page,
    Section,
    Table,
)
from designer.page.folders import files_section, number, question_section
from designer.tolerance.sources import SOURCES

QUESTION = (
    "What do errors of manufacturing cost a rig that is solved as if the target were as drawn? Frames are simulated "
    "and solved; what each error then does is predicted from the solver's Jacobians, and drawn prints are a check."
)
MEANING = (
    "Root mean squares over prints: of the distance of two cameras and of the turn of one against the other, over all "
    "pairs; of a point in the rig's frame and of a length, both in the middle of where the target was held."
)
FILES = (("table.json", "every cost, for programs"),)
AGAIN = Command("calib report .", "in this folder: makes this page again")
MEASURE = Command(
    "calib measure NAME.target.json --rig rig -o measured/NAME.target.json",
    "measures the print from the frames of a rig, and takes its errors back",
)
CHECKED_FROM = 10
"""Draws; fewer say little of a root mean square."""
SURE = 3.0


def rig_tolerance_page(folder: Path, origin: Origin) -> Page:
    """The page of such a study's folder.

    Raises:
        InputError: `table.json` cannot be read; the message names it.
    """
    study = RIG_TOLERANCE.read(folder / "table.json")
    return Page(
        printable(study.target), "Tolerance study of a rig", headline_of(study),
        (question_section(QUESTION, facts_of(study), Findings(findings_of(study))), *sections_of(study),
         Section("Next", (MEASURE,)), files_section(folder, FILES, AGAIN)),
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def headline_of(study: RigToleranceStudy) -> Headline:
    """What all errors together cost, and the worst of them."""
    all_errors, noise = study.together, study.noise
    worst = f", most of it by {source_title(study.costs[0].name)}" if study.costs else ""
    point = "" if math.isnan(all_errors.point_mm) else f", a point in the middle by {_mm(all_errors.point_mm)}"
    sentence = (
        f"A print by {study.errors.partition(':')[0]} shifts the distances of cameras by {_mm(all_errors.baseline_mm)} "
        f"(RMS){point}{worst}; the noise of {study.frames} frames by {_mm(noise.baseline_mm)}."
    )
    return Headline("note", _mm(all_errors.baseline_mm), sentence)


def facts_of(study: RigToleranceStudy) -> tuple[tuple[str, str], ...]:
    """Of what."""
    away = "" if math.isnan(study.away_mm) else f"; the middle is {study.away_mm:.0f} mm from the nearest camera"
    return (
        ("errors", printable(study.errors)),
        ("rig", f"{printable(study.rig)}: {', '.join(map(printable, study.cameras))}"),
        (
            "frames",
            f"{study.frames}, {study.sightings} sightings, at {printable(study.settings.get('distance', ''))}{away}",
        ),
    )


def findings_of(study: RigToleranceStudy) -> tuple[Finding, ...]:
    """Whether draws bear the prediction out, and remarks."""
    said = [Finding("note", "", capital(printable(line))) for line in study.remarks]
    drawn = study.drawn
    if drawn is None or study.draws < CHECKED_FROM:
        return tuple(said)
    told = math.hypot(study.together.baseline_mm, study.noise.baseline_mm)
    # One number, such as the size, may stand behind all baselines, so each draw counts once.
    chance = 1 / math.sqrt(2 * study.draws)
    fits = told > 0 and abs(drawn.baseline_mm / told - 1) <= SURE * chance
    says = (
        f"{study.draws} drawn prints were simulated and solved: distances off by {_mm(drawn.baseline_mm)}, predicted "
        f"{_mm(told)} (such a draw is off by {100 * chance:.0f} % by chance)"
    )
    said.append(Finding("good" if fits else "usable", "", f"{says}{'' if fits else '; trust the draws'}."))
    return tuple(said)


def sections_of(study: RigToleranceStudy) -> tuple[Section, ...]:
    """All that is told in tables."""
    return (Section("What each error costs", (costs_table(study),), lead=MEANING),)


def costs_table(study: RigToleranceStudy) -> Table:
    """Source by source, then all of them, noise and draws."""
    heads = (
        Column("error", is_number=False), Column("assumed", is_number=False), Column("distances mm"),
        Column("turns deg"), Column("point mm"), Column(f"{study.length_mm:g} mm length mm"),
    )  # fmt: skip
    others = (study.together, study.noise, *(() if study.drawn is None else (study.drawn,)))
    return Table("", heads, tuple(map(_row, (*study.costs, *others))), visible_rows=20)


def _row(one: RigCost) -> tuple[Cell, ...]:
    kind = "" if one.distribution in ("", "normal") else f"{one.distribution} "
    size = f"{kind}{amount(SOURCES[one.name].unit, one.size)}" if one.name in SOURCES else ""
    values = (one.baseline_mm, math.degrees(one.turn_rad), one.point_mm, one.length_mm)
    return (Cell(printable(source_title(one.name))), Cell(size), *(_known(value) for value in values))


def _known(value: float) -> Cell:
    return number(value, 2) if math.isfinite(value) else Cell("-")


def _mm(value: float) -> str:
    return f"{digits(value, 2)} mm"
