"""What is said of a bootstrap study in words: its answer, what its figures show, and what to know of its numbers."""

import math
from collections import Counter
from collections.abc import Sequence

from calib.draw.study_tables import LEVEL_OF_VERDICT, setting_in_words
from calib.studies.findings import HeldClaim
from calib.studies.samples import Setting
from calib.studies.statistics import (
    BOARD,
    CORRECTION,
    ICOSAHEDRON,
    INTERVALS,
    LEAST_P,
    METRICS,
    SMALL_SKEWNESS,
    TARGETS,
    CaseSummary,
    Distribution,
    paper_value,
)
from calib.studies.study_table import StudyTable
from designer.base.words import figure, printable, with_digits
from designer.page.blocks import Finding, Headline, Level

MANY_LOST, SOME_LOST = 0.05, 0.01
"""Parts of the samples without a good camera, from which on a study says: not with so few views, or with care."""
ON_ITS_OWN_VIEWS = (
    " Each sample is measured on the views it was solved from, and few views are easily fitted: a smaller error with "
    "fewer views is no better camera. What says how sure the camera is, is the spread (sigma)."
)
FOCAL = 0
"""Place of the focal length among the parameters of every model."""


def error_words(found: Distribution) -> str:
    """`intersection error 0.0116 ± 0.0007 mm`; "" if no sample has it."""
    if not math.isfinite(found.mu):
        return ""
    if not found.sigma > 0:
        return f"{found.metric} error {figure(found.mu, 3)} {found.unit}"
    return f"{found.metric} error {with_digits(found.mu, found.sigma)} ± {figure(found.sigma, 2)} {found.unit}"


def bootstrap_headline(table: StudyTable) -> Headline:
    """How sure the camera is at the largest number of views."""
    one = max(table.cases, key=lambda one: one.case.size)
    case, camera = one.case, table.camera(one.case)
    lost = (one.samples - one.converged) / one.samples if one.samples else 1.0
    parts = [words for name in ("intersection", "reprojection") if (words := error_words(one.of(name)))]
    if camera is not None:
        parts.insert(0, f"the focal length is sure to {figure(camera.parameters[FOCAL].sigma, 2)} px (1 sigma)")
    sentence = (
        f"With {case.size} views drawn from {case.pool} of {printable(case.target)}, "
        f"{', '.join(parts) or 'no sample has a camera'}, over {one.samples} samples."
    )
    level: Level = "bad" if lost > MANY_LOST else "usable" if lost > SOME_LOST else "note"
    if level != "note":
        sentence += f" {100 * lost:.1f} % of them have no camera that converged: take more views."
    word = {"bad": "too few views", "usable": "with care"}.get(level, "answered")
    return Headline(level, word, sentence)


def paper_headline(table: StudyTable) -> Headline:
    """How many of the paper's findings hold in all ways of sampling, in some at least in part, and in none."""
    verdicts: dict[str, list[str]] = {}
    for one in table.findings:
        verdicts.setdefault(one.claim, []).append(one.verdict)
    if not verdicts:
        return Headline("note", "answered", f"{len(table.cases)} cases; none of the paper's findings can be checked.")
    everywhere = [claim for claim, found in verdicts.items() if set(found) == {"holds"}]
    nowhere = [claim for claim, found in verdicts.items() if not {"holds", "holds in part"} & set(found)]
    some = len(verdicts) - len(everywhere) - len(nowhere)
    ways = len(table.settings)
    parts = [f"{len(everywhere)} of the paper's {len(verdicts)} findings hold in all {ways} ways of sampling"]
    parts += [f"{some} in some"] if some else []
    parts += [f"{len(nowhere)} in none ({'; '.join(nowhere)})"] if nowhere else []
    factors = [found.mu_by_paper for one in table.cases for found in one.every() if found.mu_by_paper > 0]
    sentence = f"{', '.join(parts)}."
    if factors:
        sentence += f" Our mean errors are {figure(min(factors), 2)} to {figure(max(factors), 2)} times the paper's."
    return Headline("note", f"{len(everywhere)} of {len(verdicts)} hold", sentence)


