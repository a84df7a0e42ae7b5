"""Sizes of an icosahedron, from what was asked for.

They start from the paper's proportions at edge 100 mm: 8 rings a side, diameter 7 mm, pitch 10 mm, border 2 mm.
"""

import math
from collections.abc import Iterator

from designer.code import MIN_RINGS_PER_SIDE
from designer.errors import InputError
from designer.polyhedron import INRADIUS
from designer.size_rules import (
    DIAMETER_OVER_PITCH,
    Line,
    check_count,
    check_rings,
    chosen_ring,
    chosen_words,
    diameter_and_pitch,
    widths_mm,
)
from designer.spec import RING_RATIO, IcoSpec
from designer.spec_file import IcoFile
from designer.units import round_down

PAPER_RINGS_PER_SIDE = 8
BORDER_OVER_EDGE = 0.02
INRADIUS_OVER_SIDE = 1 / (2 * math.sqrt(3))
"""Of an equilateral triangle."""
MARGIN_OVER_PITCH = (INRADIUS_OVER_SIDE - BORDER_OVER_EDGE) / 0.1 - 7 * INRADIUS_OVER_SIDE - DIAMETER_OVER_PITCH / 2
"""White between the outermost rings and the border that the paper's proportions leave."""
LEAST_INRADIUS_MM = 2.0
"""Less would leave no body behind the ink."""


def size_ico(asked: IcoFile, line: Line) -> tuple[IcoSpec, str]:
    """Choose the sizes that were left open, and say how.

    Raises:
        InputError: sizes that no icosahedron can have, or that the process cannot make.
    """
    ratio = asked.ring_ratio or RING_RATIO
    if asked.rings_per_side is not None and asked.rings_per_side < MIN_RINGS_PER_SIDE:
        raise InputError(
            f"rings_per_side {asked.rings_per_side} is too few to tell 20 faces apart; "
            f"use at least {MIN_RINGS_PER_SIDE}"
        )
    if asked.border is not None and asked.border < line.nozzle_mm:
        raise InputError(
            f"border {asked.border:g}mm is too narrow for the detector to tell faces apart by it, and for "
            f"{line.process}; use at least {line.width_mm:g}mm"
        )
    if asked.rings_per_side is None and asked.ring_diameter is None and asked.pitch is None:
        spec, remark = _auto_ico(asked, ratio, line)
    else:
        spec = _sized_ico(asked, ratio, line)
        remark = chosen_words(_chosen(asked, spec))
    _check_ico(spec, line)
    return spec, remark


def _auto_ico(asked: IcoFile, ratio: float, line: Line) -> tuple[IcoSpec, str]:
    """The most rings, up to the paper's 8 a side, whose strokes, gaps and border are two lines wide.

    For a number of rings the paper's proportions come first, then the widest strokes between gaps of two lines.
    """
    comfort = line.comfortable_mm
    border = _border_mm(asked, comfort)
    for rings in range(PAPER_RINGS_PER_SIDE, MIN_RINGS_PER_SIDE - 1, -1):
        for spec in (_filled_ico(asked, rings, border, ratio), _packed_ico(asked, rings, ratio, comfort)):
            if spec is not None and min(_chosen_widths(asked, spec)) >= comfort - 1e-9:
                why = f"strokes, gaps and border of at least two lines ({comfort:g}mm) of {line.process}"
                most = "as in the paper" if rings == PAPER_RINGS_PER_SIDE else "the most"
                return spec, f"auto: {rings} rings a side, {most} with {why}"
    return _tight_ico(asked, ratio, line)


def _border_mm(asked: IcoFile, least: float) -> float:
    """The border as asked for, else its share of the edge, but no less than `least`."""
    return asked.border if asked.border is not None else round(max(BORDER_OVER_EDGE * asked.edge, least), 4)


def _chosen_widths(asked: IcoFile, spec: IcoSpec) -> list[float]:
    """Strokes, gaps, and border and margin where they were left open."""
    widths = list(widths_mm(spec))
    widths += [spec.border_mm] if asked.border is None else []
    return widths + ([spec.margin_mm] if asked.margin is None else [])


