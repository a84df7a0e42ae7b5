"""Statistics of bootstrap samples, and what is concluded from them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from calib.draw.study_words import elsewhere
from calib.studies.findings import Verdict, findings, relative_error
from calib.studies.samples import Case
from calib.studies.statistics import (
    BOARD,
    ICOSAHEDRON,
    METRICS,
    SIZES,
    TABLE,
    TARGETS,
    Shape,
    correlations,
    distribution,
    paper_value,
    predicted_correlations,
    summarise,
)
from designer.base.arrays import Array
from tests.support.study_cases import NAMES, Made, covariance, gamma, made, paper_cases, summaries_of, with_failures

POSE = METRICS[3]
CASE = Case(BOARD, 20, 200)


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_the_fit_and_the_check_are_those_of_scipy() -> None:
    """Mean, deviation, moments, p value and the Gaussian's interval equal SciPy's."""
    values = gamma(2.0, 0.5, 500, rng())
    found = distribution(POSE, values)
    assert (found.mu, found.sigma) == pytest.approx((values.mean(), values.std(ddof=1)), rel=1e-12)
    assert (found.fit_low, found.fit_high) == pytest.approx(stats.norm.interval(0.95, found.mu, found.sigma), rel=1e-12)
    assert [found.percentile_low, found.percentile_high] == pytest.approx(
        np.quantile(values, [0.025, 0.975]), rel=1e-12
    )
    assert found.skewness == pytest.approx(stats.skew(values), rel=1e-9)
    assert found.excess_kurtosis == pytest.approx(stats.kurtosis(values), rel=1e-9)
    assert found.p_value == pytest.approx(stats.normaltest(values).pvalue, rel=1e-6)
    assert found.mu_error == pytest.approx(stats.sem(values), rel=1e-12)


@pytest.mark.parametrize("shape", [0.3, 1.0])
def test_standard_errors_are_what_repeated_studies_scatter_by(shape: float) -> None:
    """Of 1000 studies of the same distribution, mean and sigma scatter as each of them states, skewed or not."""
    repeated = [distribution(POSE, gamma(1.0, shape, 400, generator)) for generator in [rng(5)] for _ in range(1000)]
    for value, error in (("mu", "mu_error"), ("sigma", "sigma_error")):
        scatter = np.std([getattr(one, value) for one in repeated])
        stated = np.sqrt(np.mean([getattr(one, error) ** 2 for one in repeated]))
        assert stated == pytest.approx(scatter, rel=0.1)


@pytest.mark.parametrize(
    ("values", "shape"),
    [
        (rng(2).normal(3, 1, 10_000), "normal"),
        (gamma(1.0, 0.08, 10_000, rng()), "nearly normal"),
        (gamma(1.0, 0.5, 10_000, rng()), "skewed to the right"),
        (-gamma(1.0, 0.5, 10_000, rng()), "skewed to the left"),
        (rng(4).uniform(0, 1, 10_000), "light tails"),
        (rng(3).laplace(0, 1, 10_000), "heavy tails"),
        (np.full(100, 0.1), "constant"),
        (rng().normal(3, 1, 19), "too few"),
        (np.array([1.0]), "too few"),
        (np.full(5, np.nan), "too few"),
    ],
)
def test_a_distribution_in_words(values: Array, shape: Shape) -> None:
    """The word says what departs from a Gaussian, and ten thousand samples alone do not make a departure."""
    assert distribution(POSE, values).shape == shape


def test_wild_errors_have_statistics() -> None:
    """The error of a lost sample may be of any size; powers of it do not overflow."""
    found = distribution(POSE, np.array([*rng().normal(1, 0.1, 50), 1e200]))
    assert found.mu == pytest.approx(1e200 / 51)
    assert found.sigma == pytest.approx(1e200 / math.sqrt(51))
    assert math.isfinite(found.skewness)


def test_no_sample_is_dropped() -> None:
    """Degenerate samples are in mu and sigma, those without a camera are counted; the converged ones stand beside."""
    samples = with_failures(made(rng().normal(1, 0.1, (500, 4))), rng(), degenerate=20, failed=5)
    summary = summarise(CASE, samples)
    assert dict(summary.statuses) == {"converged": 475, "stopped": 0, "degenerate": 20, "failed": 5}
    assert summary.samples == 500
    every, good = summary.of("pose"), summary.of("pose", "converged")
    assert (every.count, every.without, good.count, good.without) == (495, 5, 475, 0)
    assert every.mu == pytest.approx(np.nanmean(samples.metrics[:, 3]))
    assert every.sigma > 5 * good.sigma


def test_a_converged_sample_without_an_error_is_counted() -> None:
    """Pose errors need the truth: without it none has one, and nothing else changes."""
    metrics = rng().normal(1, 0.1, (50, 4))
    metrics[:, 3] = np.nan
    summary = summarise(CASE, made(metrics))
    assert (summary.of("pose").count, summary.of("pose").without) == (0, 50)
    assert math.isnan(summary.of("pose").mu)
    assert summary.of("intersection").count == 50


def test_an_unknown_status_is_refused() -> None:
    """Else the counts would not add up."""
    with pytest.raises(ValueError, match="unknown status: lost"):
        summarise(CASE, replace(made(np.ones((3, 4))), status=np.array(["converged", "lost", "failed"])))


def test_metrics_are_taken_from_their_columns() -> None:
    """Reprojection, intersection, reconstruction, pose is the order of a sample; the table's is another."""
    summary = summarise(CASE, made(np.tile([1.0, 2.0, 3.0, 4.0], (30, 1))))
    found = {one.metric: one.mu for one in summary.every()}
    assert found == {"reprojection": 1.0, "intersection": 2.0, "reconstruction": 3.0, "pose": 4.0}