def interval_sentence(table: StudyTable) -> str:
    """Between what the intersection error lies, with the fewest and the most views."""
    parts = []
    for target in table.targets:
        cases = [one for one in table.cases if one.case.target == target]
        for one in dict.fromkeys((cases[0], max(cases, key=lambda one: one.case.size))):
            found = one.of("intersection")
            if math.isfinite(found.percentile_low):
                ends = f"{figure(found.percentile_low, 3)} and {figure(found.percentile_high, 3)} {found.unit}"
                parts.append(f"with {one.case.size} views between {ends}")
    if not parts:
        return ""
    return f"Intersection error of 95 % of the samples: {'; '.join(parts)}.{ON_ITS_OWN_VIEWS * (len(table.sizes) > 1)}"


def finding_of(one: HeldClaim, found: Sequence[HeldClaim]) -> Finding:
    """A claim with the numbers behind its verdict, and where else it holds."""
    converged = one.verdict_of_converged
    parts = [f"{setting_in_words(one.setting)}: {evidence(one)}"]
    parts += [f"over converged samples alone: {converged}"] if converged != one.verdict else []
    parts += [elsewhere(one, found)] if elsewhere(one, found) else []
    return Finding(LEVEL_OF_VERDICT.get(one.verdict, "note"), f"{one.claim}: {one.verdict}", "; ".join(parts))


def evidence(one: HeldClaim) -> str:
    """The numbers that a verdict rests on."""
    parts = []
    for ratio in one.ratios:
        side = "below" if ratio.standard_errors < 0 else "above"
        paper = f"; paper {ratio.paper:.2f}" if math.isfinite(ratio.paper) else ""
        parts.append(
            f"N = {ratio.size}: {ratio.ratio:.2f}, {abs(ratio.standard_errors):.1f} standard errors {side} 1{paper}"
        )
    if parts:
        higher = TARGETS[1 - TARGETS.index(one.target)] if one.target in TARGETS else "other"
        return f"{one.statistic} of the {one.target} / {higher}: {' | '.join(parts)}"
    for fall in one.exponents:
        paper = f", paper {fall.paper:.2f}" if math.isfinite(fall.paper) else ""
        parts.append(f"{fall.metric} N^({fall.exponent:.2f} ± {fall.error:.2f}{paper})")
    return "; ".join(parts) or "not defined in these cases"


def elsewhere(one: HeldClaim, found: Sequence[HeldClaim]) -> str:
    """Where a claim holds that does not hold here, only the sampling or only the counting being others."""
    if one.verdict == "holds":
        return ""
    holding = [other for other in found if other.claim == one.claim and other.verdict == "holds"]
    places = [f"with {printable(other.sampling)} sampling" for other in holding if other.sightings == one.sightings]
    places += [f"over {printable(other.sightings)}" for other in holding if other.sampling == one.sampling]
    return f"it holds {' and '.join(places)}, all else equal" if places else ""


def reasons(table: StudyTable) -> tuple[Finding, ...]:
    """Why findings of the paper do not hold here, as far as the study's own numbers say it."""
    lines = []
    for setting in table.settings:
        failing = {one.metric for one in table.findings if one.setting == setting and one.verdict != "holds"}
        found = [_of_pose(table, setting)] if "pose" in failing else []
        found += [_of_skewness(table, target, setting) for target in table.targets]
        lines += [Finding("note", setting_in_words(setting), text) for text in found if text]
    return tuple(lines)


def _of_pose(table: StudyTable, setting: Setting) -> str:
    """A camera's centre is known along its axis as well as its focal length is."""
    sigma = {}
    for camera in table.cameras:
        if camera.case.setting == setting:
            sigma[camera.case.target] = camera.parameters[FOCAL].stated
    ico, board = sigma.get(ICOSAHEDRON, math.nan), sigma.get(BOARD, math.nan)
    if not (board > 0 and ico > board):
        return ""
    return (
        f"A pose is as sure as the focal length, and all views together state that to {figure(ico, 2)} px for the "
        f"icosahedron and {figure(board, 2)} px for the board ({figure(ico / board, 2)} times): where the centres of "
        "both are measured as well, a target that fills the image is at an advantage."
    )


