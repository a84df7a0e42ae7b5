"""The verdict of a run on its page: the headline, the checks, and what to do better next time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calib.core.number_text import figure as digits
from calib.show.run.accuracy_figures import image_panel
from calib.show.run.run_folder import Solved
from calib.verdict.figure_next_views import draw_next_views
from calib.verdict.next_views import NextView, why_no_next_views
from calib.verdict.verdict import Check, Grade, Verdict
from calib.verdict.words import measured
from designer.base.words import capital, printable
from designer.page.blocks import Block, Figure, Finding, Findings, Headline, Level, Paragraph, Section, Steps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEVELS: dict[Grade, Level] = {"good": "good", "usable": "usable", "bad": "bad", "unknown": "note"}
WORDS: dict[Grade, str] = {"good": "good", "usable": "usable", "bad": "do not use", "unknown": "not checked"}
NOT_JUDGED = "verdict.json is missing, so nothing was judged; calib report with --criteria standard judges it."


def headline_of(verdict: Verdict) -> Headline:
    """The answer at the top of the page."""
    return Headline(LEVELS[verdict.grade], WORDS[verdict.grade], as_sentence(printable(verdict.sentence)))


def not_judged(best: Solved) -> Headline:
    """What stands there of a camera that nobody judged."""
    return Headline("note", "not judged", f"{_solution_words(best)}. {NOT_JUDGED}")


def _solution_words(best: Solved) -> str:
    calibration = best.calibration
    left = f", {digits(best.rmse_px, 3)} px are left over" if best.rmse_px >= 0 else ""
    return f"The camera ({best.model}) was solved from {calibration.observations.view_count} photos{left}"


def verdict_section(verdict: Verdict | None, best: Solved, faults: Sequence[str]) -> Section:
    """What was checked, and what is missing.

    Args:
        verdict: None: there is none.
        best: the camera that the page is about.
        faults: what of the folder could not be read.
    """
    blocks: list[Block] = []
    if verdict is not None:
        blocks.append(Findings(tuple(map(finding_of, verdict.checks))))
    remarks = (*best.calibration.remarks, *best.evaluation.remarks)
    missing = () if verdict is not None else (Finding("note", "Not judged", NOT_JUDGED),)
    rest = (
        *missing,
        *(Finding("usable", "Not on this page", printable(fault)) for fault in faults),
        *(Finding("note", "Said by the solution", printable(remark)) for remark in remarks),
    )
    if rest:
        blocks.append(Findings(rest))
    return Section("Verdict", tuple(blocks), lead=_lead(verdict))


def _lead(verdict: Verdict | None) -> str:
    if verdict is None:
        return ""
    known = [check for check in verdict.checks if check.grade != "unknown"]
    good = sum(check.grade == "good" for check in known)
    words = f"{good} of {len(known)} checks are within their limits for good"
    open_ = len(verdict.checks) - len(known)
    return f"{words}; {open_} could not be made." if open_ else f"{words}."


def finding_of(check: Check) -> Finding:
    """A check as a line of findings."""
    found = "" if check.value is None else measured(check)
    sign = "≥" if check.is_at_least else "≤"
    has_limits = check.good or check.usable
    rule = f"good {sign} {check.good:.4g}, usable {sign} {check.usable:.4g} {check.unit}".strip() if has_limits else ""
    sentence = f"{WORDS[check.grade]}: {check.sentence}" if check.grade == "unknown" else check.sentence
    return Finding(
        LEVELS[check.grade], printable(check.title), as_sentence(printable(sentence)), printable(found), rule
    )


def next_section(verdict: Verdict | None, best: Solved, proposed: Sequence[NextView]) -> tuple[Section, ...]:
    """What to do better next time, and a sketch of where to hold the target; nothing if there is nothing."""
    said = () if verdict is None else tuple(map(printable, verdict.advice))
    new = tuple(
        f"photo {number}: {view.sentence}"
        for number, view in enumerate(proposed, start=1)
        if not any(view.sentence in line for line in said)
    )
    blocks: list[Block] = []
    if said or new:
        blocks.append(Steps(tuple(as_sentence(line.replace("`", "")) for line in (*said, *new))))
    if proposed:
        blocks.append(next_views_figure(best, proposed))
    elif why := why_no_next_views(best.calibration):
        blocks.append(Paragraph(f"No photos are proposed: {printable(why)}."))
    return (Section("Next time", tuple(blocks), lead="What would make the camera better, the most useful first."),) * (
        len(blocks) > 0
    )


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{capital(text)}{'' if text.endswith(('.', '!', '?')) else '.'}"


def next_views_figure(best: Solved, proposed: Sequence[NextView]) -> Figure:
    """Where to hold the target in the next photos."""
    seen = best.calibration.observations

    def draw(axes: "Axes") -> None:
        draw_next_views(axes, seen.image_size, proposed, seen.center_px)

    count = "One more photo" if len(proposed) == 1 else f"{len(proposed)} more photos"
    last = proposed[-1]
    words = f"{count} would bring 95 % of the image within about {digits(last.sigma_px_after, 1)} px (1 sigma)"
    if last.covered_after > proposed[0].covered_before:
        words += f" and the coverage to {100 * last.covered_after:.0f} %"
    words += ", if the lens is as estimated"
    return image_panel(
        "Where to hold the target next", seen.image_size, draw, words,
        f"{words}. Grey: rings seen so far. Numbered: outlines of the target in the next photos.", has_bar=False,
    )  # fmt: skip
