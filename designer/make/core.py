"""The hollow core that tiles are glued to: numbered seats on the outside, printed open side down without supports.

A core comes apart in a plane through corners of the solid that cuts no face, because edges run all around it: below
the top corner of an icosahedron, at the waist of an octahedron. A solid without such a plane (a cube) gets a lid under
one face. All pieces are in the target's frame and in the design's lengths.

Parts that come apart between faces are shells of one thickness: walls lean as the seats do, on an icosahedron by no
less than 37 degrees from the bed, so each line of .45 mm lies on two fifths of the one below (PrusaSlicer calls .3 m of
the 708 m of a bowl of edge 100 mm overhanging); nobody sees the inside. Behind a lid the cavity narrows by 55 degrees,
as the seat above it lies level.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold

from designer.base.arrays import Array
from designer.base.solid import Polyhedron, Solid
from designer.make.mesh import cylinder, frame_along, placed, prism, union
from designer.make.pattern import moved_in
from designer.make.tile import TileSizes, key_places, number_contours, pad_places

LID_SLOPE = math.tan(math.radians(55.0))
"""Rise over run of the cavity behind a lid: so steep that the middle of the solid is hollow."""
SKIN_MM = 1.2
"""Three lines of a nozzle of .4 mm; keys go through it."""
BEHIND_KEYS_MM = 1.2
"""Least wall behind the holes for keys in a lid: as thick."""
SOCKET_WALL_MM = 2.4
SOCKET_RIM_MM = 5.0
"""Of a socket's block around its pit: what is glued to the shell."""
JOINT_OVER_EDGE = 0.04
MOST_JOINT_MM = 4.0
CAP_SHARE = 0.6
"""How far the joint ring reaches into a cap, over the same into a bowl: a cap leans more."""
RING_WALL_LINES = 3
KEY_OVER_MOUTH = 0.12
"""Width of the rib that lets the joint ring in one way only."""
LEAST_CAVITY_MM = 6.0
"""Inradius of a mouth below which a core is left solid: no finger and no stick gets in."""
_SAME = 1e-9
_SAME_MM = 1e-6


@dataclass(frozen=True, eq=False)
class Split:
    """Where a core of edge 1 comes apart: beyond the plane at `height` along `up` lies its upper part."""

    up: Array  # (3,) unit
    height: float
    lid_face: int | None  # the face that a lid carries; None: the plane cuts no face


@dataclass(frozen=True)
class Socket:
    """A round pit for a mount's stem, at a corner of the solid."""

    vertex: int
    radius_mm: float
    bottom_mm: float  # from the centroid along the corner's axis


@dataclass(frozen=True, eq=False)
class CorePart:
    """A piece of a core."""

    name: str
    solid: Manifold  # in the target's frame
    up: Array  # (3,) what points up on the bed
    seats: tuple[int, ...]  # numbers of the faces that it carries


@cache
def split_of(shape: Polyhedron) -> Split:
    """Where to part a core: along the first corner's axis, as far from the middle as edges run around."""
    up = shape.vertices[0] / np.linalg.norm(shape.vertices[0])
    heights = shape.vertices @ up
    for height in sorted({round(float(h), 9) for h in heights}, reverse=True)[1:-1]:
        above = heights[shape.faces] > height + _SAME
        below = heights[shape.faces] < height - _SAME
        if not (above.any(axis=1) & below.any(axis=1)).any():
            return Split(up, height, None)
    normal = np.asarray(shape.vertices[shape.faces[0]].mean(axis=0) / shape.inradius)
    return Split(normal, shape.inradius, 0)


def mount_vertex(shape: Polyhedron) -> int:
    """The corner that is farthest from the split's upper part: the mount's."""
    return int(np.argmin(np.round(shape.vertices @ split_of(shape).up, 9)))


