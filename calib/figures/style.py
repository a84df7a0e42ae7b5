"""How all figures look: colours that everybody can tell apart, sizes that are readable at 1600 pixels."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

# Okabe and Ito 2008: told apart by people with any kind of colour blindness.
BLUE, VERMILION, GREEN, ORANGE, GREY = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#6b6b6b"
INK, EMPTY = "#1a1a1a", "#e4e4e4"
SEQUENTIAL = "cividis"
DPI = 100
WIDTH_PX = 1600
NOTE_POINTS = 12
"""How high above axes the line under a title is."""
LABEL_POINTS = 29
"""How far below axes the middle of their label is."""


def picture(height_px: int, draw: "Callable[[Figure], None]") -> bytes:
    """A PNG of the usual width, the same from the same data.

    Args:
        height_px: of the picture.
        draw: fills the figure.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    settings = mpl.rc_context({
        "font.family": "DejaVu Sans", "font.size": 12, "axes.titlesize": 14, "axes.titleweight": "bold",
        "axes.titlelocation": "left", "axes.titlepad": 10, "axes.labelsize": 12, "xtick.labelsize": 11,
        "ytick.labelsize": 11, "legend.fontsize": 11, "axes.edgecolor": GREY, "axes.linewidth": 0.8,
        "text.color": INK, "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK,
        "figure.facecolor": "white", "hatch.linewidth": 0.6, "hatch.color": "#bdbdbd",
        "text.parse_math": False,  # names of files may hold dollar signs
    })  # fmt: skip
    with settings:
        figure = Figure(
            figsize=(WIDTH_PX / DPI, height_px / DPI), dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12)
        )
        FigureCanvasAgg(figure)
        draw(figure)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", metadata={"Software": None})
    return stream.getvalue()


def image_axes(axes: "Axes", image_size: tuple[int, int], title: str) -> None:
    """Axes that are the image: u to the right, v down, one pixel as wide as high."""
    width, height = image_size
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("u in px")
    axes.set_ylabel("v in px")
    axes.set_title(title)


def bar_beside(axes: "Axes", shown: "ScalarMappable", label: str, *, longer: bool = False) -> None:
    """A scale of colours to the right of axes; `longer` says that values beyond its end have the last colour."""
    place = axes.inset_axes((1.025, 0.0, 0.035, 1.0))
    bar = axes.figure.colorbar(shown, cax=place, extend="max" if longer else "neither")
    bar.set_label(label)


def note(axes: "Axes", text: str) -> None:
    """A line of explanation under the title."""
    axes.annotate(
        text, (0, 1), (0, NOTE_POINTS), xycoords="axes fraction", textcoords="offset points", fontsize=11, color=GREY,
        va="center", ha="left", annotation_clip=False,
    )  # fmt: skip
    axes.set_title(axes.get_title("left"), pad=26)


def nothing(axes: "Axes", text: str) -> None:
    """Say why axes are empty."""
    axes.set_xticks([])
    axes.set_yticks([])
    note(axes, text)


def round_length(length: float) -> float:
    """The nearest of 1, 2 and 5 times a power of ten, for a scale arrow."""
    import math

    if not length > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(length))
    return min((1, 2, 5, 10), key=lambda step: abs(math.log(length / (step * power)))) * power
