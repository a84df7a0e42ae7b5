"""Solids in parts: tiles, core and post, held against each other by mesh booleans."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from manifold3d import JoinType, Manifold

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.solid import Polyhedron
from designer.base.units import skew_matrix
from designer.builds.design import Design
from designer.builds.tiles import assembly_of as assembly_in_tiles
from designer.kinds.sizing import size_job
from designer.make.assembly import Assembly, assemble, plates_of
from designer.make.core import split_of
from designer.make.mesh import cone, cylinder, frame_along, placed, prism, solid_of
from designer.make.mounts import MOUNTS, mounted, room_mm
from designer.make.pattern import moved_in
from designer.make.tile import TileSizes, key_places, number_contours, tile_sizes
from designer.spec.kind import KINDS, kind_named
from designer.spec.spec import InkSide
from designer.target_scene import polygon_area_mm2
from tests.support import designs
from tests.support.designs import COARSE, asked_for

SOLIDS = [name for name in KINDS if kind_named(name).spec.form == "solid"]
NOTHING_MM3 = 1e-6
CLEARANCE_MM, LINE_MM = 0.15, 0.45
each_solid = pytest.mark.parametrize("kind", SOLIDS)


@cache
def design_of(kind: str, edge_mm: float = 100.0) -> Design:
    """A design whose rings are coarse: fits do not ask for them."""
    return designs.design_of(kind, edge=edge_mm, chord_error="0.2mm")


@cache
def assembly_of(kind: str, edge_mm: float = 100.0, ink_side: InkSide = "down") -> Assembly:
    """Its parts."""
    design = design_of(kind, edge_mm)
    solid = design.job.target.solid
    assert solid is not None
    return assemble(design.target, solid, replace(design.job.printing, inlay_mm=0.6, ink_side=ink_side))


def pin(sizes: TileSizes) -> Manifold:
    """A pin that hangs from z = 0, and reaches a little into the tile."""
    length, radius = sizes.glue_gap_mm + sizes.engaged_mm, sizes.key_mm / 2
    tip = min(0.2 * sizes.key_mm, length / 3)
    shaft = cylinder(radius, tip - length, 2 * sizes.layer_mm)
    return shaft + cone(radius - tip, radius, tip).translate((0.0, 0.0, -length))


def in_place(assembly: Assembly, face: int, out_mm: float = 0.0) -> Manifold:
    """A tile's body where it belongs, or so far out along its normal."""
    out = np.eye(4)
    out[2, 3] = out_mm
    return placed(solid_of(assembly.tiles[face].body), assembly.target_from_tile[face] @ out)


def beside(assembly: Assembly, face: int) -> list[int]:
    """Faces that share a corner or more."""
    corners = assembly.solid.polyhedron.faces
    return [other for other in range(len(corners)) if other != face and set(corners[other]) & set(corners[face])]


@each_solid
@pytest.mark.parametrize("ink_side", ["down", "up"])
def test_tiles_are_closed_and_hold_the_ink_that_one_piece_has(kind: str, ink_side: InkSide) -> None:
    """Body and ink share no volume, together they are one closed solid, and rings keep their area."""
    assembly = assembly_of(kind, ink_side=ink_side)
    for tile in (assembly.tiles[0], assembly.tiles[-1]):  # one whole, one at the mount
        assert tile.ink is not None
        body, ink = solid_of(tile.body), solid_of(tile.ink)
        assert (body ^ ink).volume() < NOTHING_MM3
        # Where booleans cut both, a sheet without volume may stay between them.
        assert sum(abs(piece.volume()) > NOTHING_MM3 for piece in (body + ink).decompose()) == 1
        assert (body + ink).volume() == pytest.approx(body.volume() + ink.volume(), rel=1e-9)
    design = design_of(kind)
    mine = design.target.ring_face == 0
    disc = np.pi * (design.target.radius_outer_mm[mine] ** 2 - design.target.radius_inner_mm[mine] ** 2)
    border = assembly.sizes.outline_at(0.6)
    assert design.target.ring_count
    section = solid_of(assembly.tiles[0].ink or assembly.tiles[0].body).slice(-0.6 + 1e-6).area()
    window = float(polygon_area_mm2(border) - polygon_area_mm2(design.target.window_mm[0]))
    assert section == pytest.approx(disc.sum() + window, rel=5e-3)


