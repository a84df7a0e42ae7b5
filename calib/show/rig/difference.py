"""What differs between two rigs, as tables."""

import math

from calib.rigs.compared import CameraApart, PairDifference, RigDifference
from designer.page.blocks import Cell, Column, Table

MOST_ROWS = 15
ALIKE = 5e-7
"""A part of a length that four digits of a per cent do not show."""


def pairs_table(difference: RigDifference) -> Table:
    """Pairs of cameras, those first that differ the most."""
    pairs = sorted(difference.pairs, key=lambda one: -one.place_mm)
    head = (
        Column("cameras", is_number=False),
        *map(Column, ("baseline A (mm)", "B - A (mm)", "sigmas", "place (mm)", "turn (deg)")),
    )
    return Table("", head, tuple(_pair(one) for one in pairs[:MOST_ROWS]))


def _pair(one: PairDifference) -> tuple[Cell, ...]:
    longer = one.baseline_mm[1] - one.baseline_mm[0]
    is_known = one.baseline_sigma_mm > 0
    sigmas = f"{longer / one.baseline_sigma_mm:+.1f}" if is_known else ""
    texts = (f"{one.baseline_mm[0]:.3f}", f"{longer:+.3f}", sigmas, f"{one.place_mm:.3f}")
    return (Cell(f"{one.a} - {one.b}"), *map(Cell, texts), Cell(f"{math.degrees(one.turn_rad):.4f}"))


def cameras_table(cameras: tuple[CameraApart, ...]) -> Table:
    """How far apart the rigs see the same points in each camera, those first that differ the most."""
    order = sorted(cameras, key=lambda one: -one.rms_px if math.isfinite(one.rms_px) else 1.0)
    head = (Column("difference (px)", is_number=False), Column("RMS"), Column("max"))
    rows = ((Cell(one.name), Cell(_px(one.rms_px)), Cell(_px(one.max_px))) for one in order[:MOST_ROWS])
    return Table("", head, tuple(rows))


def _px(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "not known"


def placed_words(difference: RigDifference) -> str:
    """Where the two place the same points."""
    placed = difference.placed
    if placed is None:
        return "no two cameras see the same points in both rigs, so nothing is told in space"
    per_cent = f"{100 * abs(placed.scale):.4f} % {'longer' if placed.scale > 0 else 'shorter'}"
    longer = "as long" if abs(placed.scale) < ALIKE else per_cent
    return (
        f"the same pixels are placed {placed.rms_mm:.4f} mm apart (RMS; at most {placed.max_mm:.4f} mm), and lengths "
        f"by B are {longer}: {placed.points} points of {placed.volume}, B laid over A"
    )
