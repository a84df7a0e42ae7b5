"""A study of costs as blocks, for page, terminal and Markdown, and its files."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from calib.core.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.parts.origin import Origin
from calib.show.studies.cost_figures import FIGURE, cost_figures
from calib.show.studies.cost_tables import TITLES, costs_table, ratios_table, starts_table
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
from calib.solver.costs import IMAGE
from calib.studies.cost.cases import CONTRAST_TO_NOISE, FARTHEST, SETTINGS, VIEWS
from calib.studies.cost.errors import WEIGHTED
from calib.studies.cost.photographed import OUTLIER_PX, OUTLIER_SHARE
from calib.studies.cost.results import COST_TABLE, CostRatio, CostTable, StartRow
from designer.base.number_text import figure
from designer.page.blocks import Block, Command, Finding, Findings, Headline, Page, Section
from designer.page.folders import files_section, question_section, warnings

QUESTION = (
    "Which distances are best minimised: those in the image, or those in space between rays and rings, as the paper "
    "leaves to future work? Measured on the same sightings, solved by each cost."
)
TITLE = "What to minimise"
FILES = (
    ("table.md", "the tables, to paste into a text"), ("table.csv", "every comparison, a line each"),
    ("table.json", "the same for programs"), (STUDY_FILE, "every set of photos and every start"),
)  # fmt: skip
MOST_WINS = 6

Drawn = Callable[[Sequence[FigureText]], tuple[Block, ...]]


def cost_page(folder: Path, origin: Origin) -> Page:
    """The page of `calib study cost`.

    Raises:
        InputError: `table.json` is damaged.
    """
    table = COST_TABLE.read_if_there(folder / JSON_FILE)
    files = files_section(folder, FILES, Command("calib report .", "in this folder: makes this page again"))
    if table is None:
        missing = question_section(QUESTION, (), NO_TABLE)
        return Page(TITLE, "Study", None, (missing, files), made_by=origin.command, program=origin.program)
    _, wrong = read_identity(folder)
    sections = (
        question_section(QUESTION, _facts(table), *warnings("Study file", wrong), _notes()),
        *cost_sections(table, partial(figures, folder)), files,
    )  # fmt: skip
    return Page(TITLE, "Study", cost_headline(table), sections, made_by=origin.command, program=origin.program)


def cost_sections(table: CostTable, drawn: Drawn = lambda texts: ()) -> tuple[Section, ...]:
    """All that is told of a study."""
    text = FigureText(FIGURE, "Errors over the image's, by cost", counts_sentence(table))
    parts: list[Section] = [
        Section("Answer", (costs_table(table), *drawn([text])), lead=counts_sentence(table)),
        Section("Every comparison", (ratios_table(table),), lead=wins_sentence(table)),
    ]
    if table.starts:
        parts.append(Section("Bad starts", (starts_table(table),), lead=starts_sentence(table)))
    return tuple(parts)


def cost_files(table: CostTable, folder: Path) -> dict[Path, bytes]:
    """The files of a study and their contents."""
    return table_files_of(table, folder) | cost_figures(table, folder / FIGURES_FOLDER)


def table_files_of(table: CostTable, folder: Path) -> dict[Path, bytes]:
    """The files without pictures."""
    asked = question_section(QUESTION, _facts(table), _notes())
    told = markdown(TITLE, (asked, *cost_sections(table)), cost_headline(table).sentence)
    return {
        folder / MARKDOWN_FILE: told.encode("utf-8", ANY_NAME),
        folder / CSV_FILE: rows_to_csv(CostRatio, table.cases),
        folder / JSON_FILE: COST_TABLE.text(table),
    }


def _facts(table: CostTable) -> tuple[tuple[str, str], ...]:
    plan = table.plan
    own = (("own photos", plan.photos), ("their model", plan.model)) if plan.photos else ()
    return (
        ("sets of each scene and condition", str(plan.sets)), ("starts of each scene", str(plan.starts)), *own,
        ("seed", str(plan.seed)),
    )  # fmt: skip


def _notes() -> Findings:
    """How it is simulated."""
    scenes = "; ".join(f"{one.name}: {one.template}, made as {one.errors}, camera {one.camera}" for one in SETTINGS)
    return Findings((
        Finding("note", "Scenes", f"{scenes}; {VIEWS} photos each."),
        Finding(
            "note", "Photos",
            f"From where the target fills the image to {FARTHEST:g} times as far; centres are as unsure as the "
            f"detector's at a contrast of {CONTRAST_TO_NOISE:g} times the noise. Made: with errors of fabrication, "
            "solved with the drawing, a print for each set.",
        ),
        Finding(
            "note", "Outliers",
            f"{OUTLIER_SHARE:.0%} of the centres are off by {OUTLIER_PX:g} px more (a standard deviation a "
            "coordinate); with least squares, and with Huber's loss.",
        ),
        Finding(
            "note", "Held out",
            "In photos that were not solved from, poses minimise the same distances over every second ring; the "
            "errors, in px and in mm across the rays, are those of the other rings.",
        ),
    ))  # fmt: skip


def cost_headline(table: CostTable) -> Headline:
    """Whether the image's distances are the ones to minimise."""
    if not any(table.compared(name) for name in table.costs):
        return Headline("note", "answered", answer(table))
    is_image = all(not _winners(table, condition) for condition in _conditions(table))
    return Headline("note", "minimise in the image" if is_image else "it depends", answer(table))