@each_solid
def test_neighbours_are_the_clearance_apart(kind: str) -> None:
    """No two tiles overlap, and those that share an edge are as far apart as the printer needs."""
    assembly = assembly_of(kind)
    corners = assembly.solid.polyhedron.faces
    for other in beside(assembly, 0):
        gap = in_place(assembly, 0).min_gap(in_place(assembly, other), 1.0)
        if len(set(corners[0]) & set(corners[other])) == 2:
            assert gap == pytest.approx(CLEARANCE_MM, abs=1e-6)
        else:
            assert gap > CLEARANCE_MM


@each_solid
def test_keys_of_a_tile_are_those_of_its_own_seat_only(kind: str) -> None:
    """All tiles over all seats in all turns: only in the own seat, unturned, does each pin find a hole."""
    assembly = assembly_of(kind)
    codes, sides = assembly.solid.polyhedron.face_code, assembly.solid.polyhedron.sides
    holes = [key_places(assembly.sizes, code) for code in codes]
    fitting = [
        (tile, seat, turn)
        for tile, seat, turn in itertools.product(range(len(codes)), range(len(codes)), range(sides))
        if _farthest(holes[tile] @ _turned(turn / sides).T, holes[seat]) < assembly.sizes.key_mm
    ]
    assert fitting == [(seat, seat, 0) for seat in range(len(codes))]


def _farthest(pins: Array, holes: Array) -> float:
    """How far the pin that is worst off is from a hole."""
    return float(np.linalg.norm(pins[:, None] - holes, axis=2).min(axis=1).max())


@each_solid
@pytest.mark.parametrize("edge_mm", [100.0, 55.0])
def test_seats_are_open_at_their_own_keys_only(kind: str, edge_mm: float) -> None:
    """By booleans with a pin at each spot, in a seat of each part; `bench_fits` lays all tiles over all seats."""
    assembly = assembly_of(kind, edge_mm)
    sizes, codes = assembly.sizes, assembly.solid.polyhedron.face_code
    spots = sorted({tuple(np.round(place, 6)) for code in codes for place in _in_all_turns(assembly, code)})
    for part in (part for part in assembly.core if part.seats):
        seat = part.seats[-1]
        local = placed(part.solid, np.linalg.inv(assembly.target_from_tile[seat]))
        local = local.trim_by_plane((0.0, 0.0, 1.0), -sizes.seat_depth_mm - 4.0)
        assert (solid_of(assembly.tiles[seat].body) ^ local).volume() < NOTHING_MM3
        own = key_places(sizes, codes[seat])
        for place in spots:
            overlap = (pin(sizes).translate((*place, -sizes.thickness_mm)) ^ local).volume()
            assert (overlap < NOTHING_MM3) == (_farthest(np.array([place]), own) < 1e-3)


def _in_all_turns(assembly: Assembly, code: int) -> Array:
    """Where keys of a code may come to stand.  # (N, 2)"""
    sides = assembly.solid.polyhedron.sides
    return np.concatenate([key_places(assembly.sizes, code) @ _turned(turn / sides).T for turn in range(sides)])


def _turned(turns: float) -> Array:
    cosine, sine = np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)
    return np.array([[cosine, -sine], [sine, cosine]])


