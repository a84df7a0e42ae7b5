"""How a part, and tiles side by side, lie on the bed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from designer.base.solid import Solid, regular_polygon
from designer.builds.design import Design
from designer.kinds.ico import icosahedron
from designer.kinds.sizing import printer_of, size_job
from designer.make.assembly import BED_RIM_MM, nest
from designer.make.bed import TOWER_MM, bed_from_target, printed_size_mm
from designer.spec.machine import BRIM_MM, TOWER_DEPTH_MM, Machine
from designer.spec.options import AskedPrinting
from designer.spec.spec import PrinterProfile
from tests.support.designs import COARSE, asked_for, ink_of, small, small_board, small_ico

PHI = (1 + 5**0.5) / 2


@pytest.fixture(params=[small_ico, small_board], ids=["ico", "board"], scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    return request.param()


def vertices_of(design: Design) -> np.ndarray:
    """Body and ink: the icosahedron's corners belong to the border.  # (V, 3)"""
    return np.concatenate([design.part.body.vertices_mm, ink_of(design).vertices_mm])


def on_bed(design: Design, motion: np.ndarray) -> np.ndarray:
    return vertices_of(design) @ motion[:3, :3].T + motion[:3, 3]


@pytest.mark.parametrize("bed_mm", [(250.0, 210.0, 220.0), (210.0, 250.0, 220.0)])
def test_part_is_centred_with_its_long_side_along_the_beds(design: Design, bed_mm: tuple[float, float, float]) -> None:
    """The bounding box is in the middle of the bed, its longer side along the bed's longer side."""
    printing = replace(design.job.printing, printer=replace(design.job.printing.printer, bed_mm=bed_mm))
    vertices = on_bed(design, bed_from_target(design.target, printing))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert ((low + high) / 2)[:2] == pytest.approx(np.array(bed_mm)[:2] / 2)
    size = printed_size_mm(design.target, printing)
    assert high - low == pytest.approx(np.array(size))
    if size[0] != pytest.approx(size[1]):
        assert (size[1] > size[0]) == (bed_mm[1] > bed_mm[0])


def test_icosahedron_size_on_its_face() -> None:
    """Face down, an icosahedron of edge a needs 1.868 a by 1.618 a on the bed and is 1.512 a high."""
    design = small_ico()
    expected = 20 * np.array([2 * PHI / 3**0.5, PHI, PHI**2 / 3**0.5])
    assert printed_size_mm(design.target, design.job.printing) == pytest.approx(expected)


def test_a_body_stands_on_its_largest_face_though_it_has_no_rings() -> None:
    """A dome of edge a stands on its pentagon: (1 + sqrt 5) / 2 a across, 1.3764 a high, its top vertex up."""
    design = small("dome")
    motion = bed_from_target(design.target, design.job.printing)
    vertices = on_bed(design, motion)
    lowest = np.unique(vertices[vertices[:, 2] < 1e-6].round(6), axis=0)
    assert motion[2, :3] == pytest.approx(np.array([0.0, 0.0, 1.0]))
    assert len(lowest) == 5
    assert np.linalg.norm(lowest[:, None] - lowest, axis=2).max() == pytest.approx(20 * PHI)
    assert vertices[:, 2].max() == pytest.approx(20 * (1 + 5**-0.5) * np.sin(0.4 * np.pi))


def test_size_follows_shrinkage_compensation(design: Design) -> None:
    """A part printed 1 % larger needs 1 % more, in height too, and still stands on the bed."""
    printing = replace(design.job.printing, shrink_compensation_percent=1.0)
    assert np.array(printed_size_mm(design.target, printing)) == pytest.approx(
        1.01 * np.array(printed_size_mm(design.target, design.job.printing))
    )
    motion = bed_from_target(design.target, printing)
    height = 1.01 * vertices_of(design) @ motion[2, :3] + motion[2, 3]
    assert height.min() == pytest.approx(0.0, abs=1e-9)


def test_body_under_stickers_is_smaller() -> None:
    """Each face of a body for stickers lies their thickness further in, so the body is lower by twice as much."""
    design = small_ico()
    printing = replace(design.job.printing, build="stickers", sticker_thickness_mm=0.25)
    height = np.ptp(Solid(icosahedron(), 20.0).corners_mm() @ bed_from_target(design.target, printing)[2, :3])
    assert printed_size_mm(design.target, printing)[2] == pytest.approx(height - 0.5)


@given(
    st.tuples(st.floats(5, 120), st.floats(5, 120)),
    st.lists(st.tuples(*[st.integers(0, 90)] * 2, *[st.integers(3, 60)] * 2), max_size=2),
    st.floats(0, 6),
)
@settings(max_examples=60, deadline=None)
def test_what_fits_lies_clear_of_what_the_bed_excludes(
    size_mm: tuple[float, float], areas: list[tuple[int, int, int, int]], free_mm: float
) -> None:
    """A rectangle is placed as near to the middle as a search over all corners finds, and nowhere only if none does."""
    excluded = tuple((float(x), float(y), float(x + w), float(y + d)) for x, y, w, d in areas)
    printer = PrinterProfile("any", (110.0, 100.0, 50.0), 0.4, 0.45, 0.2, Machine(excluded_mm=excluded))
    low = np.full(2, free_mm)
    high = np.array(printer.bed_mm[:2]) - free_mm - size_mm
    middle = (np.array(printer.bed_mm[:2]) - size_mm) / 2
    edges = [
        np.array([middle[k], low[k], high[k], *(one[k] - free_mm - size_mm[k] for one in excluded),
                  *(one[k + 2] + free_mm for one in excluded)])
        for k in (0, 1)
    ]  # fmt: skip
    corners = np.stack(np.meshgrid(*edges), axis=-1).reshape(-1, 2)
    right = ((corners >= low - 1e-7) & (corners <= high + 1e-7)).all(axis=1)
    for one in excluded:
        before, after = np.array(one[:2]) - free_mm - size_mm, np.array(one[2:]) + free_mm
        right &= ((corners <= before + 1e-7) | (corners >= after - 1e-7)).any(axis=1)
    place = printer.place_mm(size_mm, free_mm)
    assert (place is None) == (not right.any())
    if place is not None:
        nearest = np.linalg.norm(corners[right] - middle, axis=1).min()
        assert np.linalg.norm(place - middle) == pytest.approx(nearest, abs=1e-5)


def test_parts_and_brims_lie_clear_of_the_cutters_corner() -> None:
    """On a P1S a board of 220 x 200 mm and its brim are clear of 18 x 28 mm in front left.

    So it is on an A1: the strip for the prime tower is free before it, where the cutter's corner lies too.
    """
    for name in ("bambu-p1s", "bambu-a1"):
        sized = size_job(asked_for("board", {"size": "220x200mm", "printer": name, "chord_error": COARSE}))
        design = Design(sized.job)
        corners = on_bed(design, bed_from_target(design.target, sized.job.printing))
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        assert (low - BRIM_MM >= -1e-9).all()
        assert (high + BRIM_MM <= 256 + 1e-9).all()
        assert (low + high)[0] / 2 == pytest.approx(128.0)
        assert low[1] == pytest.approx(TOWER_DEPTH_MM + BRIM_MM)
        assert low[1] - BRIM_MM >= 28


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
