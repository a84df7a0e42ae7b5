"""The files of a study's folder, written and shown: tables, figures, and what the study file says of itself."""

import csv
import io
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

from calib.core.csv_table import ANY_NAME
from calib.draw.style import picture
from calib.studies.identity import StudyIdentity
from calib.studies.store import read_study
from designer.base.codec import encode
from designer.base.errors import InputError
from designer.base.small_file import JsonValue
from designer.base.words import cut, printable
from designer.page.blocks import Block, Figure, Finding, Findings, Link, Raster, Svg
from designer.page.folders import read_small_bytes, size_bytes
from designer.page.pictures import drawing_of_svg

if TYPE_CHECKING:
    from matplotlib import figure as drawn

Row = TypeVar("Row")

STUDY_FILE = "study.sqlite"
FIGURES_FOLDER = "figures"
MARKDOWN_FILE, CSV_FILE, JSON_FILE = "table.md", "table.csv", "table.json"
SUFFIXES = ("png", "pdf", "svg")
METADATA: Mapping[str, Mapping[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None}, "svg": {"Date": None, "Creator": None},
}  # fmt: skip
"""Of the formats that are asked for: nothing that differs from one drawing to the next."""
MAX_DRAWING_BYTES = 500_000
"""Of a drawing within a page: a larger one is shown as pixels."""
MAX_PIXELS_BYTES = 600_000
MOST_FIGURES = 12
"""Of a kind: more are links only, to keep the page small."""
LONGEST_SETTING = 200
_LOST = "table.json is missing: run the study again with --resume, and its tables stand here."
NO_TABLE = Findings((Finding("usable", "No tables", _LOST),))


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
            yield title, cut(value, LONGEST_SETTING)
    yield "seed", str(identity.seed)


def rows_to_csv(kind: type[Row], rows: Sequence[Row], heads: Sequence[Mapping[str, JsonValue]] = ()) -> bytes:
    """A line a row, its fields as columns; a head, if there are any, stands before each."""
    values = [encode(kind, row) for row in rows]
    lines = [
        {**head, **cast("dict[str, JsonValue]", row)}
        for head, row in zip(heads or [{}] * len(rows), values, strict=True)
    ]
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(lines[0]) if lines else ["none"], lineterminator="\n")
    writer.writeheader()
    for line in lines:
        writer.writerow({name: "" if value is None else value for name, value in line.items()})
    return stream.getvalue().encode("utf-8", ANY_NAME)


def files_of(
    place: Path, height_px: int, draw: "Callable[[drawn.Figure], None]", suffixes: Collection[str] = SUFFIXES
) -> dict[Path, bytes]:
    """A picture as PNG and in other formats, the same from the same data.

    Args:
        place: path without suffix.
        height_px: of the picture.
        draw: fills the figure.
        suffixes: of the formats; PNG is always among them.
    """
    import matplotlib as mpl

    contents: dict[str, bytes] = {}

    def draw_all(page: "drawn.Figure") -> None:
        draw(page)
        others = [suffix for suffix in SUFFIXES if suffix in METADATA and suffix in suffixes]
        if not others:
            return
        # Text stays text, so that it can be searched and edited; the salt makes the marks' names repeatable.
        with mpl.rc_context({"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": place.name}):
            page.canvas.draw()
            page.set_layout_engine("none")  # the layout is found: the same in all formats
            for suffix in others:
                contents[suffix] = _saved(page, suffix, METADATA[suffix])

    with warnings.catch_warnings():
        # A target may be called anything; where the font lacks a character there is a box.
        warnings.filterwarnings("ignore", message="Glyph")
        contents["png"] = picture(height_px, draw_all)
    return {place.with_name(f"{place.name}.{suffix}"): contents[suffix] for suffix in SUFFIXES if suffix in contents}


def _saved(page: "drawn.Figure", suffix: str, metadata: Mapping[str, None]) -> bytes:
    stream = io.BytesIO()
    page.savefig(stream, format=suffix, metadata=metadata)
    return stream.getvalue()