def _conditions(table: CostTable) -> tuple[str, ...]:
    return tuple(dict.fromkeys(condition for _, condition in table.keys))


def _counts(rows: Sequence[CostRatio]) -> tuple[int, int]:
    """How many are surely better than the image, and surely worse."""
    return sum(one.is_better for one in rows), sum(one.is_worse for one in rows)


def _winners(table: CostTable, condition: str) -> list[str]:
    """Other costs that are better more often than worse, the best first, in words."""
    found = []
    for name in table.costs:
        rows = [one for one in table.compared(name) if one.condition == condition]
        better, worse = _counts(rows)
        if better > worse and name != WEIGHTED:
            found.append((worse - better, f"{name} ({better} better, {worse} worse of {len(rows)})"))
    return [text for _, text in sorted(found)]


def answer(table: CostTable) -> str:
    """What is best minimised under each condition."""
    told = {condition: _winners(table, condition) for condition in _conditions(table)}
    if not any(table.compared(name) for name in table.costs):
        return "No comparison has three sets yet."
    image = [condition for condition, winners in told.items() if not winners]
    parts = [f"{condition}: {', '.join(winners)}" for condition, winners in told.items() if winners]
    if not parts:
        return f"Distances in the image are not beaten on balance under any condition: {'; '.join(image)}."
    rest = f"Distances in the image are not beaten on balance: {'; '.join(image)}." if image else ""
    return f"{rest} They are: {'; '.join(parts)}.".strip()


def counts_sentence(table: CostTable) -> str:
    """In how many comparisons each cost is better or worse."""
    parts = []
    for name in table.costs:
        better, worse = _counts(table.compared(name))
        parts.append(f"{name} {better} better, {worse} worse" if better or worse else f"{name} the same in all")
    count = max((len(table.compared(name)) for name in table.costs), default=0)
    return f"Against the distances in the image, of {count} comparisons: {'; '.join(parts) or 'none'}."


def wins_sentence(table: CostTable) -> str:
    """Where distances in space are better than those in the image."""
    others = [one for name in table.costs if name != WEIGHTED for one in table.compared(name)]
    wins = sorted((one for one in others if one.is_better), key=_ratio)
    if not wins:
        return "No distances in space are surely better than those in the image."
    told = [
        f"{one.cost} ({one.scene}, {one.condition}: {TITLES[one.measure]}, {figure(one.ratio, 3)} times)"
        for one in wins[:MOST_WINS]
    ]
    more = f"; and {len(wins) - MOST_WINS} smaller ones" if len(wins) > MOST_WINS else ""
    return f"Surely better than the distances in the image are: {'; '.join(told)}{more}."


def _ratio(one: CostRatio) -> float:
    return one.ratio


def starts_sentence(table: CostTable) -> str:
    """Which cost stands bad starts best."""
    total = {name: _share([one for one in table.starts if one.cost == name]) for name in _names(table)}
    ranked = sorted(total, key=lambda name: -total[name])
    told = ", ".join(f"{name} {100 * total[name]:.0f} %" for name in ranked)
    return f"So many of all bad starts lead to the least value: {told} (the image's: {100 * total[IMAGE]:.0f} %)."


def _names(table: CostTable) -> tuple[str, ...]:
    return tuple(dict.fromkeys((IMAGE, *(one.cost for one in table.starts))))


def _share(rows: Sequence[StartRow]) -> float:
    starts = sum(one.starts for one in rows)
    return sum(one.reached for one in rows) / starts if starts else 0.0
