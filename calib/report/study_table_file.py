"""`table.json` of a bootstrap study, as its page reads it."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from calib.report.stored_table import Count, FewLines, Line, Number, Stored, Word, read_table
from calib.studies.statistics import METRICS, Metric
from calib.studies.table_files import FORMAT, JSON_FILE, VERSION

MOST_CASES, MOST_FINDINGS = 1000, 1000
MOST_TARGETS, MOST_SETTINGS = 8, 8
"""That a page shows; no study of ours has more."""


class StudyMetric(Stored):
    """One error in the samples of a case; None: not defined."""

    over: Word
    metric: Word
    unit: Word
    count: Count
    without: Count
    shape: Word
    mu: Number | None
    mu_error: Number | None
    sigma: Number | None
    sigma_error: Number | None
    percentile_low: Number | None
    percentile_high: Number | None
    skewness: Number | None
    paper_mu: Number | None
    paper_sigma: Number | None
    paper_low: Number | None
    paper_high: Number | None
    mu_by_paper: Number | None
    sigma_by_paper: Number | None


class StudyCase(Stored):
    """The samples of a target, a number of views, and a way of sampling and counting."""

    target: Word
    sampling: Word
    sightings: Word
    size: Count
    pool: Count
    samples: Count
    converged: Count
    stopped: Count
    degenerate: Count
    failed: Count
    metrics: Annotated[tuple[StudyMetric, ...], Field(max_length=16)]

    @property
    def setting(self) -> tuple[str, str]:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    def of(self, metric: Metric, over: str = "all") -> StudyMetric | None:
        """The statistics of an error; None if there are none."""
        return next((one for one in self.metrics if (one.metric, one.over) == (metric.name, over)), None)


class StudyRatio(Stored):
    """A statistic of one target over the other's, at a number of views."""

    size: Count
    ratio: Number | None
    standard_errors: Number | None
    paper: Number | None


class StudyExponent(Stored):
    """How the sigma of an error goes with the number of views."""

    metric: Word
    exponent: Number | None
    error: Number | None
    paper: Number | None


class StudyFinding(Stored):
    """A claim, and whether it holds."""

    claim: Line
    sampling: Word
    sightings: Word
    verdict: Word
    elsewhere: Line
    evidence: Line
    ratios: Annotated[tuple[StudyRatio, ...], Field(max_length=100)]
    exponents: Annotated[tuple[StudyExponent, ...], Field(max_length=100)]

    @property
    def setting(self) -> tuple[str, str]:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    @property
    def numbers(self) -> str:
        """The ratios from the smallest number of views up, or the exponents metric by metric."""
        found = [one.ratio for one in self.ratios] + [one.exponent for one in self.exponents]
        return ", ".join("-" if number is None else f"{number:.2f}" for number in found)


class StudyTable(Stored):
    """All of it."""

    cases: Annotated[tuple[StudyCase, ...], Field(min_length=1, max_length=MOST_CASES)]
    notes: FewLines
    findings: Annotated[tuple[StudyFinding, ...], Field(max_length=MOST_FINDINGS)]
    reasons: FewLines

    @property
    def targets(self) -> tuple[str, ...]:
        """The first few, in the order of the cases."""
        return tuple(dict.fromkeys(one.target for one in self.cases))[:MOST_TARGETS]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of views, the smallest first."""
        return tuple(sorted({one.size for one in self.cases}))

    @property
    def settings(self) -> tuple[tuple[str, str], ...]:
        """The first few ways of sampling and counting, in the order of the cases."""
        return tuple(dict.fromkeys(one.setting for one in self.cases))[:MOST_SETTINGS]

    def case(self, target: str, size: int, setting: tuple[str, str]) -> StudyCase | None:
        """A case; None if there is none."""
        return next((one for one in self.cases if (one.target, one.size, one.setting) == (target, size, setting)), None)

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The errors that any case has, in the order of the paper's table."""
        return tuple(
            metric
            for metric in METRICS
            if any((found := one.of(metric)) is not None and found.count for one in self.cases)
        )


def read_study_table(folder: Path) -> StudyTable | None:
    """The table of a folder; None if it has none.

    Raises:
        InputError: as `read_table`.
    """
    return read_table(folder / JSON_FILE, StudyTable, FORMAT, VERSION)
