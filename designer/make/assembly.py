"""A solid in parts: its tiles, the core that holds them, the post that holds the core, and the plates to print them.

What is here is put together in the design's lengths, in the target's frame, so that fits can be checked by booleans;
shrinkage and skew compensation are applied to each piece as it lies on the bed.

Equal tiles on the printer's beds: as many as fit side by side, turned together, beside the prime tower.

The corner that is left for the tower is as long as PrusaSlicer's tower is wide: others are narrower.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Manifold

from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.solid import Solid, regular_polygon
from designer.kinds.layout import border_width_mm
from designer.make.bed import TOWER_MM, Piece, Plate, bed_words, in_rows, lying, numbered
from designer.make.core import CorePart, make_core, mount_vertex, split_of
from designer.make.lettering import ID_DIGITS
from designer.make.mesh import Part, cylinder, frame_along, mesh_of, placed, solid_of
from designer.make.mounts import DEFAULT_MOUNT, MOUNTS, Mounted, fits, mounted
from designer.make.pattern import Pattern, make_pattern
from designer.make.tile import MOST_THICKNESS_MM, TileSizes, make_tile, thickness_mm, tile_sizes
from designer.spec.build import ANY_MOUNT, NO_MOUNT
from designer.spec.spec import PrinterProfile, PrintSpec
from designer.target import TargetGeometry

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
        excluded = f"what it excludes ({printer.excluded_words}) and " if printer.machine.excluded_mm else ""
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
    taken = [np.array(area) + spacing / 2 * np.array([-1, -1, 1, 1]) for area in printer.machine.excluded_mm]
    taken.append(np.array([bed[0] - TOWER_MM, bed[1] - TOWER_MM, *bed]))
    cells = _cells(sides, cell, math.hypot(*bed))
    outline = regular_polygon(sides, inradius)
    corners = np.einsum("nij,kj->nki", cells[:, :2, :2], outline) + cells[:, None, :2, 2]
    step = 2 * cell * (math.sqrt(3) if sides == 3 else 1.0)
    best = cells[:0]
    middle = np.array(bed) / 2
    rim, far = BED_RIM_MM, np.array(bed) - BED_RIM_MM
    along = np.linspace(0, step, _SHIFTS, endpoint=False)
    shifts = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    for turn in _TURNS[2 * math.pi / sides - 1e-9 > _TURNS].tolist():
        cosine, sine = math.cos(turn), math.sin(turn)
        turned = corners @ np.array([[cosine, sine], [-sine, cosine]]) + middle
        low, high = turned.min(axis=1), turned.max(axis=1)
        on_bed = ((low + shifts >= rim) & (high + shifts <= far)).all(axis=2)  # (S, N)
        for (shift,), there, count in zip(shifts, on_bed, on_bed.sum(axis=1).tolist(), strict=True):
            if count <= len(best):
                continue
            inside = there & np.all([_clear_of(turned + shift, area) for area in taken], axis=0)
            if inside.sum() > len(best):
                u, v = middle + shift
                best = np.array([[cosine, -sine, u], [sine, cosine, v], [0, 0, 1]]) @ cells[inside]
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


FLAT_MM = 1e-6
"""As low as parts of a single face are."""
_FACE_DOWN = np.diag([-1.0, 1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Assembly:
    """A solid in parts, in the design's lengths."""

    solid: Solid
    sizes: TileSizes
    target_from_tile: Array  # (F, 4, 4)
    tiles: tuple[Part, ...]  # in their own frames  # (F,)
    core: tuple[CorePart, ...]
    mounted: Mounted | None
    remark: str  # on the mount, where it was chosen

    @property
    def post(self) -> Manifold | None:
        """What the core is held by, in the target's frame."""
        return None if self.mounted is None else placed(self.mounted.solid(), self.target_from_post)

    @property
    def target_from_post(self) -> Array:
        """The frame along the axis of the mount's corner."""
        return frame_along(self.solid.polyhedron.vertices[mount_vertex(self.solid.polyhedron)])


