"""The hollow core that tiles are glued to: numbered seats on the outside, printed open side down without supports.

A core comes apart in a plane through corners of the solid that cuts no face, because edges run all around it: below
the top corner of an icosahedron, at the waist of an octahedron. A solid without such a plane (a cube) gets a lid under
one face. Seen from its open side a part has a cavity that narrows upwards by 45 degrees or more, so nothing in it
needs supports. All pieces are in the target's frame and in the design's lengths.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from designer.base.solid import Polyhedron, Solid
from designer.make.booleans import cone, cylinder, frame_along, placed, prism, union
from designer.make.pattern import moved_in
from designer.make.tile import TileSizes, key_places, number_contours, pad_places

Array = NDArray[np.float64]

SLOPE = math.tan(math.radians(46.0))
"""Rise over run of a cavity's roof: a degree more than what prints without supports."""
LID_SLOPE = math.tan(math.radians(55.0))
"""Of the cavity behind a lid: so steep that the middle of the solid is hollow, and tiles can be pushed out from it."""
BEHIND_KEYS_MM = 1.2
"""Least wall behind the holes for keys: three lines of a nozzle of .4 mm."""
SOCKET_WALL_MM = 2.4
JOINT_OVER_EDGE = 0.06
MOST_JOINT_MM = 6.0
RING_WALL_LINES = 5
TAB_MM = 2.0
"""How far the joint ring's tab, which lets it in one way only, reaches out."""
LEAST_CAVITY_MM = 6.0
"""Radius of a cavity below which a core is left solid: no finger and no stick gets in."""
_SAME = 1e-9


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
        parts = _halves(solid, frames, sizes, socket, split)
    else:
        parts = _with_lid(solid, frames, sizes, socket, split)
    return tuple(CorePart(p.name, _finished(p, solid, frames, codes, sizes, socket), p.up, p.seats) for p in parts)


def _halves(solid: Solid, frames: Array, sizes: TileSizes, socket: Socket | None, split: Split) -> tuple[CorePart, ...]:
    """A bowl and a cap, each on its open side, and a ring that joins them."""
    corners = solid.corners_mm(below_mm=sizes.seat_depth_mm)
    edge_mm = float(np.linalg.norm(corners, axis=1).max() / np.linalg.norm(solid.polyhedron.vertices[0]))
    plane = split.height * edge_mm
    heights = corners @ split.up
    origin = plane * split.up
    sides = ((("bowl", -split.up, heights < plane + 1e-6)), ("cap", split.up, heights > plane - 1e-6))
    joint = min(JOINT_OVER_EDGE * edge_mm, MOST_JOINT_MM)
    hollows = [
        _Hollow.largest(
            corners[mine] - origin, up, _wall_mm(sizes), joint, _apex_limit(socket, solid, up, split.up, plane)
        )
        for _, up, mine in sides
    ]
    mouth = min(hollow.radius_mm for hollow in hollows)
    parts = []
    for (name, up, mine), hollow in zip(sides, hollows, strict=True):
        part = Manifold.hull_points(corners[mine])
        if mouth >= LEAST_CAVITY_MM:
            cavity = hollow.solid(mouth, joint) + _tab(mouth, joint, up, split.up, sizes.clearance_mm)
            part -= placed(cavity, _frame_at(origin, up))
        seats = tuple(int(f) for f in np.flatnonzero(mine[solid.polyhedron.faces].all(axis=1)))
        parts.append(CorePart(name, part, up, seats))
    if mouth >= LEAST_CAVITY_MM:
        wall = min(RING_WALL_LINES * sizes.line_mm, mouth / 3)
        outer = mouth - sizes.clearance_mm
        half = joint - sizes.layer_mm
        ring = cylinder(outer, -half, half) - cylinder(outer - wall, -joint, joint)
        tab = _tab(mouth, half, split.up, split.up, -sizes.clearance_mm)
        tab += tab.mirror((0.0, 0.0, 1.0))
        ring += tab - cylinder(outer - wall / 2, -joint, joint)
        parts.append(CorePart("ring", placed(ring, _frame_at(origin, split.up)), split.up, ()))
    return tuple(parts)


def _wall_mm(sizes: TileSizes) -> float:
    """Least wall between a seat and the cavity."""
    return sizes.engaged_mm + sizes.layer_mm + BEHIND_KEYS_MM


def _frame_at(origin: Array, up: Array) -> Array:
    frame = frame_along(up)
    frame[:3, 3] = origin
    return frame


def _apex_limit(socket: Socket | None, solid: Solid, up: Array, split_up: Array, plane_mm: float) -> float:
    """How high above the joint a cavity may reach below a mount that stands on the part's top."""
    if socket is None or solid.polyhedron.vertices[socket.vertex] @ up < 0:
        return math.inf
    return socket.bottom_mm - plane_mm * float(split_up @ up) - SOCKET_WALL_MM


