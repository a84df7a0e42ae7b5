"""What a comparison is shown as: tables and figures, made from its file alone."""

from pathlib import Path

from calib.studies.compare.cases import Comparison
from calib.studies.compare.figure_alone import alone_height_px, draw_alone
from calib.studies.compare.figure_boxes import boxes_height_px, draw_boxes, draw_lens
from calib.studies.compare.results import Results, results_of
from calib.studies.compare.table import files_of_table
from calib.studies.figures import files_of
from calib.studies.outputs import FIGURES_FOLDER
from calib.studies.store import Study

FIGURES = ("objects", "lens", "alone")


def comparison_output(study: Study, plan: Comparison, folder: Path) -> tuple[Results, dict[Path, bytes]]:
    """The results of all samples that a study has, and the files that show them.

    Args:
        study: finished or not.
        plan: what it is of.
        folder: where the files are to lie.
    """
    results = results_of(study, plan)
    place = folder / FIGURES_FOLDER
    files = files_of_table(results, folder)
    files |= files_of(place / FIGURES[0], boxes_height_px(), lambda page: draw_boxes(page, results))
    files |= files_of(place / FIGURES[1], boxes_height_px(), lambda page: draw_lens(page, results))
    files |= files_of(place / FIGURES[2], alone_height_px(), lambda page: draw_alone(page, results))
    return results, files
