"""What the pages of study folders have in common: figures, files, and what the study file says of itself."""

import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.studies.identity import StudyIdentity
from calib.studies.outputs import FIGURES_FOLDER, STUDY_FILE
from designer.command import printable
from designer.errors import InputError
from designer.page.blocks import (
    Block,
    Command,
    Drawing,
    Facts,
    Figure,
    FileList,
    FileRow,
    Finding,
    Findings,
    Link,
    Raster,
    Section,
)
from designer.words import capital

MAX_DRAWING_BYTES = 500_000
"""Of a drawing within a page: a larger one is shown as pixels."""
MAX_PIXELS_BYTES = 600_000
MOST_FIGURES = 12
"""Of a kind: more are links only, to keep the page small."""
SUFFIXES = ("png", "pdf", "svg")
LONGEST_SETTING = 200
LONGEST_SUBJECT = 60
NO_TABLE = "table.json is missing: run the study again with --resume, and its tables stand here."


@dataclass(frozen=True)
class FigureText:
    """What is said of a figure."""

    stem: str  # of its files
    title: str
    alt: str  # the finding
    caption: str = ""


def read_small_bytes(path: Path, most: int) -> bytes | None:
    """The content of a regular file of at most so many bytes; None if it is none."""
    try:
        # Asked before it is opened: a pipe would wait, a device would never end.
        if not stat.S_ISREG(path.stat().st_mode):
            return None
        with path.open("rb") as stream:
            content = stream.read(most + 1)
    except (OSError, ValueError):
        return None
    return content if len(content) <= most else None


def size_bytes(path: Path) -> int | None:
    """Of a regular file; None if it is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_size if stat.S_ISREG(found.st_mode) else None


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


def _drawing(path: Path) -> Drawing | None:
    from designer.page.drawing import drawing_of_svg

    content = read_small_bytes(path, MAX_DRAWING_BYTES)
    try:
        return None if content is None else drawing_of_svg(content)
    except ValueError:
        return None


def _raster(path: Path) -> Raster | None:
    from designer.page.raster import raster_of

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


def question_section(question: str, setting: Sequence[tuple[str, str]], *more: Block) -> Section:
    """What a study asks, and of what."""
    facts: tuple[Block, ...] = (Facts(tuple(setting)),) if setting else ()
    return Section("Question", (*facts, *more), lead=question)


def warnings(title: str, lines: Sequence[str]) -> tuple[Block, ...]:
    """Lines that call for care, each under the same title; nothing if there are none."""
    return (Findings(tuple(Finding("usable", title, line) for line in lines)),) if lines else ()


def notes(lines: Sequence[str]) -> tuple[Block, ...]:
    """Lines that a study says of itself: `subject: what`, those of one subject together; nothing if there are none."""
    by_subject: dict[str, list[str]] = {}
    for line in lines:
        subject, colon, text = line.partition(": ")
        has_subject = bool(colon) and len(subject) <= LONGEST_SUBJECT
        by_subject.setdefault(subject if has_subject else "", []).append(_sentence(text if has_subject else line))
    rows = [
        Finding("note", subject if "_" in subject else capital(subject), " ".join(texts))
        for subject, texts in by_subject.items()
        if subject
    ]
    rows += [Finding("note", "", text) for text in by_subject.get("", [])]
    return (Findings(tuple(rows)),) if rows else ()


def _sentence(text: str) -> str:
    start = text if text.startswith("sqrt(") else capital(text)
    return start + ("" if text.endswith(".") else ".")


def files_section(folder: Path, purposes: Sequence[tuple[str, str]], again: Command) -> Section:
    """The files of the folder that are there, and the command that makes tables or figures again."""
    known = [(name, why, size_bytes(folder / name)) for name, why in purposes]
    rows = tuple(FileRow(name, why, size) for name, why, size in known if size is not None)
    blocks: tuple[Block, ...] = (FileList(rows),) if rows else ()
    return Section("Files", (*blocks, again))
