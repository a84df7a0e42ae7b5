"""The page of `design tolerance`: what manufacturing errors cost, how large they may be, and against another target."""

from collections.abc import Sequence
from pathlib import Path

from calib.show.parts.folder_blocks import files_section, notes, question_section, warnings
from calib.show.parts.origin import Origin
from calib.show.studies.study_folder import NO_TABLE, FigureText, figures, identity_facts, read_identity
from calib.show.studies.tolerance_tables import (
    amounts_table,
    assumed,
    budget_table,
    cost_table,
    crossover_table,
    quantities_wanted,
    reach_table,
    sensitivity_table,
    source_title,
    sweep_table,
    together_table,
    totals_table,
)
from calib.show.studies.tolerance_words import (
    against_sentence,
    budget_alt,
    budget_finding,
    cost_sentence,
    crossover_alt,
    ranking_alt,
    sweep_alt,
    tolerance_headline,
)
from calib.studies.outputs import STUDY_FILE
from calib.studies.table_files import JSON_FILE
from calib.studies.tolerance.explore import AGAINST_FILE
from calib.studies.tolerance.report import FEWEST_TO_CHECK, of_name
from calib.studies.tolerance.table_file import TOLERANCE_TABLE, BudgetRow, Crossovers, ToleranceFile
from designer.base.words import capital, printable
from designer.page.blocks import Block, Command, Facts, Finding, Findings, Fold, Page, Section, Steps

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
AGAIN = Command("calib report .", "in this folder: makes this page again")
LIMITS = "Limits that were asked for, and how large errors may be to keep them."
SWEEP_CAPTION = "Dots: draws; line: prediction; grey: where that is off by more than 10 %."
WARNING = "warning: "
OFF = ("prediction off:", "of a few prints,", "errors together over", "and ")
"""What begins the notes that tell where the prediction fails."""


