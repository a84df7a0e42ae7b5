"""Bootstrap studies as blocks, of a person's photos and of the paper's: page, terminal and files are made of them."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import cast

from calib.core.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.parts.origin import Origin
from calib.show.studies.study_figures import slug, study_figures
from calib.show.studies.study_folder import (
    CSV_FILE,
    FIGURES_FOLDER,
    JSON_FILE,
    MARKDOWN_FILE,
    NO_TABLE,
    STUDY_FILE,
    FigureText,
    figures,
    identity_facts,
    read_identity,
    rows_to_csv,
)
from calib.show.studies.study_tables import (
    errors_table,
    factors_table,
    falls_table,
    findings_table,
    parameters_table,
    setting_in_words,
)
from calib.show.studies.study_words import (
    bootstrap_headline,
    correlations_alt,
    finding_of,
    histograms_alt,
    interval_sentence,
    paper_headline,
    reasons,
    sigma_alt,
    study_notes,
)
from calib.studies.statistics import CaseSummary, Distribution
from calib.studies.study_table import STUDY_TABLE, StudyCases, StudyTable
from designer.base.codec import encode
from designer.base.small_file import JsonValue
from designer.base.words import printable
from designer.page.blocks import (
    Block,
    Command,
    Figure,
    Findings,
    Fold,
    Headline,
    Page,
    Paragraph,
    Section,
    Steps,
    Table,
)
from designer.page.folders import files_section, question_section, warnings

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
FILES = (
    ("table.md", "the tables, to paste into a text"), ("table.csv", "every statistic, a line a case and error"),
    ("table.json", "the same for programs, with findings"), (STUDY_FILE, "every sample; the study goes on from it"),
)  # fmt: skip
AGAIN = Command(f"calib study plot {STUDY_FILE} -o .", "in this folder: makes tables and figures again")
ENOUGH_SAMPLES = 1000
BELOW_AND_ABOVE = "Below the diagonal: over the samples; above: as the solution of all views states it."

Drawn = Callable[[Sequence[FigureText]], tuple[Block, ...]]
"""Gives the figures that are told of."""


def bootstrap_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study bootstrap`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = STUDY_TABLE.read_if_there(folder / JSON_FILE)
    title = ", ".join(map(printable, table.targets)) if table is not None else printable(folder.absolute().name)
    return _page(folder, origin, table, title or "study", "Bootstrap study", BOOTSTRAP_QUESTION)


def paper_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study paper`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = STUDY_TABLE.read_if_there(folder / JSON_FILE)
    return _page(folder, origin, table, PAPER_TITLE, "Study of the paper", PAPER_QUESTION)


def _page(folder: Path, origin: Origin, table: StudyTable | None, title: str, kind: str, question: str) -> Page:
    sections = [_setting(folder, table, question)]
    if table is not None:
        sections += study_sections(table, partial(figures, folder))
        sections.append(Section("Next", (_next_of_paper(table) if table.is_compared else _next_of_bootstrap(table),)))
    sections.append(files_section(folder, FILES, AGAIN))
    headline = None if table is None else study_headline(table)
    return Page(title, kind, headline, tuple(sections), made_by=origin.command, program=origin.program)


def study_headline(table: StudyTable) -> Headline:
    """The answer: of the paper's study what holds, of any other how sure the camera is."""
    return paper_headline(table) if table.is_compared else bootstrap_headline(table)


def study_tables(table: StudyTable) -> tuple[Table, ...]:
    """The tables that a terminal shows."""
    last = findings_table(table.findings) if table.is_compared else falls_table(table)
    return (*(errors_table(table, target) for target in table.targets), *(() if last is None else (last,)))


def study_sections(table: StudyTable, drawn: Drawn = lambda texts: ()) -> tuple[Section, ...]:
    """All that is told of a study.

    Args:
        table: its result.
        drawn: gives its figures.
    """
    notes = study_notes(table)
    last = (Section("Notes", (Findings(notes),)),) if notes else ()
    if table.is_compared:
        return (
            _findings(table), _table_2(table), _views(table, drawn), _histograms(table, drawn),
            _correlations(table, drawn), *last,
        )  # fmt: skip
    return (_errors(table, drawn), _views(table, drawn), _correlations(table, drawn), *last)


def _setting(folder: Path, table: StudyTable | None, question: str) -> Section:
    """The question, and what is stored of the setting."""
    identity, wrong = read_identity(folder)
    facts = []
    missing: tuple[Block, ...] = ()
    if table is None:
        missing = (NO_TABLE,)
    else:
        ways = [setting_in_words(setting) for setting in table.settings]
        facts += [
            ("target" if len(table.targets) == 1 else "targets", ", ".join(map(printable, table.targets))),
            ("views drawn from", f"{_range([one.case.pool for one in table.cases])} usable views"),
            ("views of a sample", ", ".join(map(str, table.sizes))),
            ("samples of each case", _range([one.samples for one in table.cases])),
        ]
        facts += [("ways of sampling and counting", "; ".join(ways))] if len(ways) > 1 else []
    facts += identity_facts(identity, SETTING_NAMES)
    return question_section(question, facts, *warnings("Study file", wrong), *missing)


def _range(numbers: Sequence[int]) -> str:
    return " to ".join(map(str, dict.fromkeys((min(numbers), max(numbers)))))


def _errors(table: StudyTable, drawn: Drawn) -> Section:
    """Errors and parameters of a person's study, and their histograms."""
    tables = [*(errors_table(table, target) for target in table.targets), parameters_table(table)]
    shown = (one for one in tables if one is not None)
    return Section(
        "How sure the calibration is", (*shown, *drawn(_histogram_texts(table))), lead=interval_sentence(table)
    )  # fmt: skip