def assemble(target: TargetGeometry, solid: Solid, printing: PrintSpec, *, is_sample: bool = False) -> Assembly:
    """Tiles, core and post of a solid.

    Args:
        target: the nominal geometry.
        solid: that its faces bound.
        printing: how it is made.
        is_sample: a tile stands for all that are cut alike, which is enough to tell what printing them takes.

    Raises:
        InputError: the edge is too small for keys, or the mount does not fit.
    """
    scale = 1 + printing.shrink_compensation_percent / 100
    sizes = tile_sizes(
        solid, target.outline_mm[0], border_width_mm(target), printing.printer, printing.inlay_mm / scale,
        printing.ink_side, is_on_shell=split_of(solid.polyhedron).lid_face is None,
    )  # fmt: skip
    on, remark = _chosen_mount(target, solid, sizes, printing)
    # Ink is offset by what the print bleeds, whatever it shrinks.
    pattern = make_pattern(target, replace(printing, ink_offset_mm=printing.ink_offset_mm / scale))
    frames, codes = target.target_from_face, tuple(target.face_code.tolist())
    return Assembly(
        solid=solid,
        sizes=sizes,
        target_from_tile=frames,
        tiles=tuple(_tiles(target, solid, pattern, sizes, on, is_sample=is_sample)),
        core=make_core(solid, frames, codes, sizes, None if on is None else on.socket),
        mounted=on,
        remark=remark,
    )


def _chosen_mount(
    target: TargetGeometry, solid: Solid, sizes: TileSizes, printing: PrintSpec
) -> tuple[Mounted | None, str]:
    """The mount asked for, or the usual one where it fits, and a remark on what was chosen."""
    name = printing.mount
    if name == NO_MOUNT:
        return None, ""
    if printing.stand:  # which carries the solid by the corner where the post would be
        if name != ANY_MOUNT:
            raise InputError(f"mount {name}: its post is in the way of a stand; leave out one, --mount or --stand")
        return None, "mount none: its post would be in the way of the stand"
    if name != ANY_MOUNT:
        return mounted(name, target, solid, sizes), ""
    if fits(DEFAULT_MOUNT, target, solid, sizes):
        on = mounted(DEFAULT_MOUNT, target, solid, sizes)
        return on, f"mount {DEFAULT_MOUNT}: {on.mount.title}; --mount takes others, or none"
    smaller = [f"--mount {one!r}" for one in MOUNTS if fits(one, target, solid, sizes)]
    others = f"; {' or '.join(smaller)} fits" if smaller else ""
    named = "; one that is named, such as --mount m5, gets a wider margin, and smaller rings" if not others else ""
    return None, f"mount none: rings or core leave no room for {DEFAULT_MOUNT}{others}{named}"


def _tiles(
    target: TargetGeometry, solid: Solid, pattern: Pattern, sizes: TileSizes, on: Mounted | None, *, is_sample: bool
) -> Iterator[Part]:
    """All tiles; those at the mount lose their tips."""
    target_id = target.geometry_id[:ID_DIGITS].upper()
    vertex, made = mount_vertex(solid.polyhedron), dict[bool, Part]()
    for face, code in enumerate(target.face_code.tolist()):
        is_cut = on is not None and vertex in solid.polyhedron.faces[face]
        if is_sample and is_cut in made:
            yield made[is_cut]
            continue
        tile = make_tile(pattern, face, code, target_id, sizes)
        if on is not None and is_cut:
            axis = frame_along(solid.polyhedron.vertices[vertex])
            # No longer than it must be: booleans take their time with what a long one passes by.
            corner_mm = float(np.linalg.norm(solid.polyhedron.vertices[vertex])) * solid.edge_mm
            low_mm = corner_mm - 2 * sizes.thickness_mm - 2 * on.cut_mm
            tip = cylinder(on.cut_mm, max(low_mm, 0.0), corner_mm + 1.0)
            tip = placed(tip, np.linalg.inv(target.target_from_face[face]) @ axis)
            assert tile.ink is not None  # noqa: S101 - tiles have borders
            tile = Part(mesh_of(solid_of(tile.body) - tip), mesh_of(solid_of(tile.ink) - tip))
        made[is_cut] = tile
        yield tile


def plates_of(assembly: Assembly, printing: PrintSpec) -> tuple[Plate, ...]:
    """All plates: tiles in two filaments first, then core and post in one.

    Raises:
        InputError: a tile or a piece of the core is larger than the bed.
    """
    width, depth, _ = printing.printer.bed_mm
    tower = (width - TOWER_MM, depth - TOWER_MM, width, depth)
    try:
        return numbered(_tile_pieces(assembly, printing), _core_pieces(assembly, printing), tower, _words)
    except InputError as error:
        edge = _largest_edge_mm(assembly, printing)
        raise InputError(
            f"edge {assembly.solid.edge_mm:g}mm: {error}; use an edge of at most {edge}mm, or a larger printer"
        ) from None


