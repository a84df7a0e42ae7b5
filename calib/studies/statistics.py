"""What the samples of a bootstrap say: a Gaussian with its intervals, whether it is one, and who is in it.

Table 2 of the paper, as data: what studies of the same targets are held against.

Ruppel, Kutlu et al., Beyond Reprojection Error: Camera Calibration with 3D Targets. 10,000 bootstrap samples a case out
of about 200 rendered views at 400 mm. Its means, standard deviations and intervals are in the units of
`calib.studies.statistics.METRICS`: 1e-2 mm, 1e-1 px and 1e-1 mm.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from calib.studies.samples import STATUSES, Case, SampleStatus
from designer.base.arrays import Array
from designer.base.marks import INLINE, Count, Gap, Length, Word

BOARD, ICOSAHEDRON = "board", "icosahedron"
TARGETS = (BOARD, ICOSAHEDRON)
SIZES = (20, 50, 120)
POOL, SAMPLES = 200, 10_000

CORRECTION = (
    "For the board's intersection error at N = 20 the paper prints [0.34-0.52], which does not hold its own mean 4.27: "
    "a slip of the decimal point; read as [3.4-5.2]"
)
INTERVALS = (
    "The paper's intervals are percentiles of the samples, not mu +- 1.96 sigma: its pose error of the board at N = 20 "
    "would otherwise reach below zero"
)


@dataclass(frozen=True)
class PaperValue:
    """What the paper's table says of one metric, in the paper's units."""

    mu: float
    sigma: float
    low: float
    high: float  # of the 95 % interval
    is_corrected: bool = False  # the interval is not as printed


def paper_value(target: str, metric: str, size: int) -> PaperValue | None:
    """What the paper found; None if it has no such case."""
    return TABLE.get((target, metric, size))


TABLE: Mapping[tuple[str, str, int], PaperValue] = MappingProxyType({
    (BOARD, "reconstruction", 20): PaperValue(0.83, 0.05, 0.74, 0.94),
    (BOARD, "intersection", 20): PaperValue(4.27, 0.48, 3.4, 5.2, is_corrected=True),
    (BOARD, "reprojection", 20): PaperValue(1.24, 0.06, 1.14, 1.35),
    (BOARD, "pose", 20): PaperValue(1.44, 0.87, 0.31, 3.45),
    (ICOSAHEDRON, "reconstruction", 20): PaperValue(1.67, 0.15, 1.47, 2.04),
    (ICOSAHEDRON, "intersection", 20): PaperValue(2.56, 0.12, 2.35, 2.79),
    (ICOSAHEDRON, "reprojection", 20): PaperValue(1.34, 0.04, 1.28, 1.41),
    (ICOSAHEDRON, "pose", 20): PaperValue(0.93, 0.30, 0.56, 1.63),
    (BOARD, "reconstruction", 50): PaperValue(0.55, 0.03, 0.50, 0.61),
    (BOARD, "intersection", 50): PaperValue(4.30, 0.31, 3.74, 4.86),
    (BOARD, "reprojection", 50): PaperValue(1.25, 0.04, 1.18, 1.32),
    (BOARD, "pose", 50): PaperValue(0.87, 0.51, 0.21, 2.00),
    (ICOSAHEDRON, "reconstruction", 50): PaperValue(1.30, 0.07, 1.19, 1.45),
    (ICOSAHEDRON, "intersection", 50): PaperValue(2.57, 0.07, 2.44, 2.71),
    (ICOSAHEDRON, "reprojection", 50): PaperValue(1.35, 0.02, 1.30, 1.39),
    (ICOSAHEDRON, "pose", 50): PaperValue(0.82, 0.21, 0.56, 1.30),
    (BOARD, "reconstruction", 120): PaperValue(0.40, 0.02, 0.37, 0.43),
    (BOARD, "intersection", 120): PaperValue(4.32, 0.20, 3.96, 4.68),
    (BOARD, "reprojection", 120): PaperValue(1.25, 0.02, 1.21, 1.29),
    (BOARD, "pose", 120): PaperValue(0.58, 0.31, 0.17, 1.28),
    (ICOSAHEDRON, "reconstruction", 120): PaperValue(1.10, 0.03, 1.05, 1.16),
    (ICOSAHEDRON, "intersection", 120): PaperValue(2.57, 0.05, 2.49, 2.66),
    (ICOSAHEDRON, "reprojection", 120): PaperValue(1.35, 0.01, 1.32, 1.37),
    (ICOSAHEDRON, "pose", 120): PaperValue(0.78, 0.15, 0.58, 1.09),
})  # fmt: skip


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


def summarise(case: Case, samples: SampleArrays) -> CaseSummary:
    """The statistics of a case."""
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
    """
    from scipy.stats import normaltest

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
    # How likely a Gaussian is as far from one in skewness and kurtosis (D'Agostino and Pearson 1973).
    p_value = float(normaltest(standard).pvalue) if count >= FEWEST else math.nan
    return _beside_paper(replace(
        found, mu_error=sigma / math.sqrt(count), sigma=sigma, sigma_error=sigma * relative,
        fit_low=mu - HALF_WIDTH * sigma, fit_high=mu + HALF_WIDTH * sigma, skewness=skewness, excess_kurtosis=kurtosis,
        p_value=p_value, shape=_shape(p_value, skewness, kurtosis),
    ))  # fmt: skip


def _beside_paper(found: Distribution) -> Distribution:
    """With its factors over the paper's."""
    return replace(found, mu_by_paper=found.mu / found.paper_mu, sigma_by_paper=found.sigma / found.paper_sigma)


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
    """The correlations of the parameters of converged samples; one lost sample would set all of them."""
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
