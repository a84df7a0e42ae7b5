"""Pictures as PNG, and as PDF and SVG, the same from the same data."""

import io
import warnings
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from calib.figures.style import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = ("png", "pdf", "svg")
METADATA: Mapping[str, Mapping[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None}, "svg": {"Date": None, "Creator": None},
}  # fmt: skip
"""Of the formats that are asked for: nothing that differs from one drawing to the next."""


def files_of(
    place: Path, height_px: int, draw: "Callable[[Figure], None]", suffixes: Collection[str] = SUFFIXES
) -> dict[Path, bytes]:
    """A picture as PNG and in other formats, the same from the same data.

    Args:
        place: path without suffix.
        height_px: of the picture.
        draw: fills the figure.
        suffixes: of the formats; PNG is always among them.
    """
    import matplotlib as mpl

    drawn: dict[str, bytes] = {}

    def draw_all(page: "Figure") -> None:
        draw(page)
        others = [suffix for suffix in SUFFIXES if suffix in METADATA and suffix in suffixes]
        if not others:
            return
        # Text stays text, so that it can be searched and edited; the salt makes the marks' names repeatable.
        with mpl.rc_context({"pdf.fonttype": 42, "svg.fonttype": "none", "svg.hashsalt": place.name}):
            page.canvas.draw()
            page.set_layout_engine("none")  # the layout is found: the same in all formats
            for suffix in others:
                drawn[suffix] = _saved(page, suffix, METADATA[suffix])

    with warnings.catch_warnings():
        # A target may be called anything; where the font lacks a character there is a box.
        warnings.filterwarnings("ignore", message="Glyph")
        drawn["png"] = picture(height_px, draw_all)
    return {place.with_name(f"{place.name}.{suffix}"): drawn[suffix] for suffix in SUFFIXES if suffix in drawn}


def _saved(page: "Figure", suffix: str, metadata: Mapping[str, None]) -> bytes:
    stream = io.BytesIO()
    page.savefig(stream, format=suffix, metadata=metadata)
    return stream.getvalue()