@each_solid
def test_a_tile_rests_on_its_seat_and_nothing_else(kind: str) -> None:
    """It touches the core in the plane of its back, at three pads (under a lid's tile: along the rim), nowhere else."""
    assembly = assembly_of(kind)
    sizes = assembly.sizes
    for part in assembly.core:
        for face in part.seats:
            local = placed(part.solid, np.linalg.inv(assembly.target_from_tile[face]))
            touching = local.slice(-sizes.thickness_mm - 1e-4)
            if part.name == "lid":
                assert local.bounding_box()[5] == pytest.approx(-sizes.seat_depth_mm)
                continue
            assert len(touching.decompose()) == 3
            assert touching.area() == pytest.approx(3 * np.pi * sizes.pad_radius_mm**2, rel=0.01)
            assert local.bounding_box()[5] == pytest.approx(-sizes.thickness_mm)
    lidded = split_of(assembly.solid.polyhedron).lid_face
    if lidded is not None:
        rim = placed(assembly.core[0].solid, np.linalg.inv(assembly.target_from_tile[lidded]))
        assert rim.bounding_box()[5] == pytest.approx(-sizes.thickness_mm)


@each_solid
def test_every_tile_can_be_put_in_last(kind: str) -> None:
    """Along its normal it leaves and enters freely, all others and the core in place."""
    assembly = assembly_of(kind)
    core = [part.solid for part in assembly.core]
    for face in range(0, len(assembly.tiles), 5 if len(assembly.tiles) > 6 else 1):  # of caps and bands one each
        around = [in_place(assembly, other) for other in beside(assembly, face)]
        for out_mm in (0.0, 0.05, 2.0, 8.0):
            tile = in_place(assembly, face, out_mm)
            assert all((tile ^ other).volume() < NOTHING_MM3 for other in (*around, *core))


@each_solid
@pytest.mark.parametrize("edge_mm", [100.0, 55.0])
def test_core_and_post_fit_together(kind: str, edge_mm: float) -> None:
    """No two of their pieces overlap, and tiles leave the post free."""
    assembly = assembly_of(kind, edge_mm)
    pieces = [part.solid for part in assembly.core] + ([] if assembly.post is None else [assembly.post])
    for first, second in itertools.combinations(pieces, 2):
        assert (first ^ second).volume() < NOTHING_MM3
    assert all(len(piece.decompose()) == 1 for piece in pieces)
    assert sorted(face for part in assembly.core for face in part.seats) == list(range(len(assembly.tiles)))
    if assembly.post is not None:
        for face in range(len(assembly.tiles)):
            assert (in_place(assembly, face) ^ assembly.post).volume() < NOTHING_MM3


@each_solid
def test_the_upper_part_of_a_core_comes_off_with_its_tiles(kind: str) -> None:
    """Lifted along the joint's normal, it and its tiles pass those of the lower part."""
    assembly = assembly_of(kind)
    upper = next(part for part in assembly.core if part.name in ("cap", "lid"))
    low = [part for part in assembly.core if part.seats and part is not upper]
    for lift_mm in (0.1, 2.0, 20.0):
        lifted = [upper.solid, *(in_place(assembly, face) for face in upper.seats)]
        for moved, part in itertools.product(lifted, low):
            there = moved.translate(tuple(lift_mm * upper.up))
            near = [in_place(assembly, face) for face in part.seats if lift_mm == 0.1 or face % 4 == 0]
            assert all((there ^ other).volume() < NOTHING_MM3 for other in (part.solid, *near))


@each_solid
def test_a_tile_can_be_pushed_out_from_inside(kind: str) -> None:
    """A stick passes through the hole behind each tile, along its normal, into the hollow or out of the open side."""
    assembly = assembly_of(kind)
    sizes = assembly.sizes
    for part in assembly.core:
        for face in part.seats:
            local = placed(part.solid, np.linalg.inv(assembly.target_from_tile[face]))
            stick = cylinder(0.8 * sizes.push_radius_mm, -assembly.solid.inradius_mm, 0.0)
            assert (stick ^ local).volume() < NOTHING_MM3


