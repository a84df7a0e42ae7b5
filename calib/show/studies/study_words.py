"""What the page of a bootstrap study says in words: its answer, and what its figures show."""

from collections.abc import Sequence

from calib.core.number_text import figure, with_digits
from calib.show.studies.parameter_spread import Spread
from calib.studies.findings import ABOUT, ROOT, SIGNIFICANT
from calib.studies.statistics import METRICS, Metric
from calib.studies.study_table_file import StudyCase, StudyFinding, StudyTable
from calib.studies.table import setting_in_words
from designer.page.blocks import Headline, Level

MANY_LOST, SOME_LOST = 0.05, 0.01
"""Parts of the samples without a good camera, from which on a study says: not with so few views, or with care."""
OWN = "ours: "
"""What lines on a study of one way of sampling begin with, beside the paper's."""
ON_ITS_OWN_VIEWS = (
    " Each sample is measured on the views it was solved from, and few views are easily fitted: a smaller error with "
    "fewer views is no better camera. What says how sure the camera is, is the spread (sigma)."
)
FOCAL = 0
"""Place of the focal length among the parameters of every model."""


def error_words(case: StudyCase, metric: Metric) -> str:
    """`intersection error 0.0116 ± 0.0007 mm`; "" if the case has none."""
    found = case.of(metric)
    if found is None or found.mu is None:
        return ""
    if not found.sigma:
        return f"{metric.name} error {figure(found.mu, 3)} {metric.unit}"
    return f"{metric.name} error {with_digits(found.mu, found.sigma)} ± {figure(found.sigma, 2)} {metric.unit}"


def bootstrap_headline(table: StudyTable, spreads: Sequence[Spread]) -> Headline:
    """How sure the camera is at the largest number of views."""
    case = max(table.cases, key=lambda one: one.size)
    lost = (case.samples - case.converged) / case.samples if case.samples else 1.0
    parts = [words for metric in (METRICS[1], METRICS[0]) if (words := error_words(case, metric))]
    focal = next((one for one in spreads if one.case.size == case.size and one.case.target == case.target), None)
    if focal is not None:
        parts.insert(0, f"the focal length is sure to {figure(float(focal.sigma[FOCAL]), 2)} px (1 sigma)")
    sentence = (
        f"With {case.size} views drawn from {case.pool} of {case.target}, "
        f"{', '.join(parts) or 'no sample has a camera'}, over {case.samples} samples."
    )
    level: Level = "bad" if lost > MANY_LOST else "usable" if lost > SOME_LOST else "note"
    if level != "note":
        sentence += f" {100 * lost:.1f} % of them have no camera that converged: take more views."
    word = {"bad": "too few views", "usable": "with care"}.get(level, "answered")
    return Headline(level, word, sentence)


def interval_sentence(table: StudyTable) -> str:
    """Between what the intersection error lies, with the fewest and the most views."""
    parts = []
    for target in table.targets:
        cases = [one for one in table.cases if one.target == target]
        for case in dict.fromkeys((cases[0], max(cases, key=lambda one: one.size))):
            found = case.of(METRICS[1])
            if found is not None and found.percentile_low is not None and found.percentile_high is not None:
                ends = f"{figure(found.percentile_low, 3)} and {figure(found.percentile_high, 3)} {found.unit}"
                parts.append(f"with {case.size} views between {ends}")
    if not parts:
        return ""
    several = len({one.size for one in table.cases}) > 1
    return f"Intersection error of 95 % of the samples: {'; '.join(parts)}.{ON_ITS_OWN_VIEWS * several}"


def paper_headline(table: StudyTable) -> Headline:
    """How many of the paper's findings hold."""
    claims = tuple(dict.fromkeys(one.claim for one in table.findings))
    if not claims:
        return Headline("note", "answered", f"{len(table.cases)} cases; none of the paper's findings can be checked.")
    everywhere, somewhere, nowhere = held_claims(table.findings)
    ways = len({one.setting for one in table.findings})
    parts = [f"{len(everywhere)} of the paper's {len(claims)} findings hold in all {ways} ways of sampling"]
    if somewhere:
        parts.append(f"{len(somewhere)} in some")
    if nowhere:
        parts.append(f"{len(nowhere)} in none ({'; '.join(nowhere)})")
    return Headline(
        "note", f"{len(everywhere)} of {len(claims)} hold", f"{', '.join(parts)}.{_factor_words(table)}"
    )  # fmt: skip


