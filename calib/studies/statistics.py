"""What the samples of a bootstrap say: a Gaussian with its intervals, whether it is one, and who is in it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from calib.studies.paper_table import PaperValue, paper_value
from calib.studies.sample_metrics import SampleStatus
from designer.base.arrays import Array
from designer.base.marks import INLINE, Count, Gap, Length, Word

SHARE = 0.95
"""Of the samples that an interval holds."""
HALF_WIDTH = 1.959963984540054
"""Of the interval of a Gaussian that holds that share, in sigmas."""
FEWEST = 20
"""Samples that a check for normality needs: below this the kurtosis test is not valid (Anscombe and Glynn 1983)."""
LEAST_P = 0.01
SMALL_SKEWNESS, SMALL_KURTOSIS = 0.25, 0.5
"""Departures from a Gaussian that ten thousand samples show, but no eye."""
NO_SPREAD = 1e-12
"""A standard deviation below this share of the mean is rounding."""


@dataclass(frozen=True)
class Metric:
    """One of the errors of a sample, and how the paper writes it."""

    name: str
    column: int  # of `SampleArrays.metrics`
    unit: str
    short: str
    power: int  # the paper's unit is this power of ten of `unit`

    def in_paper_units(self, value: float) -> float:
        """A value in `unit` as the paper's table states it."""
        return value * 10.0**-self.power


METRICS = (
    Metric("reconstruction", 2, "mm", "Recon.", -2),
    Metric("intersection", 1, "mm", "Inter.", -2),
    Metric("reprojection", 0, "px", "Repro.", -1),
    Metric("pose", 3, "mm", "Pose", -1),
)
"""In the order of the paper's table."""

Setting = tuple[str, str]
"""A way of sampling, and of counting observations."""


@dataclass(frozen=True)
class Case:
    """What is sampled: a target's photos, which observations of them count, and how many views a sample has."""

    target: Word
    size: Count  # views drawn for a sample
    pool: Count  # views they are drawn from
    sampling: Word = ""  # of rendered photos, "binary" or "area"
    sightings: Word = ""  # which observations count, such as "all"

    @property
    def setting(self) -> Setting:
        """The way of sampling and counting."""
        return self.sampling, self.sightings

    @property
    def pool_key(self) -> tuple[str, str, str]:
        """What tells the views that samples are drawn from, whatever their number."""
        return self.target, self.sampling, self.sightings

    @property
    def name(self) -> str:
        """What tells it from the others of a study, and its samples' random numbers from theirs."""
        return f"{self.target}/{self.sampling}/{self.sightings}/{self.size}"


class SampleArrays(Protocol):
    """S samples of a case."""

    @property
    def status(self) -> Sequence[str] | NDArray[np.str_]:
        """How each sample's solution ended.  # (S,)"""

    @property
    def metrics(self) -> Array:
        """Reprojection (px), intersection, reconstruction and pose error (mm); nan if not defined.  # (S, 4)"""

    @property
    def params(self) -> Array:
        """Parameters of the camera; nan if there is none.  # (S, P)"""


Over = Literal["all", "converged"]
"""Which samples a mean is of: every sample that has the error, whatever its status, or converged ones only."""

Shape = Literal[
    "normal", "nearly normal", "skewed to the right", "skewed to the left", "heavy tails", "light tails", "constant",
    "too few",
]  # fmt: skip


@dataclass(frozen=True)
class Distribution:
    """One error in the samples of a case, and the paper's; nan where it is not defined."""

    over: Over
    metric: Word
    unit: Word
    count: Count  # samples in it
    without: Count  # samples that have no such error
    shape: Shape = "too few"
    mu: Gap = math.nan
    mu_error: Gap = math.nan  # standard error of `mu` by the number of samples
    sigma: Gap = math.nan  # of the unbiased variance
    sigma_error: Gap = math.nan
    fit_low: Gap = math.nan  # 95 % of the fitted Gaussian
    fit_high: Gap = math.nan
    percentile_low: Gap = math.nan  # 95 % of the samples
    percentile_high: Gap = math.nan
    skewness: Gap = math.nan
    excess_kurtosis: Gap = math.nan
    p_value: Gap = math.nan  # of a Gaussian, by D'Agostino and Pearson
    paper_mu: Gap = math.nan  # in the same unit
    paper_sigma: Gap = math.nan
    paper_low: Gap = math.nan
    paper_high: Gap = math.nan
    mu_by_paper: Gap = math.nan  # ours over the paper's
    sigma_by_paper: Gap = math.nan

    @property
    def has_paper(self) -> bool:
        """Whether the paper has this case."""
        return math.isfinite(self.paper_mu)