def unsupported(solid: Manifold, up: Array, layer_mm: float = 0.2) -> tuple[float, int]:
    """How wide the widest place is that hangs over more than 45 degrees, and how many islands begin in the air.

    What begins less than half a line beside a layer is held by it; slivers of half a line's square are not printed.
    """
    turned = placed(solid, np.linalg.inv(frame_along(up)))
    low, high = turned.bounding_box()[2], turned.bounding_box()[5]
    below = turned.slice(low + layer_mm / 2)
    widest, islands = 0.0, 0
    for z in np.arange(low + 1.5 * layer_mm, high, layer_mm).tolist():
        section = turned.slice(z)
        alone = [
            piece for piece in section.decompose() if (piece ^ below).area() < 1e-6 and piece.area() > LINE_MM**2 / 2
        ]
        islands += sum((piece ^ below.offset(LINE_MM / 2, JoinType.Round)).is_empty() for piece in alone)
        hanging = section - below.offset(1.02 * layer_mm, JoinType.Round, circular_segments=24)
        while hanging.offset(-widest / 2 - 0.05, JoinType.Round).area() > 0:
            widest += 0.1
        below = section
    return widest, islands


@each_solid
@pytest.mark.parametrize("edge_mm", [100.0, 55.0])
def test_a_core_prints_without_supports(kind: str, edge_mm: float) -> None:
    """As it lies, no layer begins in the air, and what hangs over are bridges no wider than a key's hole."""
    assembly = assembly_of(kind, edge_mm)
    for part in assembly.core:
        width, islands = unsupported(part.solid, part.up)
        assert islands == 0
        assert width < assembly.sizes.key_hole_mm


@pytest.mark.parametrize("name", MOUNTS)
def test_a_post_prints_without_supports_and_loses_no_ring(name: str) -> None:
    """Every mount on an icosahedron of edge 100 mm; its pit and the cut tips stay clear of all rings."""
    design, assembly = design_of("ico"), assembly_of("ico")
    on = mounted(name, design.target, assembly.solid, assembly.sizes)
    assert on.cut_mm < room_mm(design.target, assembly.solid)
    width, islands = unsupported(on.solid(), np.array([0.0, 0.0, -1.0 if on.mount.up_is_in else 1.0]))
    assert islands == 0
    assert width < 3.0
    assert on.cut_mm == pytest.approx(on.mount.stem_mm / 2 + CLEARANCE_MM)


@pytest.mark.parametrize(("edge", "mount"), [("40mm", "m5"), ("60mm", "1/4-20")])
def test_a_cube_whose_mount_is_named_gets_room_for_it(edge: str, mount: str) -> None:
    """No ring is cut, the pit has walls, the post touches nothing; and what it costs is said."""
    wishes = {"edge": edge, "build": "tiles", "mount": mount, "chord_error": COARSE}
    sized = size_job(asked_for("cube", wishes))
    usual = size_job(asked_for("cube", {**wishes, "mount": "none"})).job.target
    assembly, on = assembly_in_tiles(Design(sized.job)), sized.job.target
    assert assembly.mounted is not None
    assert assembly.post is not None
    assert assembly.mounted.cut_mm + LINE_MM <= room_mm(on.lay_out(), assembly.solid)
    assert f"of {on.ring_diameter_mm:g}mm instead of {usual.lay_out().ring_count} rings of" in sized.remarks[0]
    for piece in (*(part.solid for part in assembly.core), *(in_place(assembly, face) for face in range(6))):
        assert (piece ^ assembly.post).volume() < NOTHING_MM3
    pit = assembly.mounted.socket
    walls = cylinder(pit.radius_mm + 1.0, pit.bottom_mm - 1.0, pit.bottom_mm + 5.0)
    walls -= cylinder(pit.radius_mm, pit.bottom_mm, pit.bottom_mm + 6.0)
    assert (placed(walls, assembly.target_from_post) - assembly.core[0].solid).volume() < NOTHING_MM3


