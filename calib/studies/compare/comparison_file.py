"""`table.json` of a comparison of the paper's objects, for its page and other programs."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

from designer.base.file_kind import FileKind
from designer.base.marks import AGAIN, MOST_ROWS, Count, FewLines, Length, Line, Number, Word


@dataclass(frozen=True)
class ComparisonPlan:
    """How much was simulated."""

    camera: Line
    prints: Count
    sets: Count
    virtual_sets: Count
    seed: Count


@dataclass(frozen=True)
class CaseRow:
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


@dataclass(frozen=True)
class AloneRow:
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
    without: Count  # prints that no multiple does it for
    why: Line


@dataclass(frozen=True)
class ComparisonFile:
    """All of it."""

    plan: ComparisonPlan
    distance_mm: Annotated[dict[Word, Number], Length(0, 100)]
    cases: Annotated[tuple[CaseRow, ...], Length(0, MOST_ROWS)]
    alone: Annotated[tuple[AloneRow, ...], Length(0, 1000)]
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


COMPARISON = FileKind(ComparisonFile, "comparison", "the table of a comparison", AGAIN)