@dataclass(frozen=True)
class CaseSummary:
    """All that is said of the samples of a case."""

    case: Annotated[Case, INLINE]
    samples: Count  # of any status
    converged: Count
    stopped: Count
    degenerate: Count
    failed: Count
    metrics: Annotated[tuple[Distribution, ...], Length(0, 16)]  # of METRICS, over all and over converged samples

    @property
    def statuses(self) -> tuple[tuple[SampleStatus, int], ...]:
        """How many samples ended how, zeros included."""
        return tuple(zip(STATUSES, (self.converged, self.stopped, self.degenerate, self.failed), strict=True))

    def every(self, over: Over = "all") -> tuple[Distribution, ...]:
        """The distributions over all samples, or over converged ones."""
        return tuple(one for one in self.metrics if one.over == over)

    def of(self, metric: str, over: Over = "all") -> Distribution:
        """The distribution of an error; an empty one if there is none."""
        found = (one for one in self.metrics if (one.metric, one.over) == (metric, over))
        return next(found, Distribution(over, metric, "", 0, self.samples))


STATUSES: tuple[SampleStatus, ...] = ("converged", "stopped", "degenerate", "failed")


def summarise(case: Case, samples: SampleArrays) -> CaseSummary:
    """The statistics of a case.

    Args:
        case: what was sampled.
        samples: its samples of any status.
    """
    status = np.asarray(samples.status, dtype=np.str_)
    unknown = set(status.tolist()) - set(STATUSES)
    if unknown:
        # Else the counts would not add up to the samples.
        raise ValueError(f"samples of unknown status: {', '.join(sorted(unknown))}")
    chosen: tuple[tuple[Over, Array], ...] = (
        ("all", samples.metrics),
        ("converged", samples.metrics[status == "converged"]),
    )
    found = tuple(
        distribution(metric, values[:, metric.column], over, paper_value(case.target, metric.name, case.size))
        for over, values in chosen
        for metric in METRICS
    )
    converged, stopped, degenerate, failed = (int((status == name).sum()) for name in STATUSES)
    return CaseSummary(case, len(status), converged, stopped, degenerate, failed, found)


def distribution(metric: Metric, values: Array, over: Over = "all", paper: PaperValue | None = None) -> Distribution:
    """The Gaussian fitted to values, and how well that describes them.

    The standard error of `sigma` is that of any distribution with four moments: the variance of the sample variance
    is `(m4 - s^4 (n - 3) / (n - 1)) / n` (Cramér 1946, 27.4), which for a Gaussian is `2 s^4 / (n - 1)`.

    Args:
        metric: what they are.
        values: (S,) nan where a sample has none.
        over: which samples they are of.
        paper: what the paper has.
    """
    known = values[np.isfinite(values)]
    count = len(known)
    empty = Distribution(over, metric.name, metric.unit, count, len(values) - count)
    if paper is not None:
        unit = 10.0**metric.power
        empty = replace(
            empty, paper_mu=paper.mu * unit, paper_sigma=paper.sigma * unit, paper_low=paper.low * unit,
            paper_high=paper.high * unit,
        )  # fmt: skip
    if count < 2:
        return _beside_paper(replace(empty, mu=float(known[0])) if count else empty)
    # In units of the largest, so that the wild error of a degenerate sample has finite powers.
    largest = float(np.abs(known).max()) or 1.0
    scaled = known / largest
    mean, spread = float(scaled.mean()), float(scaled.std(ddof=1))
    mu, sigma = mean * largest, spread * largest
    low, high = np.percentile(known, [50 * (1 - SHARE), 50 * (1 + SHARE)]).tolist()
    found = replace(empty, mu=mu, percentile_low=low, percentile_high=high)
    if spread <= NO_SPREAD * abs(mean):
        return _beside_paper(
            replace(found, mu_error=0.0, sigma=0.0, sigma_error=0.0, fit_low=mu, fit_high=mu, shape="constant")
        )
    standard = (scaled - mean) / spread
    fourth = float((standard**4).mean())
    skewness = float((standard**3).mean()) * (count / (count - 1)) ** 1.5
    kurtosis = fourth * (count / (count - 1)) ** 2 - 3.0
    relative = math.sqrt(max(fourth - (count - 3) / (count - 1), 0.0) / count) / 2
    p_value = _p_of_gaussian(standard)
    return _beside_paper(replace(
        found, mu_error=sigma / math.sqrt(count), sigma=sigma, sigma_error=sigma * relative,
        fit_low=mu - HALF_WIDTH * sigma, fit_high=mu + HALF_WIDTH * sigma, skewness=skewness, excess_kurtosis=kurtosis,
        p_value=p_value, shape=_shape(p_value, skewness, kurtosis),
    ))  # fmt: skip


