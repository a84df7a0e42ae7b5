"""Design rules: what a printer (or a print shop) can and cannot make of a target.

Every rule looks at the target's own numbers, so a file made by hand is checked like one that was designed here.
A new rule is one function in `RULES`.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from designer.bed import printed_size_mm
from designer.polyhedron import DIHEDRAL_RAD, INSET_PER_DEPTH
from designer.spec import PrintSpec
from designer.target import TargetGeometry

Level = Literal["violation", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """What a rule says of a target."""

    rule: str
    level: Level
    text: str  # the value, the rule, the remedy


@dataclass(frozen=True)
class Check:
    """All findings, and the rules that hold."""

    findings: tuple[Finding, ...]
    holding: tuple[str, ...]

    @property
    def violations(self) -> tuple[Finding, ...]:
        """The findings that forbid the print."""
        return tuple(f for f in self.findings if f.level == "violation")


Rule = Callable[[TargetGeometry, PrintSpec], Iterator[Finding]]


def check_printability(target: TargetGeometry, printing: PrintSpec, *, bed_is_rule: bool) -> Check:
    """Hold a target to all design rules.

    Args:
        target: any target geometry.
        printing: how it is to be made.
        bed_is_rule: whether a part larger than the bed is a violation (else a warning).
    """
    findings: list[Finding] = []
    holding: list[str] = []
    for name, rule in RULES.items():
        found = list(rule(target, printing))
        if name == "bed" and not bed_is_rule:
            found = [Finding(f.rule, "warning", f.text) for f in found]
        findings += found
        if not any(f.level != "note" for f in found):
            holding.append(name)
    return Check(tuple(findings), tuple(holding))


def _width_rule(rule: str, what: str, width: float, remedy: str, printing: PrintSpec) -> Iterator[Finding]:
    """A printed width of at least one line is needed, of two is good."""
    line = printing.printer.line_width_mm
    if not printing.is_two_filament or width >= 2 * line - 1e-9:
        return
    if width < line - 1e-9:
        yield Finding(rule, "violation", f"{what} {width:.3g}mm is less than one line of {line:g}mm; {remedy}")
    else:
        text = f"{what} {width:.3g}mm is less than two lines ({2 * line:g}mm) and prints less truly; {remedy}"
        yield Finding(rule, "warning", text)


def _stroke(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    is_ring = ~target.is_dot
    if is_ring.any():
        stroke = float((target.radius_outer_mm - target.radius_inner_mm)[is_ring].min()) + 2 * printing.ink_offset_mm
        yield from _width_rule("stroke", "ring stroke", stroke, "use larger rings or a finer nozzle", printing)


def _centre(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    is_ring = ~target.is_dot
    if is_ring.any():
        width = 2 * (float(target.radius_inner_mm[is_ring].min()) - printing.ink_offset_mm)
        yield from _width_rule("centre", "white ring centre", width, "use larger rings or a finer nozzle", printing)


def _gap(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    a, b = target.lattice_mm[:, 0], target.lattice_mm[:, 1]
    steps = np.stack([a, b, a - b, a + b])
    pitch = float(np.linalg.norm(steps, axis=2).min())
    gap = pitch - 2 * float(target.radius_outer_mm.max()) - 2 * printing.ink_offset_mm
    yield from _width_rule("gap", "gap between rings", gap, "use a larger pitch or smaller rings", printing)


def _clearance_to_polygon(target: TargetGeometry) -> float:
    """Least distance from a ring's outer edge to its face's window."""
    corner = target.window_mm[target.ring_face]  # (R, K, 2)
    edge = np.roll(corner, -1, axis=1) - corner
    to_center = target.center_in_face_mm[:, None, :2] - corner
    cross = edge[..., 0] * to_center[..., 1] - edge[..., 1] * to_center[..., 0]
    inside = cross / np.linalg.norm(edge, axis=2)
    return float((inside - target.radius_outer_mm[:, None]).min())


def _margin(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    # The ink offset moves the rings' edges, and the border's where there is one.
    edges = 2 if border_width_mm(target) > 0 else 1
    margin = _clearance_to_polygon(target) - edges * printing.ink_offset_mm
    if margin <= 0:
        yield Finding("margin", "violation", "rings touch the border or the edge; use fewer rings or a smaller pitch")
    else:
        yield from _width_rule(
            "margin", "white around the rings", margin, "use a larger margin or fewer rings", printing
        )


def border_width_mm(target: TargetGeometry) -> float:
    """Width of the border on the lowest side; 0 without one."""
    return float(target.window_mm[0, :, 1].min() - target.outline_mm[0, :, 1].min())


def _border(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    width = border_width_mm(target)
    if target.face_count > 1 or width > 0:
        remedy = "use a wider border or a finer nozzle"
        yield from _width_rule("border", "border", width + printing.ink_offset_mm, remedy, printing)


def _inlay(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    if not printing.is_two_filament:
        return
    depth, layer = printing.inlay_mm, printing.printer.layer_height_mm
    layers = depth / layer
    if layers < 1 - 1e-9:
        yield Finding(
            "inlay", "violation", f"inlay {depth:g}mm is less than one layer of {layer:g}mm; use at least {layer:g}mm"
        )
    elif abs(layers - round(layers)) > 1e-6:
        good = math.ceil(layers) * layer
        yield Finding(
            "inlay", "warning", f"inlay {depth:g}mm is no multiple of the layer height {layer:g}mm; use {good:.4g}mm"
        )
    if target.face_count > 1 and depth < 0.9 - 1e-9:
        yield Finding(
            "inlay",
            "warning",
            f"inlay {depth:g}mm fills steep faces only in part (70 % at 0.6mm); use 0.9mm or more if the border allows",
        )
    if target.face_count > 1 and border_width_mm(target) <= INSET_PER_DEPTH * depth:
        yield Finding(
            "inlay",
            "violation",
            f"inlay {depth:g}mm undercuts a border of {border_width_mm(target):.3g}mm; use a shallower inlay",
        )


def _bed(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    if printing.build == "sheet":
        return
    size, bed = printed_size_mm(target, printing), printing.printer.bed_mm
    flat_fits = sorted(size[:2])[0] <= min(bed[:2]) and sorted(size[:2])[1] <= max(bed[:2])
    if not flat_fits or size[2] > bed[2]:
        shown = " x ".join(f"{length:.1f}" for length in size)
        room = " x ".join(f"{length:g}" for length in bed)
        yield Finding(
            "bed",
            "violation",
            f"the part needs {shown} mm, the bed of {printing.printer.name} has {room} mm; "
            "use a smaller target or a larger printer",
        )


def _overhang(target: TargetGeometry, printing: PrintSpec) -> Iterator[Finding]:
    if target.face_count > 1:
        slope = math.degrees(math.pi - DIHEDRAL_RAD)
        yield Finding(
            "overhang",
            "note",
            f"the three faces beside the bottom face rise at {slope:.1f} deg from the bed: "
            "most printers do that without supports; put supports on if yours does not",
        )


RULES: dict[str, Rule] = {
    "stroke": _stroke,
    "centre": _centre,
    "gap": _gap,
    "margin": _margin,
    "border": _border,
    "inlay": _inlay,
    "bed": _bed,
    "overhang": _overhang,
}