def test_correlations_of_converged_samples() -> None:
    """Those of NumPy; a degenerate sample does not enter, a fixed parameter has none."""
    params = rng().multivariate_normal(np.zeros(9), covariance(BOARD), size=2000) + 100.0
    params[:, 6] = 0.0
    samples = with_failures(made(np.ones((2000, 4)), params), rng(), degenerate=3, failed=2)
    good = samples.params[samples.status == "converged"]
    found = correlations(samples, NAMES)
    varying = np.delete(np.arange(9), 6)
    np.testing.assert_allclose(
        found.matrix[np.ix_(varying, varying)], np.corrcoef(good[:, varying].T), rtol=0, atol=1e-9
    )
    assert np.isnan(found.matrix[6]).all()
    assert found.count == 1995
    assert found.strongest[:2] == ("fx_px", "fy_px")


def test_predicted_correlations_are_those_drawn_from() -> None:
    """Samples drawn from a covariance have the correlations it predicts, within 4 / sqrt(S)."""
    params = rng().multivariate_normal(np.zeros(9), covariance(ICOSAHEDRON), size=5000)
    predicted = predicted_correlations(covariance(ICOSAHEDRON), NAMES)
    found = correlations(made(np.ones((5000, 4)), params), NAMES)
    np.testing.assert_allclose(found.matrix, predicted.matrix, rtol=0, atol=4 / math.sqrt(5000))
    assert found.root_mean_square == pytest.approx(predicted.root_mean_square, abs=0.01)
    none = predicted_correlations(np.zeros((2, 2)), ("a", "b"))
    assert none.strongest is None
    assert math.isnan(none.root_mean_square)


def test_the_papers_table_is_whole_and_means_what_it_says() -> None:
    """24 cases, each mean within its interval, and one interval not as printed; the numbers its text quotes."""
    assert set(TABLE) == {(target, metric.name, size) for target in TARGETS for metric in METRICS for size in SIZES}
    assert all(value.low < value.mu < value.high for value in TABLE.values())
    assert [key for key, value in TABLE.items() if value.is_corrected] == [(BOARD, "intersection", 20)]
    quoted = {
        (BOARD, "reprojection", 120): (1.25, 0.02), (ICOSAHEDRON, "reprojection", 120): (1.35, 0.01),
        (BOARD, "intersection", 120): (4.32, 0.20), (ICOSAHEDRON, "intersection", 120): (2.57, 0.05),
        (BOARD, "reconstruction", 120): (0.40, 0.02), (ICOSAHEDRON, "reconstruction", 120): (1.10, 0.03),
        (BOARD, "pose", 20): (1.44, 0.87), (ICOSAHEDRON, "pose", 20): (0.93, 0.30),
    }  # fmt: skip
    assert {key: (TABLE[key].mu, TABLE[key].sigma) for key in quoted} == quoted
    assert paper_value("cube", "pose", 20) is None


def verdicts(cases: dict[Case, Made]) -> dict[str, Verdict]:
    """What is said of each claim."""
    return {one.claim: one.verdict for one in findings(summaries_of(cases))}


ONE_SETTING = (("binary", "all"),)


def test_the_papers_own_numbers_bear_its_findings() -> None:
    """Samples with its means and deviations: what it says holds, with its ratios."""
    found = findings(summaries_of(paper_cases(2000, settings=ONE_SETTING)))
    undecided = {"pose error is lower for the icosahedron with few views"}  # 2 standard errors, 200 views given
    compared = [one for one in found if one.ratios]
    assert len(compared) == 8
    assert {one.verdict for one in compared if one.claim not in undecided} == {"holds"}
    for one in compared:
        assert [ratio.ratio for ratio in one.ratios] == pytest.approx([ratio.paper for ratio in one.ratios], rel=0.1)
    falling = [one for one in found if one.claim.startswith("sigma falls with N")]
    assert [one.verdict for one in falling] == ["holds", "holds"]
    for one in falling:
        assert [fall.exponent for fall in one.exponents] == pytest.approx(
            [fall.paper for fall in one.exponents], abs=0.05
        )


