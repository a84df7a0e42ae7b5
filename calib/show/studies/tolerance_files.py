"""The files of a tolerance study: its tables as Markdown, CSV and JSON, and its figures."""

from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calib.core.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.studies import study_folder
from calib.show.studies.study_folder import CSV_FILE, FIGURES_FOLDER, JSON_FILE, MARKDOWN_FILE, rows_to_csv
from calib.show.studies.tolerance_bars import budget_height_px, draw_budget, draw_ranking, ranking_height_px
from calib.show.studies.tolerance_curves import (
    CROSSOVER_HEIGHT_PX,
    draw_crossover,
    draw_sweeps,
    sweeps_height_px,
)
from calib.show.studies.tolerance_page import study_sections
from calib.show.studies.tolerance_tables import quantities_wanted
from calib.show.studies.tolerance_words import swept_sources, tolerance_headline
from calib.studies.tolerance.record import TOLERANCE_TABLE, CostRow, ToleranceStudy

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def tolerance_files(study: ToleranceStudy, folder: Path, formats: Collection[str] = ()) -> dict[Path, bytes]:
    """All files and their contents.

    Args:
        study: what was found.
        folder: where they are to lie.
        formats: of the figures besides PNG: "pdf", "svg".
    """
    title, sections = f"What errors of {study.target} cost a calibration", study_sections(study, lambda _: ())
    text = markdown(title, sections, tolerance_headline(study).sentence)
    return {
        folder / MARKDOWN_FILE: text.encode("utf-8", ANY_NAME),
        folder / CSV_FILE: rows_to_csv(CostRow, study.costs),
        folder / JSON_FILE: TOLERANCE_TABLE.text(study),
        **figure_files(study, folder / FIGURES_FOLDER, formats),
    }


def figure_files(study: ToleranceStudy, folder: Path, formats: Collection[str]) -> dict[Path, bytes]:
    """The figures as PNG, as what is asked for, and as what an earlier study left there: a page would show its old."""
    files: dict[Path, bytes] = {}
    for name, height, draw in _figures(study):
        left = {suffix for suffix in study_folder.METADATA if (folder / f"{name}.{suffix}").exists()}
        files |= study_folder.files_of(folder / name, height, draw, left | set(formats))
    return files


def _figures(study: ToleranceStudy) -> "Iterator[tuple[str, int, Callable[[Figure], None]]]":
    """Name, height and content of each figure."""
    if study.ranking:
        yield "ranking", ranking_height_px(study), partial(draw_ranking, study=study)
    if study.budgets:
        yield "budget", budget_height_px(study), partial(draw_budget, study=study)
    if study.crossovers is not None and study.crossovers.vary:
        yield "crossover", CROSSOVER_HEIGHT_PX, partial(draw_crossover, study=study, other=study.crossovers)
    for name in quantities_wanted(study) if study.sweeps else ():
        if swept_sources(study, name):
            yield f"sweep_{name}", sweeps_height_px(study, name), partial(draw_sweeps, study=study, quantity=name)
