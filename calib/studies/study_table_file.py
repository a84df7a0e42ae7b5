"""`table.json` of a bootstrap study, for its page and other programs."""

from dataclasses import dataclass
from typing import Annotated

from calib.studies.statistics import METRICS, Metric
from designer.base.file_kind import FileKind
from designer.base.marks import AGAIN, Count, FewLines, Length, Line, Number, Word

MOST_CASES, MOST_FINDINGS = 1000, 1000
MOST_TARGETS, MOST_SETTINGS = 8, 8
"""That a page shows; no study of ours has more."""


@dataclass(frozen=True)
class StudyMetric:
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
    fit_low: Number | None
    fit_high: Number | None
    percentile_low: Number | None
    percentile_high: Number | None
    skewness: Number | None
    excess_kurtosis: Number | None
    p_value: Number | None
    paper_mu: Number | None
    paper_sigma: Number | None
    paper_low: Number | None
    paper_high: Number | None
    mu_by_paper: Number | None
    sigma_by_paper: Number | None


@dataclass(frozen=True)
class StudyCase:
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
    metrics: Annotated[tuple[StudyMetric, ...], Length(0, 16)]

    @property
    def setting(self) -> tuple[str, str]:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    def of(self, metric: Metric, over: str = "all") -> StudyMetric | None:
        """The statistics of an error; None if there are none."""
        return next((one for one in self.metrics if (one.metric, one.over) == (metric.name, over)), None)


@dataclass(frozen=True)
class StudyRatio:
    """A statistic of one target over the other's, at a number of views."""

    size: Count
    ratio: Number | None
    standard_errors: Number | None
    paper: Number | None


@dataclass(frozen=True)
class StudyExponent:
    """How the sigma of an error goes with the number of views."""

    metric: Word
    exponent: Number | None
    error: Number | None
    paper: Number | None


@dataclass(frozen=True)
class StudyFinding:
    """A claim, and whether it holds."""

    claim: Line
    sampling: Word
    sightings: Word
    verdict: Word
    verdict_of_converged: Word | None
    elsewhere: Line
    evidence: Line
    ratios: Annotated[tuple[StudyRatio, ...], Length(0, 100)]
    exponents: Annotated[tuple[StudyExponent, ...], Length(0, 100)]

    @property
    def setting(self) -> tuple[str, str]:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    @property
    def numbers(self) -> str:
        """The ratios from the smallest number of views up, or the exponents metric by metric."""
        found = [one.ratio for one in self.ratios] + [one.exponent for one in self.exponents]
        return ", ".join("-" if number is None else f"{number:.2f}" for number in found)


@dataclass(frozen=True)
class StudyTable:
    """All of it."""

    cases: Annotated[tuple[StudyCase, ...], Length(1, MOST_CASES)]
    notes: FewLines
    findings: Annotated[tuple[StudyFinding, ...], Length(0, MOST_FINDINGS)]
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


STUDY_TABLE = FileKind(StudyTable, "study_table", "the table of a study", AGAIN)
