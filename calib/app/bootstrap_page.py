"""How a bootstrap is told, of a person's photos, of the paper's, and of a rig's frames."""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from shlex import quote
from typing import TYPE_CHECKING

from calib.app.study_result import computed
from calib.draw import study_figures as figures
from calib.draw import study_tables as tables
from calib.draw import study_words as words
from calib.draw.style import FigureSheet
from calib.studies.study_table import StudyCases, StudyTable
from designer.base.words import cut, figure, printable
from designer.page.blocks import Block, Command, Facts, Figure, Findings, Fold, Headline, Page, Paragraph, Section
from designer.page.folders import Shown, notes, number, table_of

if TYPE_CHECKING:
    from calib.app.study_bootstrap import Bootstrap, RigBootstrap

BOOTSTRAP_QUESTION = (
    "How much would the camera and its errors change, had other photos been taken? Views are drawn with replacement "
    "from those there are, calibrated and measured, many times."
)
PAPER_QUESTION = (
    "Do the findings of Ruppel, Kutlu et al., Beyond Reprojection Error: Camera Calibration with 3D Targets, come out "
    "again when its study (Table 2) is made from nothing: targets, photos, detections and bootstrap samples?"
)
PAPER_TITLE = "The paper's study, made again"
SETTING_NAMES = {
    "model": "camera model", "views": "photos rendered of each set", "weighted": "weighted", "loss": "loss",
    "reject": "left out beyond, sigmas", "fix": "fixed parameters", "share": "shared parameters",
    "image_size": "image size", "grid": "grid", "pitch": "pitch",
}  # fmt: skip
LONGEST_SETTING = 200
ENOUGH_SAMPLES = 1000
SKEWED = "The samples with fitted Gaussians: where they are skewed, a mean and a sigma say too little."
TOGETHER = "Parameters that go together are known less well one by one than in what they do together."
BELOW_AND_ABOVE = "Below the diagonal: over the samples; above: as the solution of all views states it."
RIG_QUESTION = (
    "How far would the rig be off with other frames like these? Frames are drawn with replacement, as many as there "
    "are, and solved again."
)
PAIRS_MEANING = (
    "Stated: by the noise, as the solution has it. Spread: standard deviation of the samples; of places and turns the "
    "length of the error. Errors of the target's shape show here in part, as other frames are bent by them otherwise; "
    "its size, and what is wrong in every frame alike, shows in no sample."
)
SMALLER = 0.98
"""Of the ratio by the noise alone: what is less is told."""
HONEST = 1.5
"""Spread over stated: what is more was not stated, beyond the chance of some twenty frames."""


def bootstrap_page(found: "Bootstrap") -> Page:
    """All that is told of a study."""
    table = found.table
    headline = (words.paper_headline if table.is_compared else words.bootstrap_headline)(table)
    correlations = found.figures(start="correlations")
    sections = (
        *(_of_paper(table) if table.is_compared else (_errors(table, found),)), _views(table, found),
        *((Section("Distributions", _folded(found.figures(start="histograms")), lead=SKEWED),) if table.is_compared
          else ()),
        Section("Correlations", _folded(correlations) if len(correlations) > 1 else correlations, lead=TOGETHER),
        *((Section("Notes", (Findings(told),)),) if (told := words.study_notes(table)) else ()),
    )  # fmt: skip
    fewest = min(one.samples for one in table.cases)
    sure = f"{fewest} samples tell a sigma to {100 / (2 * max(fewest, 2)) ** 0.5:.0f} %"
    firmer = "a study of the paper without --quick" if table.is_compared else f"--samples {ENOUGH_SAMPLES} --resume"
    few = [f"{sure}; {firmer} gives firmer numbers"] if fewest < ENOUGH_SAMPLES else []
    title = PAPER_TITLE if table.is_compared else ", ".join(map(printable, table.targets))
    question = PAPER_QUESTION if table.is_compared else BOOTSTRAP_QUESTION
    lead: tuple[Block, ...] = (Paragraph(question), Facts(tuple(_facts(found))), *notes((*few, *found.remarks)))
    return Page(
        title, "Study of the paper" if table.is_compared else "", headline, sections, lead=lead,
        next_steps=(Command(f"calib study plot {quote(found.place)}", "draws all again"),),
    )  # fmt: skip


def study_sheets(cases: StudyCases, table: StudyTable) -> Iterator[FigureSheet]:
    """Histograms and correlations of each way of sampling, and sigma over the number of views."""
    for setting in table.settings:
        label, way = figures.slug("_".join(setting)), f": {tables.setting_in_words(setting)}" if any(setting) else ""
        chosen = [one for one in table.cases if one.case.setting == setting]
        draw = partial(figures.draw_histograms, cases=[(one, cases.samples[one.case]) for one in chosen])
        height_px = figures.histograms_height_px(len({one.case.target for one in chosen}))
        title = f"Distributions{way or ' of the errors'}"
        yield FigureSheet(f"histograms{label}", title, words.histograms_alt(table, setting), height_px, draw)
        if pairs := figures.pairs_of(cases, [one.case for one in chosen]):
            yield FigureSheet(
                f"correlations{label}", f"Correlations of the parameters{way}", words.correlations_alt(table, setting),
                figures.correlations_height_px(len(pairs)), partial(figures.draw_correlations, pairs=pairs),
                BELOW_AND_ABOVE,
            )  # fmt: skip
    for sightings in dict.fromkeys(one.case.sightings for one in table.cases):
        counted = [one for one in table.cases if one.case.sightings == sightings]
        if len({one.case.size for one in counted}) > 1:
            title = "Sigma over the number of views" + (f", {printable(sightings)}" if sightings else "")
            yield FigureSheet(
                f"sigma{figures.slug(sightings)}", title, words.sigma_alt(table, sightings), figures.CONVERGENCE_PX,
                partial(figures.draw_convergence, summaries=counted), "Both axes logarithmic; the line is 1/sqrt(N).",
            )  # fmt: skip


