"""Design rules: what a printer (or a print shop) can and cannot make of a target.

Every rule looks at the target's own numbers, so a file made by hand or measured is checked like one that was
designed here. A new rule is one function and one line in `RULES`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from designer.base.units import round_down
from designer.base.words import capital
from designer.kinds.layout import Widths, border_width_mm, deepest_inlay_mm, inset_per_depth, narrowest_widths
from designer.make.bed import bed_words, overhang, printed_size_mm
from designer.page.blocks import Finding, Findings
from designer.page.blocks import Level as PageLevel
from designer.spec.build import BUILDS, builds_of
from designer.spec.machine import BRIM_MM
from designer.spec.spec import PAPER_LINE_MM, PrintSpec
from designer.target import TargetGeometry

Level = Literal["violation", "warning", "note"]
LEVELS: Mapping[Level, PageLevel] = {"violation": "bad", "warning": "usable", "note": "note"}
"""On a page, the worst first."""

_ROUNDING_MM = 1e-6
"""Centres in a target file are rounded, so a width may miss its design by a little."""
COUNT = ("no", "one", "two", "three", "four", "five")
STEEP_FACE_INLAY_MM = 0.9
"""Steep faces of a one-piece print fill to 93 % from here on."""


def count_words(count: int) -> str:
    """`two`; of many the number."""
    return COUNT[count] if count < len(COUNT) else str(count)


@dataclass(frozen=True)
class PrintFinding:
    """What a rule says of a target, or several rules that say the same."""

    rule: str  # its name; of several their names with commas
    level: Level
    text: str  # the value, the rule, the remedy

    @property
    def rules(self) -> tuple[str, ...]:
        """The names of the rules that say so."""
        return tuple(self.rule.split(", "))


@dataclass(frozen=True)
class Narrow:
    """A width that can be made, but less well than a wider one."""

    size: str  # what it is, and how wide
    limit: str  # "two lines (0.9mm)"
    effect: tuple[str, str]  # what comes of it, of one and of several: "prints less truly", "print less truly"
    remedy: str


@dataclass(frozen=True)
class RuleLook:
    """What a rule looked at, and what it has to say."""

    measured: str = ""  # with its unit
    limit: str = ""  # from where on it is good
    said: tuple[tuple[Level, str | Narrow], ...] = ()
    holding: str = ""  # said where it holds, in place of the rule's own words
    title: str = ""  # in place of the rule's own

    @property
    def holds(self) -> bool:
        """Whether nothing stands against the print."""
        return all(level == "note" for level, _ in self.said)


@dataclass(frozen=True)
class Rule:
    """A design rule; its look is None where it does not apply."""

    title: str
    look: Callable[[TargetGeometry, PrintSpec], RuleLook | None]
    holding: str = "Two lines or more."  # said where it holds


@dataclass(frozen=True)
class PrintCheck:
    """All findings, and what each rule that applies looked at."""

    findings: tuple[PrintFinding, ...]
    looks: Mapping[str, RuleLook]

    @property
    def holding(self) -> tuple[str, ...]:
        """The rules that hold."""
        return tuple(name for name, look in self.looks.items() if look.holds)

    @property
    def violations(self) -> tuple[PrintFinding, ...]:
        """The findings that forbid the print."""
        return tuple(f for f in self.findings if f.level == "violation")

    def title_of(self, rule: str) -> str:
        """What a rule is called of this target."""
        return (self.looks[rule].title if rule in self.looks else "") or RULES[rule].title

    def told(self) -> Findings:
        """The findings for a reader, worst first, then the rules that hold without a word."""
        rows = []
        for found in sorted(self.findings, key=lambda finding: [*LEVELS].index(finding.level)):
            look = self.looks[found.rule] if found.rule in self.looks else RuleLook()
            title = ", ".join(map(self.title_of, found.rules))
            rows.append(Finding(LEVELS[found.level], title, sentence(found.text), look.measured, look.limit))
        said = {rule for finding in self.findings for rule in finding.rules}
        for name in self.holding:
            if name not in said:
                rule, look = RULES[name], self.looks[name]
                text = look.holding or rule.holding
                rows.append(Finding("good", self.title_of(name), text, look.measured, look.limit))
        return Findings(tuple(rows))


def sentence(remark: str) -> str:
    """A remark as a sentence."""
    return f"{capital(remark)}."


def check_printability(target: TargetGeometry, printing: PrintSpec) -> PrintCheck:
    """Hold a target to all design rules that apply to it.

    Args:
        target: any target geometry.
        printing: how it is to be made.
    """
    looks = {name: look for name, rule in RULES.items() if (look := rule.look(target, printing)) is not None}
    findings: list[PrintFinding] = []
    narrow: dict[str, Narrow] = {}
    for name, look in looks.items():
        for level, text in look.said:
            if isinstance(text, Narrow):
                narrow[name] = text
            else:
                findings.append(PrintFinding(name, level, text))
    return PrintCheck((*_said_once(narrow), *findings), looks)


def _said_once(narrow: Mapping[str, Narrow]) -> Iterator[PrintFinding]:
    """Widths that fall short of the same limit in one sentence, as one remedy mends them."""
    for limit in dict.fromkeys(one.limit for one in narrow.values()):
        alike = {name: one for name, one in narrow.items() if one.limit == limit}
        first = next(iter(alike.values()))
        if len(alike) == 1:
            text = f"{first.size} is less than {limit} and {first.effect[0]}; {first.remedy}"
        else:
            *others, last = (one.size for one in alike.values())
            text = (
                f"{', '.join(others)} and {last} are less than {limit} and {first.effect[1]}; "
                "use a larger target, fewer rings or a finer nozzle"
            )
        yield PrintFinding(", ".join(alike), "warning", text)


_LARGER = "use larger squares or tags, or a finer nozzle"
OF_MARKS: Mapping[str, tuple[str, str, str]] = {
    "ring stroke": ("narrowest black", _LARGER, "Narrowest black"),
    "gap between rings": ("narrowest white", _LARGER, "Narrowest white"),
    "white around the rings": ("white around the marks", "use a larger margin", "White around the marks"),
}
"""Of other detectors' marks: what a width is of, what makes it wider, and the rule's title."""


def _width(
    what: str, remedy: str, width_mm: Callable[[Widths, float], float]
) -> Callable[[TargetGeometry, PrintSpec], RuleLook | None]:
    """The rule of a width: what the nozzle can lay is needed, one line fills well, two lines are good.

    Args:
        what: it is the width of.
        remedy: what makes it wider.
        width_mm: of a target's narrowest widths and the ink offset; infinite where there is no such thing.
    """

    def look(target: TargetGeometry, printing: PrintSpec) -> RuleLook | None:
        widths, offset = narrowest_widths(target), printing.ink_offset_mm
        width = width_mm(widths, offset)
        if math.isinf(width):
            return None
        of, better, title = (what, remedy, "") if target.marks is None else OF_MARKS.get(what, (what, remedy, ""))
        least, line = PAPER_LINE_MM, PAPER_LINE_MM  # what can be made of ink and white, and the finest line
        if printing.way.is_two_filament:
            least, line = printing.printer.nozzle_mm, printing.printer.line_width_mm
        is_by_offset = width < least <= width_mm(widths, 0.0)
        mend = "use an ink offset nearer to 0 or a finer nozzle" if is_by_offset else better
        is_graded = target.spec is not None and target.spec.is_graded
        good = line if is_graded else 2 * line
        size, said = f"{of} {width:.3g}mm", tuple[tuple[Level, str | Narrow], ...]()
        if width < least - _ROUNDING_MM:
            said = (("violation", f"{size} is less than {least:g}mm, the least that can be made; {mend}"),)
        elif width < line - _ROUNDING_MM:
            effect = ("over-extrudes", "over-extrude")
            said = (("warning", Narrow(size, f"one line ({line:g}mm)", effect, better)),)
        elif width < good - _ROUNDING_MM:
            effect = ("prints less truly", "print less truly")
            said = (("warning", Narrow(size, f"two lines ({2 * line:g}mm)", effect, better)),)
        holding = "One line or more: fine marks are what it is for." if is_graded else ""
        return RuleLook(f"{width:.3g} mm", f"≥ {good:g} mm", said, holding, title)

    return look


_border_look = _width("border", "use a wider border or a finer nozzle", lambda w, offset: w.border_mm + offset)


def _border(target: TargetGeometry, printing: PrintSpec) -> RuleLook | None:
    """A plate may do without."""
    return _border_look(target, printing) if not target.is_plate or border_width_mm(target) > 0 else None


def _inlay(target: TargetGeometry, printing: PrintSpec) -> RuleLook | None:
    if not printing.way.is_two_filament:
        return None
    said = tuple(_inlay_remarks(target, printing))
    return RuleLook(f"{printing.inlay_mm:g} mm", f"layers of {printing.printer.layer_height_mm:g} mm", said)


def _inlay_remarks(target: TargetGeometry, printing: PrintSpec) -> Iterator[tuple[Level, str]]:
    depth, layer = printing.inlay_mm, printing.printer.layer_height_mm
    layers, what = depth / layer, {"flush": "inlay", "raised": "relief", "recessed": "groove"}[printing.way.ink]
    if layers < 1 - 1e-9:
        yield "violation", f"{what} {depth:g}mm is less than one layer of {layer:g}mm; use at least {layer:g}mm"
    elif abs(layers - round(layers)) > 1e-6:
        level: Level = "violation" if printing.way.ink == "raised" else "warning"  # the filament changes between two
        good = math.ceil(layers) * layer
        yield level, f"{what} {depth:g}mm is no multiple of the layer height {layer:g}mm; use {good:.4g}mm"
    if target.is_plate:
        yield from _plate_remarks(target, depth, layer, what)
        return
    if depth < STEEP_FACE_INLAY_MM - 1e-9 and not printing.way.is_in_parts:
        yield (
            "warning",
            f"{what} {depth:g}mm fills steep faces only in part (70 % at 0.6mm); "
            f"use {STEEP_FACE_INLAY_MM:g}mm or more if the border allows",
        )
    border, wall = border_width_mm(target), math.inf if target.spec is None else target.spec.depth_mm
    if depth >= wall:
        deepest = round_down(deepest_inlay_mm(target))
        yield "violation", f"{what} {depth:g}mm goes through walls {wall:g}mm thick; use at most {deepest:g}mm"
    if border <= inset_per_depth(target) * depth:
        deepest = round_down(deepest_inlay_mm(target))
        yield (
            "violation",
            f"{what} {depth:g}mm undercuts a border of {border:.3g}mm; use at most {deepest:g}mm or a wider border",
        )


def _plate_remarks(target: TargetGeometry, depth: float, layer: float, what: str) -> Iterator[tuple[Level, str]]:
    """Ink may not go through; of two sides, the upper one's begins at a layer only if the plate ends at one."""
    if target.spec is None:
        return
    thickness, sides = target.spec.depth_mm, target.face_count
    if depth * sides >= thickness:
        yield "violation", f"{what} {depth:g}mm goes through the board; use at most {thickness / (2 * sides):g}mm"
    layers = thickness / layer
    if sides > 1 and abs(layers - round(layers)) > 1e-6:
        good = math.ceil(layers) * layer
        yield (
            "warning",
            f"thickness {thickness:g}mm is no multiple of the layer height {layer:g}mm, so that the ink above "
            f"is off by part of a layer; use {good:.4g}mm",
        )


