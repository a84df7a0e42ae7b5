"""How a study of errors is told: what they cost, how large they may be, other sizes, and against another target."""

from collections.abc import Iterator
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING

from calib.app.study_result import computed
from calib.draw import tolerance_tables as tables
from calib.draw import tolerance_words as words
from calib.draw.tolerance_sliders import what_if_section
from calib.studies.tolerance.quantities import quantity_named
from designer.base.words import figure, printable
from designer.page.blocks import Block, Command, Facts, Finding, Findings, Fold, Headline, Page, Paragraph, Section
from designer.page.folders import notes, warnings

if TYPE_CHECKING:
    from calib.app.tolerance import Tolerance, Ways
    from calib.studies.tolerance.record import PhotographedSetting, ToleranceStudy

QUESTION = "What do errors of manufacturing cost a calibration that takes the drawing for true? "
DRAWN = "Targets are made with errors drawn at random, photographed, calibrated and compared."
PREDICTED = "Predicted from the solver's Jacobians, without a single draw."
WAYS_LEAD = "The best first; a click on a head sorts by price or hours."
LIMITS = "Limits that were asked for, and how large errors may be to keep them."
GROWTH = "A cost grows in proportion to its error as long as errors are small: half the error costs half as much."


def tolerance_page(found: "Tolerance") -> Page:
    """All that a study says."""
    study, other = found.study, found.study.crossovers
    question = QUESTION + (DRAWN if study.kind == "draws" else PREDICTED)
    height = found.layer_height_mm
    facts = (
        *_setting_facts(study.target, study.setting),
        ("draws", f"{study.draws} made targets" if study.draws else "none: predicted from Jacobians"),
        *computed(found.drawn, "draws"), ("errors ranked by", quantity_named(study.ranked_by).title),
        *((("layer height", f"{figure(height, 3)} mm"),) if height else ()), ("seed", str(found.seed)),
    )  # fmt: skip
    sliders = what_if_section(study, found.made_by)
    sections = [_costs(found), *([sliders] if sliders is not None else []), *_ways_section(study, "")]
    if study.budgets:
        missed = [tables.budget_table(study, one) for one in study.budgets if one.met_by_noise_alone]
        limits = Findings(tuple(words.budget_finding(study, one) for one in study.budgets))
        sections.append(Section("Limits", (limits, *found.figures("budget"), *missed), lead=LIMITS))
    sections.append(_sizes(found))
    if other is not None:
        told: tuple[Block, ...] = (
            *found.figures("crossover"), tables.totals_table(study, other), tables.crossover_table(study, other),
            *notes(other.setting.remarks), Facts(tuple(_setting_facts(other.target, other.setting))),
        )  # fmt: skip
        sections.append(Section(f"Against {other.target}", told, lead=words.against_sentence(study, other)))
    reach = (tables.reach_table(study),) if study.is_checked else ()
    said = (Finding("note", "", words.prediction_sentence(study)), *words.prediction_notes(study))
    sections += [
        Section("Prediction", (Findings(said), *reach)),
        Section("Assumptions", (tables.amounts_table(study),)),
    ]
    file, measured = quote(found.target_file), quote(f"measured/{printable(study.target)}.target.json")
    measure = Command(
        f"calib measure {file} camera/detections.csv --photos FOLDER -o {measured}",
        "takes the errors of your own print back, once calib run -o camera has seen photos of it",
    )
    lead = (Paragraph(question), Facts(facts), *warnings("Warning", _warnings(study)), *notes(_remarks(found)))
    return Page(study.target, "", words.tolerance_headline(study), tuple(sections), lead=lead, next_steps=(measure,))


def ways_page(found: "Ways") -> Page:
    """The same study, told as a choice between ways of making."""
    page, study = tolerance_page(found), found.study
    others = tuple(section for section in page.sections if section.title != tables.WAYS)
    ranked = study.ways()
    step = Command(
        f"design tolerance {quote(found.target_file)} --errors {ranked[0].way.name} -o tolerance",
        "draws, which check the prediction",
    )
    headline = Headline("note", "answered", f"{words.best_way(ranked)} {words.choice_of_ways(ranked)}")
    return replace(page, headline=headline, sections=(*_ways_section(study, WAYS_LEAD), *others), next_steps=(step,))


def remarks_of(found: "Tolerance") -> tuple[str, ...]:
    """What a person must know of the numbers."""
    return (*_warnings(found.study), *_remarks(found), words.prediction_sentence(found.study))


def _warnings(study: "ToleranceStudy") -> list[str]:
    other = study.crossovers
    settings = [(study.target, study.setting), *([] if other is None else [(other.target, other.setting)])]
    return [f"{name}: {line}" for name, setting in settings for line in setting.warnings]


def _remarks(found: "Tolerance") -> tuple[str, ...]:
    return (*found.camera_remarks, *found.study.setting.remarks)


def _setting_facts(target: str, setting: "PhotographedSetting") -> Iterator[tuple[str, str]]:
    """What is photographed, and how."""
    yield from (("target", target), ("photos", setting.photos), ("errors", setting.errors))


def _ways_section(study: "ToleranceStudy", lead: str) -> Iterator[Section]:
    if ranked := study.ways():
        yield Section(
            tables.WAYS, (tables.ways_table(study, study.ranked_by),), lead=lead or words.choice_of_ways(ranked)
        )


def _costs(found: "Tolerance") -> Section:
    """The ranking first, then all the quantities."""
    study = found.study
    lead = words.cost_sentence(study) if study.budgets else "Each error alone, the one that costs most first."
    notes_of_costs = tuple(words.cost_notes(study))
    told = (Findings(notes_of_costs),) if notes_of_costs else ()
    shown = tables.cost_table(study), tables.together_table(study)
    return Section("Costs", (tables.ranking_table(study), *found.figures("ranking"), *shown, *told), lead=lead)


def _sizes(found: "Tolerance") -> Section:
    """What larger and smaller errors would cost."""
    study, blocks = found.study, list[Block]()
    wanted = words.quantities_wanted(study) if study.sweeps else ()
    blocks += found.figures(*(f"sweep_{name}" for name in wanted if words.swept_sources(study, name)))
    if wanted:
        blocks.append(Fold("The same as numbers", tuple(tables.sweep_table(study, name) for name in wanted)))
    return Section("Sizes of errors", (*blocks, tables.sensitivity_table(study)), lead=GROWTH)