def _beside_paper(found: Distribution) -> Distribution:
    """With its factors over the paper's."""
    return replace(found, mu_by_paper=found.mu / found.paper_mu, sigma_by_paper=found.sigma / found.paper_sigma)


def _p_of_gaussian(values: Array) -> float:
    """How likely a Gaussian's samples are as far from it in skewness and kurtosis (D'Agostino and Pearson 1973)."""
    from scipy.stats import normaltest

    return float(normaltest(values).pvalue) if len(values) >= FEWEST else math.nan


def _shape(p_value: float, skewness: float, kurtosis: float) -> Shape:
    """A distribution in words: significance alone would call every distribution of many samples abnormal."""
    if math.isnan(p_value):
        return "too few"
    if p_value >= LEAST_P:
        return "normal"
    if abs(skewness) >= SMALL_SKEWNESS:
        return "skewed to the right" if skewness > 0 else "skewed to the left"
    if abs(kurtosis) >= SMALL_KURTOSIS:
        return "heavy tails" if kurtosis > 0 else "light tails"
    return "nearly normal"


@dataclass(frozen=True, eq=False)
class Correlations:
    """How parameters go together."""

    names: tuple[str, ...]  # (P,)
    matrix: Array  # (P, P) nan for parameters that do not vary
    count: int  # samples it is of; 0: it was predicted

    @property
    def strongest(self) -> tuple[str, str, float] | None:
        """The two parameters with the largest correlation, and that; None if no two vary."""
        rows, columns = np.triu_indices(len(self.names), k=1)
        size = np.abs(self.matrix[rows, columns])
        if not np.isfinite(size).any():
            return None
        first = int(np.nanargmax(size))
        row, column = int(rows[first]), int(columns[first])
        return self.names[row], self.names[column], float(self.matrix[row, column])

    @property
    def root_mean_square(self) -> float:
        """Of the correlations of different parameters; nan if no two vary."""
        known = self.matrix[np.triu_indices(len(self.names), k=1)]
        known = known[np.isfinite(known)]
        return float(np.sqrt((known**2).mean())) if len(known) else math.nan


def correlations(samples: SampleArrays, names: Sequence[str]) -> Correlations:
    """The correlations of the parameters of converged samples; one lost sample would set all of them.

    Args:
        samples: of a case.
        names: of the parameters, or of the first of them.
    """
    is_good = (np.asarray(samples.status, dtype=np.str_) == "converged") & np.isfinite(samples.params).all(axis=1)
    params = samples.params[is_good, : len(names)]
    if len(params) < 3:
        return Correlations(tuple(names), np.full((len(names), len(names)), np.nan), len(params))
    centred = params - params.mean(axis=0)
    sigma = centred.std(axis=0)
    varies = sigma > NO_SPREAD * np.abs(params).max(axis=0)
    standard = centred / np.where(varies, sigma, np.nan)
    return Correlations(tuple(names), _bounded(standard.T @ standard / len(params)), len(params))


def predicted_correlations(covariance: Array, names: Sequence[str]) -> Correlations:
    """The correlations that a solution's covariance states.

    Args:
        covariance: (P, P) zero for fixed parameters.
        names: (P,) of the parameters.
    """
    variance = np.diagonal(covariance)
    sigma = np.sqrt(np.where(variance > 0, variance, np.nan))
    return Correlations(tuple(names), _bounded(covariance / (sigma[:, None] * sigma)), 0)


def _bounded(matrix: Array) -> Array:
    """Correlations without the last digit's excess over 1."""
    return np.asarray(np.clip(matrix, -1.0, 1.0))
