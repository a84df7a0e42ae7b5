"""A comparison of the paper's objects as blocks, for page, terminal and Markdown, and its files."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from calib.cameras import COMMON
from calib.core.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.parts.origin import Origin
from calib.show.studies.compare_figures import FIGURES, comparison_figures
from calib.show.studies.compare_tables import OBJECT_OF, alone_table, explains, lens_table, objects_table
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
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, LENS_OBJECTS, PLAIN_DRAWN, WITHOUT_EFFECT
from calib.studies.compare.objects import MODELS, REPROJECTION_RATIO
from calib.studies.compare.results import COMPARISON, CaseRow, ComparisonTable, Explanation, Results, short
from calib.studies.compare.scene import CAP_RAD
from designer.base.number_text import figure
from designer.page.blocks import Block, Command, Finding, Findings, Headline, Page, Section, Steps
from designer.page.folders import files_section, question_section, warnings

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

BROWN, VIRTUAL = MODELS[:2], MODELS[2]
ALIKE = 0.03
"""Errors that differ by less than this part are called the same."""

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
        missing = question_section(QUESTION, (), NO_TABLE)
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


def compare_headline(table: ComparisonTable) -> Headline:
    """Which object is best, by what factor, and whether the virtual camera wins."""
    ranked = ranked_objects(table)
    if not ranked:
        return Headline("note", "answered", "No object has an intersection error yet.")
    (best, least), (worst, most) = ranked[0], ranked[-1]
    sentence = f"{best} has the smallest intersection error, {figure(least, 2)} mm"
    if worst != best:
        sentence += f", {figure(most / least, 2)} times below {worst} with {figure(most, 2)} mm"
    found = [table.of(name, FIGURE, COMMON, "intersection") for name, _ in ranked]
    factors = [one.paper / one.median for one in found if one is not None and one.paper > 0]
    if factors:
        low, high = min(factors), max(factors)
        sentence += f"; the paper's errors are {figure(low, 2)} to {figure(high, 2)} times as large"
    return Headline("note", f"{best} is best", f"{sentence}. {lens_sentence(table)}".strip())


def ranked_objects(table: ComparisonTable) -> list[tuple[str, float]]:
    """Objects by their median intersection error, the smallest first."""
    names = dict.fromkeys(name for name, _, _ in table.keys(FIGURE))
    found = [(name, table.median(name, FIGURE, COMMON, "intersection")) for name in names]
    return sorted(((name, value) for name, value in found if value > 0), key=lambda pair: pair[1])


def lens_sentence(table: ComparisonTable) -> str:
    """How the virtual camera's error compares in photos held out, behind the smooth lens."""
    parts = []
    for part, made in ((LENS_DRAWN, "as drawn"), (LENS_MADE, "as made")):
        for name in LENS_OBJECTS:
            brown = [table.median(name, part, model, "held_intersection") for model in BROWN]
            known = [value for value in brown if value > 0]
            learned = table.median(name, part, VIRTUAL, "held_intersection")
            if known and learned > 0:
                parts.append(f"{name} {made}, {_compared(min(known), learned)}")
    if not parts:
        return ""
    return (
        "Behind a lens that no Brown model fits, the virtual camera's intersection error in photos held out is: "
        f"{'; '.join(parts)}."
    )


def _compared(brown: float, learned: float) -> str:
    ratio = learned / brown
    if abs(ratio - 1) < ALIKE:
        return "level with Brown's"
    return f"{figure(max(ratio, 1 / ratio), 2)} times {'smaller' if ratio < 1 else 'larger'} than Brown's"


def objects_alt(table: ComparisonTable) -> str:
    """What the boxes of the objects show."""
    parts = [f"{name} {figure(value, 2)} mm" for name, value in ranked_objects(table)]
    found = [table.of(name, FIGURE, COMMON, "intersection") for name, _ in ranked_objects(table)]
    paper = [f"{one.object} {one.paper:g} mm" for one in found if one is not None and one.paper > 0]
    theirs = f" In the paper: {', '.join(paper)}." if paper else ""
    return f"Intersection errors of the objects from the smallest: {', '.join(parts) or 'none'}.{theirs}"