def _histograms(table: StudyTable, drawn: Drawn) -> Section:
    return Section(
        "Distributions", _folded(drawn(_histogram_texts(table))),
        lead="The samples with fitted Gaussians: where they are skewed, a mean and a sigma say too little.",
    )  # fmt: skip


def _histogram_texts(table: StudyTable) -> list[FigureText]:
    texts = []
    for setting in table.settings:
        of = f": {setting_in_words(setting)}" if any(setting) else " of the errors"
        stem = f"histograms{slug('_'.join(setting))}"
        texts.append(FigureText(stem, f"Distributions{of}", histograms_alt(table, setting)))
    return texts


def _views(table: StudyTable, drawn: Drawn) -> Section:
    """What more views bring."""
    if len(table.sizes) < 2:
        line = f"All samples have {table.sizes[0]} views: give several --sizes to see what more views bring."
        return Section("More views", (Paragraph(line),))
    texts = [
        FigureText(f"sigma{slug(one)}", "Sigma over the number of views" + (f", {printable(one)}" if one else ""),
                   sigma_alt(table, one), "Both axes logarithmic; the line is 1/sqrt(N).")
        for one in dict.fromkeys(one.case.sightings for one in table.cases)
    ]  # fmt: skip
    falls = None if table.is_compared else falls_table(table)
    return Section(
        "More views", (*drawn(texts), *(() if falls is None else (falls,))),
        lead="Where sigma falls as 1/sqrt(N), four times as many views halve it.",
    )  # fmt: skip


def _correlations(table: StudyTable, drawn: Drawn) -> Section:
    texts = []
    for setting in table.settings:
        way = f": {setting_in_words(setting)}" if any(setting) else ""
        stem, title = f"correlations{slug('_'.join(setting))}", f"Correlations of the parameters{way}"
        texts.append(FigureText(stem, title, correlations_alt(table, setting), BELOW_AND_ABOVE))
    blocks = drawn(texts)
    lead = "Parameters that go together are known less well one by one than in what they do together."
    return Section("Correlations", _folded(blocks) if len(texts) > 1 else blocks, lead=lead)


def _folded(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Figures under headings that open, the first open."""
    first = next((block for block in blocks if isinstance(block, Figure)), None)
    return tuple(
        Fold(block.title, (block,), is_open=block is first) if isinstance(block, Figure) else block for block in blocks
    )  # fmt: skip


def _findings(table: StudyTable) -> Section:
    """The paper's claims, why some do not hold, and the numbers behind these."""
    claims, why = findings_table(table.findings), reasons(table)
    failing = tuple(finding_of(one, table.findings) for one in table.findings if one.verdict != "holds")
    blocks: list[Block] = [] if claims is None else [claims]
    blocks += [Findings(why)] if why else []
    if failing:
        title = f"The numbers behind the {len(failing)} that do not hold in full"
        blocks.append(Fold(title, (Findings(failing),)))
    lead = "Each is held against the errors of our samples, in each way of sampling and counting."
    return Section("The paper's findings", tuple(blocks), lead=lead)


def _table_2(table: StudyTable) -> Section:
    """The paper's table with our rows, and ours over the paper's."""
    tables = [*(errors_table(table, target) for target in table.targets), factors_table(table)]
    shown = tuple(one for one in tables if one is not None)
    return Section("Table 2", shown, lead="In the paper's units; its own rows stand first.")


def _next_of_bootstrap(table: StudyTable) -> Steps:
    """What to do with the answer."""
    steps = [
        f"If the spread with {table.sizes[-1]} views is too large for your work, take more photos: four times as many "
        "views halve it where sigma falls as 1/sqrt(N).",
        "Give --truth with photos that were rendered, and the error of poses is measured too.",
    ]
    fewest = min(one.samples for one in table.cases)
    if fewest < ENOUGH_SAMPLES:
        steps.insert(
            0,
            f"{fewest} samples tell a sigma to {100 / (2 * max(fewest, 2)) ** 0.5:.0f} %: run the same command with "
            f"--samples {ENOUGH_SAMPLES} --resume for firmer numbers.",
        )
    return Steps(tuple(steps))


def _next_of_paper(table: StudyTable) -> Steps:
    fewest = min(one.samples for one in table.cases)
    steps = ["Compare targets of your own with errors of your printer: design tolerance TARGET --errors NAME."]
    if fewest < ENOUGH_SAMPLES:
        steps.insert(
            0,
            f"These are {fewest} samples a case: the quick study. Run calib study paper without --quick into another "
            "folder for the paper's 10000.",
        )
    return Steps(tuple(steps))


def study_files(cases: StudyCases, table: StudyTable, folder: Path) -> dict[Path, bytes]:
    """The files of a study and their contents.

    Args:
        cases: its samples.
        table: what they say.
        folder: where the files are to lie.
    """
    return table_files(table, folder) | study_figures(cases, table, folder / FIGURES_FOLDER)


def table_files(table: StudyTable, folder: Path) -> dict[Path, bytes]:
    """The files without pictures."""
    told = markdown("Calibrations of drawn views", study_sections(table), study_headline(table).sentence)
    return {
        folder / MARKDOWN_FILE: told.encode("utf-8", ANY_NAME),
        folder / CSV_FILE: _csv(table),
        folder / JSON_FILE: STUDY_TABLE.text(table),
    }


def _csv(table: StudyTable) -> bytes:
    """A line for each case, error, and set of samples that the statistics are over."""
    heads = []
    for one in table.cases:
        keys = cast("dict[str, JsonValue]", encode(CaseSummary, one))
        del keys["metrics"]
        heads += [keys] * len(one.metrics)
    return rows_to_csv(Distribution, [found for one in table.cases for found in one.metrics], heads)
