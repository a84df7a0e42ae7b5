"""A printable stand: a cradle of posts for solids, an easel for plates.

The stand frame has z up and the printer's bed, later the table, at z = 0. A stand is a few plain solids minus
the target grown by a clearance; it carries the target by the room beside the rings and leaves every ring free.
Nothing hangs over by more than 45 degrees, so it prints as it stands, without supports.

What helps to glue tiles: a jig for edges, and a press.

The *jig* is a block with a V of the solid's dihedral angle. Over an edge it brings two printed faces to this angle
while glue sets, wherever pins and pads leave them. Printed on end, it has no steps of layers on its flanks. The *press*
is a plate with a rim, which meets a tile's border alone: no ring is rubbed, and all pads of the seat are loaded.
"""

import math

import numpy as np
from manifold3d import CrossSection, Manifold, OpType

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.solid import Solid
from designer.kinds.layout import lip_of
from designer.make.mesh import Mesh, mesh_of, prism
from designer.make.pattern import moved_in
from designer.spec.spec import PrinterProfile, PrintSpec, Spec
from designer.target import TargetGeometry

CLEARANCE_MM = 0.2
"""Gap around the target, so that one printed part fits into another."""

LEAN_RAD = math.radians(75.0)
"""Between a board on its easel and the table."""

_SMALLEST_MM = 0.002
"""Corners of booleans that lie nearer to each other fall together in the single precision of an STL file."""
_MIN_WALL_MM = 1.6
_MIN_LIP_MM = 1.0
_HOLD = 0.9
"""Share of the room beside the rings that a stand uses."""


def make_stand(target: TargetGeometry, printing: PrintSpec) -> Mesh:
    """The stand of a target in the stand frame; lengths as printed, with shrinkage compensation.

    Raises:
        InputError: the target has no spec, or too little room beside its rings to be held there.
    """
    if (spec := _spec(target)).solid is None and spec.body is not None:
        raise InputError(f"stand: there is one for boards and regular solids, not for a {spec.words}; leave it out")
    wall = max(_MIN_WALL_MM, 3 * printing.printer.line_width_mm)
    gap = CLEARANCE_MM + (lip_of(target, printing).rise_mm if printing.lip else 0.0)
    stand = _easel(target, spec, wall) if spec.solid is None else _cradle(target, spec.solid, wall, gap)
    mesh = stand.as_original().simplify(_SMALLEST_MM).to_mesh64()
    scale = 1 + printing.shrink_compensation_percent / 100
    return Mesh(scale * mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int32))