def lens_alt(table: ComparisonTable) -> str:
    """What the boxes of the lens show."""
    return lens_sentence(table) or "Errors of camera models behind a lens that no Brown model fits: none yet."


def alone_alt(table: ComparisonTable) -> str:
    """What the figure of single errors shows."""
    return f"Reconstruction error of single errors that give the paper's intersection error. {alone_sentence(table)}"


def alone_sentence(table: ComparisonTable) -> str:
    """Which errors explain the paper's numbers alone."""
    parts = []
    for name in dict.fromkeys(one.object for one in table.alone):
        fits = [_with_amount(one) for one in table.alone if one.object == name and explains(one)[0] == "yes"]
        parts.append(f"{name}: {', '.join(fits) or 'none'}")
    return f"What explains both of the paper's numbers: {'; '.join(parts) or 'not tried'}."


def _with_amount(one: Explanation) -> str:
    """An error with how large it would be."""
    size = ", ".join(part for part in (one.amount, f"{short(one.multiple)} times what is assumed") if part)
    return f"{one.source.replace('_', ' ')} ({size})"


def setting_notes(table: ComparisonTable) -> Findings:
    """From where the photos are taken, and what cannot show."""
    far = ", ".join(f"{name} {distance:g} mm" for name, distance in table.distance_mm.items()) or "not known"
    angle = f"boards from within {math.degrees(CAP_RAD):g} degrees of their normal, icosahedra from all sides"
    sources = ", ".join(WITHOUT_EFFECT).replace("_", " ")
    return Findings((
        Finding("note", "Distances", f"Where each object just fills the image: {far}; {angle}."),
        Finding(
            "note", "Without effect",
            f"{sources} cost nothing against the drawing: a wrong size only moves the cameras, and a ring's centre "
            "does not depend on its width. They are in the prints, but can explain nothing.",
        ),
    ))  # fmt: skip


def object_notes(table: ComparisonTable) -> tuple[Finding, ...]:
    """The templates' errors against the paper's medians."""
    rows = []
    for name, one in OBJECT_OF.items():
        found = table.of(name, FIGURE, COMMON, "intersection")
        if found is None or not one.is_known:
            continue
        is_inside = found.low <= one.intersection_mm <= found.high
        told = "as ours" if is_inside else f"{figure(one.intersection_mm / found.median, 2)} times ours"
        text = (
            f"Made as {one.errors}, the intersection error is {figure(found.median, 2)} mm, of 95 % of {found.prints} "
            f"prints {figure(found.low, 2)} to {figure(found.high, 2)}; the paper has {one.intersection_text}: {told}."
        )
        rows.append(Finding("note", name, text))
    first, second, paper = REPROJECTION_RATIO
    ours, theirs = (table.median(name, FIGURE, COMMON, "reprojection") for name in (first, second))
    if ours > 0 and theirs > 0:
        text = f"{first} over {second}: {figure(ours / theirs, 2)} with the templates, {paper:g} in the paper."
        rows.append(Finding("note", "Reprojection error", text))
    return tuple(rows)


def lens_notes(table: ComparisonTable) -> tuple[Finding, ...]:
    """What the virtual camera's freedom costs where it is not needed."""
    parts = [(name, PLAIN_DRAWN, f"Without distortion, {name} as drawn") for name in LENS_OBJECTS]
    parts += [
        (name, FIGURE, f"Camera {table.plan.camera}, {name} made as {one.errors}")
        for name, one in OBJECT_OF.items()
        if one.is_board
    ]
    return tuple(Finding("note", "", text) for name, part, what in parts for text in _price(table, name, part, what))


def _price(table: ComparisonTable, name: str, part: str, what: str) -> Iterator[str]:
    brown, learned = (table.median(name, part, model, "held_intersection") for model in (COMMON, VIRTUAL))
    if not (brown > 0 and learned > 0):
        return
    is_lost = part == FIGURE and learned > (1 + ALIKE) * brown
    why = "; one photo of the board gives its map, whose bend it takes for the lens's" if is_lost else ""
    yield (
        f"{what}, photos held out: virtual {figure(learned, 2)} mm, {COMMON} {figure(brown, 2)} mm, which is "
        f"{_compared(brown, learned)}{why}."
    )