def _of_skewness(table: StudyTable, target: str, setting: Setting) -> str:
    """A sigma that few wild samples make does not fall with the root of the number of views."""
    cases = [one for one in table.cases if (one.case.target, one.case.setting) == (target, setting)]
    skewness = [one.of("reconstruction").skewness for one in cases]
    largest = max((value for value in skewness if math.isfinite(value)), default=0.0)
    if not largest > 4 * SMALL_SKEWNESS:
        return ""
    return (
        f"The {printable(target)}'s reconstruction error is skewed to the right (up to {largest:.1f}): rings that few "
        "views of a sample see make it, so its sigma is not one of 1/sqrt(N)."
    )


def study_notes(table: StudyTable) -> tuple[Finding, ...]:
    """What to know of the numbers."""
    rows = [finding for one in table.cases if (finding := not_converged(one)) is not None]
    every = [found for one in table.cases for found in one.every() if found.count]
    tested = [one for one in every if one.shape != "too few"]
    if tested:
        counts = Counter(one.shape for one in tested).most_common()
        shapes = ", ".join(f"{count} {shape}" for shape, count in counts)
        text = f"Of {len(tested)}: {shapes} (normal: D'Agostino and Pearson, p >= {LEAST_P:g})."
        rows.append(Finding("note", "Distributions", text))
    errors = [
        error / value
        for one in every
        for error, value in ((one.mu_error, one.mu), (one.sigma_error, one.sigma))
        if value > 0 and math.isfinite(error)
    ]
    if errors:
        text = f"By the number of samples at most {figure(100 * max(errors), 2)} % of a mean or sigma."
        rows.append(Finding("note", "Standard errors", text))
    known = [paper_value(one.case.target, metric.name, one.case.size) for one in table.cases for metric in METRICS]
    rows += [Finding("note", "", INTERVALS)] if any(value is not None for value in known) else []
    is_corrected = any(value is not None and value.is_corrected for value in known)
    rows += [Finding("note", "", CORRECTION)] if is_corrected else []
    return tuple(rows)


def not_converged(one: CaseSummary) -> Finding | None:
    """The statuses of a case that has others than converged, and its errors without those; else None."""
    if one.converged == one.samples:
        return None
    counts = ", ".join(f"{count} {status}" for status, count in one.statuses if count)
    errors = ", ".join(words for found in one.every("converged") if (words := error_words(found)))
    setting = f", {setting_in_words(one.case.setting)}" if any(one.case.setting) else ""
    title = f"{printable(one.case.target)}, {one.case.size} views{setting}"
    return Finding("usable", title, f"{counts}; the converged alone: {errors or 'no errors'}.")


def histograms_alt(table: StudyTable, setting: Setting) -> str:
    """What the histograms of a way of sampling show."""
    lines = []
    for target in table.targets:
        cases = [one for size in table.sizes if (one := table.case(target, size, setting)) is not None]
        if cases:
            parts = [f"{words}, {found.shape}" for found in cases[-1].every() if (words := error_words(found))]
            told = "; ".join(parts) or "no errors"
            lines.append(f"{printable(target)} with {cases[-1].case.size} views: {told}")
    return f"Errors of the samples with fitted Gaussians. {'; '.join(lines)}."


def sigma_alt(table: StudyTable, sightings: str) -> str:
    """What the figure of sigma over the number of views shows."""
    parts = [
        f"{setting_in_words(one.setting)}, {printable(one.target)}: exponents of the number of views "
        + ", ".join(f"{part.metric} {part.exponent:.2f}" for part in one.exponents)
        for one in table.findings
        if one.about == "fall" and one.sightings == sightings
    ]
    found = "; ".join(parts) or "exponents are not known"
    return f"Sigma of each error falls with the number of views, next to a line of 1/sqrt(N). {found}."


def correlations_alt(table: StudyTable, setting: Setting) -> str:
    """Which parameters go together most, of each target at its largest number of views."""
    parts = []
    for target in table.targets:
        cameras = [one for one in table.cameras if (one.case.target, one.case.setting) == (target, setting)]
        tie = max(cameras, key=lambda one: one.case.size).strongest if cameras else None
        if tie is not None:
            parts.append(f"{printable(target)}: {tie.first} and {tie.second} go together most ({tie.correlation:+.2f})")
    way = f", {setting_in_words(setting)}" if any(setting) else ""
    found = "; ".join(parts) or "no two vary"
    return (
        f"Correlations of the camera's parameters over samples of {table.sizes[-1]} views{way}, and as one solution "
        f"predicts them: {found}."
    )