def make_core(
    solid: Solid, frames: Array, codes: tuple[int, ...], sizes: TileSizes, socket: Socket | None
) -> tuple[CorePart, ...]:
    """All pieces of a core, the one with most seats first.

    Args:
        solid: of the design's size.
        frames: target_from_face.  # (F, 4, 4)
        codes: of the faces.
        sizes: of the tiles.
        socket: for a mount's stem.
    """
    split = split_of(solid.polyhedron)
    if split.lid_face is None:
        parts = _halves(solid, sizes, socket, split)
    else:
        parts = _with_lid(solid, frames, sizes, socket, split)
    is_shell = any(part.name == "ring" for part in parts)
    deep_mm = sizes.seat_depth_mm + 2 * skin_mm(sizes) if is_shell else solid.inradius_mm
    return tuple(replace(part, solid=_finished(part, solid, frames, codes, sizes, socket, deep_mm)) for part in parts)


def _halves(solid: Solid, sizes: TileSizes, socket: Socket | None, split: Split) -> tuple[CorePart, ...]:
    """A bowl and a cap, shells that each lie on the open side; inside them a ring that joins them, and a socket."""
    corners = solid.corners_mm(below_mm=sizes.seat_depth_mm)
    heights = corners @ split.up
    plane = split.height * float(np.linalg.norm(corners[0]) / np.linalg.norm(solid.polyhedron.vertices[0]))
    frame = _joint_frame(corners[np.abs(heights - plane) < _SAME_MM], split.up)
    low, high = (share * min(JOINT_OVER_EDGE * solid.edge_mm, MOST_JOINT_MM) for share in (1.0, CAP_SHARE))
    mouth = _hollow(solid, sizes, frame, 0.0).slice(0.0)
    inradius = mouth.bounds()[2]
    cavity, ring = Manifold(), Manifold()
    if inradius >= LEAST_CAVITY_MM:
        key = _key(inradius, sizes, 0.0).trim_by_plane((0.0, 0.0, 1.0), -low).trim_by_plane((0.0, 0.0, -1.0), -high)
        cavity = placed(_hollow(solid, sizes, frame, 0.0) - key, frame)
        within = [_within(solid, sizes, frame, mouth, inwards) for inwards in _ring_sides_mm(sizes)]
        ring = within[0] - within[1] - _key(inradius, sizes, sizes.clearance_mm)
        ring = ring.trim_by_plane((0.0, 0.0, 1.0), sizes.layer_mm - low)
        ring = ring.trim_by_plane((0.0, 0.0, -1.0), sizes.layer_mm - high)
    parts = []
    for name, up, mine in (
        ("bowl", -split.up, heights < plane + _SAME_MM),
        ("cap", split.up, heights > plane - _SAME_MM),
    ):
        seats = tuple(int(f) for f in np.flatnonzero(mine[solid.polyhedron.faces].all(axis=1)))
        parts.append(CorePart(name, Manifold.hull_points(corners[mine]) - cavity, up, seats))
    if not ring.is_empty():
        parts.append(CorePart("ring", placed(ring, frame), split.up, ()))
        if socket is not None:
            parts.append(CorePart("socket", *_socket_block(solid, sizes, socket), ()))
    return tuple(parts)


def _joint_frame(rim: Array, up: Array) -> Array:
    """A frame whose z = 0 is the joint and whose x points at the middle of one of its sides."""
    nearest = int(np.argsort(np.linalg.norm(rim - rim[0], axis=1), kind="stable")[1])
    origin, middle = rim.mean(axis=0), (rim[0] + rim[nearest]) / 2
    frame = np.eye(4)
    x = (middle - origin) / np.linalg.norm(middle - origin)
    frame[:3, 0], frame[:3, 1], frame[:3, 2], frame[:3, 3] = x, np.cross(up, x), up, origin
    return frame


def _hollow(solid: Solid, sizes: TileSizes, frame: Array, inwards_mm: float) -> Manifold:
    """What lies this far and farther inside the shell, as seen from a frame."""
    below_mm = sizes.seat_depth_mm + skin_mm(sizes) + inwards_mm
    return Manifold.hull_points((solid.corners_mm(below_mm=below_mm) - frame[:3, 3]) @ frame[:3, :3])


def _within(solid: Solid, sizes: TileSizes, frame: Array, mouth: CrossSection, inwards_mm: float) -> Manifold:
    """What of it also goes in through the joint's mouth."""
    narrower, reach = mouth.offset(-inwards_mm, JoinType.Miter), solid.edge_mm
    shaft = Manifold.extrude(narrower, 2 * reach).translate((0.0, 0.0, -reach))
    return shaft ^ _hollow(solid, sizes, frame, inwards_mm)


