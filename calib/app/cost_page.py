"""How a study of costs is told: which distances are best minimised, and how many bad starts each stands."""

from collections.abc import Sequence
from shlex import quote
from typing import TYPE_CHECKING

from calib.app.study_result import computed
from calib.draw.cost_tables import TITLES, costs_table, ratios_table, starts_table
from calib.solver.costs import IMAGE
from calib.studies.cost.estimates import OUTLIER_PX, OUTLIER_SHARE, WEIGHTED
from calib.studies.cost.ratios import CONTRAST_TO_NOISE, FARTHEST, SETTINGS, VIEWS, CostRatio, CostTable
from designer.base.words import figure
from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Paragraph, Section

if TYPE_CHECKING:
    from calib.app.study_cost import CostStudy

QUESTION = (
    "Which distances are best minimised: those in the image, or those in space between rays and rings, as the paper "
    "leaves to future work? Measured on the same sightings, solved by each cost."
)
TITLE = "What to minimise"
MOST_WINS = 6


def cost_page(found: "CostStudy") -> Page:
    """All that is told of a study."""
    table, plan = found.table, found.table.plan
    own = (("own photos", plan.photos), ("their model", plan.model)) if plan.photos else ()
    facts = (
        ("sets of each scene and condition", str(plan.sets)), ("starts of each scene", str(plan.starts)), *own,
        ("seed", str(plan.seed)), *computed(found.sampled, "samples"),
    )  # fmt: skip
    parts: list[Section] = [
        Section("Answer", (costs_table(table), *found.figures("costs")), lead=counts_sentence(table)),
        Section("Every comparison", (ratios_table(table),), lead=wins_sentence(table)),
    ]
    if table.starts:
        parts.append(Section("Bad starts", (starts_table(table),), lead=starts_sentence(table)))
    step = Command(f"calib study cost -o {quote(found.place)} --resume --sets {2 * plan.sets}", "adds sets")
    lead = (Paragraph(QUESTION), Facts(facts), _notes())
    return Page(TITLE, "", cost_headline(table), tuple(parts), lead=lead, next_steps=(step,))


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
    wins = sorted((one for one in others if one.is_better), key=lambda one: one.ratio)
    if not wins:
        return "No distances in space are surely better than those in the image."
    told = [
        f"{one.cost} ({one.scene}, {one.condition}: {TITLES[one.measure]}, {figure(one.ratio, 3)} times)"
        for one in wins[:MOST_WINS]
    ]
    more = f"; and {len(wins) - MOST_WINS} smaller ones" if len(wins) > MOST_WINS else ""
    return f"Surely better than the distances in the image are: {'; '.join(told)}{more}."


def starts_sentence(table: CostTable) -> str:
    """Which cost stands bad starts best."""
    total = {}
    for name in dict.fromkeys((IMAGE, *(one.cost for one in table.starts))):
        rows = [one for one in table.starts if one.cost == name]
        total[name] = sum(one.reached for one in rows) / max(sum(one.starts for one in rows), 1)
    ranked = sorted(total, key=lambda name: -total[name])
    told = ", ".join(f"{name} {100 * total[name]:.0f} %" for name in ranked)
    return f"So many of all bad starts lead to the least value: {told} (the image's: {100 * total[IMAGE]:.0f} %)."
