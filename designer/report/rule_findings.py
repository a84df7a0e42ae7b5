"""The design rules on a page: what each found, with its value and its limit."""

from dataclasses import dataclass

from designer.base.words import capital
from designer.kinds.layout import narrowest_widths
from designer.make.bed import printed_size_mm
from designer.make.printability import Level as RuleLevel
from designer.make.printability import PrintCheck
from designer.page.blocks import Finding, Findings, Level
from designer.produce import Design

_LEVELS: dict[RuleLevel, Level] = {"violation": "bad", "warning": "usable", "note": "note"}
_ORDER: tuple[RuleLevel, ...] = ("violation", "warning", "note")
_TITLES = {
    "stroke": "Stroke of the rings",
    "centre": "White centre of the rings",
    "gap": "Gap between rings",
    "margin": "White around the rings",
    "border": "Border",
    "inlay": "Depth of the ink",
    "bed": "Size on the bed",
    "overhang": "Overhang",
}
_HOLDING = {"inlay": "Whole layers, and no deeper than border or plate allow.", "bed": "The part fits."}
_HOLDING_WIDTH = "Two lines or more."


@dataclass(frozen=True)
class Limit:
    """What a rule looked at: the value and the limit, as text."""

    measured: str
    rule: str


def rule_findings(design: Design, check: PrintCheck) -> Findings:
    """The findings, worst first, then the rules that hold without a word."""
    limits = rule_limits(design)
    nothing = Limit("", "")
    rows = []
    for found in sorted(check.findings, key=lambda finding: _ORDER.index(finding.level)):
        limit = limits.get(found.rule, nothing)
        title = ", ".join(_TITLES.get(rule, rule) for rule in found.rules)
        rows.append(Finding(_LEVELS[found.level], title, sentence(found.text), limit.measured, limit.rule))
    said = {rule for finding in check.findings for rule in finding.rules}
    for rule in check.holding:
        if rule not in said:
            limit = limits.get(rule, nothing)
            text = _HOLDING.get(rule, _HOLDING_WIDTH)
            rows.append(Finding("good", _TITLES.get(rule, rule), text, limit.measured, limit.rule))
    return Findings(tuple(rows))


def rule_limits(design: Design) -> dict[str, Limit]:
    """By rule: what the print has there, the ink offset included, and from where on it is good."""
    printing, widths = design.job.printing, narrowest_widths(design.target)
    offset = printing.ink_offset_mm
    inked_sides = 2 if widths.border_mm > 0 else 1
    have = {
        "stroke": widths.stroke_mm + 2 * offset,
        "centre": widths.centre_mm - 2 * offset,
        "gap": widths.gap_mm - 2 * offset,
        "margin": widths.margin_mm - inked_sides * offset,
        "border": widths.border_mm + offset,
    }
    good = f"at least {2 * printing.pattern_line_mm:g} mm"
    limits = {rule: Limit(f"{width:.3g} mm", good) for rule, width in have.items()}
    layer = printing.printer.layer_height_mm
    limits["inlay"] = Limit(f"{printing.inlay_mm:g} mm", f"layers of {layer:g} mm")
    size = " x ".join(f"{length:.0f}" for length in printed_size_mm(design.target, printing))
    bed = " x ".join(f"{length:g}" for length in printing.printer.bed_mm)
    limits["bed"] = Limit(f"{size} mm", f"of {bed} mm")
    return limits


def rule_lead(design: Design, check: PrintCheck) -> str:
    """What the rules were held to."""
    printing = design.job.printing
    held = f"Held to lines of {printing.pattern_line_mm:g} mm"
    if printing.is_two_filament:
        held += f" and layers of {printing.printer.layer_height_mm:g} mm"
    if any(finding.level == "warning" for finding in check.findings):
        return f"{held}. What warns can be made, but comes out less true to the drawing."
    return f"{held}."


def sentence(remark: str) -> str:
    """A remark as a sentence."""
    return f"{capital(remark)}."
