"""The one place where a page becomes HTML: self-contained, without network, all text escaped."""

import base64
import hashlib
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from designer.page.blocks import Block, Cell, Figure, Fold, Page, Raster, Section, Sliders, Svg, Table, View3d, href
from designer.page.pictures import media_type

_PARTS = Path(__file__).parent / "parts"
_ROW_REM = 2.125  # height of a line of a table, as in page.css
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff]")


@dataclass(frozen=True)
class _Extra:
    """What a page needs besides where it has a kind of block."""

    style: str
    scripts: tuple[str, ...]


_OF_BLOCKS: dict[type[Block], _Extra] = {
    View3d: _Extra("viewer.css", ("three.min.js", "viewer_shapes.js", "viewer.js")),
    Sliders: _Extra("what_if.css", ("what_if.js",)),
}


@dataclass(frozen=True)
class _Chapter:
    """A section and where the contents lead to."""

    anchor: str
    section: Section


def page_html(page: Page) -> bytes:
    """The page as one UTF-8 HTML file; the same page gives the same bytes.

    Scripts and styles stand in the file, and a Content-Security-Policy allows these alone, by their SHA-256
    (https://www.w3.org/TR/CSP3/#grammardef-hash-source): were some text to become markup all the same, it could not
    run.

    Raises:
        ValueError: a link leads out of the page's folder, or a picture is neither PNG nor JPEG.
    """
    kinds = {type(block) for block in _blocks(page)}
    extra = [parts for kind, parts in _OF_BLOCKS.items() if kind in kinds]
    style = _part("page.css") + _row_heights(page) + "".join(_part(parts.style) for parts in extra)
    scripts = [_part(name) for name in (*(name for parts in extra for name in parts.scripts), "page.js")]
    allowed = " ".join(map(_source_hash, scripts))
    # A lead of one picture and words, which then stand side by side where there is room.
    is_picture = [isinstance(block, (Figure, View3d)) for block in page.lead]
    html = _environment().get_template("page.html.j2").render(
        page=page,
        chapters=_chapters(page.sections),
        is_split=len(page.lead) > 1 and is_picture[0] and not any(is_picture[1:]),
        policy=f"default-src 'none'; img-src data:; style-src {_source_hash(style)}; script-src {allowed}; "
        "base-uri 'none'; form-action 'none'",
        style=Markup(style),  # noqa: S704 - our own file
        scripts=[Markup(script) for script in scripts],  # noqa: S704 - our own files
        number=count(1).__next__,
    )  # fmt: skip
    return html.encode()


@cache
def _environment() -> Environment:
    """Templates that escape all they are given, whatever its file's name."""
    environment = Environment(
        loader=FileSystemLoader(_PARTS), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=_printable,
    )  # fmt: skip
    environment.filters.update(
        kind=lambda block: type(block).__name__,
        href=href, data_url=_data_url, scene=_scene, what_if_data=_what_if, sort_value=_sort_value, file_size=file_size,
    )  # fmt: skip
    return environment


def _printable(value: object) -> object:
    """Text without what neither HTML nor UTF-8 has: control characters, and bytes of file names that are no text."""
    return _CONTROL.sub("\ufffd", value) if isinstance(value, str) and not isinstance(value, Markup) else value


@cache
def _part(name: str) -> str:
    """One of the page's own files, with the line ends that browsers hash: line feeds alone."""
    text = (_PARTS / name).read_text(encoding="utf-8")
    if re.search(r"</(script|style)|<!--", text, re.IGNORECASE):
        raise ValueError(f"{name}: holds markup that would end its element")
    return text


def _source_hash(text: str) -> str:
    """How a Content-Security-Policy names an inline element's text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _blocks(page: Page) -> Iterator[Block]:
    """All blocks, those inside folds too."""
    for block in (*page.lead, *(block for section in page.sections for block in section.blocks)):
        yield block
        if isinstance(block, Fold):
            yield from block.blocks
        if isinstance(block, Sliders):
            yield block.table


def _row_heights(page: Page) -> str:
    """A rule for each height of a table's box, since a page without style attributes has no other place for them."""
    heights = sorted({block.visible_rows for block in _blocks(page) if isinstance(block, Table)})
    # Half a line more, so that one sees that it goes on.
    rules = "".join(f".rows-{rows}{{max-height:{(rows + 1.5) * _ROW_REM:g}rem}}" for rows in heights)
    return f"\n@media screen{{{rules}}}\n"


def _chapters(sections: tuple[Section, ...]) -> list[_Chapter]:
    """Sections with anchors made of their titles, each its own."""
    chapters: list[_Chapter] = []
    taken: set[str] = set()
    for number, section in enumerate(sections, start=1):
        slug = "-".join(re.findall(r"[a-z0-9]+", section.title.lower()))[:60]
        # "s-": no anchor may take the name of a part of the page.
        anchor = f"s-{slug}" if slug and f"s-{slug}" not in taken else f"s{number}"
        taken.add(anchor)
        chapters.append(_Chapter(anchor, section))
    return chapters


def _data_url(image: Raster | Svg) -> str:
    """The picture inside the page."""
    media = "image/svg+xml" if isinstance(image, Svg) else media_type(image.content)
    return f"data:{media};base64,{base64.b64encode(image.content).decode()}"


def _scene(view: View3d) -> Markup:
    """The scene as JSON that cannot end its script element (https://html.spec.whatwg.org/#restrictions-for-contents)."""
    from designer.page.scene import scene_json

    return Markup(scene_json(view.scene))  # noqa: S704 - escaped there


def _what_if(block: Sliders) -> Markup:
    """The sliders' model as JSON, as `_scene`."""
    from designer.page.what_if import what_if_json

    return Markup(what_if_json(block.model))  # noqa: S704 - escaped there


def _sort_value(cell: Cell) -> str | None:
    """The number to sort by as JavaScript reads it, where there is one."""
    if cell.value is None or math.isnan(cell.value):
        return None
    return repr(float(cell.value))


def file_size(size_bytes: int) -> str:
    """A size in words: two or three digits, in powers of 1000."""
    value, unit = size_bytes / 1000, "kB"
    for larger in ("MB", "GB", "TB"):
        if value >= 999.5:
            value, unit = value / 1000, larger
    if size_bytes < 1000:
        return f"{size_bytes} bytes"
    return f"{value:.1f} {unit}" if value < 9.95 else f"{value:.0f} {unit}"
