"""The pages of bootstrap studies: of a person's photos, and of the paper's study made again."""

from collections.abc import Sequence
from pathlib import Path

from calib.show.parts.folder_blocks import files_section, notes, question_section, warnings
from calib.show.parts.origin import Origin
from calib.show.studies.parameter_spread import Spread, spreads
from calib.show.studies.study_folder import NO_TABLE, FigureText, figures, identity_facts, read_identity
from calib.show.studies.study_tables import (
    LEVEL_OF_VERDICT,
    errors_table,
    factors_table,
    falls_table,
    findings_table,
    parameters_table,
)
from calib.show.studies.study_words import (
    OWN,
    bootstrap_headline,
    correlations_alt,
    histograms_alt,
    interval_sentence,
    paper_headline,
    sigma_alt,
)
from calib.studies.figures import slug
from calib.studies.outputs import STUDY_FILE
from calib.studies.study_table_file import STUDY_TABLE, StudyFinding, StudyTable
from calib.studies.table import setting_in_words
from calib.studies.table_files import JSON_FILE
from designer.base.words import printable
from designer.page.blocks import (
    Block,
    Command,
    Figure,
    Finding,
    Findings,
    Fold,
    Headline,
    Leaf,
    Page,
    Paragraph,
    Section,
    Steps,
)

BOOTSTRAP_QUESTION = (
    "How much would the camera and its errors change, had other photos been taken? Views are drawn with replacement "
    "from those there are, calibrated and measured, many times."
)
PAPER_QUESTION = (
    "Do the findings of Ruppel, Kutlu et al., Beyond Reprojection Error: Camera Calibration with 3D Targets, come out "
    "again when its study (Table 2) is made from nothing: targets, photos, detections and bootstrap samples?"
)
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
MOST_FAILING = 100
BELOW_AND_ABOVE = "Below the diagonal: over the samples; above: as the solution of all views states it."


def bootstrap_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study bootstrap`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table, found = STUDY_TABLE.read_if_there(folder / JSON_FILE), spreads(folder)
    sections: list[Section] = [_setting(folder, table, BOOTSTRAP_QUESTION)]
    headline: Headline | None = None
    if table is not None:
        headline = bootstrap_headline(table, found)
        sections += [_errors(folder, table, found), _views(folder, table), _correlations(folder, table, found)]
        sections += [_notes(table), Section("Next", (_next_of_bootstrap(table),))]
    sections.append(files_section(folder, FILES, AGAIN))
    return Page(
        _title(folder, table), "Bootstrap study", headline, tuple(sections), made_by=origin.command,
        program=origin.program,
    )  # fmt: skip


def paper_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study paper`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table, found = STUDY_TABLE.read_if_there(folder / JSON_FILE), spreads(folder)
    sections: list[Section] = [_setting(folder, table, PAPER_QUESTION)]
    headline: Headline | None = None
    if table is not None:
        headline = paper_headline(table)
        sections += [_findings(table), _table_2(table), _views(folder, table)]
        sections += [_histograms(folder, table), _correlations(folder, table, found), _notes(table)]
        sections.append(Section("Next", (_next_of_paper(table),)))
    sections.append(files_section(folder, FILES, AGAIN))
    return Page(
        "The paper's study, made again", "Study of the paper", headline, tuple(sections), made_by=origin.command,
        program=origin.program,
    )  # fmt: skip


def _title(folder: Path, table: StudyTable | None) -> str:
    return printable(folder.absolute().name) or "study" if table is None else ", ".join(table.targets)