def _bed(target: TargetGeometry, printing: PrintSpec) -> RuleLook | None:
    if not printing.way.has_body or printing.way.is_in_parts:  # whose plates are made, or refused
        return None
    size, printer = printed_size_mm(target, printing), printing.printer
    said: tuple[tuple[Level, str], ...] = ()
    shown = " x ".join(f"{length:.1f}" for length in size)
    if printer.place_mm(size[:2]) is None or size[2] > printer.bed_mm[2]:
        names = [name for name in builds_of(target.form) if BUILDS[name].is_in_parts and not target.has_back]
        in_parts = "".join(f", build {name}" for name in names)
        remedy = f"use a smaller target{in_parts} or a larger printer"
        if printer.place_mm((size[1], size[0])) is not None and size[2] <= printer.bed_mm[2]:
            remedy = "turned by a quarter it fits: turn it, and say --bed-turn 90deg to calib measure"
        said = (("violation", f"the part needs {shown} mm, {bed_words(printer)}; {remedy}"),)
    elif printer.place_mm(size[:2], BRIM_MM) is None:
        text = f"the part takes {shown} mm and leaves no room for a brim of {BRIM_MM:g} mm: {bed_words(printer)}"
        said = (("note", f"{text}; print it without, or with a narrower one"),)
    lies = " x ".join(f"{round(length, 1 if length < 10 else 0):g}" for length in size)
    room = " x ".join(f"{length:g}" for length in printer.bed_mm)
    but = f", without {printer.excluded_words}" if printer.machine.excluded_mm else ""
    return RuleLook(f"{lies} mm", f"of {room} mm{but}", said)


