"""A solid in parts: its tiles, the core that holds them, the post that holds the core, and the plates to print them.

What is here is put together in the design's lengths, in the target's frame, so that fits can be checked by booleans;
shrinkage and skew compensation are applied to each piece as it lies on the bed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from manifold3d import Manifold

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.solid import Solid
from designer.kinds.layout import border_width_mm
from designer.make.bed import against_skew_along, bed_words
from designer.make.booleans import cylinder, frame_along, mesh_of, placed, solid_of
from designer.make.core import CorePart, make_core, mount_vertex, split_of
from designer.make.lettering import ID_DIGITS
from designer.make.mesh import Part
from designer.make.mounts import DEFAULT_MOUNT, MOUNTS, Mounted, fits, mounted
from designer.make.nesting import BED_RIM_MM, largest_inradius_mm, nest
from designer.make.pattern import Pattern, make_pattern
from designer.make.plate import Piece, Plate
from designer.make.tile import MOST_THICKNESS_MM, TileSizes, make_tile, thickness_mm, tile_sizes
from designer.make.tower import TOWER_MM
from designer.spec.build import ANY_MOUNT, NO_MOUNT
from designer.spec.machine import BRIM_MM
from designer.spec.spec import PrinterProfile, PrintSpec
from designer.target import TargetGeometry

FLAT_MM = 1e-6
"""As low as parts of a single face are."""
APART_MM = 8.0
"""Between the pieces of a core: room for two brims."""
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


def assemble(target: TargetGeometry, solid: Solid, printing: PrintSpec) -> Assembly:
    """Tiles, core and post of a solid.

    Args:
        target: the nominal geometry.
        solid: that its faces bound.
        printing: how it is made.

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
        tiles=tuple(_tiles(target, solid, pattern, sizes, on)),
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
    target: TargetGeometry, solid: Solid, pattern: Pattern, sizes: TileSizes, on: Mounted | None
) -> Iterator[Part]:
    """All tiles; those at the mount lose their tips."""
    target_id = target.geometry_id[:ID_DIGITS].upper()
    vertex = mount_vertex(solid.polyhedron)
    for face, code in enumerate(target.face_code.tolist()):
        tile = make_tile(pattern, face, code, target_id, sizes)
        if on is not None and vertex in solid.polyhedron.faces[face]:
            axis = frame_along(solid.polyhedron.vertices[vertex])
            # No longer than it must be: booleans take their time with what a long one passes by.
            corner_mm = float(np.linalg.norm(solid.polyhedron.vertices[vertex])) * solid.edge_mm
            low_mm = corner_mm - 2 * sizes.thickness_mm - 2 * on.cut_mm
            tip = cylinder(on.cut_mm, max(low_mm, 0.0), corner_mm + 1.0)
            tip = placed(tip, np.linalg.inv(target.target_from_face[face]) @ axis)
            assert tile.ink is not None  # noqa: S101 - tiles have borders
            tile = Part(mesh_of(solid_of(tile.body) - tip), mesh_of(solid_of(tile.ink) - tip))
        yield tile


def plates_of(assembly: Assembly, printing: PrintSpec) -> tuple[Plate, ...]:
    """All plates: tiles in two filaments first, then core and post in one.

    Raises:
        InputError: a tile or a piece of the core is larger than the bed.
    """
    width, depth, _ = printing.printer.bed_mm
    tower_mm = (width - TOWER_MM + BRIM_MM, depth - TOWER_MM + BRIM_MM)
    try:
        tiles = [(group, tower_mm) for group in _tile_pieces(assembly, printing)]
        groups = [*tiles, *((group, None) for group in _core_pieces(assembly, printing))]
    except InputError as error:
        edge = _largest_edge_mm(assembly, printing)
        raise InputError(
            f"edge {assembly.solid.edge_mm:g}mm: {error}; use an edge of at most {edge}mm, or a larger printer"
        ) from None
    return tuple(
        Plate(f"plate-{number}", group, _words(group), tower) for number, (group, tower) in enumerate(groups, start=1)
    )


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
            pieces.append(Piece(f"tile {number}", _as_printed(tile, motion[:3, :3], printing), motion))
        yield tuple(pieces)


def _core_pieces(assembly: Assembly, printing: PrintSpec) -> Iterator[tuple[Piece, ...]]:
    """The core's parts and the post as they are printed, in rows."""
    parts = [(part.name, part.solid, frame_along(part.up)[:3, :3].T) for part in assembly.core]
    post = assembly.post
    if assembly.mounted is not None and post is not None:
        axis = assembly.target_from_post[:3, 2]
        up = -axis if assembly.mounted.mount.up_is_in else axis
        parts.append(("post", post, frame_along(up)[:3, :3].T))
    pieces = []
    for name, solid, axes in parts:
        part = _as_printed(Part(mesh_of(solid), None), axes, printing)
        motion = np.eye(4)
        motion[:3, :3] = axes
        pieces.append(Piece(name, part, motion))
    yield from _in_rows(pieces, printing)


def _as_printed(part: Part, axes: Array, printing: PrintSpec) -> Part:
    """A part with shrinkage compensation, and sheared against the printer's skew as it lies."""
    scale = 1 + printing.shrink_compensation_percent / 100
    return part.placed(lambda points: against_skew_along(axes, printing, scale * points))


def _in_rows(pieces: list[Piece], printing: PrintSpec) -> Iterator[tuple[Piece, ...]]:
    """Pieces in rows from the left front, on as many beds as they take; all on one are centred together."""
    printer, width = printing.printer, printing.printer.bed_mm[0] - 2 * BED_RIM_MM
    row: list[Piece] = []
    at, deepest, widest = np.zeros(2), 0.0, 0.0
    for piece in pieces:
        turned = piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T
        low, size = turned.min(axis=0), np.ptp(turned, axis=0)
        if printer.place_mm((size[0], size[1]), BED_RIM_MM) is None or size[2] > printer.bed_mm[2]:
            shown = " x ".join(f"{length:.0f}" for length in size)
            raise InputError(f"the core's {piece.name} needs {shown}mm, {bed_words(printer)}")
        if at[0] + size[0] > width:
            at = np.array([0.0, at[1] + deepest + APART_MM])
            deepest = 0.0
        together = max(widest, at[0] + size[0]), at[1] + max(deepest, size[1])
        if printer.place_mm(together, BED_RIM_MM) is None:
            yield _centred(row, printer)
            row, at, deepest, widest = [], np.zeros(2), 0.0, 0.0
        motion = piece.bed_from_part.copy()
        motion[:3, 3] = [at[0] - low[0], at[1] - low[1], -low[2]]
        row.append(replace(piece, bed_from_part=motion))
        at = at + np.array([size[0] + APART_MM, 0.0])
        deepest, widest = max(deepest, float(size[1])), max(widest, float(at[0] - APART_MM))
    yield _centred(row, printer)


def _centred(pieces: list[Piece], printer: PrinterProfile) -> tuple[Piece, ...]:
    """Pieces moved together to the middle of the bed, or as near to it as the bed is free."""
    corners = np.concatenate(
        [piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T + piece.bed_from_part[:3, 3] for piece in pieces]
    )
    low, (width, depth, _) = corners.min(axis=0), np.ptp(corners, axis=0).tolist()
    place = printer.place_mm((width, depth), BED_RIM_MM)
    assert place is not None  # noqa: S101 - they were put together so
    step = np.zeros((4, 4))
    step[:2, 3] = place - low[:2]
    return tuple(replace(piece, bed_from_part=piece.bed_from_part + step) for piece in pieces)
