"""Pictures of a study, each as PNG, and as PDF and SVG."""

import io
import re
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.figures.style import picture
from calib.studies.figure_convergence import convergence_height_px, draw_convergence
from calib.studies.figure_correlations import Pair, correlations_height_px, draw_correlations
from calib.studies.figure_histograms import draw_histograms, histograms_height_px
from calib.studies.findings import settings
from calib.studies.statistics import (
    Array,
    Case,
    CaseSummary,
    SampleArrays,
    correlations,
    predicted_correlations,
    summarise,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = ("png", "pdf", "svg")
METADATA: Mapping[str, Mapping[str, None]] = {
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None}, "svg": {"Date": None, "Creator": None},
}  # fmt: skip
"""Of the formats that are asked for: nothing that differs from one drawing to the next."""
NOT_IN_NAMES = re.compile(r"[^a-z0-9]+")


def study_figures(
    cases: Mapping[Case, SampleArrays],
    names: Sequence[str],
    folder: Path,
    predicted: Mapping[tuple[str, str, str], Array] | None = None,
) -> dict[Path, bytes]:
    """All pictures of a study.

    Args:
        cases: samples of each case.
        names: (P,) of the camera's parameters.
        folder: where they are to lie.
        predicted: (P, P) covariance of the parameters in the solution of all views of a pool, by target, sampling and
            sightings.
    """
    summaries = {case: summarise(case, samples) for case, samples in cases.items()}
    files: dict[Path, bytes] = {}
    for setting in settings(list(summaries.values())):
        of_setting = [case for case in cases if (case.sampling, case.sightings) == setting]
        files |= histogram_files({case: cases[case] for case in of_setting}, folder, "_".join(setting))
        pairs = _pairs({case: cases[case] for case in of_setting}, names, predicted or {})
        files |= correlation_files(pairs, folder, "_".join(setting))
    for sightings in dict.fromkeys(case.sightings for case in cases):
        chosen = [one for one in summaries.values() if one.case.sightings == sightings]
        files |= convergence_files(chosen, folder, sightings)
    return files


def histogram_files(cases: Mapping[Case, SampleArrays], folder: Path, label: str = "") -> dict[Path, bytes]:
    """Histograms with fitted Gaussians and intervals: a row a metric, a column a target.

    Args:
        cases: of one way of sampling and counting.
        folder: where the files are to lie.
        label: of the files' names.
    """
    columns = len({case.target for case in cases})
    return files_of(
        folder / f"histograms{slug(label)}", histograms_height_px(columns), lambda page: draw_histograms(page, cases)
    )


def convergence_files(summaries: Sequence[CaseSummary], folder: Path, label: str = "") -> dict[Path, bytes]:
    """Sigma over the number of views; nothing if there is one number only.

    Args:
        summaries: that count the same sightings.
        folder: where the files are to lie.
        label: of the files' names.
    """
    if len({one.case.size for one in summaries}) < 2:
        return {}
    return files_of(
        folder / f"sigma{slug(label)}", convergence_height_px(), lambda page: draw_convergence(page, summaries)
    )


def correlation_files(pairs: Sequence[Pair], folder: Path, label: str = "") -> dict[Path, bytes]:
    """Matrices of the parameters' correlations side by side; nothing if there are none.

    Args:
        pairs: a matrix each.
        folder: where the files are to lie.
        label: of the files' names.
    """
    if not pairs:
        return {}
    return files_of(
        folder / f"correlations{slug(label)}",
        correlations_height_px(pairs),
        lambda page: draw_correlations(page, pairs),
    )


def _pairs(
    cases: Mapping[Case, SampleArrays], names: Sequence[str], predicted: Mapping[tuple[str, str, str], Array]
) -> list[Pair]:
    """Of each target's case with the most views, which is the closest to linear, if its parameters vary."""
    pairs = []
    for target in dict.fromkeys(case.target for case in cases):
        case = max((case for case in cases if case.target == target), key=lambda case: case.size)
        found = correlations(cases[case], names)
        covariance = predicted.get((target, case.sampling, case.sightings))
        stated = None if covariance is None else predicted_correlations(covariance, names)
        if found.strongest is not None:
            pairs.append(Pair(case, found, stated))
    return pairs


def slug(label: str) -> str:
    """A label as a part of a file's name."""
    slug = NOT_IN_NAMES.sub("_", label.lower()).strip("_")
    return f"_{slug}" if slug else ""


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