def _overhang(target: TargetGeometry, printing: PrintSpec) -> RuleLook | None:
    over = None if printing.way.is_in_parts else overhang(target, printing)
    if over is None:
        return None
    count, slope = over
    which = f"the {count_words(count)} faces beside the bottom face rise"
    if count == 1:
        which = "the face beside the bottom face rises"
    text = (
        f"{which} at {math.degrees(slope):.1f} deg from the bed: "
        "most printers do that without supports; put supports on if yours does not"
    )
    return RuleLook(said=(("note", text),))


RULES: dict[str, Rule] = {
    "stroke": Rule(
        "Ring stroke",
        _width("ring stroke", "use larger rings or a finer nozzle", lambda w, offset: w.stroke_mm + 2 * offset),
    ),
    "centre": Rule(
        "White ring centre",
        _width("white ring centre", "use larger rings or a finer nozzle", lambda w, offset: w.centre_mm - 2 * offset),
    ),
    "gap": Rule(
        "Gap between rings",
        _width("gap between rings", "use a larger pitch or smaller rings", lambda w, offset: w.gap_mm - 2 * offset),
    ),
    "margin": Rule(
        "White around rings",
        _width(
            "white around the rings",
            "use a larger margin or fewer rings",
            lambda w, offset: w.margin_mm - w.inked_sides * offset,
        ),
    ),
    "border": Rule("Border", _border),
    "inlay": Rule("Ink depth", _inlay, "Whole layers, and no deeper than border or plate allow."),
    "bed": Rule("Size on the bed", _bed, "The part fits."),
    "overhang": Rule("Overhang", _overhang),
}
