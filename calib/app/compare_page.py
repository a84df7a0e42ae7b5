"""How a comparison of the paper's objects is told: figures, tables, and what they say."""

import math
from collections.abc import Iterator
from functools import partial
from shlex import quote
from typing import TYPE_CHECKING

from calib.app.study_result import computed
from calib.cameras import COMMON
from calib.draw import compare_figures as figures
from calib.draw.style import FigureSheet
from calib.studies.compare import cases as compared
from calib.studies.compare.scene import CAP_RAD, MODELS, REPROJECTION_RATIO
from designer.base.words import figure
from designer.page.blocks import Command, Facts, Finding, Findings, Headline, Page, Paragraph, Section

if TYPE_CHECKING:
    from calib.app.study_compare import ComparedObjects

QUESTION = (
    "Which of the paper's five objects is best, do errors of manufacturing explain the paper's numbers, and does the "
    "virtual camera win behind a lens that no Brown model fits? Simulated: objects are made with errors, photographed, "
    "and calibrated as the paper did, against their drawings."
)
TITLE = "The paper's objects, simulated"
FEW_PRINTS = 12
BROWN, VIRTUAL = MODELS[:2], MODELS[2]
ALIKE = 0.03
"""Errors that differ by less than this part are called the same."""


def comparison_page(found: "ComparedObjects") -> Page:
    """All that is told of a comparison."""
    table, plan = found.results.table, found.results.table.plan
    facts = (
        ("camera", plan.camera), ("prints of each object", str(plan.prints)),
        ("sets of photos of each print", f"{plan.sets} ({plan.slow_sets} for the virtual camera)"),
        ("seed", str(plan.seed)), *computed(found.sampled, "samples"),
    )  # fmt: skip
    parts = (
        ("The five objects", "objects", objects_alt(table), figures.objects_table(table), object_notes(table)),
        ("A smooth lens", "lens", lens_sentence(table), figures.lens_table(table), lens_notes(table)),
        ("Explanations", "alone", alone_sentence(table), figures.alone_table(table), ()),
    )
    sections = tuple(
        Section(title, (*found.figures(stem), shown, *((Findings(notes),) if notes else ())), lead=lead)
        for title, stem, lead, shown, notes in parts
    )
    more = max(FEW_PRINTS, 2 * plan.prints)
    step = Command(f"calib study compare -o {quote(found.place)} --resume --prints {more}", "adds prints")
    lead = (Paragraph(QUESTION), Facts(facts), setting_notes(table))
    return Page(TITLE, "", compare_headline(table), sections, lead=lead, next_steps=(step,))


def comparison_sheets(results: compared.Results) -> tuple[FigureSheet, ...]:
    """Boxes of the objects, of the lens, and single errors."""
    table = results.table
    draw = {name: partial(function, results=results) for name, function in
            (("objects", figures.draw_boxes), ("lens", figures.draw_lens), ("alone", figures.draw_alone))}  # fmt: skip
    lens = lens_sentence(table) or "Errors of camera models behind a lens that no Brown model fits: none yet."
    alone = f"Reconstruction error of single errors that give the paper's intersection error. {alone_sentence(table)}"
    return (
        FigureSheet(
            "objects", "Errors of the five objects", objects_alt(table), figures.BOXES_PX, draw["objects"],
            "Dashed: the paper's medians.",
        ),
        FigureSheet("lens", "Camera models behind a smooth lens", lens, figures.BOXES_PX, draw["lens"]),
        FigureSheet(
            "alone", "Single errors that would give the paper's numbers", alone, figures.ALONE_PX, draw["alone"]
        ),
    )  # fmt: skip


def compare_headline(table: compared.ComparisonTable) -> Headline:
    """Which object is best, by what factor, and whether the virtual camera wins."""
    ranked = ranked_objects(table)
    if not ranked:
        return Headline("note", "answered", "No object has an intersection error yet.")
    (best, least), (worst, most) = ranked[0], ranked[-1]
    sentence = f"{best} has the smallest intersection error, {figure(least, 2)} mm"
    if worst != best:
        sentence += f", {figure(most / least, 2)} times below {worst} with {figure(most, 2)} mm"
    found = [table.of(name, compared.FIGURE, COMMON, "intersection") for name, _ in ranked]
    factors = [one.paper / one.median for one in found if one is not None and one.paper > 0]
    if factors:
        low, high = min(factors), max(factors)
        sentence += f"; the paper's errors are {figure(low, 2)} to {figure(high, 2)} times as large"
    return Headline("note", f"{best} is best", f"{sentence}. {lens_sentence(table)}".strip())


