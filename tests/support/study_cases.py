"""Samples of bootstraps, made up: Gaussian, skewed, with failures, and with the paper's own means and deviations."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.studies.samples import Case
from calib.studies.statistics import METRICS, POOL, SIZES, TARGETS, CaseSummary, paper_value, summarise
from calib.studies.study_table import StudyCases, StudyTable, study_table
from designer.base.arrays import Array

NAMES = ("fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "p1", "p2")
SETTINGS = tuple((sampling, sightings) for sampling in ("binary", "area") for sightings in ("all", "<= 75 deg"))


@dataclass(frozen=True, eq=False)
class Made:
    """Samples as a study holds them."""

    status: NDArray[np.str_]  # (S,)
    metrics: Array  # (S, 4)
    params: Array  # (S, P)


def made(metrics: Array, params: Array | None = None) -> Made:
    """Converged samples."""
    held = np.zeros((len(metrics), len(NAMES))) if params is None else params
    return Made(np.full(len(metrics), "converged", dtype="U10"), metrics, held)


def with_failures(samples: Made, rng: np.random.Generator, degenerate: int, failed: int) -> Made:
    """The same, some of them degenerate, with large errors, and some without a camera."""
    rows = rng.permutation(len(samples.status))
    lost, bad = rows[:failed], rows[failed : failed + degenerate]
    status, metrics, params = samples.status.copy(), samples.metrics.copy(), samples.params.copy()
    status[lost], status[bad] = "failed", "degenerate"
    metrics[lost], params[lost] = np.nan, np.nan
    metrics[bad] *= 5.0
    params[bad] *= 3.0
    return Made(status, metrics, params)


def gamma(mu: float, sigma: float, count: int, rng: np.random.Generator) -> Array:
    """Positive numbers with these moments, skewed to the right: by 2 sigma / mu.  # (count,)"""
    return rng.gamma((mu / sigma) ** 2, sigma**2 / mu, size=count)


def paper_samples(target: str, size: int, count: int, rng: np.random.Generator, factor: float = 1.0) -> Made:
    """Samples with the paper's means and deviations, times a factor."""
    metrics = np.empty((count, 4))
    for metric in METRICS:
        value = paper_value(target, metric.name, size)
        metrics[:, metric.column] = factor * 10.0**metric.power * gamma(value.mu, value.sigma, count, rng)
    return made(metrics, rng.multivariate_normal(np.zeros(len(NAMES)), covariance(target), size=count) / size**0.5)


def covariance(target: str) -> Array:
    """Of the parameters: focal lengths, and radial terms, go together, more so for a plane.  # (P, P)"""
    strength = 0.98 if target == TARGETS[0] else 0.6
    correlation = np.eye(len(NAMES))
    correlation[0, 1] = correlation[1, 0] = strength
    correlation[2, 8] = correlation[8, 2] = correlation[3, 7] = correlation[7, 3] = -0.8 * strength
    for a, b, share in ((4, 5, -0.95), (5, 6, -0.97), (4, 6, 0.9)):
        correlation[a, b] = correlation[b, a] = share
    sigma = np.array([1.0, 1, 0.5, 0.5, 1e-3, 1e-2, 3e-2, 1e-5, 1e-5])
    return correlation * sigma[:, None] * sigma


def studied(cases: dict[Case, Made], *, has_covariance: bool = True) -> StudyCases:
    """A study of these samples."""
    pools = {case.pool_key: covariance(case.target) for case in cases} if has_covariance else {}
    return StudyCases("luhmann", cases, pools)


def summaries_of(cases: dict[Case, Made]) -> list[CaseSummary]:
    """The summaries of several cases."""
    return [summarise(case, samples) for case, samples in cases.items()]


def table_of_cases(cases: dict[Case, Made]) -> StudyTable:
    """What a study of these samples says."""
    return study_table(studied(cases))


def paper_cases(count: int, seed: int = 1, settings: tuple[tuple[str, str], ...] = SETTINGS) -> dict[Case, Made]:
    """All cases of the paper's study; those of area sampling have a third of the errors."""
    rng = np.random.default_rng(seed)
    return {
        Case(target, size, POOL, *setting): paper_samples(
            target, size, count, rng, 1 / 3 if setting[0] == "area" else 1.0
        )
        for target in TARGETS
        for size in SIZES
        for setting in settings
    }
