"""What the pages of study folders have in common: figures, and what the study file says of itself."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.show.parts.folder_blocks import read_small_bytes, size_bytes
from calib.studies.identity import StudyIdentity
from calib.studies.outputs import FIGURES_FOLDER, STUDY_FILE
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.blocks import (
    Block,
    Figure,
    Finding,
    Findings,
    Link,
    Raster,
    Svg,
)
from designer.page.pictures import drawing_of_svg

MAX_DRAWING_BYTES = 500_000
"""Of a drawing within a page: a larger one is shown as pixels."""
MAX_PIXELS_BYTES = 600_000
MOST_FIGURES = 12
"""Of a kind: more are links only, to keep the page small."""
SUFFIXES = ("png", "pdf", "svg")
LONGEST_SETTING = 200
NO_TABLE = "table.json is missing: run the study again with --resume, and its tables stand here."


@dataclass(frozen=True)
class FigureText:
    """What is said of a figure."""

    stem: str  # of its files
    title: str
    alt: str  # the finding
    caption: str = ""


def figure(folder: Path, text: FigureText) -> Figure | None:
    """A figure of the folder, as a drawing where that is small; None if it is missing or damaged."""
    place = folder / FIGURES_FOLDER
    image = _drawing(place / f"{text.stem}.svg") or _raster(place / f"{text.stem}.png")
    if image is None:
        return None
    files = tuple(
        Link(suffix.upper(), f"{FIGURES_FOLDER}/{text.stem}.{suffix}")
        for suffix in SUFFIXES
        if size_bytes(place / f"{text.stem}.{suffix}") is not None
    )
    return Figure(text.title, image, text.alt, text.caption, files, is_wide=True)


def _drawing(path: Path) -> Svg | None:
    content = read_small_bytes(path, MAX_DRAWING_BYTES)
    try:
        return None if content is None else drawing_of_svg(content)
    except ValueError:
        return None


def _raster(path: Path) -> Raster | None:
    from designer.page.pictures import raster_of

    content = read_small_bytes(path, MAX_PIXELS_BYTES)
    try:
        return None if content is None else raster_of(content)
    except ValueError:
        return None


def figures(folder: Path, texts: Sequence[FigureText]) -> tuple[Block, ...]:
    """All figures that are there, and a line that names those that are not."""
    found = [(text, figure(folder, text)) for text in texts[:MOST_FIGURES]]
    blocks: list[Block] = [one for _, one in found if one is not None]
    missing = [f"{text.stem}.svg or .png" for text, one in found if one is None]
    if missing:
        text = f"{', '.join(missing)} in {FIGURES_FOLDER}: not there, or not a picture. Make the figures again."
        blocks.append(Findings((Finding("usable", "Figures are missing", text),)))
    return tuple(blocks)


def read_identity(folder: Path) -> tuple[StudyIdentity | None, tuple[str, ...]]:
    """What a study is, and what is wrong with its file; None and nothing if it has none."""
    from calib.studies.store import read_study

    path = folder / STUDY_FILE
    if not path.exists():
        return None, ()
    try:
        with read_study(path) as study:
            return study.identity, ()
    except InputError as error:
        return None, (printable(str(error).replace(str(path), STUDY_FILE)),)


def identity_facts(identity: StudyIdentity | None, names: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Settings of a study in words, those that have a value, and its seed.

    Args:
        identity: None if it is not known.
        names: of the settings, and what they are called on the page.
    """
    if identity is None:
        return
    settings = dict(identity.settings)
    for name, title in names.items():
        if value := printable(settings.get(name, "")):
            yield title, value if len(value) <= LONGEST_SETTING else f"{value[: LONGEST_SETTING - 3]}..."
    yield "seed", str(identity.seed)
