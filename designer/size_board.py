"""Sizes of a board, from what was asked for."""

import math
from collections.abc import Iterator

from designer.errors import InputError
from designer.size_rules import (
    DIAMETER_OVER_PITCH,
    Line,
    check_count,
    check_rings,
    chosen_ring,
    chosen_words,
    diameter_and_pitch,
)
from designer.spec import RING_RATIO, BoardSpec, Lattice
from designer.spec_file import BoardFile
from designer.units import format_mm, round_down, round_up

RINGS_ACROSS = 22
"""A board's shorter side over its pitch, as on the paper's 3DBoard."""
THICKNESS_MM = 5.0
"""Of a plate, as on the paper's 3DBoard."""


def size_board(asked: BoardFile, line: Line) -> tuple[BoardSpec, str]:
    """Choose the sizes that were left open, and say how.

    Raises:
        InputError: sizes that no board can have, or that the process cannot make.
    """
    lattice: Lattice = asked.lattice or "square"
    _check_extent(asked)
    if asked.size is not None and asked.ring_diameter is None and asked.pitch is None:
        diameter, pitch = _auto_board_rings(asked, min(asked.size), line)
    else:
        diameter, pitch = diameter_and_pitch(asked)
    check_rings(diameter, asked.ring_ratio or RING_RATIO, pitch, line)
    border = asked.border or 0.0
    margin = asked.margin if asked.margin is not None else pitch / 2
    around = diameter + 2 * (border + margin)
    row_step = pitch * (1.0 if lattice == "square" else math.sqrt(3) / 2)
    if asked.size is None:
        columns, rows = asked.columns or 0, asked.rows or 0  # both are given
        size = (round_up((columns - 1) * pitch + around), round_up((rows - 1) * row_step + around))
    else:
        size = asked.size
        columns = asked.columns or 1 + math.floor((size[0] - around) / pitch + 1e-9)
        rows = asked.rows or 1 + math.floor((size[1] - around) / row_step + 1e-9)
    spec = BoardSpec(
        size_mm=size,
        thickness_mm=asked.thickness or THICKNESS_MM,
        columns=columns,
        rows=rows,
        lattice=lattice,
        ring_diameter_mm=diameter,
        ring_ratio=asked.ring_ratio or RING_RATIO,
        pitch_mm=pitch,
        border_mm=border,
        margin_mm=margin,
        dots=asked.dots is not False,
    )
    _check_board(spec, line, ((columns - 1) * pitch + around, (rows - 1) * row_step + around))
    return spec, chosen_words(_chosen(asked, spec))


def _check_extent(asked: BoardFile) -> None:
    """Refuse a board of which too little is said, with all that it needs.

    Raises:
        InputError: neither its size, nor its rings and their distance.
    """
    has_rings = asked.columns is not None and asked.rows is not None
    has_distance = asked.pitch is not None or asked.ring_diameter is not None
    if asked.size is None and not (has_rings and has_distance):
        raise InputError(
            "a board needs its size, or its rings and their distance; give --size 200x200mm, or --columns 10 --rows 7 "
            "--pitch 20mm"
        )


def _chosen(asked: BoardFile, spec: BoardSpec) -> Iterator[str]:
    """What was not given, and why it is as it is."""
    pitch = spec.pitch_mm
    if asked.pitch is None and asked.ring_diameter is None:
        finest = pitch > round_down(min(spec.size_mm) / RINGS_ACROSS)
        why = "the least of two lines a stroke" if finest else f"1/{RINGS_ACROSS} of the shorter side, as in the paper"
        yield f"pitch {pitch:g}mm ({why})"
    yield from chosen_ring(asked, spec)
    if asked.columns is None or asked.rows is None:
        yield f"{spec.columns} x {spec.rows} rings (as many as fit)"
    if asked.size is None:
        yield f"board {format_mm(*spec.size_mm)} (rings and margin)"
    if asked.margin is None:
        yield f"margin {spec.margin_mm:g}mm (half the pitch)"
    if asked.thickness is None:
        yield f"thickness {spec.thickness_mm:g}mm (as in the paper)"


def _auto_board_rings(asked: BoardFile, shorter_mm: float, line: Line) -> tuple[float, float]:
    """Diameter and pitch in the paper's proportions, not finer than two lines a stroke."""
    ratio = asked.ring_ratio or RING_RATIO
    finest = line.comfortable_mm * max(2 / (1 - ratio), 1 / ratio) / DIAMETER_OVER_PITCH
    pitch = max(round_down(shorter_mm / RINGS_ACROSS), math.ceil(10 * finest) / 10)
    return round_down(DIAMETER_OVER_PITCH * pitch), pitch


def _check_board(spec: BoardSpec, line: Line, needed_mm: tuple[float, float]) -> None:
    """The rules of a board but those of its rings, whoever chose the sizes."""
    if spec.columns < 3 or spec.rows < 3:
        raise InputError(
            f"a board of {format_mm(*spec.size_mm)} holds {max(spec.columns, 0)} x {max(spec.rows, 0)} rings at pitch "
            f"{spec.pitch_mm:g}mm; it must hold 3 x 3: use a larger board or a smaller pitch"
        )
    if any(need > have + 1e-9 for need, have in zip(needed_mm, spec.size_mm, strict=True)):
        raise InputError(
            f"{spec.columns} x {spec.rows} rings with their margin need {needed_mm[0]:.4g} x {needed_mm[1]:.4g}mm, "
            f"more than the board's {format_mm(*spec.size_mm)}; use fewer rings, a smaller pitch or a smaller margin"
        )
    if 0 < spec.border_mm < line.nozzle_mm:
        raise InputError(
            f"border {spec.border_mm:g}mm is thinner than {line.process}; "
            f"use 0 for none or at least {line.width_mm:g}mm"
        )
    if spec.margin_mm + spec.border_mm <= 0:
        raise InputError("margin 0mm lets rings touch the board's edge; use a margin of at least one line")
    check_count(spec.columns * spec.rows, line)
