"""Pages with every kind of block, tame and hostile, and the files that they lead to."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from designer.page.blocks import (
    Block,
    Cell,
    Column,
    Command,
    Facts,
    Figure,
    FileList,
    FileRow,
    Finding,
    Findings,
    Fold,
    Gallery,
    Headline,
    Level,
    Link,
    Page,
    Paragraph,
    Picture,
    Raster,
    Section,
    Steps,
    Table,
    View3d,
)
from designer.page.pictures import drawing_of_svg, raster_of
from designer.page.scene import Layer, Scene, Segments
from designer.page.shell import page_html

PLOT = b"""<svg xmlns="http://www.w3.org/2000/svg" width="288pt" height="144pt" viewBox="0 0 288 144">
<path d="M 0 144 L 288 144 L 288 0 L 0 0 z" style="fill: #ffffff"/>
<rect x="200" y="90" width="60" height="40" fill="#e4e4e4"/>
<text style="font-size: 10px; fill: #1a1a1a" transform="translate(20 20)">sigma in px</text>
<path d="M 20 120 L 268 40" style="fill: none; stroke: #0072b2; stroke-width: 2"/></svg>"""

HOSTILE = (
    "<img src=x onerror=alert(1)>",
    '"></script><script>alert(2)</script>',
    "' onmouseover='alert(3)",
    "../../etc/passwd",
    "{{ 7 * 7 }}{% raw %}",
    "\u202egnp.exe \u2066\u05d0",
    "&lt;b&gt; &amp;amp; \x00\x07 \udcff",
    "x" * 300,
)
VALUES = (0.5, 10.0, 9.0, None, -2.0, 1e-7)


def png(width: int = 6, height: int = 4, grey: int = 128) -> bytes:
    """A picture of one grey."""
    stream = io.BytesIO()
    Image.fromarray(np.full((height, width), grey, dtype=np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def picture(grey: int = 128) -> Raster:
    """A small picture, its grey telling it from others."""
    return raster_of(png(60, 40, grey))


def values_table(rows: int = 0) -> Table:
    """A table of numbers, one missing, and texts; longer by as many rows as asked."""
    columns = (Column("Photo", is_number=False), Column("RMS in px", note="Root mean square."), Column("Rings"))
    cells = [
        (Cell(f"view_{n}.png", path="photos/a b.png"), Cell("–" if value is None else f"{value:g}", value, level=level))
        for n, (value, level) in enumerate(zip(VALUES, LEVELS, strict=True))
    ]
    named = tuple((*row, Cell(str(10 - n), float(10 - n))) for n, row in enumerate(cells))
    more = tuple((Cell(f"more_{n}.png"), Cell("0.1", 0.1), Cell("5", 5.0)) for n in range(rows))
    return Table("Views", columns, named + more, "Worst first.", visible_rows=5)


LEVELS: tuple[Level | None, ...] = ("good", "usable", "bad", "note", None, None)


def scene() -> Scene:
    """A line in space."""
    line = Segments(np.array([[[0.0, 0.0, 0.0], [10.0, 5.0, 3.0]]]), ("#0072b2",))
    return Scene((Layer("line", (line,)),), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))


def leaves() -> tuple[Block, ...]:
    """A block of every kind but folds and scenes."""
    return (
        Paragraph("Plain words."),
        Facts((("Photos", "20"), ("Focal length", "3 812.42 px"))),
        Findings((
            Finding("bad", "Halves", "They differ.", "3.4 sigma", "at most 2 sigma"),
            Finding("usable", "Coverage", "Corners are empty.", "61 %", "at least 70 %"),
            Finding("good", "Uncertainty", "Small.", "0.08 px"),
            Finding("note", "Scale", "Not measured."),
        )),
        values_table(40),
        Figure("Plot", drawing_of_svg(PLOT), "Sigma grows to the right", "A line.", (Link("SVG", "figures/plot.svg"),)),
        Figure("Pixels", picture(), "A grey picture"),
        Figure("Wide", drawing_of_svg(PLOT), "The same, wide", is_wide=True),
        Gallery(tuple(
            Picture(picture(60 * n), f"photo {n}.png", f"{n} rings", "photos/a b.png" if n else "", LEVELS[n])
            for n in range(3)
        )),
        Command("calib report run", "Make it again:"),
        Steps(("Take photos.", "Run it.")),
        FileList((FileRow("photos/a b.png", "a photo", 1_234_567), FileRow("figures/plot.svg", "the plot", 812))),
    )  # fmt: skip


def whole_page(*, has_scene: bool = False) -> Page:
    """A page with every kind of block."""
    view = (View3d("Line", scene(), "A line in space", "Turn it.", picture()),) if has_scene else ()
    fold = Fold("Numbers", (Paragraph("Words within a fold."), values_table()))
    figure = Figure("First", picture(), "First of all")
    return Page(
        title="run_7",
        kind="Calibration",
        headline=Headline("usable", "usable", "Known to 0.08 px, but not in the corners."),
        lead=(figure, Facts((("Model", "virtual"),)), Command("calib undistort photos/*.png")),
        sections=(Section("Results", leaves(), "Two checks ask for more."), Section("More", (*view, fold))),
        made_by="calib run photos --target ico.target.json",
        program="ringsolid 0.1.0",
    )


def hostile_page() -> Page:
    """A page in which every text is a file name of an enemy."""
    cells = tuple((Cell(text), Cell(text, float(n), level="bad")) for n, text in enumerate(HOSTILE))
    blocks: tuple[Block, ...] = (
        *(Paragraph(text) for text in HOSTILE),
        Facts(tuple((text, text) for text in HOSTILE)),
        Findings(tuple(Finding("bad", text, text, text, text) for text in HOSTILE)),
        Table(HOSTILE[1], (Column(HOSTILE[0], note=HOSTILE[2]), Column(HOSTILE[1])), cells, HOSTILE[0]),
        Figure(HOSTILE[0], picture(), HOSTILE[2], HOSTILE[1]),
        Gallery(tuple(Picture(picture(), text, text) for text in HOSTILE)),
        *(Command(text, text) for text in HOSTILE),
        Steps(HOSTILE),
        FileList(tuple(FileRow(f"odd/{n}:{text[-20:]}".replace("\x00", ""), text, 1) for n, text in enumerate(
            ("<b>", "javascript:alert(1)", "100%.png", "a?b#c.png", "\u202etxt")
        ))),
    )  # fmt: skip
    sections = tuple(Section(text, blocks if n == 0 else (), text) for n, text in enumerate(HOSTILE))
    return Page(HOSTILE[0], HOSTILE[1], Headline("bad", HOSTILE[7], HOSTILE[7]), sections, (), HOSTILE[1], HOSTILE[2])


def written(page: Page, folder: Path) -> Path:
    """The page's file, with the files it leads to beside it."""
    for name in ("photos/a b.png", "figures/plot.svg"):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(png())
    file = folder / "index.html"
    file.write_bytes(page_html(page))
    return file


def blocks_of(page: Page) -> Iterator[Block]:
    """All blocks, those in folds too."""
    for block in (*page.lead, *(block for section in page.sections for block in section.blocks)):
        yield block
        if isinstance(block, Fold):
            yield from block.blocks


def table_of(page: Page, start: str) -> Table:
    """The table whose title starts so."""
    return next(one for one in blocks_of(page) if isinstance(one, Table) and one.title.startswith(start))


def figures_of(page: Page) -> list[Figure]:
    """All figures."""
    return [one for one in blocks_of(page) if isinstance(one, Figure)]


def findings_of(page: Page) -> list[Finding]:
    """All findings."""
    return [row for one in blocks_of(page) if isinstance(one, Findings) for row in one.rows]


def section_of(page: Page, title: str) -> Section:
    """The section with this title."""
    return next(one for one in page.sections if one.title == title)