def _ring_sides_mm(sizes: TileSizes) -> tuple[float, float]:
    """How far inside the shell the joint ring begins and ends."""
    return sizes.clearance_mm, sizes.clearance_mm + RING_WALL_LINES * sizes.line_mm


def _key(inradius_mm: float, sizes: TileSizes, grown_mm: float) -> Manifold:
    """A rib inside the shell, in the joint's frame, or, grown, the gap of the ring that it lets in one way only."""
    width = KEY_OVER_MOUTH * inradius_mm + 2 * grown_mm
    begin = inradius_mm - _ring_sides_mm(sizes)[1] - (sizes.line_mm if grown_mm == 0 else 2 * sizes.line_mm)
    return Manifold.cube((2 * inradius_mm, width, 2 * inradius_mm)).translate((begin, -width / 2, -inradius_mm))


def _socket_block(solid: Solid, sizes: TileSizes, socket: Socket) -> tuple[Manifold, Array]:
    """A block around a mount's pit, glued under the shell's corner from inside, and what points up on the bed.

    A pit that hung from the shell would begin in the air when the bowl is printed.
    """
    axis = solid.polyhedron.vertices[socket.vertex]
    block = cylinder(socket.radius_mm + SOCKET_RIM_MM, socket.bottom_mm - SOCKET_WALL_MM, 2 * solid.inradius_mm)
    return placed(block, frame_along(axis)) ^ _hollow(solid, sizes, np.eye(4), sizes.glue_gap_mm), axis


def skin_mm(sizes: TileSizes) -> float:
    """Thickness of a shell, which its folds hold on both sides of each pad.

    Pressed with 10 N on three pads, a tile of edge 100 mm sinks by F r^2 (3 + v) / (16 pi (1 + v) D) = 0.03 mm: a
    simply supported disc (Timoshenko) that ends at the folds, r = 8 mm, F = 3.3 N, D = E t^3 / (12 (1 - v^2)), where
    E = 2400 N/mm^2 and v = 0.35 are assumed for PLA. By its own weight it sinks by a hundredth of that.
    """
    return max(SKIN_MM, 2 * sizes.line_mm)


def _with_lid(
    solid: Solid, frames: Array, sizes: TileSizes, socket: Socket | None, split: Split
) -> tuple[CorePart, ...]:
    """A core in one piece, printed on the open side, and a lid that wedges into it under one tile.

    The core's rim there stands as high as the pads of other seats, since it is printed on it.
    """
    assert split.lid_face is not None  # noqa: S101 - what told this way of parting from the other
    rim_up = split.up
    corners = solid.corners_mm(below_mm=sizes.seat_depth_mm)
    on_rim = corners @ rim_up > float((corners @ rim_up).max()) - 1e-6
    raised = _raised(corners[on_rim], solid, sizes, rim_up)
    body = Manifold.hull_points(np.concatenate([corners, raised]))
    rim_height = solid.inradius_mm - sizes.thickness_mm
    rim = max(3 * sizes.line_mm, BEHIND_KEYS_MM) + sizes.inset_per_depth * sizes.glue_gap_mm
    frame = frames[split.lid_face]
    outline = moved_in(sizes.outline_mm, sizes.inset_per_depth * sizes.seat_depth_mm + rim)
    inradius = float(-outline[:, 1].min())
    slope, depth = LID_SLOPE, sizes.engaged_mm + sizes.layer_mm + BEHIND_KEYS_MM  # least wall below the lid's seat
    limit = _socket_free(solid, socket, rim_height, rim_up)
    cavity = placed(_wedge(outline, inradius, slope, min(limit, slope * inradius)), frame @ _shift(-sizes.thickness_mm))
    lid = _wedge(moved_in(outline, sizes.clearance_mm), inradius - sizes.clearance_mm, slope, depth)
    lid = lid.trim_by_plane((0.0, 0.0, -1.0), sizes.glue_gap_mm)
    if inradius < LEAST_CAVITY_MM:
        return (CorePart("core", body, -rim_up, tuple(range(len(frames)))),)
    seats = tuple(f for f in range(len(frames)) if f != split.lid_face)
    return (
        CorePart("core", body - cavity, -rim_up, seats),
        CorePart("lid", placed(lid, frame @ _shift(-sizes.thickness_mm)), rim_up, (split.lid_face,)),
    )


