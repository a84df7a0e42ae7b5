"""The page of `calib study compare`: the paper's objects simulated, and a lens that no Brown model fits."""

from pathlib import Path

from calib.show.parts.folder_blocks import files_section, notes, question_section, warnings
from calib.show.parts.origin import Origin
from calib.show.studies.compare_tables import alone_table, lens_table, objects_table
from calib.show.studies.compare_words import (
    alone_alt,
    alone_sentence,
    compare_headline,
    lens_alt,
    lens_sentence,
    objects_alt,
    split_sentences,
)
from calib.show.studies.study_folder import NO_TABLE, FigureText, figures, read_identity
from calib.studies.compare.comparison_file import COMPARISON, ComparisonFile
from calib.studies.compare.outputs import FIGURES
from calib.studies.outputs import STUDY_FILE
from calib.studies.table_files import JSON_FILE
from designer.page.blocks import Block, Command, Finding, Findings, Page, Section, Steps

QUESTION = (
    "Which of the paper's five objects is best, do errors of manufacturing explain the paper's numbers, and does the "
    "virtual camera win behind a lens that no Brown model fits? Simulated: objects are made with errors, photographed, "
    "and calibrated as the paper did, against their drawings."
)
TITLE = "The paper's objects, simulated"
FILES = (
    ("table.md", "the tables, to paste into a text"), ("table.csv", "every median, a line a case and error"),
    ("table.json", "the same for programs, with what it says"), (STUDY_FILE, "every set of photos"),
)  # fmt: skip
FEW_PRINTS = 12


def compare_page(folder: Path, origin: Origin) -> Page:
    """The page of a comparison.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = COMPARISON.read_if_there(folder / JSON_FILE)
    again = Command("calib report .", "in this folder: makes this page again")
    if table is None:
        missing = Findings((Finding("usable", "No tables", NO_TABLE),))
        short = (question_section(QUESTION, (), missing), files_section(folder, FILES, again))
        return Page(TITLE, "Comparison", None, short, made_by=origin.command, program=origin.program)
    said = {name: notes(lines) for name, lines in split_sentences(table).items()}
    objects = FigureText(FIGURES[0], "Errors of the five objects", objects_alt(table), "Dashed: the paper's medians.")
    lens = FigureText(FIGURES[1], "Camera models behind a smooth lens", lens_alt(table))
    alone = FigureText(FIGURES[2], "Single errors that would give the paper's numbers", alone_alt(table))
    sections = (
        _setting(folder, table, said["setting"]),
        Section(
            "The five objects", (*figures(folder, [objects]), objects_table(table), *said["objects"]),
            lead=objects_alt(table),
        ),
        Section(
            "A smooth lens", (*figures(folder, [lens]), lens_table(table), *said["lens"]),
            lead=lens_sentence(table),
        ),
        Section(
            "Explanations", (*figures(folder, [alone]), alone_table(table), *said["alone"]),
            lead=alone_sentence(table),
        ),
        Section("Next", (_next(table),)), files_section(folder, FILES, again),
    )  # fmt: skip
    return Page(
        TITLE, "Comparison", compare_headline(table), sections, made_by=origin.command, program=origin.program
    )  # fmt: skip


def _setting(folder: Path, table: ComparisonFile, lines: tuple[Block, ...]) -> Section:
    """The question, and how much was simulated."""
    plan = table.plan
    _, wrong = read_identity(folder)
    distances = ", ".join(f"{name} {distance:g} mm" for name, distance in table.distance_mm.items())
    facts = [
        ("camera", plan.camera), ("prints of each object", str(plan.prints)),
        ("sets of photos of each print", f"{plan.sets} ({plan.virtual_sets} for the virtual camera)"),
        ("distances", distances), ("seed", str(plan.seed)),
    ]  # fmt: skip
    return question_section(
        QUESTION, facts, *warnings("Study file", wrong), *lines, *notes(table.notes[:1]),
    )  # fmt: skip


def _next(table: ComparisonFile) -> Steps:
    """What to do with the answer."""
    steps = [
        "Study a target of your own with errors of your own printer: design tolerance TARGET --errors NAME.",
        "Measure your own print with photos: calib measure takes its errors back.",
    ]
    if table.plan.prints < FEW_PRINTS:
        steps.insert(
            0,
            f"{table.plan.prints} prints of each object say little of how prints differ: run the same command with "
            f"--prints {FEW_PRINTS} --resume (without --quick).",
        )
    return Steps(tuple(steps))