@dataclass(frozen=True)
class _Hollow:
    """A cylinder that a cone closes."""

    radius_mm: float
    apex_mm: float  # above the open side

    @classmethod
    def largest(cls, corners: Array, up: Array, wall_mm: float, joint_mm: float, most_mm: float) -> "_Hollow":
        """The largest within a convex part, a wall away from its sides.  # corners (N, 3), the joint at the origin"""
        local = corners @ frame_along(up)[:3, :3]
        hull = Manifold.hull_points(local).to_mesh64()
        points, triangles = hull.vert_properties[:, :3], hull.tri_verts
        normal = np.cross(
            points[triangles[:, 1]] - points[triangles[:, 0]], points[triangles[:, 2]] - points[triangles[:, 0]]
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        reach = (normal * points[triangles[:, 0]]).sum(axis=1) - wall_mm
        outer = normal[:, 2] > -0.99  # all but the open side
        flat, rise, reach = np.linalg.norm(normal[outer, :2], axis=1), normal[outer, 2], reach[outer]

        def highest(radius: float, lift: float) -> float:
            """The greatest z at which a circle stays inside, `lift` above it."""
            room = reach - flat * radius
            up_faces = rise > _SAME
            top = float((room[up_faces] / rise[up_faces]).min(initial=math.inf))
            down = ~up_faces & (rise < -_SAME)
            low = float((room[down] / rise[down]).max(initial=-math.inf))
            is_in = bool((room[np.abs(rise) <= _SAME] >= 0).all()) and low <= joint_mm
            return top + lift if is_in and top >= 0 else -math.inf

        best = cls(0.0, 0.0)
        for radius in np.linspace(1.0, float(np.abs(local[:, :2]).max()), 200).tolist():
            apex = min(highest(radius, SLOPE * radius), highest(0.0, 0.0), most_mm)
            if apex - SLOPE * radius < joint_mm:
                continue
            hollow = cls(radius, apex)
            if hollow.volume > best.volume:
                best = hollow
        return best

    @property
    def volume(self) -> float:
        """Enclosed."""
        cone_mm = SLOPE * self.radius_mm
        return math.pi * self.radius_mm**2 * (self.apex_mm - cone_mm + cone_mm / 3)

    def solid(self, mouth_mm: float, joint_mm: float) -> Manifold:
        """With a mouth of its own radius for the joint ring; z = 0 is the open side."""
        shoulder = self.apex_mm - SLOPE * self.radius_mm
        widened = min(mouth_mm + (shoulder - joint_mm), self.radius_mm)
        body = cylinder(mouth_mm, -1.0, joint_mm)
        if widened > mouth_mm:
            body += cone(mouth_mm, widened, max(shoulder - joint_mm, 0.01)).translate((0.0, 0.0, joint_mm))
            body += cone(widened, 0.0, SLOPE * widened).translate((0.0, 0.0, shoulder))
        else:
            top = self.apex_mm - SLOPE * mouth_mm
            body += cylinder(mouth_mm, 0.0, top)
            body += cone(mouth_mm, 0.0, SLOPE * mouth_mm).translate((0.0, 0.0, top))
        return body


def _tab(mouth_mm: float, height_mm: float, up: Array, joint_up: Array, grown_mm: float) -> Manifold:
    """The tab of the ring or, grown, its slot, in the frame of a part with this `up`; always on the same side."""
    axes = frame_along(joint_up)[:3, 0] @ frame_along(up)[:3, :3]
    width, reach = 0.25 * mouth_mm + 2 * grown_mm, mouth_mm + TAB_MM + grown_mm
    box = Manifold.cube((reach, width, height_mm + 1.0)).translate((0.0, -width / 2, -1.0))
    if grown_mm < 0:
        box = Manifold.cube((reach, width, height_mm)).translate((0.0, -width / 2, 0.0))
    return box.rotate((0.0, 0.0, math.degrees(math.atan2(axes[1], axes[0]))))


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
    slope, depth = LID_SLOPE, _wall_mm(sizes)
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
    part: CorePart, solid: Solid, frames: Array, codes: tuple[int, ...], sizes: TileSizes, socket: Socket | None
) -> Manifold:
    """A part with its seats: keys' holes, numbers, holes to push tiles out, pads; and the mount's socket."""
    cuts, pads = [], []
    for face in part.seats:
        cuts.append(placed(_seat_cut(face, codes[face], sizes, solid.inradius_mm), frames[face]))
        if part.name not in ("lid",):
            pads.append(placed(_pads(sizes), frames[face]))
    if socket is not None:
        axis = solid.polyhedron.vertices[socket.vertex]
        if float(axis @ part.up) > 0:
            pit = cylinder(socket.radius_mm, socket.bottom_mm, 2 * solid.inradius_mm)
            cuts.append(placed(pit, frame_along(axis)))
    return (part.solid - union(cuts)) + union(pads) if cuts else part.solid


def _seat_cut(face: int, code: int, sizes: TileSizes, inradius_mm: float) -> Manifold:
    """All that is cut into a seat, in the face's frame."""
    seat = -sizes.seat_depth_mm
    low = seat - sizes.engaged_mm - sizes.layer_mm
    keys = [cylinder(sizes.key_hole_mm / 2, low, seat + 1.0, (x, y)) for x, y in key_places(sizes, code).tolist()]
    number = number_contours(sizes, face)
    letters = [prism(number, seat - 2 * sizes.layer_mm, seat + 1.0)] if number else []
    return union([*keys, *letters, cylinder(sizes.push_radius_mm, -inradius_mm, seat + 1.0)])


def _pads(sizes: TileSizes) -> Manifold:
    """Three pads that reach up to the tile's back."""
    low, top = -sizes.seat_depth_mm - sizes.layer_mm, -sizes.thickness_mm
    return union([cylinder(sizes.pad_radius_mm, low, top, (x, y)) for x, y in pad_places(sizes).tolist()])
