"""`table.json` of a comparison of the paper's objects, as its page reads it."""

from functools import cached_property
from pathlib import Path
from typing import Annotated

from pydantic import Field

from calib.report.stored_table import MOST_ROWS, Count, FewLines, Line, Number, Stored, Word, read_table
from calib.studies.compare.table import FORMAT, VERSION
from calib.studies.table_files import JSON_FILE


class ComparisonPlan(Stored):
    """How much was simulated."""

    camera: Line
    prints: Count
    sets: Count
    virtual_sets: Count
    seed: Count


class CaseRow(Stored):
    """One error of an object, part and camera model; medians over prints."""

    object: Word
    part: Word
    model: Word
    metric: Word
    unit: Word
    median: Number | None
    low: Number | None
    high: Number | None
    prints: Count
    samples: Count
    without_camera: Count
    not_converged: Count
    paper: Number | None


class AloneRow(Stored):
    """One error source scaled until it gives the paper's intersection error alone."""

    object: Word
    source: Word
    multiple: Number | None
    multiple_low: Number | None
    multiple_high: Number | None
    amount: Word
    reconstruction_mm: Number | None
    paper_reconstruction_mm: Number | None
    reprojection_px: Number | None
    prints: Count
    why: Line


class ComparisonFile(Stored):
    """All of it."""

    plan: ComparisonPlan
    distance_mm: Annotated[dict[Word, Number], Field(max_length=100)]
    cases: Annotated[tuple[CaseRow, ...], Field(max_length=MOST_ROWS)]
    alone: Annotated[tuple[AloneRow, ...], Field(max_length=1000)]
    notes: FewLines
    sentences: FewLines

    @cached_property
    def by_key(self) -> dict[tuple[str, str, str, str], CaseRow]:
        """Rows by object, part, model and metric."""
        return {(one.object, one.part, one.model, one.metric): one for one in self.cases}

    def of(self, name: str, part: str, model: str, metric: str) -> CaseRow | None:
        """A row that has a number; None if there is none."""
        found = self.by_key.get((name, part, model, metric))
        return None if found is None or found.median is None else found

    def median(self, name: str, part: str, model: str, metric: str) -> float | None:
        """A median; None if there is none."""
        found = self.of(name, part, model, metric)
        return None if found is None else found.median

    def keys(self, *parts: str) -> tuple[tuple[str, str, str], ...]:
        """Object, part and model of the cases of these parts, part by part."""
        found = dict.fromkeys((one.part, one.object, one.model) for one in self.cases)
        return tuple((name, part, model) for wanted in parts for part, name, model in found if part == wanted)


def read_comparison(folder: Path) -> ComparisonFile | None:
    """The table of a folder; None if it has none.

    Raises:
        InputError: as `read_table`.
    """
    return read_table(folder / JSON_FILE, ComparisonFile, FORMAT, VERSION)
