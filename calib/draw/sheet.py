"""The figures of a study: each a picture in several formats, for a text of one's own, and a block of the page."""

import io
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calib.draw.style import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from designer.page.blocks import Figure as FigureBlock

FIGURES_FOLDER = "figures"
SUFFIXES = ("png", "pdf", "svg")
METADATA: Mapping[str, Mapping[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
}
"""Of the formats besides PNG: nothing that differs from one drawing to the next."""
MAX_DRAWING_BYTES = 500_000
"""Of a drawing within a page: a larger one is shown as pixels."""


@dataclass(frozen=True)
class FigureSheet:
    """A figure that is to be drawn."""

    stem: str  # of its files
    title: str
    alt: str  # the finding
    height_px: int
    draw: "Callable[[Figure], None]"
    caption: str = ""

    def path(self, suffix: str) -> str:
        """Of the file in a format, in the folder of the study."""
        return f"{FIGURES_FOLDER}/{self.stem}.{suffix}"

    def drawn(self, formats: Collection[str]) -> dict[str, bytes]:
        """The files by their paths."""
        pictures = sheet_files(self.stem, self.height_px, self.draw, formats)
        return {self.path(suffix): content for suffix, content in pictures.items()}

    def block(self, files: Mapping[str, bytes]) -> "FigureBlock":
        """The figure on a page, as a drawing where that was drawn and is small."""
        from designer.page.blocks import Figure, Link
        from designer.page.pictures import drawing_of_svg, raster_of

        svg = files.get(self.path("svg"), b"")
        image = drawing_of_svg(svg) if 0 < len(svg) <= MAX_DRAWING_BYTES else raster_of(files[self.path("png")])
        links = tuple(Link(suffix.upper(), path) for suffix in SUFFIXES if (path := self.path(suffix)) in files)
        return Figure(self.title, image, self.alt, self.caption, links, is_wide=True)


def sheet_files(
    name: str, height_px: int, draw: "Callable[[Figure], None]", suffixes: Collection[str]
) -> dict[str, bytes]:
    """A picture as PNG and in other formats, the same from the same data."""
    import matplotlib as mpl

    contents: dict[str, bytes] = {}

    def draw_all(page: "Figure") -> None:
        draw(page)
        others = [suffix for suffix in SUFFIXES if suffix in METADATA and suffix in suffixes]
        if not others:
            return
        # Text stays text, so that it can be searched and edited; the salt makes the marks' names repeatable.
        with mpl.rc_context({"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": name}):
            page.canvas.draw()
            page.set_layout_engine("none")  # the layout is found: the same in all formats
            for suffix in others:
                stream = io.BytesIO()
                page.savefig(stream, format=suffix, metadata=METADATA[suffix])
                contents[suffix] = stream.getvalue()

    with warnings.catch_warnings():
        # A target may be called anything; where the font lacks a character there is a box.
        warnings.filterwarnings("ignore", message="Glyph")
        contents["png"] = picture(height_px, draw_all)
    return {suffix: contents[suffix] for suffix in SUFFIXES if suffix in contents}