def _largest_edge_mm(assembly: Assembly, printing: PrintSpec) -> int:
    """Of a solid whose tiles and core all fit the bed, whatever edge was asked for.

    Tiles and core are smaller than the solid by what does not grow with it.
    """
    solid, sizes, scale = assembly.solid, assembly.sizes, 1 + printing.shrink_compensation_percent / 100
    widest = largest_inradius_mm(len(sizes.outline_mm), printing.printer) / scale
    by_tile = solid.edge_mm + (widest - _inradius_mm(sizes)) / solid.polyhedron.face_inradius
    corners, height = solid.corners_mm(below_mm=sizes.seat_depth_mm), printing.printer.bed_mm[2]
    rooms = [
        np.array([right - left, rear - front, height])
        for left, front, right, rear in printing.printer.rooms_mm(BED_RIM_MM)
    ]
    core_edge = solid.edge_mm - sizes.seat_depth_mm / solid.polyhedron.inradius
    fitting = []
    for part in assembly.core:
        if part.seats:  # without pits, which not all edges have
            own = corners[np.unique(solid.polyhedron.faces[list(part.seats)])] @ frame_along(part.up)[:3, :3]
            size = scale * np.maximum(np.ptp(own, axis=0), FLAT_MM)
            fitting.append(core_edge * max(float((room / size).min()) for room in rooms))
    edge = int(min(by_tile, min(fitting) + 2 * MOST_THICKNESS_MM / solid.polyhedron.inradius))
    while edge - _seat_mm(edge, sizes) / solid.polyhedron.inradius > min(fitting):
        edge -= 1
    return edge


def _seat_mm(edge_mm: float, sizes: TileSizes) -> float:
    """How deep seats lie below the faces of another edge."""
    return thickness_mm(edge_mm, sizes.inlay_mm, sizes.layer_mm) + sizes.glue_gap_mm


def _inradius_mm(sizes: TileSizes) -> float:
    """Of a tile where it is widest."""
    return float(-sizes.outline_at(sizes.chamfer_mm if sizes.ink_side == "down" else 0.0)[:, 1].min())


def _words(pieces: tuple[Piece, ...]) -> str:
    """`tiles 0 to 6`, `bowl`, `cap, ring and post`."""
    names = [piece.name for piece in pieces]
    if pieces[0].part.ink is not None and len(names) > 1:
        return f"{names[0].replace('tile', 'tiles')} to {names[-1].split()[1]}"
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def _tile_pieces(assembly: Assembly, printing: PrintSpec) -> Iterator[tuple[Piece, ...]]:
    """Tiles by their numbers, side by side."""
    sizes, scale = assembly.sizes, 1 + printing.shrink_compensation_percent / 100
    is_down = sizes.ink_side == "down"
    sides = len(sizes.outline_mm)
    shares = nest(sides, scale * _inradius_mm(sizes), len(assembly.tiles), printing.printer)
    tiles = enumerate(assembly.tiles)
    for share in shares:
        pieces = []
        for place in share.bed_from_tile:
            number, tile = next(tiles)
            motion = np.eye(4)
            motion[:2, :2], motion[:2, 3] = place[:2, :2], place[:2, 2]
            if is_down:
                motion = motion @ _FACE_DOWN
            else:
                motion[2, 3] = scale * sizes.thickness_mm
            pieces.append(replace(lying(f"tile {number}", tile, motion[:3, :3], printing), bed_from_part=motion))
        yield tuple(pieces)


def _core_pieces(assembly: Assembly, printing: PrintSpec) -> Iterator[tuple[Piece, ...]]:
    """The core's parts and the post as they are printed, in rows."""
    parts = [(part.name, part.solid, frame_along(part.up)[:3, :3].T) for part in assembly.core]
    post = assembly.post
    if assembly.mounted is not None and post is not None:
        axis = assembly.target_from_post[:3, 2]
        up = -axis if assembly.mounted.mount.up_is_in else axis
        parts.append(("post", post, frame_along(up)[:3, :3].T))
    printer = printing.printer
    pieces = [lying(name, Part(mesh_of(solid), None), axes, printing) for name, solid, axes in parts]
    for piece in pieces:
        size = np.ptp(piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T, axis=0)
        if printer.place_mm((size[0], size[1]), BED_RIM_MM) is None or size[2] > printer.bed_mm[2]:
            shown = " x ".join(f"{length:.0f}" for length in size)
            raise InputError(f"the core's {piece.name} needs {shown}mm, {bed_words(printer)}")
    width = printer.bed_mm[0] - 2 * BED_RIM_MM
    yield from in_rows(pieces, width, lambda size: printer.place_mm(size, BED_RIM_MM))
