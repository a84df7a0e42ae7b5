"""The verdict: the worst of what is known, and no praise where nothing independent was checked."""

import math
from collections.abc import Sequence

from calib.verdict.checks import OWN_ROTATION, checks_of, px
from calib.verdict.criteria import Criteria
from calib.verdict.evidence import CameraEvidence
from calib.verdict.halves import NoHalves
from calib.verdict.verdict import Check, Grade, Verdict

WORSE: tuple[Grade, ...] = ("good", "usable", "bad")
NEEDED = ("uncertainty", "coverage", "halves", "residuals")
"""Without these checks nothing is called good."""
FIRST = (
    "solution", "target", "residuals", "outliers", "halves", "systematic", "uncertainty", "coverage", "models",
)  # fmt: skip
"""Of checks that are beyond their limits alike, the one that is named first: what spoils the data comes before what a
few more photos mend."""


def judge(evidence: CameraEvidence, criteria: Criteria, advice: Sequence[str] = ()) -> Verdict:
    """The verdict on a camera.

    The grade is the worst of the checks that are known. If one of those that are needed could not be made, it is
    "usable" at best: three photos, or a single one of an icosahedron, may determine a camera well, but nothing in them
    tells whether their standard deviations hold, and no careful person calls good what was never checked. Other
    checks that could not be made, such as agreement with models that were not solved, change nothing.
    """
    checks = checks_of(evidence, criteria)
    known = [check.grade for check in checks if check.grade != "unknown"]
    grade = max(known, key=WORSE.index) if known else "usable"
    missing = missing_of(evidence, checks)
    if missing and grade == "good":
        grade = "usable"
    return Verdict(grade, evidence.model, _sentence(evidence, checks, missing, grade), checks, tuple(advice))


def _sentence(evidence: CameraEvidence, checks: Sequence[Check], missing: Sequence[Check], grade: Grade) -> str:
    """The answer and its main reason."""
    if grade == "good":
        return _why_good(evidence)
    faults = faults_of(checks, grade)
    if not faults:
        return f"no fault was found, but not everything could be checked: {missing[0].sentence}"
    names = {check.name for check in faults}
    if grade == "bad" and "coverage" in names and names <= {"uncertainty", "coverage"}:
        narrow = _good_inside(evidence, faults)
        if narrow:
            return narrow
    also = ", ".join(check.title.lower() for check in faults[1:])
    return faults[0].sentence + (f" (also: {also})" if also else "")


def missing_of(evidence: CameraEvidence, checks: Sequence[Check]) -> tuple[Check, ...]:
    """The checks without which nothing is called good, and that could not be made.

    What the target may be off is in the uncertainty, unless nobody knows how it was made.
    """
    is_told = evidence.uncertainty.target_error is not None
    needed = NEEDED if is_told else (*NEEDED, "target")
    return tuple(check for check in checks if check.grade == "unknown" and check.name in needed)


def faults_of(checks: Sequence[Check], grade: Grade) -> tuple[Check, ...]:
    """The checks of a grade, the one that is farthest beyond its limit first."""
    faults = (check for check in checks if check.grade == grade)
    return tuple(sorted(faults, key=lambda check: (-_times_beyond(check), FIRST.index(check.name))))


def _times_beyond(check: Check) -> float:
    """How many times a value is worse than the limit of what it is not; without a value, without bound."""
    limit = check.usable if check.grade == "bad" else check.good
    if check.value is None:
        return math.inf
    worse, better = (limit, check.value) if check.is_at_least else (check.value, limit)
    return worse / better if better > 0 else math.inf


def _good_inside(evidence: CameraEvidence, faults: Sequence[Check]) -> str:
    """Why a camera is not to be used that is good where the target was seen; "" if it is not."""
    inside, outside = evidence.uncertainty.covered_px, evidence.uncertainty.image_px
    limit = next((check.usable for check in faults if check.name == "uncertainty"), math.inf)
    if inside is None or inside > limit or evidence.uncertainty.is_map_exact:
        return ""
    covered = f"the sightings surround only {100 * evidence.coverage.share:.0f} % of the image, where it is known to"
    if math.isinf(limit):
        elsewhere = "the lens model only continues what it learned there"
    elif outside is None:
        elsewhere = "the lens model breaks down"
    else:
        elsewhere = f"it is uncertain by up to {px(outside)} (1 sigma)"
    return f"{covered} {px(inside)} ({OWN_ROTATION}); elsewhere {elsewhere}, and nothing was seen to check it"


def _why_good(evidence: CameraEvidence) -> str:
    uncertain, halves = evidence.uncertainty.image_px, evidence.halves
    parts = [f"{100 * evidence.coverage.share:.0f} % of the image is covered"]
    if uncertain is not None:
        parts.insert(0, f"the camera is uncertain by at most {px(uncertain)} in 95 % of the image")
    if not isinstance(halves, NoHalves):
        parts.append("two halves of the photos agree")
    return f"{', '.join(parts[:-1])}, and {parts[-1]}"
