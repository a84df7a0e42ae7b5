"""The page of `calib study bootstrap --rig`: how far samples of a rig's frames scatter, beside what is stated."""

import math
from pathlib import Path

from calib.show.parts.origin import Origin
from calib.studies.rig_bootstrap import PairSpread
from calib.studies.rig_bootstrap_record import RIG_BOOTSTRAP, RigBootstrapStudy
from designer.base.number_text import figure as digits
from designer.base.words import capital, printable
from designer.page.blocks import Cell, Column, Command, Finding, Findings, Headline, Page, Section, Table
from designer.page.folders import files_section, number, question_section, whole

QUESTION = (
    "How far would the rig be off with other frames like these? Frames are drawn with replacement, as many as there "
    "are, and solved again."
)
MEANING = (
    "Stated: by the noise, as the solution has it. Spread: standard deviation of the samples; of places and turns the "
    "length of the error. Errors of the target's shape show here in part, as other frames are bent by them otherwise; "
    "its size, and what is wrong in every frame alike, shows in no sample."
)
FILES = (("table.json", "every pair, for programs"),)
AGAIN = Command("calib report .", "in this folder: makes this page again")
SMALLER = 0.98
"""Of the ratio by the noise alone: what is less is told."""
HONEST = 1.5
"""Spread over stated: what is more was not stated, beyond the chance of some twenty frames."""


def rig_bootstrap_page(folder: Path, origin: Origin) -> Page:
    """The page of such a study's folder.

    Raises:
        InputError: `table.json` cannot be read; the message names it.
    """
    study = RIG_BOOTSTRAP.read(folder / "table.json")
    return Page(
        printable(study.rig), "Bootstrap of a rig", headline_of(study),
        (question_section(QUESTION, facts_of(study), Findings(findings_of(study))),
         Section("Pairs of cameras", (pairs_table(study),), lead=MEANING), files_section(folder, FILES, AGAIN)),
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def headline_of(study: RigBootstrapStudy) -> Headline:
    """Whether the stated sigmas hold."""
    ratio = study.ratio
    if math.isnan(ratio):
        return Headline("usable", "not known", "The rig states no sigmas that samples could be compared with.")
    chance = math.sqrt(0.5 / study.frames + 0.5 / study.samples)
    words = f"Places and turns of cameras scatter {digits(ratio, 3)} times as far as the noise's sigmas say"
    words += f" (± {100 * chance:.0f} %)"
    if study.ratio_of_all < SMALLER * ratio:
        words += f", {digits(study.ratio_of_all, 3)} times as far as is stated with the target's errors"
        ratio = study.ratio_of_all
    if ratio > HONEST:
        return Headline("usable", f"{digits(ratio, 3)} times", f"{words}: take the spread, not the stated sigmas.")
    return Headline("good", f"{digits(ratio, 3)} times", f"{words}.")


def facts_of(study: RigBootstrapStudy) -> tuple[tuple[str, str], ...]:
    """Of what."""
    failed = f", {study.failed} that do not determine the rig" if study.failed else ""
    return (
        ("rig", ", ".join(map(printable, study.cameras))),
        ("samples", f"{study.samples} of {study.frames} frames each{failed}"),
    )


def findings_of(study: RigBootstrapStudy) -> tuple[Finding, ...]:
    """What else to know."""
    return tuple(Finding("note", "", capital(printable(line))) for line in study.remarks)


def pairs_table(study: RigBootstrapStudy) -> Table:
    """Pair by pair."""
    heads = (
        Column("pair", is_number=False), Column("frames", note="that both see"), Column("distance mm"),
        Column("stated mm"), Column("spread mm"), Column("place, stated mm"), Column("place, spread mm"),
        Column("turn, stated deg"), Column("turn, spread deg"),
    )  # fmt: skip
    return Table("", heads, tuple(map(_row, study.pairs)), visible_rows=20)


def _row(one: PairSpread) -> tuple[Cell, ...]:
    values = (
        one.baseline_sigma_mm, one.baseline_spread_mm, one.place_sigma_mm, one.place_spread_mm,
        math.degrees(one.turn_sigma_rad), math.degrees(one.turn_spread_rad),
    )  # fmt: skip
    pair = " - ".join(map(printable, one.names))
    return (Cell(pair), whole(one.frames), number(one.baseline_mm, 6), *(number(value, 2) for value in values))