def _filled_ico(asked: IcoFile, rings: int, border: float, ratio: float) -> IcoSpec | None:
    """The pitch that fills the face's window with `rings` a side, or None where there is no window."""
    window_inradius = INRADIUS_OVER_SIDE * asked.edge - border
    per_pitch = (rings - 1) * INRADIUS_OVER_SIDE + DIAMETER_OVER_PITCH / 2
    if asked.margin is None:
        pitch = round_down(window_inradius / (per_pitch + MARGIN_OVER_PITCH))
        margin = round_down(MARGIN_OVER_PITCH * pitch)
    else:
        pitch, margin = round_down((window_inradius - asked.margin) / per_pitch), asked.margin
    diameter = round_down(DIAMETER_OVER_PITCH * pitch)
    return IcoSpec(asked.edge, rings, diameter, ratio, pitch, border, margin) if diameter > 0 else None


def _packed_ico(asked: IcoFile, rings: int, ratio: float, gap: float) -> IcoSpec | None:
    """The widest strokes that leave gaps, margin and border of `gap`, or None where nothing is left for rings."""
    border = _border_mm(asked, gap)
    margin = asked.margin if asked.margin is not None else gap
    # inradius of the window = (rings - 1) pitch k + diameter / 2 + margin, with diameter = pitch - gap
    window_inradius = INRADIUS_OVER_SIDE * asked.edge - border
    pitch = round_down((window_inradius - margin + gap / 2) / ((rings - 1) * INRADIUS_OVER_SIDE + 0.5))
    diameter = round_down(pitch - gap)
    return IcoSpec(asked.edge, rings, diameter, ratio, pitch, border, margin) if diameter > 0 else None


def _tight_ico(asked: IcoFile, ratio: float, line: Line) -> tuple[IcoSpec, str]:
    """Five rings a side with the widest stroke that leaves gaps and border one line."""
    width, rings = line.width_mm, MIN_RINGS_PER_SIDE
    spec = _packed_ico(asked, rings, ratio, width)
    if spec is None or min(widths_mm(spec)[:2]) < width:
        raise InputError(
            f"edge {asked.edge:g}mm{_given(asked)} is too small for {rings} rings a side with {line.process}; "
            f"use at least {_smallest_edge_mm(asked, ratio, width):g}mm{line.finer}"
        )
    return spec, (
        f"auto: {rings} rings a side, the fewest that carry a face code; gaps and border are one line ({width:g}mm) of "
        f"{line.process} only: for two lines everywhere use a larger edge or a finer nozzle"
    )


def _smallest_edge_mm(asked: IcoFile, ratio: float, width: float) -> float:
    """The smallest edge, in tenths of a millimetre, on which `_tight_ico` finds room."""
    rings = MIN_RINGS_PER_SIDE
    least_diameter = width * max(2 / (1 - ratio), 1 / ratio)
    margin = asked.margin if asked.margin is not None else width
    window_inradius = (rings - 1) * INRADIUS_OVER_SIDE * (least_diameter + width) + least_diameter / 2 + margin
    edge = _edge_around(asked, window_inradius, width)
    # Pitch and diameter are rounded down to a hundredth: take the next tenth that still leaves the stroke its width.
    tenths = math.floor(10 * edge)
    while True:
        spec = _packed_ico(asked.model_copy(update={"edge": tenths / 10}), rings, ratio, width)
        if spec is not None and min(widths_mm(spec)[:2]) >= width:
            return tenths / 10
        tenths += 1


def _sized_ico(asked: IcoFile, ratio: float, line: Line) -> IcoSpec:
    """Complete sizes of which some are given."""
    border = _border_mm(asked, line.width_mm)
    if asked.ring_diameter is None and asked.pitch is None and asked.rings_per_side is not None:
        spec = _filled_ico(asked, asked.rings_per_side, border, ratio)
        if spec is None:
            raise InputError(
                f"edge {asked.edge:g}mm has no room inside a border of {border:g}mm; use a narrower border"
            )
        return spec
    diameter, pitch = diameter_and_pitch(asked)
    check_rings(diameter, ratio, pitch, line)
    margin = asked.margin if asked.margin is not None else round(pitch - diameter, 4)
    room = INRADIUS_OVER_SIDE * asked.edge - border - diameter / 2 - margin
    rings = asked.rings_per_side or 1 + math.floor(room / (INRADIUS_OVER_SIDE * pitch) + 1e-9)
    if room < 0 or rings < MIN_RINGS_PER_SIDE:
        raise InputError(
            f"edge {asked.edge:g}mm{_given(asked)} cannot carry {MIN_RINGS_PER_SIDE} rings a side of {diameter:g}mm "
            f"at pitch {pitch:g}mm; use {_what_fits(asked, ratio, line, diameter, pitch)}"
        )
    return IcoSpec(asked.edge, rings, diameter, ratio, pitch, border, margin)