def _setting(folder: Path, table: StudyTable | None, question: str) -> Section:
    """The question, and what is stored of the setting."""
    identity, wrong = read_identity(folder)
    facts = []
    if table is not None:
        pools = sorted({one.pool for one in table.cases})
        counts = sorted({one.samples for one in table.cases})
        ways = [setting_in_words(*setting) for setting in table.settings]
        facts += [
            ("target" if len(table.targets) == 1 else "targets", ", ".join(table.targets)),
            ("views drawn from", " to ".join(map(str, dict.fromkeys((pools[0], pools[-1])))) + " usable views"),
            ("views of a sample", ", ".join(map(str, table.sizes))),
            ("samples of each case", " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))),
        ]
        facts += [("ways of sampling and counting", "; ".join(ways))] if len(ways) > 1 else []
    facts += identity_facts(identity, SETTING_NAMES)
    missing: tuple[Block, ...] = ()
    if table is None:
        missing = (Findings((Finding("usable", "No tables", NO_TABLE),)),)
    return question_section(question, facts, *warnings("Study file", wrong), *missing)


def _errors(folder: Path, table: StudyTable, found: Sequence[Spread]) -> Section:
    """Errors and parameters of a person's study, and their histograms."""
    blocks: list[Block] = [errors_table(table, target) for target in table.targets]
    parameters = parameters_table(found)
    if parameters is not None:
        blocks.append(parameters)
    blocks += figures(folder, _histogram_texts(table))
    return Section("How sure the calibration is", tuple(blocks), lead=interval_sentence(table))


def _histograms(folder: Path, table: StudyTable) -> Section:
    return Section(
        "Distributions", _folded(figures(folder, _histogram_texts(table))),
        lead="The samples with fitted Gaussians: where they are skewed, a mean and a sigma say too little.",
    )  # fmt: skip


def _histogram_texts(table: StudyTable) -> list[FigureText]:
    return [
        FigureText(
            f"histograms{slug('_'.join(setting))}", f"Distributions{_of(setting)}", histograms_alt(table, setting)
        )
        for setting in table.settings
    ]


def _of(setting: tuple[str, str]) -> str:
    return f": {setting_in_words(*setting)}" if any(setting) else " of the errors"


def _views(folder: Path, table: StudyTable) -> Section:
    """What more views bring."""
    if len(table.sizes) < 2:
        line = f"All samples have {table.sizes[0]} views: give several --sizes to see what more views bring."
        return Section("More views", (Paragraph(line),))
    sightings = tuple(dict.fromkeys(one.sightings for one in table.cases))
    texts = [
        FigureText(f"sigma{slug(one)}", "Sigma over the number of views" + (f", {one}" if one else ""),
                   sigma_alt(table, one), "Both axes logarithmic; the line is 1/sqrt(N).")
        for one in sightings
    ]  # fmt: skip
    blocks = list(figures(folder, texts))
    falls = [one for one in table.findings if one.exponents]
    is_own = len(falls) == len(table.findings)
    claims = falls_table(falls) if is_own else None
    return Section(
        "More views", (*blocks, *((claims,) if claims is not None else ())),
        lead="Where sigma falls as 1/sqrt(N), four times as many views halve it.",
    )  # fmt: skip


def _correlations(folder: Path, table: StudyTable, found: Sequence[Spread]) -> Section:
    texts = [
        FigureText(
            f"correlations{slug('_'.join(setting))}", f"Correlations of the parameters{_of_way(setting)}",
            correlations_alt(table, found, setting), BELOW_AND_ABOVE,
        )
        for setting in table.settings
    ]  # fmt: skip
    blocks = figures(folder, texts)
    lead = "Parameters that go together are known less well one by one than in what they do together."
    return Section("Correlations", _folded(blocks) if len(texts) > 1 else blocks, lead=lead)


def _of_way(setting: tuple[str, str]) -> str:
    return f": {setting_in_words(*setting)}" if any(setting) else ""


def _folded(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Figures under headings that open, the first open."""
    shown: list[Block] = []
    for block in blocks:
        if isinstance(block, Figure):
            shown.append(Fold(block.title, (block,), is_open=not shown))
        else:
            shown.append(block)
    return tuple(shown)


def _findings(table: StudyTable) -> Section:
    """The paper's claims, and why some do not hold."""
    claims = findings_table(table.findings, "The paper's findings with our numbers")
    if claims is None:
        return Section("The paper's findings", (Paragraph("This study has too few cases to check any."),))
    failing = [one for one in table.findings if one.verdict != "holds"][:MOST_FAILING]
    rows = tuple(_finding(one) for one in failing)
    blocks: list[Block] = [claims]
    blocks += notes(table.reasons)
    if rows:
        numbers: tuple[Leaf, ...] = (Findings(rows),)
        blocks.append(Fold(f"The numbers behind the {len(rows)} that do not hold in full", numbers))
    lead = "Each is held against the errors of our samples, in each way of sampling and counting."
    return Section("The paper's findings", tuple(blocks), lead=lead)


def _finding(one: StudyFinding) -> Finding:
    text = f"{setting_in_words(*one.setting)}: {one.evidence}" + (f"; {one.elsewhere}" if one.elsewhere else "")
    return Finding(LEVEL_OF_VERDICT.get(one.verdict, "note"), f"{one.claim}: {one.verdict}", text)


def _table_2(table: StudyTable) -> Section:
    """The paper's table with our rows, and ours over the paper's."""
    blocks: list[Block] = [errors_table(table, target) for target in table.targets]
    factors = factors_table(table)
    if factors is not None:
        blocks.append(factors)
    return Section("Table 2", tuple(blocks), lead="In the paper's units; its own rows stand first.")


def _notes(table: StudyTable) -> Section:
    reasons = () if any(one.ratios for one in table.findings) else table.reasons
    return Section("Notes", notes((*table.notes, *(line.removeprefix(OWN) for line in reasons))))


def _next_of_bootstrap(table: StudyTable) -> Steps:
    """What to do with the answer."""
    largest = max(table.cases, key=lambda one: one.size)
    steps = [
        f"If the spread with {largest.size} views is too large for your work, take more photos: four times as many "
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
