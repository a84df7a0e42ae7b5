"""What changes of filament throw away: purge, and the tower that is printed of it beside the part.

    >>> purged(estimate.changing, printer).volume_mm3

The tower is PrusaSlicer's (`GCode/WipeTower.cpp`, of which those of Bambu Studio and OrcaSlicer descend): a box around
lines of purge, from a solid foot with a brim up to the last change. The first three lines of a change are slow, since
the filament has just been loaded. What other slicers do for towers that are high and thin is not in it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from designer.spec.spec import PrinterProfile

TOWER_MM, TOWER_BRIM_MM = 60.0, 2.0
"""Width of PrusaSlicer's wipe tower, and its brim; others are narrower and deeper."""
_FIRST_LINES, _NEXT_LINE = (0.33, 0.375, 0.458), 0.875
"""How fast the lines of a change are, as shares of the full speed; those that follow approach it."""
_GAIN_MM_S = 50 / 60
"""By how much a line is faster than the one before it."""
_BOX = 2900 / 4800
"""How fast the box is, as a share of the full speed."""


@dataclass(frozen=True)
class Purged:
    """What all changes of a print purge."""

    volume_mm3: float
    time_s: float


def purged(changing: Sequence[int], printer: PrinterProfile) -> Purged:
    """By the layers that change filament: first to the ink, then back to the body, and so on."""
    machine, change = printer.machine, printer.machine.change
    flow_mm3_s = min(change.purge_flow_mm3_s, machine.flow_mm3_s)
    volumes = [change.purge_to_body_mm3 if k % 2 else change.purge_to_ink_mm3 for k in range(len(changing))]
    if not changing or not change.has_tower:
        return Purged(sum(volumes), sum(volumes) / flow_mm3_s)
    line_mm2 = printer.line_width_mm * printer.layer_height_mm
    speed_mm_s, layers = flow_mm3_s / line_mm2, changing[-1] + 1
    laid = [min(volume, change.most_on_tower_mm3) for volume in volumes]
    most_mm3 = min(max(change.purge_to_ink_mm3, change.purge_to_body_mm3), change.most_on_tower_mm3)
    deep_mm = most_mm3 / (TOWER_MM * printer.layer_height_mm)
    # Purge fills the box line by line: it is rounded up to whole ones, half a line on the mean; the ends are walls.
    walls_mm = (2 * deep_mm + TOWER_MM / 2) * layers
    # The foot is solid; a change in the first layer is a part of it.
    foot_mm = TOWER_MM * deep_mm * printer.layer_height_mm / line_mm2 - (laid[0] / line_mm2 if changing[0] == 0 else 0)
    brim_mm = 2 * (TOWER_MM + deep_mm) * TOWER_BRIM_MM * printer.layer_height_mm / line_mm2
    # Some of the purge is laid down as the box.
    box_mm = 2 * (TOWER_MM + deep_mm) * layers
    lines_mm = max(sum(laid) / line_mm2 + walls_mm - box_mm, 0.0) / len(changing)
    first_mm_s = min(machine.speeds.first_layer_mm_s, speed_mm_s)
    time_s = (
        (sum(volumes) - sum(laid)) / flow_mm3_s
        + len(changing) * _lines_s(lines_mm, speed_mm_s)
        + box_mm / (_BOX * speed_mm_s)
        + (foot_mm + brim_mm) / first_mm_s
    )
    return Purged(sum(volumes) + (walls_mm + foot_mm + brim_mm) * line_mm2, time_s)


def _lines_s(length_mm: float, speed_mm_s: float) -> float:
    """The lines of one change, as long together as told."""
    after = max(math.ceil(length_mm / TOWER_MM) - len(_FIRST_LINES), 0)
    speeds = [*(share * speed_mm_s for share in _FIRST_LINES)]
    speeds += [min(_NEXT_LINE * speed_mm_s + k * _GAIN_MM_S, speed_mm_s) for k in range(after)]
    lengths = np.clip(length_mm - TOWER_MM * np.arange(len(speeds)), 0, TOWER_MM)
    return float((lengths / np.array(speeds)).sum())
