"""The files that tell of a bootstrap study: its table as Markdown, CSV and JSON, and its pictures."""

from pathlib import Path
from typing import cast

from calib.observe.csv_table import ANY_NAME
from calib.show.markdown import markdown
from calib.show.studies.study_figures import study_figures
from calib.show.studies.study_page import study_headline, study_sections
from calib.studies.outputs import FIGURES_FOLDER
from calib.studies.statistics import CaseSummary, Distribution
from calib.studies.study_table import STUDY_TABLE, StudyCases, StudyTable
from calib.studies.table_files import CSV_FILE, JSON_FILE, MARKDOWN_FILE, rows_to_csv
from designer.base.codec import encode
from designer.base.small_file import JsonValue


def study_files(cases: StudyCases, table: StudyTable, folder: Path) -> dict[Path, bytes]:
    """The files of a study and their contents.

    Args:
        cases: its samples.
        table: what they say.
        folder: where the files are to lie.
    """
    return table_files(table, folder) | study_figures(cases, table, folder / FIGURES_FOLDER)


def table_files(table: StudyTable, folder: Path) -> dict[Path, bytes]:
    """The files without pictures."""
    told = markdown("Calibrations of drawn views", study_sections(table), study_headline(table).sentence)
    return {
        folder / MARKDOWN_FILE: told.encode("utf-8", ANY_NAME),
        folder / CSV_FILE: _csv(table),
        folder / JSON_FILE: STUDY_TABLE.text(table),
    }


def _csv(table: StudyTable) -> bytes:
    """A line for each case, error, and set of samples that the statistics are over."""
    heads = []
    for one in table.cases:
        keys = cast("dict[str, JsonValue]", encode(CaseSummary, one))
        del keys["metrics"]
        heads += [keys] * len(one.metrics)
    return rows_to_csv(Distribution, [found for one in table.cases for found in one.metrics], heads)
