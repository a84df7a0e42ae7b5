"""How all figures look: colours that everybody can tell apart, sizes that are readable on paper and on a phone.

The figures of a study: each a picture in several formats, for a text of one's own, and a block of the page.
"""

import io
import math
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from designer.base.words import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    from designer.page.blocks import Figure as FigureBlock

# Okabe and Ito 2008: told apart by people with any kind of colour blindness.
BLUE, VERMILION, GREEN, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#6b6b6b"
INK, EMPTY = "#1a1a1a", "#e4e4e4"
PALE, DEEP = "#fefefe", "#0b1a33"
"""For what lies on colours: unlike white and ink they stay as they are on a dark page."""
SEQUENTIAL = "cividis"
DPI = 100
WIDTH_PX = 1600
NOTE_POINTS = 12
"""How high above axes the line under a title is."""
LABEL_POINTS = 29
"""How far below axes the middle of their label is."""
HEADLINE_PX, ABOVE_PX, BELOW_PX, LEFT_PX = 50, 68, 62, 85
"""Of a picture with placed axes: for its headline; for title and note above axes, labels below, a scale on the left."""
PANEL_WIDTH_IN, PANEL_HEIGHT_IN = 5.6, 4.2
"""Of a panel on a page: its texts are readable at 360 pixels, and not too large at 600."""
LEFT_IN, RIGHT_IN, BAR_IN, BOTTOM_IN, TOP_IN = 0.82, 0.14, 1.12, 0.62, 0.1
"""Margins of a panel for tick labels and labels; on the right there may be a scale of colours."""
LEAST_AXES_IN, MOST_AXES_IN = 1.5, 6.0
RASTER_DPI = 160
"""Of the parts of a panel that would be too many shapes."""


@dataclass(frozen=True)
class AxesDrawing:
    """What a pair of axes shows: on a page title and words are text beside it, on a sheet they stand above it."""

    title: str
    words: str  # the finding, a sentence without its full stop
    draw: "Callable[[Axes], None]"
    image_size: tuple[int, int] | None = None  # of axes that are an image
    has_bar: bool = False  # a scale of colours beside them


def _style() -> AbstractContextManager[None]:
    """The settings of all figures."""
    import matplotlib as mpl

    return mpl.rc_context({
        "font.family": "DejaVu Sans", "font.size": 12, "axes.titlesize": 14, "axes.titleweight": "bold",
        "axes.titlelocation": "left", "axes.titlepad": 10, "axes.labelsize": 12, "xtick.labelsize": 11,
        "ytick.labelsize": 11, "legend.fontsize": 11, "axes.edgecolor": GREY, "axes.linewidth": 0.8,
        "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
        "figure.facecolor": "white", "hatch.linewidth": 0.6, "hatch.color": "#bdbdbd",
        "text.parse_math": False,  # names of files may hold dollar signs
    })  # fmt: skip


def _on_a_page() -> AbstractContextManager[None]:
    """What is different in an SVG on a page."""
    import matplotlib as mpl

    return mpl.rc_context({
        "svg.fonttype": "none",  # text stays text, which is a third of the size of outlines
        "svg.hashsalt": "ringsolid",  # ids are the same each time
        "figure.facecolor": "none", "axes.facecolor": "none", "savefig.facecolor": "none", "legend.frameon": False,
    })  # fmt: skip


def picture(
    height_px: int, draw: "Callable[[Figure], None]", *, is_placed: bool = False, title: str | None = None
) -> bytes:
    """A PNG of the usual width, the same from the same data.

    Args:
        height_px: of the picture.
        draw: fills the figure.
        is_placed: its axes stand where `axes_at` has put them; else the best margins are searched for, which takes
            longer than to draw.
        title: that the file says of itself.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    with _style():
        layout = None if is_placed else ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12)
        figure = Figure(figsize=(WIDTH_PX / DPI, height_px / DPI), dpi=DPI, layout=layout)
        canvas = FigureCanvasAgg(figure)
        draw(figure)
        stream = io.BytesIO()
        how = {
            "metadata": {"Software": None, "Title": title},
            "pil_kwargs": {"compress_level": 2},
        }  # a third of the time, 5 % larger
        # `savefig` would search for the layout and draw twice; matplotlib gives this method no types.
        canvas.print_png(stream, **how)  # type: ignore[no-untyped-call]
    return stream.getvalue()


def axes_at(page: "Figure", left: float, top: float, width: float, height: float) -> "Axes":
    """Axes of a picture whose inside has this place and size, in px from the picture's upper left."""
    whole = page.get_figheight() * DPI
    return page.add_axes((left / WIDTH_PX, 1 - (top + height) / whole, width / WIDTH_PX, height / whole))


def headline(page: "Figure", text: str) -> None:
    """A line of large type at the top of a picture."""
    whole = page.get_figheight() * DPI
    page.suptitle(text, fontsize=16, fontweight="bold", x=0.01, y=1 - HEADLINE_PX / 4 / whole, ha="left", va="top")