def tolerance_page(folder: Path, origin: Origin) -> Page:
    """The page of a tolerance study.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = TOLERANCE_TABLE.read_if_there(folder / JSON_FILE)
    if table is None:
        missing = Findings((Finding("usable", "No tables", NO_TABLE),))
        sections = [question_section(QUESTION, (), missing), files_section(folder, FILES, AGAIN)]
        title = printable(folder.absolute().name) or "study"
        return Page(
            title, "Tolerance study", None, tuple(sections), made_by=origin.command, program=origin.program
        )  # fmt: skip
    sections = [_setting(folder, table), _ranking(folder, table)]
    sections += [_limits(folder, table)] if table.budgets else []
    sections += [_sizes(folder, table)]
    sections += [_against(folder, table, table.crossovers)] if table.crossovers is not None else []
    sections += [_prediction(table), Section("Assumptions", (amounts_table(table),))]
    sections += [Section("Next", (_next(table), *_commands())), files_section(folder, FILES, AGAIN)]
    return Page(
        table.target, "Tolerance study", tolerance_headline(table), tuple(sections), made_by=origin.command,
        program=origin.program,
    )  # fmt: skip


def _setting(folder: Path, table: ToleranceFile) -> Section:
    identity, wrong = read_identity(folder)
    facts = setting_facts(table.setting)
    facts.append(("draws", f"{table.draws} made targets" if table.draws else "none: predicted from Jacobians"))
    facts.append(("errors ranked by", of_name(table.ranked_by).title))
    facts += identity_facts(identity, SETTING_NAMES)
    careful = warnings("Warning", warned(table.setting))
    question = QUESTION if table.kind == "draws" else PREDICTED_QUESTION
    return question_section(question, facts, *careful, *warnings("Study file", wrong))


def setting_facts(lines: Sequence[str]) -> list[tuple[str, str]]:
    """What stands in the lines of a setting but for warnings."""
    facts = []
    for place, line in enumerate(line for line in lines if not line.startswith(WARNING)):
        name, _, rest = line.partition(": ") if place == 0 else line.partition(" ")
        if place == 0 and rest:
            facts += [("target", name), ("photos", rest)]
        elif name == "errors":
            facts.append(("errors", rest))
        else:
            facts.append(("remark", line))
    return facts


def warned(lines: Sequence[str]) -> list[str]:
    """The warnings among the lines of a setting."""
    return [line.removeprefix(WARNING) for line in lines if line.startswith(WARNING)]


def _ranking(folder: Path, table: ToleranceFile) -> Section:
    text = FigureText("ranking", f"What each error adds: {table.target}", ranking_alt(table),
                      "Bars: one error alone, and all together; dashed: noise alone.")  # fmt: skip
    told = (*OFF, f"{of_name(table.ranked_by).title}: ")  # elsewhere, and in the lead
    others = [line for line in table.notes if not line.lower().startswith(tuple(map(str.lower, told)))]
    return Section(
        "Costs", (*figures(folder, [text]), cost_table(table), together_table(table), *notes(others)),
        lead=cost_sentence(table, table.ranked_by),
    )  # fmt: skip


def _limits(folder: Path, table: ToleranceFile) -> Section:
    """How good a print must be."""
    text = FigureText("budget", "How large may errors be?", budget_alt(table),
                      "Green: there is room; red: this must come down, even alone.")  # fmt: skip
    budgets: tuple[BudgetRow, ...] = table.budgets
    blocks: list[Block] = [Findings(tuple(budget_finding(table, one) for one in budgets))]
    blocks += figures(folder, [text])
    blocks += [budget_table(table, one) for one in budgets if one.met_by_noise_alone]
    return Section("Limits", tuple(blocks), lead=LIMITS)


def _sizes(folder: Path, table: ToleranceFile) -> Section:
    """What larger and smaller errors would cost."""
    blocks: list[Block] = []
    if table.sweeps:
        texts = [
            FigureText(f"sweep_{name}", f"{capital(of_name(name).title)} by the size of each error",
                       sweep_alt(table, name), SWEEP_CAPTION)
            for name in quantities_wanted(table)
        ]  # fmt: skip
        blocks += figures(folder, texts)
    swept = [found for name in quantities_wanted(table) if (found := sweep_table(table, name)) is not None]
    blocks += [Fold("The same as numbers", tuple(swept))] if swept else []
    blocks.append(sensitivity_table(table))
    return Section(
        "Sizes of errors", tuple(blocks),
        lead="A cost grows in proportion to its error as long as errors are small: half the error costs half as much.",
    )  # fmt: skip


def _against(folder: Path, table: ToleranceFile, other: Crossovers) -> Section:
    text = FigureText("crossover", f"{table.target} against {other.target}", crossover_alt(table, other))
    careful = warnings("Warning", warned(other.setting))
    return Section(
        f"Against {other.target}",
        (*figures(folder, [text]), totals_table(table, other), crossover_table(table, other),
         *careful, Facts(tuple(setting_facts(other.setting)))),
        lead=against_sentence(table, other),
    )  # fmt: skip


def _prediction(table: ToleranceFile) -> Section:
    """Where the prediction from Jacobians fails."""
    off = [line for line in table.notes if line.startswith(OFF)]
    reach = reach_table(table)
    blocks: tuple[Block, ...] = (() if reach is None else (reach,)) + notes(off)
    if table.kind == "linear":
        lead = "All numbers are predicted for small errors; nothing has checked them: run it without --linear."
    elif table.draws < FEWEST_TO_CHECK:
        lead = f"{table.draws} draws are too few to check the prediction with; {FEWEST_TO_CHECK} do."
    elif any(line.startswith(OFF[0]) for line in off):
        lead = "The prediction is off for what is named below: trust the draws there."
    else:
        lead = "The prediction is within 10 % of the draws for every error: --linear, which takes seconds, will do."
    return Section("Prediction", blocks, lead=lead)


def _next(table: ToleranceFile) -> Steps:
    """What to do with the answer."""
    steps = []
    if table.ranking:
        first = table.ranking[0]
        steps.append(
            f"Better {source_title(first.error)} first (assumed {assumed(first)}): it is "
            f"{100 * (first.share or 0.0):.0f} % of the {of_name(first.quantity).title}."
        )
    steps.append("Or measure your own print with photos, which takes its errors back without printing better.")
    if not table.budgets:
        steps.append("Give --require, such as intersection=0.05mm, to learn how large each error may be.")
    if table.crossovers is None:
        steps.append("Give --against another target and --against-errors to see which is better made as it is.")
    return Steps(tuple(steps))


def _commands() -> tuple[Command, ...]:
    return (
        Command(
            "calib measure NAME.target.json detections.csv -o measured/NAME.target.json",
            "measures a print from photos of it",
        ),
    )
