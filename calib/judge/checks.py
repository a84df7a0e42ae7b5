"""All checks of cameras and of rigs, and the limits that they are judged by: templates, or a person's own TOML file.

A file of one's own needs to hold only what differs from the template `standard`. Of a check that both have, the limits
are the same.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from calib.judge import joint_checks, lens_checks
from calib.judge.evidence import Evidence, JointEvidence, LensEvidence
from calib.judge.verdict import Check, Criteria, Found, Grade, Limits, at_least, at_most, measured_text, px
from designer.base.errors import InputError
from designer.base.files import read_spec_file
from designer.base.words import figure, printable, shown, suggestion
from designer.kinds.presets import preset_or_file

STANDARD = "standard"
LONGEST_TITLE = 200
_NUMBER = re.compile(r"\s*(\d{1,9}\.?\d{0,9}|\.\d{1,9})\s*([A-Za-z%]{0,8})\s*")
NO_LIMITS = Limits(0.0, 0.0)
_KEYS = ("good", "usable", "source")


NOISY, NOISY_TOGETHER = 3.0, 2.0
"""Residuals of a camera by itself, or with others, this many times the stated noise are said to be something else."""
OF_ROBOTS = 2.0
"""Times the limit of residuals up to which a camera on a robot is judged by its error in mm alone."""


@dataclass(frozen=True)
class CheckKind:
    """Something that is checked: what it is called, and how it is judged by given limits; None: nothing to say."""

    name: str  # a key of a criteria file
    title: str
    unit: str  # of the value and of its limits; "": nothing is measured
    every: Callable[[Evidence, Criteria], Found | None] | None = None  # of whatever was solved; else of
    lens: Callable[[LensEvidence, Criteria], Found | None] | None = None  # one camera that was solved by itself
    joint: Callable[[JointEvidence, Criteria], Found | None] | None = None  # several, or what moved one
    limits: Limits = NO_LIMITS  # where neither the criteria nor the template `standard` have some
    most: float = 1000.0  # that a limit may be
    is_at_least: bool = False  # the value must be at least the limits, not at most
    is_needed: bool = False  # without it nothing is called good

    def is_of(self, evidence: Evidence) -> bool:
        """Whether it is asked of cameras that were solved so."""
        return bool(self.every or (self.lens if evidence.lens else self.joint))

    def check(self, evidence: Evidence, criteria: Criteria) -> Check | None:
        """What came of it."""
        found = None
        if self.every is not None:
            found = self.every(evidence, criteria)
        elif isinstance(evidence, JointEvidence):
            found = self.joint and self.joint(evidence, criteria)
        elif evidence.lens is not None:
            found = self.lens and self.lens(evidence.lens, criteria)
        if found is None:
            return None
        limits = criteria[self.name] if self.unit else self.limits
        usable = limits.usable if found.usable is None else found.usable
        return Check(
            self.name, self.title, found.grade, found.value, self.unit, limits.good, usable, self.is_at_least,
            found.sentence,
        )  # fmt: skip


def _solution(evidence: Evidence, _: Criteria) -> Found | None:
    if evidence.status == "converged":
        return None
    what = "the photos do not determine the camera" if evidence.lens else "the frames do not determine the rig"
    fault = {"degenerate": what, "stopped": "the solution is not at its end"}.get(evidence.status, "")
    return Found("bad", None, f"{fault}: {evidence.status_reason}" if evidence.status_reason else fault)


def _priors(evidence: Evidence, _: Criteria) -> Found | None:
    """What was known beforehand against what the photos say: one of both is wrong, and all numbers are of both."""
    said = evidence.contradicted
    if said is None:
        return None
    if not said:
        return Found("good", None, "nothing in the photos contradicts what was known beforehand")
    return Found("bad", None, said[0] + (f" (and {len(said) - 1} more)" if len(said) > 1 else ""))


def _coverage(evidence: Evidence, criteria: Criteria) -> Found | None:
    """What the observations surround of the image of the camera that saw least; a given lens was learned elsewhere.

    It makes no rig unusable: where the cameras look at together they saw the target, and `space` judges that.
    """
    limits, is_joint = criteria["coverage"], evidence.lens is None
    solved = [(one.name, one.coverage) for one in evidence.cameras if one.coverage is not None]
    if not solved:
        return None
    name, least = min(solved, key=lambda pair: pair[1].share)
    percent = 100 * least.share
    sentence = f"the observations surround {measured_text(percent, '%', (limits.good, limits.usable))} % of the "
    sentence += f"{least.area} of {printable(name)}" if is_joint else least.area
    sentence += ", the least of all cameras" if len(solved) > 1 else ""
    if least.missing_words:
        sentence += f"; mostly without: {least.missing_words}"
        sentence += ", where its lens is only continued" if is_joint else ""
    if is_joint:
        return Found("good" if percent >= limits.good else "usable", percent, sentence, usable=0.0)
    return Found(at_least(percent, limits), percent, sentence)


def _residuals(evidence: Evidence, criteria: Criteria) -> Found:
    """Of the worst camera. Those of one on a robot spoil it later: what they do at the target `space` tells in mm."""
    limits, is_joint = criteria["residuals"], evidence.lens is None
    worst = max(evidence.cameras, key=lambda one: one.rms_px if math.isfinite(one.rms_px) else math.inf)
    of = f" of {printable(worst.name)}" if is_joint else ""
    if is_joint and not math.isfinite(worst.rms_px):
        return Found("bad", None, f"no observation{of} counts")
    largest = ", the largest of all cameras," if len(evidence.cameras) > 1 else ""
    sentence = f"the residuals{of}{largest} are {px(worst.rms_px)} (RMS of {worst.sightings} observations)"
    grade = at_most(worst.rms_px, limits)
    if worst.times_stated is not None and worst.times_stated > (NOISY_TOGETHER if is_joint else NOISY):
        times = f"{figure(worst.times_stated, 2)} times the noise that is stated"
        sentence += (
            f": within the limit, though {times}, a hint that some of it comes from target, lens or moving things"
            if grade == "good"
            else f", {times}: most of it is not noise, but target, lens or moving things"
        )
    is_in_mm = isinstance(evidence, JointEvidence) and joint_checks.is_in_mm(evidence)
    if grade == "bad" and is_in_mm and worst.rms_px <= OF_ROBOTS * limits.usable:
        return Found("usable", worst.rms_px, sentence, usable=worst.rms_px)
    return Found(grade, worst.rms_px, sentence)


CHECKS: dict[str, CheckKind] = {
    kind.name: kind
    for kind in (
        CheckKind("solution", "Solution", "", _solution),
        CheckKind("priors", "What was known beforehand", "", _priors),
        CheckKind("reading", "How the observations read", "", lens=lens_checks.reading),
        CheckKind(
            "frames",
            "Frames that join the cameras",
            "frames",
            joint=joint_checks.frames,
            is_at_least=True,
            is_needed=True,
        ),
        CheckKind("points", "What the points are", "", lens=lens_checks.points, joint=joint_checks.points),
        CheckKind("lenses", "Lenses that were kept", "", joint=joint_checks.lenses),
        CheckKind("uncertainty", "Uncertainty over the image", "px", lens=lens_checks.uncertainty, is_needed=True),
        CheckKind("coverage", "Sensor coverage", "%", _coverage, most=100.0, is_at_least=True, is_needed=True),
        CheckKind(
            "halves",
            "Cross-validation by halves",
            "sigma",
            lens=lens_checks.halves,
            joint=joint_checks.halves,
            is_needed=True,
        ),
        CheckKind("residuals", "Residuals", "px", _residuals, is_needed=True),
        CheckKind("systematic", "Systematic residuals", "px", lens=lens_checks.systematic),
        CheckKind("outliers", "Outliers", "%", lens=lens_checks.outliers, joint=joint_checks.outliers, most=100.0),
        CheckKind("delays", "Delays", "px", joint=joint_checks.delays),
        CheckKind("carrier", "Errors of what carries", "deg", joint=joint_checks.carrier, most=180.0),
        CheckKind("baselines", "Distances of the cameras", "%", joint=joint_checks.baselines, most=100.0),
        CheckKind("space", "Error in space", "%", joint=joint_checks.space, most=100.0),
        CheckKind("target", "Shape of the target", "px", lens=lens_checks.target),
        CheckKind("capture", "Alike in all photos", "px", lens=lens_checks.capture, limits=Limits(0.1, 0.3)),
        CheckKind("models", "Agreement of the models", "px", lens=lens_checks.models),
    )
}
"""In the order of reading. Their limits are in `templates/criteria`."""
FIRST = (
    "carrier", "priors", "reading", "solution", "points", "capture", "target", "residuals", "outliers", "halves",
    "systematic", "frames", "delays", "baselines", "space", "lenses", "uncertainty", "coverage", "models",
)  # fmt: skip
"""Of checks that are beyond their limits alike, the one that is named first: what spoils the data comes before what a
few more photos mend."""


def checks_of(evidence: Evidence, criteria: Criteria) -> tuple[Check, ...]:
    """All checks that have something to say, in the order of reading."""
    return tuple(check for kind in CHECKS.values() if (check := kind.check(evidence, criteria)) is not None)


def missing_of(evidence: Evidence, checks: Sequence[Check]) -> tuple[Check, ...]:
    """The checks without which nothing is called good, and that could not be made.

    What the target may be off is in a camera's uncertainty, unless nobody knows how it was made.
    """
    lens = evidence.lens
    also = () if lens is None or lens.uncertainty.target_error is not None else ("target",)
    return tuple(
        check for check in checks if check.grade == "unknown" and (CHECKS[check.name].is_needed or check.name in also)
    )


def faults_of(checks: Sequence[Check], grade: Grade) -> tuple[Check, ...]:
    """The checks of a grade, the one that is farthest beyond its limit first; last one that nothing fails by.

    A carrier that is lost is told before all: what it spoils may be beyond every limit.
    """
    order = list(dict.fromkeys((*FIRST, *CHECKS)))

    def rank(check: Check) -> tuple[bool, bool, float, int]:
        fails_nothing, is_lost = check.is_at_least and check.usable == 0, check.name == "carrier" and grade == "bad"
        return fails_nothing, not is_lost, -check.times_beyond, order.index(check.name)

    return tuple(sorted((check for check in checks if check.grade == grade), key=rank))


def read_criteria(name_or_path: str = STANDARD) -> Criteria:
    """The criteria of a template, or of a person's TOML file.

    Raises:
        InputError: neither, or a key or value that breaks a rule; the message says which.
    """
    path = preset_or_file("criteria", name_or_path)
    values = {**read_spec_file(preset_or_file("criteria", STANDARD)), **read_spec_file(path)}
    try:
        _require_known(values, ("title", *CHECKS))
        title = values["title"]
        if not isinstance(title, str) or not 0 < len(title) <= LONGEST_TITLE:
            raise ValueError(f"title {shown(title)}: must be a text of 1 to {LONGEST_TITLE} characters")
        limits = {
            name: _limits(kind, values[name]) if name in values else kind.limits
            for name, kind in CHECKS.items()
            if kind.unit
        }
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return Criteria(path.stem, title, limits)


def applied(criteria: Criteria, evidence: Evidence) -> Criteria:
    """The limits that are a camera's, or a rig's: what is kept of a verdict on it."""
    names = [name for name, kind in CHECKS.items() if kind.unit and kind.is_of(evidence)]
    return Criteria(criteria.name, criteria.title, {name: criteria[name] for name in names if name in criteria.limits})


def _limits(kind: CheckKind, table: object) -> Limits:
    """The limits of one check."""
    if not isinstance(table, dict):
        raise ValueError(f"{kind.name} {shown(table)}: must be a table with good and usable")
    _require_known(table, _KEYS, f"{kind.name}.")
    for key in ("good", "usable"):
        if key not in table:
            raise ValueError(f"{kind.name}.{key} is missing; give both limits, good and usable")
    good, usable = (_quantity(f"{kind.name}.{key}", table[key], kind) for key in ("good", "usable"))
    if (good < usable) if kind.is_at_least else (good > usable):
        rule, what = ("less", "least") if kind.is_at_least else ("more", "most")
        raise ValueError(f"{kind.name}: good {good:g} must not be {rule} than usable {usable:g}: it is at {what} so")
    source = table.get("source", "")
    if not isinstance(source, str):
        raise ValueError(f"{kind.name}.source {shown(source)}: must be a text")
    return Limits(good, usable, source)


def _quantity(key: str, value: object, kind: CheckKind) -> float:
    """A number of a unit, with or without it."""
    number = value
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if match is None or match[2] not in ("", kind.unit):
            raise ValueError(f"{key} {shown(value)}: must be a number of {kind.unit}, such as '1{kind.unit}'")
        number = float(match[1])
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= kind.most:
        raise ValueError(f"{key} {shown(value)}: must be from 0 to {kind.most:g}{kind.unit}")
    return float(number)


def _require_known(values: Mapping[str, object], known: tuple[str, ...], within: str = "") -> None:
    for key in values:
        if key not in known:
            hint = suggestion(key, list(known)) or "; there are " + ", ".join(known)
            raise ValueError(f"unknown key {shown(within + key)}{hint}")
