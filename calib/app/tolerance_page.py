"""How a study of errors is told: what they cost, how large they may be, other sizes, and against another target."""

import math
from collections.abc import Iterator
from dataclasses import replace
from shlex import quote
from typing import TYPE_CHECKING

from calib.app.study_result import computed
from calib.draw import tolerance_tables as tables
from calib.draw import tolerance_words as words
from calib.draw.tolerance_sliders import WHAT_IF, what_if_section
from calib.studies.tolerance.quantities import quantity_named
from designer.base.words import capital, figure, printable
from designer.page.blocks import Block, Command, Facts, Finding, Findings, Fold, Headline, Page, Paragraph, Section
from designer.page.folders import Shown, notes, table_of, warnings
from designer.tolerance.sources import SOURCES

if TYPE_CHECKING:
    from calib.app.tolerance import RigTolerance, Tolerance
    from calib.app.ways import Ways
    from calib.studies.tolerance.record import PhotographedSetting, ToleranceStudy

QUESTION = "What do errors of manufacturing cost a calibration that takes the drawing for true? "
DRAWN = "Targets are made with errors drawn at random, photographed, calibrated and compared."
PREDICTED = "Predicted from the solver's Jacobians, without a single draw."
WAYS_LEAD = "The best first; a click on a head sorts by price or hours."
LIMITS = "Limits that were asked for, and how large errors may be to keep them."
GROWTH = "A cost grows in proportion to its error as long as errors are small: half the error costs half as much."
RIG_QUESTION = (
    "What do errors of manufacturing cost a rig that is solved as if the target were as drawn? Frames are simulated "
    "and solved; what each error then does is predicted from the solver's Jacobians, and drawn prints are a check."
)
RIG_MEANING = (
    "Root mean squares over prints: of the distance of two cameras and of the turn of one against the other, over all "
    "pairs; of a point in the rig's frame and of a length, both in the middle of where the target was held."
)
CHECKED_FROM = 10
"""Draws; fewer say little of a root mean square."""
SURE = 3.0


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
    sliders = (section for section in page.sections if section.title == WHAT_IF)
    ranked, setting = study.ways(), study.setting
    ranking: tuple[Block, ...] = (
        tables.ranking_table(study),
        *found.figures("ranking"),
        Findings(tuple(words.cost_notes(study))),
    )
    costs = Section("Costs", ranking, lead=f"Of {setting.errors}.")
    photos = Paragraph(f"{setting.photos}; seed {found.seed}.")
    told = (*warnings("Warning", _warnings(study)), *notes((*_remarks(found), words.prediction_sentence(study))))
    step = Command(
        f"design tolerance {quote(found.target_file)} --errors {ranked[0].way.name} -o tolerance",
        "draws, which check the prediction",
    )
    headline = Headline("note", "answered", f"{words.best_way(ranked)} {words.choice_of_ways(ranked)}")
    sections = (*_ways_section(study, WAYS_LEAD), *sliders, costs)
    return replace(page, headline=headline, lead=(photos, *told), sections=sections, next_steps=(step,))


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


def rig_tolerance_page(found: "RigTolerance") -> Page:
    """What all errors together cost, each of them, and whether draws bear it out."""
    from calib.studies.tolerance.rig_costs import RigCost

    all_errors, noise = found.together, found.noise
    worst = f", most of it by {words.source_title(found.costs[0].name)}" if found.costs else ""
    point = "" if math.isnan(all_errors.point_mm) else f", a point in the middle by {_mm(all_errors.point_mm)}"
    sentence = (
        f"A print by {found.errors.partition(':')[0]} shifts the distances of cameras by {_mm(all_errors.baseline_mm)} "
        f"(RMS){point}{worst}; the noise of {found.frames} frames by {_mm(noise.baseline_mm)}."
    )
    away = "" if math.isnan(found.away_mm) else f"; the middle is {found.away_mm:.0f} mm from the nearest camera"
    facts = Facts((
        ("errors", printable(found.errors)),
        ("rig", f"{found.rig}: {', '.join(found.cameras)}"),
        ("frames", f"{found.frames}, {found.sightings} sightings, at {found.settings['distance']}{away}"),
    ))  # fmt: skip

    def assumed(one: RigCost) -> str:
        kind = "" if one.distribution in ("", "normal") else f"{one.distribution} "
        return f"{kind}{words.amount(SOURCES[one.name].unit, one.size)}" if one.name in SOURCES else ""

    cost = Shown[RigCost]
    table = table_of(
        (*found.costs, all_errors, noise, *(() if found.drawn is None else (found.drawn,))),
        cost("error", lambda one: printable(words.source_title(one.name))), cost("assumed", assumed),
        cost("distances mm", lambda one: one.baseline_mm, unknown="-"),
        cost("turns deg", lambda one: math.degrees(one.turn_rad), unknown="-"),
        cost("point mm", lambda one: one.point_mm, unknown="-"),
        cost(f"{found.length_mm:g} mm length mm", lambda one: one.length_mm, unknown="-"), visible_rows=20,
    )  # fmt: skip
    told = tuple(_rig_findings(found))
    costs = Section("What each error costs", (table, *((Findings(told),) if told else ())), lead=RIG_MEANING)
    measure = Command(
        f"calib measure {quote(found.target_file)} --rig rig -o {quote(f'measured/{found.target}.target.json')}",
        "measures the print from the frames of a rig, and takes its errors back",
    )
    return Page(
        found.target, "", Headline("note", _mm(all_errors.baseline_mm), sentence), (costs,),
        lead=(Paragraph(RIG_QUESTION), facts), next_steps=(measure,),
    )  # fmt: skip


def _rig_findings(found: "RigTolerance") -> Iterator[Finding]:
    """Whether draws bear the prediction out, and remarks."""
    for line in found.remarks:
        yield Finding("note", "", capital(printable(line)))
    if found.drawn is None or found.draws < CHECKED_FROM:
        return
    told = math.hypot(found.together.baseline_mm, found.noise.baseline_mm)
    # One number, such as the size, may stand behind all baselines, so each draw counts once.
    chance = 1 / math.sqrt(2 * found.draws)
    fits = told > 0 and abs(found.drawn.baseline_mm / told - 1) <= SURE * chance
    says = (
        f"{found.draws} drawn prints were simulated and solved: distances off by {_mm(found.drawn.baseline_mm)}, "
        f"predicted {_mm(told)} (such a draw is off by {100 * chance:.0f} % by chance)"
    )
    yield Finding("good" if fits else "usable", "", f"{says}{'' if fits else '; trust the draws'}.")


def _mm(value: float) -> str:
    return f"{figure(value, 2)} mm"