def test_the_other_way_round_does_not_hold() -> None:
    """With the targets exchanged no comparison of the paper holds."""
    cases = paper_cases(2000, settings=ONE_SETTING)
    other = dict(zip(TARGETS, reversed(TARGETS), strict=True))
    exchanged = {replace(case, target=other[case.target]): samples for case, samples in cases.items()}
    found = [one for one in findings(summaries_of(exchanged)) if one.ratios]
    assert {one.verdict for one in found} <= {"does not hold", "not decided"}
    assert sum(one.verdict == "does not hold" for one in found) >= 7


def test_equal_targets_decide_nothing_and_constant_sigma_does_not_fall() -> None:
    """Two targets with the same errors, whatever N: every comparison is open, and sigma does not fall."""
    cases = {
        Case(target, size, 200): made(rng(size + seed).normal(1.0, 0.1, (3000, 4)))
        for seed, target in enumerate(TARGETS)
        for size in (20, 50, 120)
    }
    found = verdicts(cases)
    falls = {verdict for claim, verdict in found.items() if claim.startswith("sigma falls")}
    assert falls == {"does not hold"}
    assert {verdict for claim, verdict in found.items() if not claim.startswith("sigma falls")} == {"not decided"}


@pytest.mark.parametrize(
    ("exponent", "falls", "root"),
    [(-0.5, "holds", "holds"), (-1.0, "holds", "does not hold"), (0.3, "does not hold", "does not hold")],
)
def test_the_exponent_of_sigma(exponent: float, falls: Verdict, root: Verdict) -> None:
    """A power law is told for what it is."""
    cases = {
        Case("cube", size, 200): made(1.0 + size**exponent * rng(size).normal(0, 0.1, (4000, 4)))
        for size in (20, 50, 120)
    }
    found = {one.claim: one for one in findings(summaries_of(cases))}
    assert set(found) == {"sigma falls with N for the cube", "sigma falls about as 1/sqrt(N) for the cube"}
    assert found["sigma falls with N for the cube"].verdict == falls
    assert found["sigma falls about as 1/sqrt(N) for the cube"].verdict == root
    for fall in found["sigma falls with N for the cube"].exponents:
        assert abs(fall.exponent - exponent) < 4 * fall.error


def test_another_set_of_views_is_within_the_stated_error() -> None:
    """Studies of many pools of the same kind scatter as one of them states; by its samples alone it would claim more.

    The error of a sample is the mean over its views, whose own errors are drawn anew for each pool.
    """
    generator, views, size, samples = rng(8), 100, 50, 400
    found = []
    for _ in range(300):
        pool = generator.normal(10.0, 1.0, views)
        means = pool[generator.integers(views, size=(samples, size))].mean(axis=1)
        found.append(distribution(POSE, means))
    case = Case(BOARD, size, views)
    for statistic in ("mu", "sigma"):
        logarithms = [math.log(getattr(one, statistic)) for one in found]
        stated = np.mean([relative_error(case, one, statistic) for one in found])  # type: ignore[arg-type]
        assert stated == pytest.approx(np.std(logarithms), rel=0.15)
    assert found[0].mu_error < 0.2 * np.std([one.mu for one in found])


def test_what_a_claim_depends_on_is_named() -> None:
    """A claim that fails with one sampling only is said to hold with the other."""
    cases = paper_cases(2000, settings=(("binary", "all"), ("area", "all")))
    for case in list(cases):
        if case.sampling == "area":
            cases[case] = replace(cases[case], metrics=np.abs(rng(case.size).normal(1, 0.01, (2000, 4))))
    found = [
        one for one in findings(summaries_of(cases)) if one.claim == "intersection error is lower for the icosahedron"
    ]
    assert [one.verdict for one in found] == ["holds", "not decided"]
    assert [elsewhere(one, found) for one in found] == ["", "it holds with binary sampling, all else equal"]


def test_factors_against_the_paper() -> None:
    """Samples with a third of the paper's errors give a third, in their own units."""
    found = [one for case in summaries_of(paper_cases(3000, settings=(("area", "all"),))) for one in case.every()]
    factors = [factor for one in found for factor in (one.mu_by_paper, one.sigma_by_paper)]
    assert factors == pytest.approx([1 / 3] * 48, rel=0.1)
    assert all(one.mu == pytest.approx(one.mu_by_paper * one.paper_mu) for one in found)