def svg_panel(draw: "Callable[[Axes], None]", *, height_in: float = PANEL_HEIGHT_IN, has_bar: bool = False) -> bytes:
    """An SVG of one pair of axes for a page, the same from the same data.

    It has no title and no note: on a page they are text beside the picture, which wraps on small screens. Margins are
    fixed: panels line up, and are drawn in half the time that a search for the best margins takes.

    Args:
        draw: fills the axes.
        height_in: of the panel; it is `PANEL_WIDTH_IN` wide.
        has_bar: there is a scale of colours beside the axes.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with _style(), _on_a_page():
        figure = Figure(figsize=(PANEL_WIDTH_IN, height_in), dpi=RASTER_DPI)
        FigureCanvasSVG(figure)
        width_in = PANEL_WIDTH_IN - LEFT_IN - (BAR_IN if has_bar else RIGHT_IN)
        axes = figure.add_axes((
            LEFT_IN / PANEL_WIDTH_IN, BOTTOM_IN / height_in,
            width_in / PANEL_WIDTH_IN, (height_in - BOTTOM_IN - TOP_IN) / height_in,
        ))  # fmt: skip
        draw(axes)
        stream = io.BytesIO()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    return stream.getvalue()


def figure_of(
    drawing: "AxesDrawing", said: str = "", alt: str = "", *, height_in: float = PANEL_HEIGHT_IN
) -> "FigureBlock":
    """A drawing as a page shows it.

    Args:
        drawing: its words are the caption.
        said: more of the caption.
        alt: in place of the picture; "": the words.
        height_in: of a drawing that is no image.
    """
    from designer.page.blocks import Figure
    from designer.page.pictures import drawing_of_svg

    has_bar, size = drawing.has_bar, drawing.image_size
    height_in = height_in if size is None else panel_height_in(size, has_bar=has_bar)
    svg = drawing_of_svg(svg_panel(drawing.draw, has_bar=has_bar, height_in=height_in))
    return Figure(drawing.title, svg, alt or drawing.words, f"{drawing.words}. {said}".rstrip())


def panel_height_in(image_size: tuple[int, int], *, has_bar: bool = False) -> float:
    """How high a panel is whose axes are an image."""
    width, height = image_size
    axes_in = (PANEL_WIDTH_IN - LEFT_IN - (BAR_IN if has_bar else RIGHT_IN)) * height / width
    return min(max(axes_in, LEAST_AXES_IN), MOST_AXES_IN) + BOTTOM_IN + TOP_IN


def image_axes(axes: "Axes", image_size: tuple[int, int]) -> None:
    """Axes that are the image: u to the right, v down, one pixel as wide as high."""
    width, height = image_size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("u in px")
    axes.set_ylabel("v in px")


def open_axes(axes: "Axes", x_label: str, y_label: str) -> None:
    """Axes with labels, and without a frame above and on the right."""
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def heading(page: "Figure", text: str) -> None:
    """The title of a figure of several axes."""
    page.suptitle(printable(text), fontsize=15, fontweight="bold", x=0.01, ha="left")


def legend_below(page: "Figure", every: "Iterable[Axes]", columns: int, handle_length: float = 2.0) -> None:
    """One legend for several axes, each label once."""
    known = {label: handle for axes in every for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    page.legend(
        known.values(), known.keys(), loc="outside lower center", ncols=columns, frameon=False,
        handlelength=handle_length,
    )  # fmt: skip


def log_axis(axis: "Axis", ticks: Sequence[float] | None = None) -> None:
    """Plain numbers on a logarithmic axis, and only at its ticks; None: at 1, 2 and 5."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)) if ticks is None else FixedLocator(ticks))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    if ticks is not None:
        axis.set_minor_locator(NullLocator())


def bar_beside(
    axes: "Axes", shown: "ScalarMappable", label: str, *, longer: bool = False, ticks: int | list[float] = 0
) -> None:
    """A scale of colours to the right of axes.

    Args:
        axes: that it belongs to.
        shown: in these colours.
        label: of the scale.
        longer: values beyond its end have the last colour; bands of colour say so themselves.
        ticks: where they are, or about how many; 0: as it comes.
    """
    from matplotlib.ticker import FormatStrFormatter, MaxNLocator, NullLocator

    place = axes.inset_axes((1.025, 0.0, 0.035, 1.0))
    figure = axes.figure
    bar = figure.colorbar(shown, cax=place, extend="max") if longer else figure.colorbar(shown, cax=place)
    bar.set_label(label)
    if isinstance(ticks, list):
        bar.set_ticks(ticks)
        bar.ax.yaxis.set_minor_locator(NullLocator())
        bar.ax.yaxis.set_major_formatter(FormatStrFormatter("%g"))
    elif ticks:
        bar.locator = MaxNLocator(ticks)
        bar.update_ticks()


def note(axes: "Axes", text: str) -> None:
    """A line of explanation under the title."""
    axes.annotate(
        text, (0, 1), (0, NOTE_POINTS), xycoords="axes fraction", textcoords="offset points", fontsize=11, color=GREY,
        va="center", ha="left", annotation_clip=False,
    )  # fmt: skip
    axes.set_title(axes.get_title("left"), pad=26)


def nothing(axes: "Axes", text: str = "") -> None:
    """Axes that are empty, and why."""
    axes.set_xticks([])
    axes.set_yticks([])
    if text:
        note(axes, text)


def round_length(length: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten, for a scale arrow."""
    if not length > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(length))
    return min((1, 2, 5, 10), key=lambda step: abs(math.log(length / (step * power)))) * power


def nice(value: float, *, is_down: bool = False) -> float:
    """1, 2 or 5 times a power of ten, at least (or at most) the value."""
    if not math.isfinite(value) or value <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    steps = [step * power for step in (1, 2, 5, 10)]
    if is_down:
        return max(step for step in steps if step <= value * (1 + 1e-9))
    return min(step for step in steps if step >= value * (1 - 1e-9))


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
