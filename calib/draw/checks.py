"""A verdict and its checks as blocks of a page."""

from calib.judge.verdict import Check, Grade, Verdict
from designer.base.words import capital, printable
from designer.page.blocks import Finding, Headline, Level

LEVELS: dict[Grade, Level] = {"good": "good", "usable": "usable", "bad": "bad", "unknown": "note"}
WORDS: dict[Grade, str] = {"good": "good", "usable": "usable", "bad": "do not use", "unknown": "not checked"}


def headline_by(verdict: Verdict) -> Headline:
    """The answer of a verdict."""
    return Headline(LEVELS[verdict.grade], WORDS[verdict.grade], as_sentence(printable(verdict.sentence)))


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{capital(text)}{'' if text.endswith(('.', '!', '?')) else '.'}"


def check_findings(verdict: Verdict) -> tuple[Finding, ...]:
    """The checks, a line each; the one that is the headline says only its numbers."""
    return tuple(finding_of(check, is_said=check.name == verdict.leads_with) for check in verdict.checks)


def finding_of(check: Check, *, is_said: bool = False) -> Finding:
    """A check as a line of findings.

    Args:
        check: the check.
        is_said: the headline says its sentence already, so that it says its numbers only.
    """
    sign = "≥" if check.is_at_least else "≤"
    rule = f"good {sign} {check.good:.4g}, usable {sign} {check.usable:.4g} {check.unit}" if check.unit else ""
    sentence = f"{WORDS[check.grade]}: {check.sentence}" if check.grade == "unknown" else check.sentence
    text = "" if is_said else as_sentence(printable(sentence))
    return Finding(LEVELS[check.grade], printable(check.title), capital(text), printable(check.measured), rule)