def _raised(rim: Array, solid: Solid, sizes: TileSizes, up: Array) -> Array:
    """The corners of a seat's outline, moved along the planes beside it to the height of pads."""
    lift = sizes.glue_gap_mm
    middle = rim.mean(axis=0)
    inradius = float(-moved_in(sizes.outline_mm, sizes.inset_per_depth * sizes.seat_depth_mm)[:, 1].min())
    # Beside a seat the planes of its neighbours lean by the dihedral angle.
    run = lift / math.tan(solid.polyhedron.dihedral_rad) if abs(math.cos(solid.polyhedron.dihedral_rad)) > 1e-9 else 0.0
    moved: Array = middle + (rim - middle) * (1 + run / inradius) + lift * up
    return moved


def _shift(z_mm: float) -> Array:
    frame = np.eye(4)
    frame[2, 3] = z_mm
    return frame


def _wedge(outline: Array, inradius: float, slope: float, depth_mm: float) -> Manifold:
    """What lies below an outline at z = 0 and narrows downwards."""
    end = max(1 - depth_mm / (slope * inradius), 0.0)
    top = np.column_stack([outline, np.zeros(len(outline))])
    low = np.column_stack([end * outline, np.full(len(outline), -min(depth_mm, slope * inradius))])
    return Manifold.hull_points(np.concatenate([top, low]))


def _socket_free(solid: Solid, socket: Socket | None, rim_mm: float, up: Array) -> float:
    """How deep below the rim a cavity may reach before it comes near a mount's socket."""
    if socket is None:
        return math.inf
    axis = solid.polyhedron.vertices[socket.vertex]
    axis = axis / np.linalg.norm(axis)
    end = socket.bottom_mm * axis
    lowest = float(end @ up) + socket.radius_mm * math.sqrt(max(1 - float(axis @ up) ** 2, 0.0))
    return rim_mm - lowest if np.hypot(*(end - (end @ up) * up)[:2]) < socket.radius_mm else math.inf


def _finished(
    part: CorePart,
    solid: Solid,
    frames: Array,
    codes: tuple[int, ...],
    sizes: TileSizes,
    socket: Socket | None,
    deep_mm: float,
) -> Manifold:
    """A part with its seats: keys' holes, numbers, holes so deep to push tiles out, pads; and the mount's socket."""
    cuts, pads = [], []
    for face in part.seats:
        cuts.append(placed(_seat_cut(face, codes[face], sizes, deep_mm), frames[face]))
        if part.name != "lid":
            pads.append(placed(_pads(sizes), frames[face]))
    if socket is not None:
        axis = solid.polyhedron.vertices[socket.vertex]
        if float(axis @ part.up) > 0:
            pit = cylinder(socket.radius_mm, socket.bottom_mm, 2 * solid.inradius_mm)
            cuts.append(placed(pit, frame_along(axis)))
    return (part.solid - union(cuts)) + union(pads) if cuts else part.solid


def _seat_cut(face: int, code: int, sizes: TileSizes, deep_mm: float) -> Manifold:
    """All that is cut into a seat, in the face's frame."""
    seat = -sizes.seat_depth_mm
    low = seat - sizes.engaged_mm - sizes.layer_mm
    keys = [cylinder(sizes.key_hole_mm / 2, low, seat + 1.0, (x, y)) for x, y in key_places(sizes, code).tolist()]
    number = number_contours(sizes, face)
    letters = [prism(number, seat - 2 * sizes.layer_mm, seat + 1.0)] if number else []
    return union([*keys, *letters, cylinder(sizes.push_radius_mm, -deep_mm, seat + 1.0)])


def _pads(sizes: TileSizes) -> Manifold:
    """Three pads that reach up to the tile's back."""
    low, top = -sizes.seat_depth_mm - sizes.layer_mm, -sizes.thickness_mm
    return union([cylinder(sizes.pad_radius_mm, low, top, (x, y)) for x, y in pad_places(sizes).tolist()])