def stand_from_target(target: TargetGeometry) -> Array:
    """Where the target stands: a rigid motion, in design lengths.  # (4, 4)

    A solid lies on its last face, its centroid above the origin. A board faces -y and leans back; its lower
    front edge runs along x.

    Raises:
        InputError: the target has no spec.
    """
    spec = _spec(target)
    motion = np.eye(4)
    if spec.solid is not None:
        face = target.target_from_face[-1, :3, :3]
        motion[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ face.T  # half a turn about x: the outward normal points down
        motion[2, 3] = _lift_mm(spec.solid) + spec.solid.inradius_mm
    else:
        up, out = _board_axes()
        motion[:3, :3] = np.stack([[1.0, 0.0, 0.0], up, out], axis=1)
        lowest = -CLEARANCE_MM * (up + out) - spec.depth_mm * out  # of the grown board, from its lower front edge
        size = _size_mm(target)
        motion[:3, 3] = size[1] / 2 * up + [0.0, 0.0, _floor_mm(max(size)) - lowest[2]]
    return motion


def _size_mm(target: TargetGeometry) -> tuple[float, float]:
    """Width and height of a plate."""
    width, height = np.ptp(target.outline_mm[0], axis=0).tolist()
    return width, height


def _spec(target: TargetGeometry) -> Spec:
    if target.spec is None:
        raise InputError("the target file has no spec, so no stand can be made; use a target made by `design`")
    return target.spec


def _floor_mm(size_mm: float) -> float:
    """Thickness of a stand's base."""
    return min(max(0.02 * size_mm, 2.0), 5.0)


def _lift_mm(solid: Solid) -> float:
    """Height of the lowest face above the table: enough for a camera to see the lower faces."""
    return max(0.3 * solid.edge_mm, 10.0)


def _cradle(target: TargetGeometry, solid: Solid, wall_mm: float, gap_mm: float) -> Manifold:
    """Posts under the corners of the lowest face, on a ring.

    A post stays within a ball around its corner that no ring of the faces there reaches.
    """
    motion = stand_from_target(target)
    vertices = solid.corners_mm() @ motion[:3, :3].T + motion[:3, 3]
    corners = vertices[np.argsort(vertices[:, 2])[: solid.polyhedron.sides]]
    rings = target.center_mm @ motion[:3, :3].T + motion[:3, 3]
    distance = np.linalg.norm(rings[:, None] - corners, axis=2) - target.radius_outer_mm[:, None]
    reach = _HOLD * float(distance.min())
    # 0.92 and 0.39: the rim of the post's top lies on the ball.
    radius = min(0.92 * reach, max(1.5 * wall_mm, 0.07 * solid.edge_mm))
    hold = 0.39 * reach
    if radius - hold * _run_over_rise(vertices, corners[0]) < wall_mm:
        raise InputError(
            f"rings come within {reach / _HOLD:.2g}mm of the corners, too near for a stand with walls of "
            f"{wall_mm:.2g}mm; leave out the stand, or use a wider margin or a larger edge"
        )
    height = _lift_mm(solid) + hold
    circle = solid.edge_mm / (2 * math.sin(math.pi / solid.polyhedron.sides))
    # Wider than the posts: cylinders that touch along a line would leave slivers.
    half_width = 1.2 * radius
    ring_base = CrossSection.circle(circle + half_width, 96) - CrossSection.circle(circle - half_width, 96)
    posts = [Manifold.cylinder(height, radius, circular_segments=48).translate((x, y, 0.0)) for x, y, _ in corners]
    base = Manifold.extrude(ring_base, _floor_mm(solid.edge_mm))
    grown = (1 + gap_mm / solid.inradius_mm) * (vertices - motion[:3, 3]) + motion[:3, 3]
    return Manifold.batch_boolean([base, *posts], OpType.Add) - Manifold.hull_points(grown)


def _run_over_rise(vertices: Array, corner: Array) -> float:
    """How far the steepest edge leads outwards from a corner of the lowest face, over how far it leads up."""
    step = vertices - corner
    length = np.linalg.norm(step, axis=1)
    edges = step[(length < 1.01 * length[length > 0].min()) & (step[:, 2] > 0.01 * length)]
    return float((np.hypot(edges[:, 0], edges[:, 1]) / edges[:, 2]).min())


def _easel(target: TargetGeometry, spec: Spec, wall_mm: float) -> Manifold:
    """Two shoes for the lower edge, on a bar, and a fin behind the board's middle, on a spine."""
    if target.face_count > 1:
        raise InputError("a stand leans on the back, and this board has rings there; leave --stand out")
    lip = _lip_mm(target)
    up, out = _board_axes()
    width, height = _size_mm(target)
    motion = stand_from_target(target)
    corner = motion[:3, 3] - height / 2 * up  # on the lower front edge, at x = 0
    gap, back = CLEARANCE_MM, -(spec.depth_mm + CLEARANCE_MM) * out
    floor = _floor_mm(max(width, height))
    front_y = float((gap * out - gap * up)[1]) - wall_mm
    shoe_back_y = float((lip * up + back)[1]) + wall_mm
    rest = corner + 0.6 * height * up + back  # the upper end of the line on which the board rests
    rear_y = float(rest[1]) + wall_mm + 0.2 * height

    half_shoe, half_fin = max(1.5 * wall_mm, 0.04 * width), max(wall_mm, 0.02 * width)
    half_bar = 0.3 * width + half_shoe
    shoe_top = float((corner + lip * up + gap * out)[2]) + spec.depth_mm
    shoes = [
        _box((x - half_shoe, x + half_shoe), (front_y, shoe_back_y), shoe_top).trim_by_plane(
            tuple(-up), -float(up @ corner) - lip
        )
        for x in (-0.3 * width, 0.3 * width)
    ]
    foot_y = float(rest[1] - rest[2] / math.tan(LEAN_RAD))
    profile = [(foot_y, 0.0), (rear_y, 0.0), (rest[1] + wall_mm, rest[2]), (rest[1], rest[2])]
    fin = _upright(np.array(profile), 2 * half_fin)
    bar = _box((-half_bar, half_bar), (front_y, shoe_back_y), floor)
    spine = _box((-half_fin, half_fin), (front_y, rear_y), floor)
    grown = Manifold.cube((width + 2 * gap, height + 2 * gap, spec.depth_mm + 2 * gap), center=True)
    grown = grown.translate((0.0, 0.0, -spec.depth_mm / 2)).transform(motion[:3])
    return Manifold.batch_boolean([bar, spine, fin, *shoes], OpType.Add) - grown


def _board_axes() -> tuple[Array, Array]:
    """A leaning board's directions up along the board and out of its face, in the stand frame."""
    sine, cosine = math.sin(LEAN_RAD), math.cos(LEAN_RAD)
    return np.array([0.0, cosine, sine]), np.array([0.0, -sine, cosine])


def _lip_mm(target: TargetGeometry) -> float:
    """How far up the board's face the shoes may reach."""
    height = _size_mm(target)[1]
    room = float((target.center_in_face_mm[:, 1] - target.radius_outer_mm).min()) + height / 2
    if _HOLD * room < _MIN_LIP_MM:
        raise InputError(
            f"rings come within {room:.2g}mm of the board's lower edge, too near for a stand's lip of "
            f"{_MIN_LIP_MM:g}mm; leave out the stand or use a margin of at least {_MIN_LIP_MM / _HOLD:.2g}mm"
        )
    return min(_HOLD * room, max(3.0, 0.04 * height))


def _box(x_mm: tuple[float, float], y_mm: tuple[float, float], height_mm: float) -> Manifold:
    """A box on the bed."""
    size = (x_mm[1] - x_mm[0], y_mm[1] - y_mm[0], height_mm)
    return Manifold.cube(size).translate((x_mm[0], y_mm[0], 0.0))


def _upright(profile_mm: Array, width_mm: float) -> Manifold:
    """A counter-clockwise profile in the y-z plane, `width_mm` wide along x and centred there.  # (N, 2)"""
    along_z = Manifold.extrude(CrossSection([profile_mm]), width_mm)
    axes = np.array([[0.0, 0.0, 1.0, -width_mm / 2], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    return along_z.transform(axes)


FLANK_OVER_EDGE, MOST_FLANK_MM = 0.35, 35.0
LENGTH_OVER_EDGE, MOST_LENGTH_MM = 0.5, 50.0
BELOW_MM = 6.0
"""Behind the V's ground."""
SLOT_MM = (1.5, 2.0)
"""Half its width, and its depth: the ground meets no edge, and takes the glue that comes out of it."""
PLATE_MM, PIT_MM = 4.0, 1.0
"""Of the press: behind the rim, and how high that is."""


def edge_jig(solid: Solid) -> Mesh:
    """The jig as it is printed: the V opens towards y, its ground lies along z."""
    tilt = (math.pi - solid.polyhedron.dihedral_rad) / 2
    flank = min(FLANK_OVER_EDGE * solid.edge_mm, MOST_FLANK_MM)
    out, up = flank * math.cos(tilt), flank * math.sin(tilt)
    half, deep = SLOT_MM
    right = [(out, -BELOW_MM), (out, up), (half, half * math.tan(tilt)), (half, -deep)]
    corners = [*right, *((-x, y) for x, y in reversed(right))]
    length = min(LENGTH_OVER_EDGE * solid.edge_mm, MOST_LENGTH_MM)
    return mesh_of(Manifold.extrude(CrossSection([np.array(corners)]), length))


def tile_press(target: TargetGeometry, printer: PrinterProfile) -> Mesh:
    """The press as it is printed, its rim up: as wide as the border, less a clearance on either side."""
    clear = printer.clearance_mm
    plate = prism((moved_in(target.outline_mm[0], clear),), 0.0, PLATE_MM + PIT_MM)
    return mesh_of(plate - prism((moved_in(target.window_mm[0], -clear),), PLATE_MM, PLATE_MM + PIT_MM + 1.0))
