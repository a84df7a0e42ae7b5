"""What the page of a comparison says in words: its answer, and what its figures show."""

from calib.cameras import COMMON
from calib.core.number_text import figure
from calib.show.studies.compare_tables import explains
from calib.studies.compare.cases import FIGURE, LENS_DRAWN, LENS_MADE, LENS_OBJECTS
from calib.studies.compare.comparison_file import AloneRow, ComparisonFile
from calib.studies.compare.objects import MODELS
from calib.studies.compare.results import short
from calib.studies.compare.words import ALIKE
from designer.page.blocks import Headline

LENS_STARTS = ("Smooth lens", "Without distortion", "Camera ")
SETTING_STARTS = ("Distances at which",)
SIZE_MARKS = (" made as ", "Reprojection error of")
BROWN, VIRTUAL = MODELS[:2], MODELS[2]


def compare_headline(table: ComparisonFile) -> Headline:
    """Which object is best, by what factor, and whether the virtual camera wins."""
    ranked = ranked_objects(table)
    if not ranked:
        return Headline("note", "answered", "No object has an intersection error yet.")
    (best, least), (worst, most) = ranked[0], ranked[-1]
    sentence = f"{best} has the smallest intersection error, {figure(least, 2)} mm"
    if worst != best:
        sentence += f", {figure(most / least, 2)} times below {worst} with {figure(most, 2)} mm"
    factors = paper_factors(table)
    if factors:
        low, high = min(factors), max(factors)
        sentence += f"; the paper's errors are {figure(low, 2)} to {figure(high, 2)} times as large"
    lens = lens_sentence(table)
    return Headline("note", f"{best} is best", f"{sentence}. {lens}".strip())


def ranked_objects(table: ComparisonFile) -> list[tuple[str, float]]:
    """Objects by their median intersection error, the smallest first."""
    names = dict.fromkeys(name for name, _, _ in table.keys(FIGURE))
    found = [(name, table.median(name, FIGURE, COMMON, "intersection")) for name in names]
    return sorted(((name, value) for name, value in found if value), key=lambda pair: pair[1])


def paper_factors(table: ComparisonFile) -> list[float]:
    """The paper's intersection errors over ours."""
    found = [table.of(name, FIGURE, COMMON, "intersection") for name, _ in ranked_objects(table)]
    return [one.paper / one.median for one in found if one is not None and one.median and one.paper]


def lens_sentence(table: ComparisonFile) -> str:
    """By what factor the virtual camera's error is smaller in photos held out, behind the smooth lens."""
    parts = []
    for part, made in ((LENS_DRAWN, "as drawn"), (LENS_MADE, "as made")):
        for name in LENS_OBJECTS:
            pair = _held_out(table, name, part)
            if pair is not None:
                parts.append(f"{name} {made}, {_compared(*pair)}")
    if not parts:
        return ""
    return (
        "Behind a lens that no Brown model fits, the virtual camera's intersection error in photos held out is: "
        f"{'; '.join(parts)}."
    )


def _held_out(table: ComparisonFile, name: str, part: str) -> tuple[float, float] | None:
    """The best Brown model's median and the virtual camera's."""
    brown = [value for model in BROWN if (value := table.median(name, part, model, "held_intersection"))]
    learned = table.median(name, part, VIRTUAL, "held_intersection")
    return (min(brown), learned) if brown and learned else None


def _compared(brown: float, learned: float) -> str:
    ratio = learned / brown
    if abs(ratio - 1) < ALIKE:
        return "level with Brown's"
    return f"{figure(max(ratio, 1 / ratio), 2)} times {'smaller' if ratio < 1 else 'larger'} than Brown's"


def objects_alt(table: ComparisonFile) -> str:
    """What the boxes of the objects show."""
    parts = [f"{name} {figure(value, 2)} mm" for name, value in ranked_objects(table)]
    paper = [
        f"{name} {found.paper:g} mm"
        for name, _ in ranked_objects(table)
        if (found := table.of(name, FIGURE, COMMON, "intersection")) is not None and found.paper
    ]
    theirs = f" In the paper: {', '.join(paper)}." if paper else ""
    return f"Intersection errors of the objects from the smallest: {', '.join(parts) or 'none'}.{theirs}"


def lens_alt(table: ComparisonFile) -> str:
    """What the boxes of the lens show."""
    return lens_sentence(table) or "Errors of camera models behind a lens that no Brown model fits: none yet."


def alone_alt(table: ComparisonFile) -> str:
    """What the figure of single errors shows."""
    return f"Reconstruction error of single errors that give the paper's intersection error. {alone_sentence(table)}"


def alone_sentence(table: ComparisonFile) -> str:
    """Which errors explain the paper's numbers alone."""
    parts = []
    for name in dict.fromkeys(one.object for one in table.alone):
        fits = [_with_amount(one) for one in table.alone if one.object == name and explains(one)[0] == "yes"]
        parts.append(f"{name}: {', '.join(fits) or 'none'}")
    return f"What explains both of the paper's numbers: {'; '.join(parts) or 'not tried'}."


def _with_amount(one: AloneRow) -> str:
    """An error with how large it would be."""
    times = "" if one.multiple is None else f"{short(one.multiple)} times what is assumed"
    size = ", ".join(part for part in (one.amount, times) if part)
    return one.source.replace("_", " ") + (f" ({size})" if size else "")


def split_sentences(table: ComparisonFile) -> dict[str, tuple[str, ...]]:
    """The study's own sentences by the section that they belong to."""
    found: dict[str, list[str]] = {"setting": [], "objects": [], "lens": [], "alone": []}
    for line in table.sentences:
        if line.startswith(SETTING_STARTS):
            found["setting"].append(line)
        elif line.startswith(LENS_STARTS):
            found["lens"].append(line)
        elif any(mark in line for mark in SIZE_MARKS):
            found["objects"].append(line)
        else:
            found["alone"].append(line)
    return {name: tuple(lines) for name, lines in found.items()}