def ranked_objects(table: compared.ComparisonTable) -> list[tuple[str, float]]:
    """Objects by their median intersection error, the smallest first."""
    names = dict.fromkeys(name for name, _, _ in table.keys(compared.FIGURE))
    found = [(name, table.median(name, compared.FIGURE, COMMON, "intersection")) for name in names]
    return sorted(((name, value) for name, value in found if value > 0), key=lambda pair: pair[1])


def lens_sentence(table: compared.ComparisonTable) -> str:
    """How the virtual camera's error compares in photos held out, behind the smooth lens."""
    parts = []
    for part, made in ((compared.LENS_DRAWN, "as drawn"), (compared.LENS_MADE, "as made")):
        for name in compared.LENS_OBJECTS:
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


def objects_alt(table: compared.ComparisonTable) -> str:
    """What the boxes of the objects show."""
    parts = [f"{name} {figure(value, 2)} mm" for name, value in ranked_objects(table)]
    found = [table.of(name, compared.FIGURE, COMMON, "intersection") for name, _ in ranked_objects(table)]
    paper = [f"{one.object} {one.paper:g} mm" for one in found if one is not None and one.paper > 0]
    theirs = f" In the paper: {', '.join(paper)}." if paper else ""
    return f"Intersection errors of the objects from the smallest: {', '.join(parts) or 'none'}.{theirs}"


def alone_sentence(table: compared.ComparisonTable) -> str:
    """Which errors explain the paper's numbers alone."""
    parts = []
    for name in dict.fromkeys(one.object for one in table.alone):
        fits = []
        for one in table.alone:
            if one.object == name and figures.explains(one)[0] == "yes":
                sizes = filter(None, (one.amount, f"{compared.short(one.multiple)} times what is assumed"))
                fits.append(f"{one.source.replace('_', ' ')} ({', '.join(sizes)})")
        parts.append(f"{name}: {', '.join(fits) or 'none'}")
    return f"What explains both of the paper's numbers: {'; '.join(parts) or 'not tried'}."


def setting_notes(table: compared.ComparisonTable) -> Findings:
    """From where the photos are taken, and what cannot show."""
    far = ", ".join(f"{name} {distance:g} mm" for name, distance in table.distance_mm.items()) or "not known"
    angle = f"boards from within {math.degrees(CAP_RAD):g} degrees of their normal, icosahedra from all sides"
    sources = ", ".join(compared.WITHOUT_EFFECT).replace("_", " ")
    return Findings((
        Finding("note", "Distances", f"Where each object just fills the image: {far}; {angle}."),
        Finding(
            "note", "Without effect",
            f"{sources} cost nothing against the drawing: a wrong size only moves the cameras, and a ring's centre "
            "does not depend on its width. They are in the prints, but can explain nothing.",
        ),
    ))  # fmt: skip


def object_notes(table: compared.ComparisonTable) -> tuple[Finding, ...]:
    """The templates' errors against the paper's medians."""
    rows = []
    for name, one in figures.OBJECT_OF.items():
        found = table.of(name, compared.FIGURE, COMMON, "intersection")
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
    ours, theirs = (table.median(name, compared.FIGURE, COMMON, "reprojection") for name in (first, second))
    if ours > 0 and theirs > 0:
        text = f"{first} over {second}: {figure(ours / theirs, 2)} with the templates, {paper:g} in the paper."
        rows.append(Finding("note", "Reprojection error", text))
    return tuple(rows)


def lens_notes(table: compared.ComparisonTable) -> tuple[Finding, ...]:
    """What the virtual camera's freedom costs where it is not needed."""
    parts = [(name, compared.PLAIN_DRAWN, f"Without distortion, {name} as drawn") for name in compared.LENS_OBJECTS]
    parts += [
        (name, compared.FIGURE, f"Camera {table.plan.camera}, {name} made as {one.errors}")
        for name, one in figures.OBJECT_OF.items()
        if one.is_board
    ]
    return tuple(Finding("note", "", text) for name, part, what in parts for text in _price(table, name, part, what))


def _price(table: compared.ComparisonTable, name: str, part: str, what: str) -> Iterator[str]:
    brown, learned = (table.median(name, part, model, "held_intersection") for model in (COMMON, VIRTUAL))
    if not (brown > 0 and learned > 0):
        return
    is_lost = part == compared.FIGURE and learned > (1 + ALIKE) * brown
    why = "; one photo of the board gives its map, whose bend it takes for the lens's" if is_lost else ""
    yield (
        f"{what}, photos held out: virtual {figure(learned, 2)} mm, {COMMON} {figure(brown, 2)} mm, which is "
        f"{_compared(brown, learned)}{why}."
    )