@each_solid
@pytest.mark.parametrize(("percent", "skew_deg"), [(0.0, 0.0), (0.4, 0.3)])
def test_rings_of_the_assembled_solid_are_those_of_the_target(kind: str, percent: float, skew_deg: float) -> None:
    """Centres on the plates, brought back by the plates' frames and the printer's shrinkage and skew: within 10 nm."""
    design, made = design_of(kind), assembly_of(kind)
    skew = (np.radians(skew_deg), 0.0, 0.0)
    printing = replace(
        design.job.printing, inlay_mm=0.6, shrink_compensation_percent=percent, skew_compensation_rad=skew
    )
    assembly = assemble(design.target, made.solid, printing)
    target, found = design.target, np.full((design.target.ring_count, 3), np.nan)
    for plate in plates_of(assembly, printing):
        for piece in plate.pieces:
            if piece.part.ink is not None:
                face = int(piece.name.split()[1])
                motion = piece.bed_from_part
                from_bed = motion[:3, :3].T @ skew_matrix(skew) @ motion[:3, :3] / (1 + percent / 100)
                points = piece.part.ink.vertices_mm @ from_bed.T
                found[target.ring_face == face] = ring_centres(assembly, face, points, design)
    assert np.abs(found - target.center_mm).max() < 1e-5


def ring_centres(assembly: Assembly, face: int, ink_mm: Array, design: Design) -> Array:
    """Means of the ink's corners at each ring, which are regular polygons, in the target's frame.  # (N, 3)"""
    target = design.target
    mine = target.ring_face == face
    frame = assembly.target_from_tile[face]
    on_top = ink_mm[ink_mm[:, 2] > -1e-6]
    expected = target.center_in_face_mm[mine, :2]
    apart = np.linalg.norm(on_top[None, :, :2] - expected[:, None], axis=2)
    near = apart < 1.05 * target.radius_outer_mm[mine, None]
    centres = np.stack([on_top[row].mean(axis=0) for row in near])
    centred: Array = centres @ frame[:3, :3].T + frame[:3, 3]
    return centred


def octahedron() -> Polyhedron:
    """As `docs/extend.md` has it."""
    return Polyhedron(
        name="octahedron",
        vertices=np.sqrt(0.5) * np.concatenate([np.eye(3), -np.eye(3)]),
        faces=np.array([[0, 1, 2], [0, 5, 1], [0, 2, 4], [0, 4, 5], [3, 2, 1], [3, 1, 5], [3, 4, 2], [3, 5, 4]]),
        inradius=np.sqrt(1 / 6), dihedral_rad=np.arccos(-1 / 3), face_code=(0, 19, 5, 13, 8, 16, 11, 3),
        code_corner=(0, 1, 2, 0, 2, 1, 0, 1), net=(), net_angle_rad=0.0,
    )  # fmt: skip


def test_a_solid_of_ones_own_is_parted_where_it_cuts_no_face() -> None:
    """An octahedron at its waist, an icosahedron below its top corner; a cube has no such plane and gets a lid."""
    assert split_of(octahedron()).lid_face is None
    assert split_of(octahedron()).height == pytest.approx(0.0)
    ico, cube = assembly_of("ico").solid.polyhedron, assembly_of("cube").solid.polyhedron
    heights = ico.vertices @ split_of(ico).up
    assert int((heights > split_of(ico).height + 1e-6).sum()) == 1
    assert split_of(cube).lid_face is not None


@pytest.mark.parametrize("bed_mm", [(160.0, 160.0, 200.0), (200.0, 200.0, 60.0)])
def test_a_bed_too_small_says_which_edge_fits(bed_mm: tuple[float, float, float]) -> None:
    """By tile or by core, the same edge whatever was asked for; it does fit, and a millimetre more does not."""

    def plates(edge_mm: float) -> None:
        printing = design_of("cube", edge_mm).job.printing
        printing = replace(printing, printer=replace(printing.printer, bed_mm=bed_mm))
        plates_of(assembly_of("cube", edge_mm), printing)

    def refused_mm(edge_mm: float) -> float:
        with pytest.raises(InputError, match="use an edge of at most") as error:
            plates(edge_mm)
        return float(str(error.value).split("at most ")[1].split("mm")[0])

    edge_mm = refused_mm(120.0)
    assert refused_mm(edge_mm + 1.0) == edge_mm
    plates(edge_mm)