def _chosen(asked: IcoFile, spec: IcoSpec) -> Iterator[str]:
    """What was not given beside the sizes of rings that were, and why it is as it is."""
    fills_face = asked.ring_diameter is None and asked.pitch is None
    if fills_face:
        yield f"pitch {spec.pitch_mm:g}mm (fills the face)"
    yield from chosen_ring(asked, spec)
    if asked.rings_per_side is None:
        yield f"{spec.rings_per_side} rings a side (as many as fit)"
    if asked.border is None:
        yield f"border {spec.border_mm:g}mm ({BORDER_OVER_EDGE:g} of the edge, but no less than a line)"
    if asked.margin is None:
        why = "the paper's share of the pitch" if fills_face else "at least the gap between rings"
        yield f"margin {spec.margin_mm:g}mm ({why})"


def _what_fits(asked: IcoFile, ratio: float, line: Line, diameter: float, pitch: float) -> str:
    """The largest rings that fit on the edge, if any can be made, and the smallest edge for the rings."""
    across = (MIN_RINGS_PER_SIDE - 1) * INRADIUS_OVER_SIDE
    window_inradius = across * pitch + diameter / 2 + (pitch - diameter if asked.margin is None else asked.margin)
    edge = f"an edge of at least {math.ceil(10 * _edge_around(asked, window_inradius, line.width_mm) + 0.01) / 10:g}mm"
    room = INRADIUS_OVER_SIDE * asked.edge - _border_mm(asked, line.width_mm) - (asked.margin or 0.0)
    largest = round_down(room * diameter / (window_inradius - (asked.margin or 0.0)))
    its_pitch = round_down(largest * pitch / diameter)
    narrowest = min(largest / 2 * (1 - ratio), largest * ratio, its_pitch - largest)
    return edge if narrowest < line.nozzle_mm else f"rings of at most {largest:g}mm at pitch {its_pitch:g}mm, or {edge}"


def _edge_around(asked: IcoFile, window_inradius: float, least_border: float) -> float:
    """The edge whose border leaves a window of this inradius."""
    least = LEAST_INRADIUS_MM / INRADIUS
    if asked.border is not None:
        return max(least, (window_inradius + asked.border) / INRADIUS_OVER_SIDE)
    # The border is one line, or its share of the edge.
    shared = window_inradius / (INRADIUS_OVER_SIDE - BORDER_OVER_EDGE)
    return max(least, (window_inradius + least_border) / INRADIUS_OVER_SIDE, shared)


def _given(asked: IcoFile) -> str:
    """The border and margin that were asked for, since they take room too."""
    parts = [f"{name} {value:g}mm" for name, value in (("border", asked.border), ("margin", asked.margin)) if value]
    return f" with {' and '.join(parts)}" if parts else ""


def _check_ico(spec: IcoSpec, line: Line) -> None:
    """The rules of an icosahedron, whoever chose the sizes."""
    check_rings(spec.ring_diameter_mm, spec.ring_ratio, spec.pitch_mm, line)
    room = INRADIUS_OVER_SIDE * spec.edge_mm - spec.border_mm - spec.ring_diameter_mm / 2
    margin = room - (spec.rings_per_side - 1) * INRADIUS_OVER_SIDE * spec.pitch_mm
    if margin < max(spec.margin_mm, 1e-6) - 1e-9:
        fitting = 1 + math.floor(max(room - spec.margin_mm, 0) / (INRADIUS_OVER_SIDE * spec.pitch_mm) + 1e-9)
        raise InputError(
            f"{spec.rings_per_side} rings a side leave a margin of {margin:.3g}mm to the border, "
            f"less than {spec.margin_mm:g}mm; "
            f"use at most {fitting} rings a side, a smaller pitch, or a smaller margin"
        )
    check_count(10 * spec.rings_per_side * (spec.rings_per_side + 1), line)
    if INRADIUS * spec.edge_mm < LEAST_INRADIUS_MM:
        least = math.ceil(10 * LEAST_INRADIUS_MM / INRADIUS) / 10
        raise InputError(f"edge {spec.edge_mm:g}mm leaves no body behind the ink; use at least {least:g}mm")