def held_claims(found: Sequence[StudyFinding]) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """The claims that hold in every way of sampling, in some at least in part, and in none."""
    everywhere, somewhere, nowhere = [], [], []
    for claim in dict.fromkeys(one.claim for one in found):
        verdicts = [one.verdict for one in found if one.claim == claim]
        if all(one == "holds" for one in verdicts):
            everywhere.append(claim)
        elif any(one in ("holds", "holds in part") for one in verdicts):
            somewhere.append(claim)
        else:
            nowhere.append(claim)
    return tuple(everywhere), tuple(somewhere), tuple(nowhere)


def _factor_words(table: StudyTable) -> str:
    """The range of our mean errors over the paper's."""
    factors = [
        one.mu_by_paper
        for case in table.cases
        for one in case.metrics
        if one.over == "all" and one.mu_by_paper is not None
    ]
    if not factors:
        return ""
    return f" Our mean errors are {figure(min(factors), 2)} to {figure(max(factors), 2)} times the paper's."


def histograms_alt(table: StudyTable, setting: tuple[str, str]) -> str:
    """What the histograms of a way of sampling show."""
    lines = []
    for target in table.targets:
        cases = [one for size in table.sizes if (one := table.case(target, size, setting)) is not None]
        if cases:
            lines.append(f"{target} with {cases[-1].size} views: {_shape_words(cases[-1])}")
    return f"Errors of the samples with fitted Gaussians. {'; '.join(lines)}."


def _shape_words(case: StudyCase) -> str:
    parts = []
    for metric in METRICS:
        found = case.of(metric)
        if found is not None and (words := error_words(case, metric)):
            parts.append(f"{words}, {found.shape}")
    return "; ".join(parts) or "no errors"


def sigma_alt(table: StudyTable, sightings: str) -> str:
    """What the figure of sigma over the number of views shows."""
    parts = [
        f"{setting_in_words(*one.setting)}, {one.claim.removeprefix('sigma falls with N for the ')}: exponents of the "
        f"number of views {', '.join(_exponents(one))}"
        for one in table.findings
        if one.claim.startswith("sigma falls with N") and one.sightings == sightings
    ]
    found = "; ".join(parts) or "exponents are not known"
    return f"Sigma of each error falls with the number of views, next to a line of 1/sqrt(N). {found}."


def fall_in_words(exponent: float, error: float) -> str:
    """How fast sigma falls, against 1/sqrt(N).

    Args:
        exponent: a of sigma = c N^a.
        error: its standard error.
    """
    told = f"sigma goes as N^({exponent:.2f} ± {error:.2f})"
    if abs(exponent - ROOT) <= ABOUT and SIGNIFICANT * error < -ROOT:
        return f"{told}, about as 1/sqrt(N)"
    if abs(exponent - ROOT) <= ABOUT + SIGNIFICANT * error:
        return f"{told}, not told from 1/sqrt(N) by so few samples"
    if exponent < ROOT:
        return f"{told}, faster than 1/sqrt(N): samples of few views are at times much worse than usual"
    return f"{told}, slower than 1/sqrt(N): more views bring less than usual"


def _exponents(one: StudyFinding) -> list[str]:
    return [f"{part.metric} {part.exponent:.2f}" for part in one.exponents if part.exponent is not None]


def correlations_alt(table: StudyTable, spreads: Sequence[Spread], setting: tuple[str, str]) -> str:
    """Which parameters go together most, of each target at its largest number of views."""
    parts = []
    for target in table.targets:
        chosen = [
            one for one in spreads if (one.case.target, (one.case.sampling, one.case.sightings)) == (target, setting)
        ]
        strongest = max(chosen, key=lambda one: one.case.size).together.strongest if chosen else None
        if strongest is not None:
            first, second, value = strongest
            parts.append(f"{target}: {first} and {second} go together most ({value:+.2f})")
    way = f", {setting_in_words(*setting)}" if any(setting) else ""
    found = "; ".join(parts) or "which go together most is not known, as the samples are not in the folder"
    return (
        f"Correlations of the camera's parameters over samples of {table.sizes[-1]} views{way}, and as one solution "
        f"predicts them: {found}."
    )