@pytest.mark.parametrize(
    ("kind", "small_mm"), [("ico", 20.0), ("cube", 20.0), ("octahedron", 25.0), ("tetrahedron", 36.0)]
)
def test_pins_that_cannot_be_printed_are_refused(kind: str, small_mm: float) -> None:
    """With the edge from which on they can, the same whatever was asked for; thicker tiles take none of it away."""

    def sizes(edge_mm: float) -> TileSizes:
        design = design_of(kind, edge_mm)
        solid, printing = design.job.target.solid, design.job.printing
        assert solid is not None
        return tile_sizes(
            solid, design.target.outline_mm[0], 1.0, printing.printer, 0.6, "down", is_on_shell=False
        )  # fmt: skip

    def refused_mm(edge_mm: float) -> float:
        with pytest.raises(InputError, match="use an edge of at least") as error:
            sizes(edge_mm)
        return float(str(error.value).split("at least ")[1].split("mm")[0])

    edge_mm = refused_mm(small_mm)
    assert refused_mm(edge_mm - 1) == edge_mm
    assert all(sizes(edge_mm + more).key_mm >= 2 * LINE_MM for more in (0.0, 0.7, 1.5, 2.5, 5.0, 20.0))


def test_a_stand_and_a_post_are_in_each_others_way() -> None:
    """A stand asks for no post; both by name are refused."""
    design = design_of("ico", 60.0)
    solid = assembly_of("ico", 60.0).solid
    standing = replace(design.job.printing, inlay_mm=0.6, stand=True)
    assert assemble(design.target, solid, standing).mounted is None
    with pytest.raises(InputError, match="leave out one"):
        assemble(design.target, solid, replace(standing, mount="m5"))


def test_a_mount_that_does_not_fit_names_an_edge_that_does() -> None:
    """The edge that the message names has room."""
    design = design_of("ico", 60.0)
    with pytest.raises(InputError, match="mount 1/4-20: needs") as error:
        mounted("1/4-20", design.target, assembly_of("ico", 60.0).solid, assembly_of("ico", 60.0).sizes)
    edge = float(str(error.value).split("edge of about ")[1].split("mm")[0])
    larger = assembly_of("ico", edge)
    mounted("1/4-20", design_of("ico", edge).target, larger.solid, larger.sizes)


@pytest.mark.parametrize("ink_side", ["down", "up"])
def test_a_back_keeps_its_number_off_the_rim_and_has_pins_and_pits(ink_side: InkSide) -> None:
    """By booleans: a small tile is its prism and three pins, without engraving and holes, none of it at a side."""
    assembly = assembly_of("ico", 60.0 if ink_side == "up" else 45.0, ink_side)
    sizes, tile = assembly.sizes, assembly.tiles[12]
    assert tile.ink is not None
    assert number_contours(sizes, 12)
    whole = solid_of(tile.body) + solid_of(tile.ink)
    outline = sizes.outline_at(sizes.thickness_mm, sizes.chamfer_mm)
    back = prism((outline,), -sizes.thickness_mm, 0.2 - sizes.thickness_mm)
    rim = back - prism((moved_in(outline, 0.3),), -sizes.thickness_mm, 0.0)
    assert (rim - whole).volume() < NOTHING_MM3
    beyond = whole.trim_by_plane((0.0, 0.0, -1.0), sizes.thickness_mm)
    pins = pin(sizes).trim_by_plane((0.0, 0.0, -1.0), 0.0).volume()
    assert beyond.volume() == pytest.approx(3 * pins if sizes.has_pins else 0.0, abs=1e-6)
    assert (back - whole).volume() > 0.05
