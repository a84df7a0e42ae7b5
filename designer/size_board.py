"""Sizes of a board, from what was asked for."""

import math

from designer.errors import InputError
from designer.size_rules import (
    DIAMETER_OVER_PITCH,
    Line,
    check_count,
    check_rings,
    diameter_and_pitch,
)
from designer.spec import RING_RATIO, BoardSpec, Lattice
from designer.spec_file import BoardFile
from designer.units import format_mm, round_down, round_up

RINGS_ACROSS = 22
"""A board's shorter side over its pitch, as on the paper's 3DBoard."""


def size_board(asked: BoardFile, line: Line) -> tuple[BoardSpec, str]:
    """Choose the sizes that were left open, and say how.

    Raises:
        InputError: sizes that no board can have, or that the process cannot make.
    """
    lattice: Lattice = asked.lattice or "square"
    if asked.ring_diameter is None and asked.pitch is None:
        diameter, pitch = _auto_board_rings(asked, line)
        remark = f"auto: pitch {pitch:g}mm and rings of {diameter:g}mm"
    else:
        diameter, pitch = diameter_and_pitch(asked)
        remark = "sizes: as given"
    check_rings(diameter, asked.ring_ratio or RING_RATIO, pitch, line)
    border = asked.border or 0.0
    margin = asked.margin if asked.margin is not None else pitch / 2
    around = diameter + 2 * (border + margin)
    row_step = pitch * (1.0 if lattice == "square" else math.sqrt(3) / 2)
    if asked.size is None:
        if asked.columns is None or asked.rows is None:
            raise InputError("a board needs its size or its rings; give --size 220x220mm, or --columns 10 --rows 7")
        columns, rows = asked.columns, asked.rows
        size = (round_up((columns - 1) * pitch + around), round_up((rows - 1) * row_step + around))
    else:
        size = asked.size
        columns = asked.columns or 1 + math.floor((size[0] - around) / pitch + 1e-9)
        rows = asked.rows or 1 + math.floor((size[1] - around) / row_step + 1e-9)
    spec = BoardSpec(
        size_mm=size,
        thickness_mm=asked.thickness or 5.0,
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
    return spec, remark


def _auto_board_rings(asked: BoardFile, line: Line) -> tuple[float, float]:
    """Diameter and pitch in the paper's proportions, not finer than two lines a stroke."""
    ratio = asked.ring_ratio or RING_RATIO
    if asked.size is None:
        raise InputError(
            "a board without a size needs the distance of its rings; give --pitch, for example --pitch 10mm"
        )
    finest = line.comfortable_mm * max(2 / (1 - ratio), 1 / ratio) / DIAMETER_OVER_PITCH
    pitch = max(round_down(min(asked.size) / RINGS_ACROSS), math.ceil(10 * finest) / 10)
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
