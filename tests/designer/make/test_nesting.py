"""Tiles side by side on beds."""

from dataclasses import replace

import numpy as np
import pytest
from shapely import Polygon, box

from designer.base.solid import regular_polygon
from designer.kinds.sizing import printer_of
from designer.make.assembly import BED_RIM_MM, nest
from designer.make.bed import TOWER_MM
from designer.spec.options import AskedPrinting


@pytest.mark.parametrize(("sides", "inradius_mm"), [(3, 20.0), (4, 18.0)])
@pytest.mark.parametrize("excluded", [(), ((0.0, 0.0, 18.0, 28.0),), ((100.0, 90.0, 130.0, 120.0),)])
def test_tiles_lie_on_the_bed_clear_of_each_other_of_the_tower_and_of_what_is_excluded(
    sides: int, inradius_mm: float, excluded: tuple[tuple[float, float, float, float], ...]
) -> None:
    """As polygons of others: inside the rim, apart by the spacing, and none in an area that is not theirs."""
    printer = printer_of(AskedPrinting(printer="bambu-p1s"))
    printer = replace(printer, machine=replace(printer.machine, excluded_mm=excluded))
    outline = regular_polygon(sides, inradius_mm)
    bed = box(0, 0, *printer.bed_mm[:2]).buffer(-BED_RIM_MM + 1e-6)
    taken = [box(*area) for area in excluded]
    taken.append(box(printer.bed_mm[0] - TOWER_MM + 1e-6, printer.bed_mm[1] - TOWER_MM + 1e-6, *printer.bed_mm[:2]))
    nests = nest(sides, inradius_mm, 40, printer)
    assert sum(len(one.bed_from_tile) for one in nests) == 40
    for one in nests:
        tiles = [Polygon(outline @ motion[:2, :2].T + motion[:2, 2]) for motion in one.bed_from_tile]
        for tile in tiles:
            assert bed.covers(tile)
            assert not any(tile.intersects(area) for area in taken)
        apart = [a.distance(b) for k, a in enumerate(tiles) for b in tiles[:k]]
        assert np.min(apart) > one.spacing_mm - 1e-6
