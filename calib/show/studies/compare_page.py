"""A comparison of the paper's objects as blocks, for page, terminal and Markdown, and its files."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from calib.observe.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.parts.folder_blocks import files_section, question_section, warnings
from calib.show.parts.origin import Origin
from calib.show.studies.compare_figures import FIGURES, comparison_figures
from calib.show.studies.compare_tables import alone_table, lens_table, objects_table
from calib.show.studies.compare_words import (
    alone_alt,
    alone_sentence,
    compare_headline,
    lens_alt,
    lens_notes,
    lens_sentence,
    object_notes,
    objects_alt,
    setting_notes,
)
from calib.show.studies.study_folder import (
    CSV_FILE,
    FIGURES_FOLDER,
    JSON_FILE,
    MARKDOWN_FILE,
    NO_TABLE,
    STUDY_FILE,
    FigureText,
    figures,
    read_identity,
    rows_to_csv,
)
from calib.studies.compare.results import COMPARISON, CaseRow, ComparisonTable, Results
from designer.page.blocks import Block, Command, Finding, Findings, Page, Section, Steps

QUESTION = (
    "Which of the paper's five objects is best, do errors of manufacturing explain the paper's numbers, and does the "
    "virtual camera win behind a lens that no Brown model fits? Simulated: objects are made with errors, photographed, "
    "and calibrated as the paper did, against their drawings."
)
TITLE = "The paper's objects, simulated"
FILES = (
    ("table.md", "the tables, to paste into a text"), ("table.csv", "every median, a line a case and error"),
    ("table.json", "the same for programs"), (STUDY_FILE, "every set of photos"),
)  # fmt: skip
FEW_PRINTS = 12

Drawn = Callable[[Sequence[FigureText]], tuple[Block, ...]]
"""Gives the figures that are told of."""


def compare_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study compare`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = COMPARISON.read_if_there(folder / JSON_FILE)
    again = Command("calib report .", "in this folder: makes this page again")
    files = files_section(folder, FILES, again)
    if table is None:
        missing = question_section(QUESTION, (), Findings((Finding("usable", "No tables", NO_TABLE),)))
        return Page(TITLE, "Comparison", None, (missing, files), made_by=origin.command, program=origin.program)
    _, wrong = read_identity(folder)
    sections = (
        question_section(QUESTION, _facts(table), *warnings("Study file", wrong), setting_notes(table)),
        *compare_sections(table, partial(figures, folder)), Section("Next", (_next(table),)), files,
    )  # fmt: skip
    return Page(
        TITLE, "Comparison", compare_headline(table), sections, made_by=origin.command, program=origin.program
    )  # fmt: skip


def compare_sections(table: ComparisonTable, drawn: Drawn = lambda texts: ()) -> tuple[Section, ...]:
    """All that is told of a comparison.

    Args:
        table: its result.
        drawn: gives its figures.
    """
    objects = FigureText(FIGURES[0], "Errors of the five objects", objects_alt(table), "Dashed: the paper's medians.")
    lens = FigureText(FIGURES[1], "Camera models behind a smooth lens", lens_alt(table))
    alone = FigureText(FIGURES[2], "Single errors that would give the paper's numbers", alone_alt(table))
    parts = (
        ("The five objects", objects, objects_alt(table), objects_table(table), object_notes(table)),
        ("A smooth lens", lens, lens_sentence(table), lens_table(table), lens_notes(table)),
        ("Explanations", alone, alone_sentence(table), alone_table(table), ()),
    )
    return tuple(
        Section(title, (*drawn([text]), shown, *((Findings(notes),) if notes else ())), lead=lead)
        for title, text, lead, shown, notes in parts
    )


def comparison_files(results: Results, folder: Path) -> dict[Path, bytes]:
    """The files of a comparison and their contents.

    Args:
        results: what it says.
        folder: where they are to lie.
    """
    return table_files_of(results.table, folder) | comparison_figures(results, folder / FIGURES_FOLDER)


def table_files_of(table: ComparisonTable, folder: Path) -> dict[Path, bytes]:
    """The files without pictures."""
    asked = question_section(QUESTION, _facts(table), setting_notes(table))
    told = markdown(TITLE, (asked, *compare_sections(table)), compare_headline(table).sentence)
    return {
        folder / MARKDOWN_FILE: told.encode("utf-8", ANY_NAME),
        folder / CSV_FILE: rows_to_csv(CaseRow, table.cases),
        folder / JSON_FILE: COMPARISON.text(table),
    }


def _facts(table: ComparisonTable) -> tuple[tuple[str, str], ...]:
    """How much was simulated."""
    plan = table.plan
    return (
        ("camera", plan.camera), ("prints of each object", str(plan.prints)),
        ("sets of photos of each print", f"{plan.sets} ({plan.slow_sets} for the virtual camera)"),
        ("seed", str(plan.seed)),
    )  # fmt: skip


def _next(table: ComparisonTable) -> Steps:
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