def _facts(found: "Bootstrap") -> Iterator[tuple[str, str]]:
    """What is stored of the setting."""
    table, settings = found.table, dict(found.identity.settings)
    yield "target" if len(table.targets) == 1 else "targets", ", ".join(map(printable, table.targets))
    yield "views drawn from", f"{_range([one.case.pool for one in table.cases])} usable views"
    yield "views of a sample", ", ".join(map(str, table.sizes))
    yield "samples of each case", _range([one.samples for one in table.cases])
    if len(table.settings) > 1:
        yield "ways of sampling and counting", "; ".join(map(tables.setting_in_words, table.settings))
    for name, title in SETTING_NAMES.items():
        if value := printable(settings.get(name, "")):
            yield title, cut(value, LONGEST_SETTING)
    yield "seed", str(found.identity.seed)
    yield from computed(found.sampled, "samples")


def _range(numbers: Sequence[int]) -> str:
    return " to ".join(map(str, dict.fromkeys((min(numbers), max(numbers)))))


def _errors(table: StudyTable, found: "Bootstrap") -> Section:
    """Errors and parameters of a person's study, and their histograms."""
    known = [*(tables.errors_table(table, target) for target in table.targets), tables.parameters_table(table)]
    shown = (one for one in known if one is not None)
    return Section(
        "How sure the calibration is", (*shown, *found.figures(start="histograms")), lead=words.interval_sentence(table)
    )


def _views(table: StudyTable, found: "Bootstrap") -> Section:
    """What more views bring."""
    if len(table.sizes) < 2:
        line = f"All samples have {table.sizes[0]} views: give several --sizes to see what more views bring."
        return Section("More views", (Paragraph(line),))
    falls = None if table.is_compared else tables.falls_table(table)
    return Section(
        "More views",
        (*found.figures(start="sigma"), *(() if falls is None else (falls,))),
        lead="Where sigma falls as 1/sqrt(N), four times as many views halve it.",
    )


def _folded(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Figures under headings that open, the first open."""
    first = next((block for block in blocks if isinstance(block, Figure)), None)
    return tuple(
        Fold(block.title, (block,), is_open=block is first) if isinstance(block, Figure) else block for block in blocks
    )


def _of_paper(table: StudyTable) -> tuple[Section, Section]:
    """Its claims, why some do not hold and the numbers behind; its table with our rows, and ours over its own."""
    claims, why = tables.findings_table(table.findings), words.reasons(table)
    failing = tuple(words.finding_of(one, table.findings) for one in table.findings if one.verdict != "holds")
    blocks: list[Block] = [] if claims is None else [claims]
    blocks += [Findings(why)] if why else []
    if failing:
        title = f"The numbers behind the {len(failing)} that do not hold in full"
        blocks.append(Fold(title, (Findings(failing),)))
    lead = "Each is held against the errors of our samples, in each way of sampling and counting."
    known = [*(tables.errors_table(table, target) for target in table.targets), tables.factors_table(table)]
    shown = tuple(one for one in known if one is not None)
    return (
        Section("The paper's findings", tuple(blocks), lead=lead),
        Section("Table 2", shown, lead="In the paper's units; its own rows stand first."),
    )


def rig_bootstrap_page(found: "RigBootstrap") -> Page:
    """Whether the stated sigmas hold, pair by pair."""
    from calib.studies.rig_bootstrap import PairSpread

    failed = f", {found.failed} that do not determine the rig" if found.failed else ""
    facts = Facts(
        (("rig", ", ".join(found.cameras)), ("samples", f"{found.samples} of {found.frames} frames each{failed}"))
    )
    pair = Shown[PairSpread]
    pairs = table_of(
        found.pairs, pair("pair", lambda one: " - ".join(map(printable, one.names))),
        pair("frames", lambda one: one.frames, "that both see"),
        pair("distance mm", lambda one: number(one.baseline_mm, 6)),
        pair("stated mm", lambda one: one.baseline_sigma_mm), pair("spread mm", lambda one: one.baseline_spread_mm),
        pair("place, stated mm", lambda one: one.place_sigma_mm),
        pair("place, spread mm", lambda one: one.place_spread_mm),
        pair("turn, stated deg", lambda one: math.degrees(one.turn_sigma_rad)),
        pair("turn, spread deg", lambda one: math.degrees(one.turn_spread_rad)), visible_rows=20,
    )  # fmt: skip
    section = Section("Pairs of cameras", (pairs, *notes(found.remarks)), lead=PAIRS_MEANING)
    return Page(found.rig, "", _rig_headline(found), (section,), lead=(Paragraph(RIG_QUESTION), facts))


def _rig_headline(found: "RigBootstrap") -> Headline:
    ratio = found.ratio
    if math.isnan(ratio):
        return Headline("usable", "not known", "The rig states no sigmas that samples could be compared with.")
    chance = math.sqrt(0.5 / found.frames + 0.5 / found.samples)
    words = f"Places and turns of cameras scatter {figure(ratio, 3)} times as far as the noise's sigmas say"
    words += f" (± {100 * chance:.0f} %)"
    if found.ratio_of_all < SMALLER * ratio:
        words += f", {figure(found.ratio_of_all, 3)} times as far as is stated with the target's errors"
        ratio = found.ratio_of_all
    if ratio > HONEST:
        return Headline("usable", f"{figure(ratio, 3)} times", f"{words}: take the spread, not the stated sigmas.")
    return Headline("good", f"{figure(ratio, 3)} times", f"{words}.")
