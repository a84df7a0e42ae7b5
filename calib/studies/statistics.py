"""What the samples of a bootstrap say: a Gaussian with its intervals, whether it is one, and who is in it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from calib.studies.sample import SampleStatus

Array = NDArray[np.float64]

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

    @property
    def paper_unit(self) -> str:
        """As over the paper's columns."""
        return f"1e{self.power} {self.unit}"

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


@dataclass(frozen=True)
class Case:
    """What is sampled: a target's photos, which sightings of them count, and how many views a sample has."""

    target: str
    size: int  # views drawn for a sample
    pool: int  # views they are drawn from
    sampling: str = ""  # of rendered photos, "binary" or "area"
    sightings: str = ""  # which count, such as "all"

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
    """One metric in the samples of a case; nan where it is not defined."""

    metric: Metric
    count: int  # samples in it
    without: int  # samples that have no such error
    mu: float = math.nan
    sigma: float = math.nan  # of the unbiased variance
    mu_error: float = math.nan  # standard error of `mu` by the number of samples
    sigma_error: float = math.nan
    fit: tuple[float, float] = (math.nan, math.nan)  # 95 % of the fitted Gaussian
    percentiles: tuple[float, float] = (math.nan, math.nan)  # 95 % of the samples
    skewness: float = math.nan
    excess_kurtosis: float = math.nan
    p_value: float = math.nan  # of a Gaussian, by D'Agostino and Pearson
    shape: Shape = "too few"


@dataclass(frozen=True)
class CaseSummary:
    """All that is said of the samples of a case."""

    case: Case
    statuses: tuple[tuple[SampleStatus, int], ...]  # how many samples ended how, zeros included
    all: tuple[Distribution, ...]  # of METRICS, over every sample that has the error
    converged: tuple[Distribution, ...]  # over converged samples

    @property
    def samples(self) -> int:
        """How many samples, of any status."""
        return sum(count for _, count in self.statuses)

    def counted(self, status: SampleStatus) -> int:
        """How many samples ended so."""
        return dict(self.statuses)[status]

    def of(self, metric: str, over: Over = "all") -> Distribution:
        """The distribution of a metric."""
        return next(one for one in (self.all if over == "all" else self.converged) if one.metric.name == metric)


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
    statuses = tuple((name, int((status == name).sum())) for name in STATUSES)
    is_converged = status == "converged"
    every = tuple(distribution(metric, samples.metrics[:, metric.column]) for metric in METRICS)
    good = tuple(distribution(metric, samples.metrics[is_converged, metric.column]) for metric in METRICS)
    return CaseSummary(case, statuses, every, good)


def distribution(metric: Metric, values: Array) -> Distribution:
    """The Gaussian fitted to values, and how well that describes them.

    The standard error of `sigma` is that of any distribution with four moments: the variance of the sample variance
    is `(m4 - s^4 (n - 3) / (n - 1)) / n` (Cramér 1946, 27.4), which for a Gaussian is `2 s^4 / (n - 1)`.

    Args:
        metric: what they are.
        values: (S,) nan where a sample has none.
    """
    known = values[np.isfinite(values)]
    count, without = len(known), len(values) - len(known)
    if count < 2:
        return Distribution(metric, count, without, *known.tolist())
    # In units of the largest, so that the wild error of a degenerate sample has finite powers.
    unit = float(np.abs(known).max()) or 1.0
    scaled = known / unit
    mean, spread = float(scaled.mean()), float(scaled.std(ddof=1))
    mu, sigma = mean * unit, spread * unit
    low, high = np.percentile(known, [50 * (1 - SHARE), 50 * (1 + SHARE)]).tolist()
    if spread <= NO_SPREAD * abs(mean):
        return Distribution(metric, count, without, mu, 0.0, 0.0, 0.0, (mu, mu), (low, high), shape="constant")
    standard = (scaled - mean) / spread
    fourth = float((standard**4).mean())
    skewness = float((standard**3).mean()) * (count / (count - 1)) ** 1.5
    kurtosis = fourth * (count / (count - 1)) ** 2 - 3.0
    relative = math.sqrt(max(fourth - (count - 3) / (count - 1), 0.0) / count) / 2
    p_value = _p_of_gaussian(standard)
    return Distribution(
        metric, count, without, mu, sigma, sigma / math.sqrt(count), sigma * relative,
        (mu - HALF_WIDTH * sigma, mu + HALF_WIDTH * sigma), (low, high), skewness, kurtosis, p_value,
        _shape(p_value, skewness, kurtosis),
    )  # fmt: skip


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
        names: (P,) of the parameters.
    """
    is_good = (np.asarray(samples.status, dtype=np.str_) == "converged") & np.isfinite(samples.params).all(axis=1)
    params = samples.params[is_good]
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
