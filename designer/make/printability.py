"""Design rules: what a printer (or a print shop) can and cannot make of a target.

Every rule looks at the target's own numbers, so a file made by hand or measured is checked like one that was
designed here. A new rule is one function and one line in `RULES`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from designer.base.units import round_down
from designer.kinds.layout import border_width_mm, deepest_inlay_mm, inset_per_depth, narrowest_widths
from designer.make.bed import overhang, printed_size_mm
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

Level = Literal["violation", "warning", "note"]

_ROUNDING_MM = 1e-6
"""Centres in a target file are rounded, so a width may miss its design by a little."""
COUNT = ("no", "one", "two", "three", "four", "five")
STEEP_FACE_INLAY_MM = 0.9
"""Steep faces of a one-piece print fill to 93 % from here on."""


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
class PrintCheck:
    """All findings, and the rules that hold; a rule that does not apply is in neither."""

    findings: tuple[PrintFinding, ...]
    holding: tuple[str, ...]

    @property
    def violations(self) -> tuple[PrintFinding, ...]:
        """The findings that forbid the print."""
        return tuple(f for f in self.findings if f.level == "violation")


@dataclass(frozen=True)
class Narrow:
    """A width that can be made, but less well than a wider one."""

    what: str
    width_mm: float
    limit: str  # "two lines (0.9mm)"
    effect: tuple[str, str]  # what comes of it, of one and of several: "prints less truly", "print less truly"
    remedy: str

    @property
    def size(self) -> str:
        """What it is, and how wide."""
        return f"{self.what} {self.width_mm:.3g}mm"


Remarks = Iterator[tuple[Level, str | Narrow]]


@dataclass(frozen=True)
class Rule:
    """A design rule: whether it applies, and what it has to say."""

    applies: Callable[[TargetGeometry, PrintSpec], bool]
    look: Callable[[TargetGeometry, PrintSpec], Remarks]


def check_printability(target: TargetGeometry, printing: PrintSpec, *, bed_is_rule: bool) -> PrintCheck:
    """Hold a target to all design rules that apply to it.

    Args:
        target: any target geometry.
        printing: how it is to be made.
        bed_is_rule: whether a part larger than the bed is a violation (else a warning).
    """
    findings: list[PrintFinding] = []
    holding: list[str] = []
    narrow: dict[str, Narrow] = {}
    for name, rule in RULES.items():
        if not rule.applies(target, printing):
            continue
        said = list(rule.look(target, printing))
        for level, text in said:
            if isinstance(text, Narrow):
                narrow[name] = text
            else:
                findings.append(PrintFinding(name, "warning" if name == "bed" and not bed_is_rule else level, text))
        if not any(level != "note" for level, _ in said):
            holding.append(name)
    return PrintCheck((*_said_once(narrow), *findings), tuple(holding))


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


def _width(what: str, width: float, remedy: str, printing: PrintSpec) -> Remarks:
    """A width the nozzle can lay is needed, one line fills well, two lines are good."""
    least, line = printing.pattern_least_mm, printing.pattern_line_mm
    if width < least - _ROUNDING_MM:
        yield "violation", f"{what} {width:.3g}mm is less than {least:g}mm, the least that can be made; {remedy}"
    elif width < line - _ROUNDING_MM:
        yield "warning", Narrow(what, width, f"one line ({line:g}mm)", ("over-extrudes", "over-extrude"), remedy)
    elif width < 2 * line - _ROUNDING_MM:
        effect = ("prints less truly", "print less truly")
        yield "warning", Narrow(what, width, f"two lines ({2 * line:g}mm)", effect, remedy)


def _stroke(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    width = narrowest_widths(target).stroke_mm + 2 * printing.ink_offset_mm
    return _width("ring stroke", width, "use larger rings or a finer nozzle", printing)


def _centre(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    width = narrowest_widths(target).centre_mm - 2 * printing.ink_offset_mm
    return _width("white ring centre", width, "use larger rings or a finer nozzle", printing)


def _gap(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    width = narrowest_widths(target).gap_mm - 2 * printing.ink_offset_mm
    return _width("gap between rings", width, "use a larger pitch or smaller rings", printing)


def _margin(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    widths = narrowest_widths(target)
    inked_sides = 2 if widths.border_mm > 0 else 1
    width = widths.margin_mm - inked_sides * printing.ink_offset_mm
    return _width("white around the rings", width, "use a larger margin or fewer rings", printing)


def _border(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    width = border_width_mm(target) + printing.ink_offset_mm
    return _width("border", width, "use a wider border or a finer nozzle", printing)


def _inlay(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    depth, layer = printing.inlay_mm, printing.printer.layer_height_mm
    layers = depth / layer
    if layers < 1 - 1e-9:
        yield "violation", f"inlay {depth:g}mm is less than one layer of {layer:g}mm; use at least {layer:g}mm"
    elif abs(layers - round(layers)) > 1e-6:
        good = math.ceil(layers) * layer
        yield "warning", f"inlay {depth:g}mm is no multiple of the layer height {layer:g}mm; use {good:.4g}mm"
    if target.is_planar:
        if target.spec is not None and depth >= target.spec.depth_mm:
            yield "violation", f"inlay {depth:g}mm goes through the board; use at most {target.spec.depth_mm / 2:g}mm"
        return
    if depth < STEEP_FACE_INLAY_MM - 1e-9:
        yield (
            "warning",
            f"inlay {depth:g}mm fills steep faces only in part (70 % at 0.6mm); "
            f"use {STEEP_FACE_INLAY_MM:g}mm or more if the border allows",
        )
    border = border_width_mm(target)
    if border <= inset_per_depth(target) * depth:
        deepest = round_down(deepest_inlay_mm(target))
        yield (
            "violation",
            f"inlay {depth:g}mm undercuts a border of {border:.3g}mm; use at most {deepest:g}mm or a wider border",
        )


def _bed(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    size, bed = printed_size_mm(target, printing), printing.printer.bed_mm
    is_too_wide = min(size[:2]) > min(bed[:2]) or max(size[:2]) > max(bed[:2])
    if is_too_wide or size[2] > bed[2]:
        shown = " x ".join(f"{length:.1f}" for length in size)
        room = " x ".join(f"{length:g}" for length in bed)
        yield (
            "violation",
            f"the part needs {shown} mm, the bed of {printing.printer.name} has {room} mm; "
            "use a smaller target or a larger printer",
        )


def _overhang(target: TargetGeometry, printing: PrintSpec) -> Remarks:
    over = overhang(target, printing)
    if over is not None:
        count, slope = over
        yield (
            "note",
            f"the {COUNT[count]} faces beside the bottom face rise at {math.degrees(slope):.1f} deg from the bed: "
            "most printers do that without supports; put supports on if yours does not",
        )


def _always(target: TargetGeometry, printing: PrintSpec) -> bool:
    return True


def _has_rings(target: TargetGeometry, printing: PrintSpec) -> bool:
    return not target.is_dot.all()


RULES: dict[str, Rule] = {
    "stroke": Rule(_has_rings, _stroke),
    "centre": Rule(_has_rings, _centre),
    "gap": Rule(_always, _gap),
    "margin": Rule(_always, _margin),
    "border": Rule(lambda target, printing: not target.is_planar or border_width_mm(target) > 0, _border),
    "inlay": Rule(lambda target, printing: printing.is_two_filament, _inlay),
    "bed": Rule(lambda target, printing: printing.build != "sheet", _bed),
    "overhang": Rule(lambda target, printing: overhang(target, printing) is not None, _overhang),
}
