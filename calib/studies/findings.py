"""Which of the paper's findings hold with our numbers: computed, with what they rest on."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from calib.studies.samples import Case, Setting
from calib.studies.statistics import BOARD, ICOSAHEDRON, METRICS, TARGETS, CaseSummary, Distribution, Over, paper_value
from designer.base.marks import Count, Gap, Length, Line, Word
from designer.base.words import printable

SIGNIFICANT = 2.0
"""Standard errors by which a ratio must differ from 1, or an exponent from 0."""
ROOT = -0.5
ABOUT = 0.1
"""How far an exponent may be from that of 1/sqrt(N) to be called about that, and from 0 to be called none."""

Statistic = Literal["mu", "sigma"]
Verdict = Literal["holds", "holds in part", "does not hold", "not decided", "no data"]


@dataclass(frozen=True)
class Claim:
    """One statistic of one metric is lower for one target than for the other, says the paper."""

    metric: str
    statistic: Statistic
    lower: str  # the target
    smallest_only: bool = False  # said for few views only

    @property
    def higher(self) -> str:
        """The other target."""
        return TARGETS[1 - TARGETS.index(self.lower)]

    @property
    def text(self) -> str:
        """The claim in words."""
        what = f"{self.metric} error is lower" if self.statistic == "mu" else f"{self.metric} error is more stable"
        return f"{what} for the {self.lower}" + (" with few views" if self.smallest_only else "")


CLAIMS = (
    Claim("intersection", "mu", ICOSAHEDRON),
    Claim("intersection", "sigma", ICOSAHEDRON),
    Claim("reconstruction", "mu", BOARD),
    Claim("reconstruction", "sigma", BOARD),
    Claim("reprojection", "mu", BOARD),
    Claim("reprojection", "sigma", ICOSAHEDRON),
    Claim("pose", "mu", ICOSAHEDRON, smallest_only=True),
    Claim("pose", "sigma", ICOSAHEDRON),
)


@dataclass(frozen=True)
class Ratio:
    """A statistic of the target that the paper finds lower, over that of the other, at a number of views."""

    size: Count
    ratio: Gap
    standard_errors: Gap  # of its logarithm from 0: of the samples drawn and of the set of views
    paper: Gap  # nan if it has no such case


@dataclass(frozen=True)
class Fall:
    """The exponent `a` in `sigma = c N^a`, fitted to several sizes."""

    metric: Word
    exponent: Gap
    error: Gap  # standard error, by the number of samples
    is_monotone: bool  # every larger size has the lower sigma
    paper: Gap  # nan if it has no such cases


@dataclass(frozen=True)
class HeldClaim:
    """A claim held against the cases of one way of sampling and counting."""

    claim: Line
    about: Literal["comparison", "fall", "root"]  # of two targets; of sigma with N, and as 1/sqrt(N), of one
    metric: Word  # that is compared; "" for all
    statistic: Word  # that is compared, or that falls
    target: Word  # that has the lower value, or whose sigma falls
    sampling: Word
    sightings: Word
    verdict: Verdict  # over all samples that have the error
    verdict_of_converged: Verdict  # over converged samples
    ratios: Annotated[tuple[Ratio, ...], Length(0, 100)] = ()
    exponents: Annotated[tuple[Fall, ...], Length(0, 100)] = ()

    @property
    def setting(self) -> Setting:
        """The way of sampling and counting."""
        return self.sampling, self.sightings


def findings(summaries: Sequence[CaseSummary]) -> tuple[HeldClaim, ...]:
    """All claims in all ways of sampling and counting, claim by claim; those of two targets need both."""
    found: list[HeldClaim] = []
    targets = tuple(dict.fromkeys(one.case.target for one in summaries))
    ways = tuple(dict.fromkeys(one.case.setting for one in summaries))
    for claim in CLAIMS if set(targets) >= set(TARGETS) else ():
        for way in ways:
            cases = _of(summaries, way)
            ratios, sure = _ratios(claim, cases, "all"), _ratios(claim, cases, "converged")
            found.append(HeldClaim(
                claim.text, "comparison", claim.metric, claim.statistic, claim.lower, *way, _verdict(ratios),
                _verdict(sure), ratios=ratios,
            ))  # fmt: skip
    for is_root in (False, True):
        for target in targets:
            for way in ways:
                cases = [one for one in _of(summaries, way) if one.case.target == target]
                if len(cases) < 2:
                    continue
                falls, of_converged = _falls(target, cases, "all"), _falls(target, cases, "converged")
                found.append(HeldClaim(
                    f"sigma falls {'about as 1/sqrt(N)' if is_root else 'with N'} for the {printable(target)}",
                    "root" if is_root else "fall", "", "sigma", target, *way,
                    _verdict_of_falls(falls, is_root=is_root), _verdict_of_falls(of_converged, is_root=is_root),
                    exponents=falls,
                ))  # fmt: skip
    return tuple(found)


def _of(summaries: Sequence[CaseSummary], setting: Setting) -> list[CaseSummary]:
    """The cases of one way of sampling and counting, the smallest size first."""
    return sorted((one for one in summaries if one.case.setting == setting), key=lambda one: one.case.size)


def relative_error(case: Case, found: Distribution, statistic: Statistic) -> float:
    """The standard error of a mean or standard deviation, over its value.

    The number of samples makes one part. The other no number of samples can lower: the V views of the pool are
    themselves a sample. For an error that is about a mean over views, another pool moves `mu` by `sigma sqrt(N / V)`,
    and `sigma`, estimated from V values, by `sigma / sqrt(2 (V - 1))`.
    """
    value = found.mu if statistic == "mu" else found.sigma
    if not value > 0:
        return math.nan
    if statistic == "mu":
        return math.hypot(found.mu_error, found.sigma * math.sqrt(case.size / case.pool)) / value
    return math.hypot(found.sigma_error, found.sigma / math.sqrt(2 * max(case.pool - 1, 1))) / value


def _ratios(claim: Claim, cases: Sequence[CaseSummary], over: Over) -> tuple[Ratio, ...]:
    """Of all sizes that both targets have."""
    of_size = {(one.case.target, one.case.size): one for one in cases}
    sizes = sorted({size for _, size in of_size})
    ratios = []
    for size in sizes[:1] if claim.smallest_only else sizes:
        lower, higher = of_size.get((claim.lower, size)), of_size.get((claim.higher, size))
        if lower is None or higher is None:
            continue
        above, below = lower.of(claim.metric, over), higher.of(claim.metric, over)
        value = _value(above, claim.statistic) / _value(below, claim.statistic)
        error = math.hypot(
            relative_error(lower.case, above, claim.statistic), relative_error(higher.case, below, claim.statistic)
        )
        if value > 0 and error > 0:
            theirs, other = (paper_value(target, claim.metric, size) for target in (claim.lower, claim.higher))
            paper = math.nan
            if theirs is not None and other is not None:
                paper = theirs.mu / other.mu if claim.statistic == "mu" else theirs.sigma / other.sigma
            ratios.append(Ratio(size, value, math.log(value) / error, paper))
    return tuple(ratios)


def _value(found: Distribution, statistic: Statistic) -> float:
    value = found.mu if statistic == "mu" else found.sigma
    return value if value > 0 else math.nan


def _verdict(ratios: Sequence[Ratio]) -> Verdict:
    """Of ratios that the claim says are below 1."""
    if not ratios:
        return "no data"
    below = [one.standard_errors <= -SIGNIFICANT for one in ratios]
    above = [one.standard_errors >= SIGNIFICANT for one in ratios]
    if any(below):
        return "holds" if all(below) else "holds in part"
    return "does not hold" if any(above) else "not decided"


def _falls(target: str, cases: Sequence[CaseSummary], over: Over) -> tuple[Fall, ...]:
    return tuple(fall for metric in METRICS if (fall := _fall(target, metric.name, cases, over)) is not None)


def _verdict_of_falls(falls: Sequence[Fall], *, is_root: bool) -> Verdict:
    verdicts = {_verdict_of_root(one) if is_root else _verdict_of_fall(one) for one in falls}
    if len(verdicts) < 2:
        return verdicts.pop() if verdicts else "no data"
    return "holds in part" if verdicts & {"holds", "holds in part"} else "does not hold"


def _fall(target: str, metric: str, cases: Sequence[CaseSummary], over: Over) -> Fall | None:
    """The exponent by weighted least squares on logarithms; None if fewer than two sizes have a spread.

    Only the error by the number of samples counts: all sizes draw from the same views.
    """
    found = [(one.case.size, one.of(metric, over)) for one in cases]
    found = [(size, one) for size, one in found if one.sigma > 0 and one.sigma_error > 0]
    if len({size for size, _ in found}) < 2:
        return None
    sizes, sigmas = [size for size, _ in found], [one.sigma for _, one in found]
    exponent, error = _exponent(sizes, sigmas, [one.sigma_error / one.sigma for _, one in found])
    is_monotone = all(after < before for before, after in itertools.pairwise(sigmas))
    known = [(size, of_paper.sigma) for size in sizes if (of_paper := paper_value(target, metric, size)) is not None]
    paper = math.nan
    if len(known) == len(sizes):
        paper, _ = _exponent(sizes, [sigma for _, sigma in known], [1.0] * len(sizes))
    return Fall(metric, exponent, error, is_monotone, paper)


def _exponent(sizes: Sequence[int], sigmas: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """The slope of log sigma over log N with its standard error."""
    x, y, weight = np.log(sizes), np.log(sigmas), np.array(errors) ** -2.0
    x = x - np.average(x, weights=weight)
    squares = float((weight * x**2).sum())
    return float((weight * x * y).sum()) / squares, squares**-0.5


def _verdict_of_fall(fall: Fall) -> Verdict:
    margin = SIGNIFICANT * fall.error
    if fall.exponent < -max(margin, ABOUT):
        return "holds" if fall.is_monotone else "holds in part"
    return "does not hold" if fall.exponent > margin or margin < ABOUT else "not decided"


def _verdict_of_root(fall: Fall) -> Verdict:
    margin, off = SIGNIFICANT * fall.error, abs(fall.exponent - ROOT)
    if off <= ABOUT:
        return "holds" if margin < -ROOT else "not decided"
    return "does not hold" if off > ABOUT + margin else "not decided"
