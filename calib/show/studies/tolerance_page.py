"""The page of `design tolerance`: what manufacturing errors cost, how large they may be, and against another target."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from calib.show.parts.origin import Origin
from calib.show.studies.study_folder import (
    JSON_FILE,
    NO_TABLE,
    STUDY_FILE,
    FigureText,
    figures,
    identity_facts,
    read_identity,
)
from calib.show.studies.tolerance_tables import (
    amounts_table,
    budget_table,
    cost_table,
    crossover_table,
    quantities_wanted,
    ranking_table,
    reach_table,
    sensitivity_table,
    sweep_table,
    together_table,
    totals_table,
)
from calib.show.studies.tolerance_words import (
    against_sentence,
    budget_finding,
    budget_sentence,
    cost_notes,
    cost_sentence,
    first_steps,
    prediction_notes,
    prediction_sentence,
    ranking_alt,
    sweep_alt,
    swept_sources,
    tolerance_headline,
)
from calib.show.studies.ways_tables import TITLE as WAYS_TITLE
from calib.show.studies.ways_tables import ways_headline, ways_section
from calib.show.studies.what_if_block import what_if_section
from calib.studies.tolerance.quantities import quantity_named
from calib.studies.tolerance.record import TOLERANCE_TABLE, Crossovers, PhotographedSetting, ToleranceStudy
from calib.studies.tolerance.stored import AGAINST_FILE
from designer.base.words import capital, printable
from designer.page.blocks import Block, Command, Facts, Finding, Findings, Fold, Page, Section, Steps
from designer.page.folders import files_section, question_section, warnings

QUESTION = (
    "What do errors of manufacturing cost a calibration that takes the drawing for true? Targets are made with errors "
    "drawn at random, photographed, calibrated and compared."
)
PREDICTED_QUESTION = (
    "What do errors of manufacturing cost a calibration that takes the drawing for true? Predicted from the solver's "
    "Jacobians, without a single draw."
)
SETTING_NAMES = {"images": "photos rendered and detected", "layer height": "layer height, mm"}
FILES = (
    ("table.md", "the tables, to paste into a text"), ("table.csv", "every cost, a line an error and quantity"),
    ("table.json", "the same for programs, with limits and crossovers"), (STUDY_FILE, "every draw"),
    (AGAINST_FILE, "every draw of the other target"),
)  # fmt: skip
WAYS_LEAD = "The best first; a click on a head sorts by price or hours."
AGAIN = Command("calib report .", "in this folder: makes this page again")
LIMITS = "Limits that were asked for, and how large errors may be to keep them."
SWEEP_CAPTION = "Dots: draws; line: prediction; grey: where that is off by more than 10 %."
MEASURE = Command(
    "calib measure NAME.target.json detections.csv --photos FOLDER -o measured/NAME.target.json",
    "measures a print from photos of it",
)

Pictures = Callable[[FigureText], tuple[Block, ...]]
"""A figure of the study, or what is said where there is none."""


def tolerance_page(folder: Path, origin: Origin) -> Page:
    """The page of a tolerance study.

    Raises:
        InputError: `table.json` is damaged.
    """
    study = TOLERANCE_TABLE.read_if_there(folder / JSON_FILE)
    files = files_section(folder, FILES, AGAIN)
    if study is None:
        missing = NO_TABLE
        title, headline = printable(folder.absolute().name) or "study", None
        sections: tuple[Section, ...] = (question_section(QUESTION, (), missing), files)
    else:
        identity, wrong = read_identity(folder)
        facts, careful = identity_facts(identity, SETTING_NAMES), warnings("Study file", wrong)
        title, headline = study.target, tolerance_headline(study)
        told = study_sections(
            study, lambda text: figures(folder, [text]), tuple(facts), careful, made_by=origin.command
        )
        sections = (*told, Section("Next", (_next(study), MEASURE)), files)
    return Page(title, "Tolerance study", headline, sections, made_by=origin.command, program=origin.program)


def ways_page(folder: Path, origin: Origin) -> Page:
    """The page of `design ways`: the same study, told as a choice between ways of making.

    Raises:
        InputError: `table.json` is damaged.
    """
    page, study = tolerance_page(folder, origin), TOLERANCE_TABLE.read_if_there(folder / JSON_FILE)
    found = next((section for section in page.sections if section.title == WAYS_TITLE), None)
    if study is None or found is None:
        return page
    others = tuple(section for section in page.sections if section is not found)
    headline = ways_headline(study, study.ranked_by)
    return replace(page, kind="Ways of making", headline=headline, sections=(replace(found, lead=WAYS_LEAD), *others))


def study_sections(
    study: ToleranceStudy,
    pictures: Pictures,
    facts: tuple[tuple[str, str], ...] = (),
    careful: tuple[Block, ...] = (),
    *,
    made_by: str = "",
) -> tuple[Section, ...]:
    """All that a study says.

    Args:
        study: what was found.
        pictures: its figures.
        facts: what else is known of its setting.
        careful: what to know of its file.
        made_by: the command line that made it; "" if it is not known.
    """
    other = study.crossovers
    setting = (
        *setting_facts(study.target, study.setting),
        ("draws", f"{study.draws} made targets" if study.draws else "none: predicted from Jacobians"),
        ("errors ranked by", quantity_named(study.ranked_by).title),
    )
    question = QUESTION if study.kind == "draws" else PREDICTED_QUESTION
    sections = [
        question_section(question, (*setting, *facts), *warnings("Warning", study.setting.warnings), *careful),
        _costs(study, pictures),
    ]
    what_if = what_if_section(study, made_by)
    sections += [what_if] if what_if is not None else []
    ways = ways_section(study, study.ranked_by)
    sections += [ways] if ways is not None else []
    sections += [_limits(study, pictures)] if study.budgets else []
    sections += [_sizes(study, pictures)]
    sections += [_against(study, other, pictures)] if other is not None else []
    prediction = (reach_table(study),) if study.is_checked else ()
    notes = _findings(*prediction_notes(study))
    sections.append(Section("Prediction", (*prediction, *notes), lead=prediction_sentence(study)))
    return (*sections, Section("Assumptions", (amounts_table(study),)))


def _findings(*rows: Finding) -> tuple[Block, ...]:
    return (Findings(rows),) if rows else ()


def setting_facts(target: str, setting: PhotographedSetting) -> tuple[tuple[str, str], ...]:
    """What is photographed, and how."""
    remarks = (("remark", line) for line in setting.remarks)
    return ("target", target), ("photos", setting.photos), ("errors", setting.errors), *remarks


def _costs(study: ToleranceStudy, pictures: Pictures) -> Section:
    """The ranking first, then all the quantities."""
    text = FigureText(
        "ranking", f"What each error adds: {study.target}", ranking_alt(study),
        "Bars: one error alone, and all together; dashed: noise alone.",
    )  # fmt: skip
    tables = ranking_table(study), cost_table(study), together_table(study)
    notes = _findings(*cost_notes(study))
    lead = cost_sentence(study) if study.budgets else "Each error alone, the one that costs most first."
    return Section("Costs", (tables[0], *pictures(text), *tables[1:], *notes), lead=lead)


def _limits(study: ToleranceStudy, pictures: Pictures) -> Section:
    """How good a print must be."""
    alt = " ".join(budget_sentence(study, one) for one in study.budgets)
    caption = "Green: there is room; red: this must come down, even alone."
    drawn = pictures(FigureText("budget", "How large may errors be?", alt, caption))
    tables = [budget_table(study, one) for one in study.budgets if one.met_by_noise_alone]
    found = _findings(*(budget_finding(study, one) for one in study.budgets))
    return Section("Limits", (*found, *drawn, *tables), lead=LIMITS)


def _sizes(study: ToleranceStudy, pictures: Pictures) -> Section:
    """What larger and smaller errors would cost."""
    blocks: list[Block] = []
    wanted = quantities_wanted(study) if study.sweeps else ()
    for name in (name for name in wanted if swept_sources(study, name)):
        title = f"{capital(quantity_named(name).title)} by the size of each error"
        blocks += pictures(FigureText(f"sweep_{name}", title, sweep_alt(study, name), SWEEP_CAPTION))
    if wanted:
        blocks.append(Fold("The same as numbers", tuple(sweep_table(study, name) for name in wanted)))
    return Section(
        "Sizes of errors", (*blocks, sensitivity_table(study)),
        lead="A cost grows in proportion to its error as long as errors are small: half the error costs half as much.",
    )  # fmt: skip


def _against(study: ToleranceStudy, other: Crossovers, pictures: Pictures) -> Section:
    told = against_sentence(study, other)
    alt = f"Errors of both targets over the size of {other.vary}. {told}"
    text = FigureText("crossover", f"{study.target} against {other.target}", alt)
    drawn = pictures(text) if other.vary else ()
    tables = totals_table(study, other), crossover_table(study, other)
    careful = warnings("Warning", other.setting.warnings)
    facts = Facts(setting_facts(other.target, other.setting))
    return Section(f"Against {other.target}", (*drawn, *tables, *careful, facts), lead=told)


def _next(study: ToleranceStudy) -> Steps:
    """What to do with the answer."""
    steps = [*first_steps(study)]
    steps.append("Or measure your own print with photos, which takes its errors back without printing better.")
    if not study.budgets:
        steps.append("Give --require, such as intersection=0.05mm, to learn how large each error may be.")
    if study.crossovers is None:
        steps.append("Give --against another target and --against-errors to see which is better made as it is.")
    return Steps(tuple(steps))
