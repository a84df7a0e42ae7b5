"""Equal tiles on the printer's beds: as many as fit side by side, turned together, beside the prime tower.

The corner that is left for the tower is as long as PrusaSlicer's tower is wide: others are narrower.
"""

import math
from dataclasses import dataclass

import numpy as np

from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.solid import regular_polygon
from designer.make.tower import TOWER_MM
from designer.spec.spec import PrinterProfile

SPACINGS_MM = (8.0, 5.0, 3.0, 2.0, 1.5)
"""Between tiles, the widest first: 8 mm leave room for two brims of 4 mm."""
BED_RIM_MM = 2.0
"""Free along the bed's rim: an assumption, as machines differ."""
_TURNS = np.radians(np.arange(0.0, 120.0, 5.0))
_SHIFTS = 12


@dataclass(frozen=True, eq=False)
class Nest:
    """Where tiles lie on a bed."""

    bed_from_tile: Array  # (N, 3, 3) motions of the plane
    spacing_mm: float


def nest(sides: int, inradius_mm: float, count: int, printer: PrinterProfile) -> tuple[Nest, ...]:
    """Regular polygons on as few beds as they fit on, then evenly and as far apart as that allows.

    Args:
        sides: 3 or 4.
        inradius_mm: of a tile where it is widest.
        count: of tiles.
        printer: whose beds they are; the corner with the highest x and y stays free for a prime tower.

    Raises:
        InputError: not one fits.
    """
    densest = _lattice(sides, inradius_mm, SPACINGS_MM[-1], printer)
    if not len(densest):
        excluded = f"what it excludes ({printer.excluded_words}) and " if printer.excluded_mm else ""
        bed = " x ".join(f"{side:g}" for side in printer.bed_mm[:2])
        raise InputError(f"a tile does not fit a bed of {bed}mm beside {excluded}a prime tower")
    beds = math.ceil(count / len(densest))
    each = math.ceil(count / beds)
    spacing, lattice = SPACINGS_MM[-1], densest
    for spacing in SPACINGS_MM:
        lattice = _lattice(sides, inradius_mm, spacing, printer)
        if len(lattice) >= each:
            break
    shares = [each] * (count // each) + ([count % each] if count % each else [])
    return tuple(Nest(lattice[:share], spacing) for share in shares)


def largest_inradius_mm(sides: int, printer: PrinterProfile) -> float:
    """Of a tile that fits a bed alone, to a tenth of a millimetre."""
    low, high = 0.0, max(printer.bed_mm[:2]) / 2
    while high - low > 0.1:
        middle = (low + high) / 2
        if len(_lattice(sides, middle, SPACINGS_MM[-1], printer)):
            low = middle
        else:
            high = middle
    return low


def _lattice(sides: int, inradius: float, spacing: float, printer: PrinterProfile) -> Array:
    """The densest of the tilings that are turned and shifted by steps: tiles inside, those in the middle first."""
    bed, cell = printer.bed_mm[:2], inradius + spacing / 2
    taken = [np.array(area) + spacing / 2 * np.array([-1, -1, 1, 1]) for area in printer.excluded_mm]
    taken.append(np.array([bed[0] - TOWER_MM, bed[1] - TOWER_MM, *bed]))
    cells = _cells(sides, cell, math.hypot(*bed))
    outline = regular_polygon(sides, inradius)
    corners = np.einsum("nij,kj->nki", cells[:, :2, :2], outline) + cells[:, None, :2, 2]
    step = 2 * cell * (math.sqrt(3) if sides == 3 else 1.0)
    best = cells[:0]
    middle = np.array(bed) / 2
    for turn in _TURNS[2 * math.pi / sides - 1e-9 > _TURNS].tolist():
        cosine, sine = math.cos(turn), math.sin(turn)
        turned = corners @ np.array([[cosine, sine], [-sine, cosine]])
        for u in np.linspace(0, step, _SHIFTS, endpoint=False).tolist():
            for v in np.linspace(0, step, _SHIFTS, endpoint=False).tolist():
                moved = turned + middle + [u, v]
                inside = (moved >= BED_RIM_MM).all(axis=(1, 2)) & (moved <= np.array(bed) - BED_RIM_MM).all(axis=(1, 2))
                if inside.sum() <= len(best):
                    continue
                for area in taken:
                    inside &= _clear_of(moved, area)
                if inside.sum() > len(best):
                    motion = np.array([[cosine, -sine, middle[0] + u], [sine, cosine, middle[1] + v], [0, 0, 1]])
                    best = motion @ cells[inside]
    order = np.argsort(np.round(np.linalg.norm(best[:, :2, 2] - middle, axis=1), 6), kind="stable")
    return best[order]


def _cells(sides: int, inradius: float, reach: float) -> Array:
    """Motions of the plane that tile it around the origin.  # (N, 3, 3)"""
    side = 2 * inradius * math.tan(math.pi / sides)
    count = math.ceil(reach / side) + 1
    around = range(-count, count + 1)
    cells = []
    for i in around:
        for j in around:
            if sides == 4:
                cells.append(_motion(0.0, side * i, side * j))
            else:
                x, y = side * (i + j / 2), 3 * inradius * j
                cells.append(_motion(0.0, x, y))
                cells.append(_motion(math.pi, x + side / 2, y + inradius))
    return np.array([cell for cell in cells if math.hypot(cell[0, 2], cell[1, 2]) < reach])


def _motion(turn: float, x: float, y: float) -> Array:
    cosine, sine = math.cos(turn), math.sin(turn)
    return np.array([[cosine, -sine, x], [sine, cosine, y], [0.0, 0.0, 1.0]])


def _clear_of(corners: Array, area: Array) -> Flags:
    """Whether convex polygons stay out of a rectangle: a side of theirs, or one of the rectangle's, parts them."""
    low, high = area[:2], area[2:]
    after = np.roll(corners, -1, axis=1)
    outward = np.stack([after[..., 1] - corners[..., 1], corners[..., 0] - after[..., 0]], axis=2)
    nearest = np.where(outward > 0, low, high)  # of the rectangle's corners, along each outward normal
    by_own_side = (((nearest - corners) * outward).sum(axis=2) >= 0).any(axis=1)
    beside = np.logical_or.reduce((corners <= low).all(axis=1) | (corners >= high).all(axis=1), axis=1)
    clear: Flags = by_own_side | beside
    return clear
