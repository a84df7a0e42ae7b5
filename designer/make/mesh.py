"""From the pattern to closed triangle meshes of the body and of the ink set into it.

Body and ink share every vertex of their common walls, so they fill the solid exactly. Where two faces of a solid
meet, the tops of their borders share the solid's edge and the floors share the edge of a smaller solid at the
inlay's depth; no wall stands between them, and the whole border is one closed shell.

Meshes as solids that can be united, cut and measured, and back.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from manifold3d import CrossSection, Error, Manifold, Mesh64, OpType, triangulate
from numpy.typing import NDArray

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.solid import INLAY_SHARE, Faceted, Solid
from designer.base.units import round_down
from designer.kinds.layout import border_mm
from designer.make.pattern import Contour, FacePattern, Pattern, Stamp

Ids = NDArray[np.int32]

_SLIVER_MM2 = 1e-7
"""Twice the area below which a triangle counts as a line; the smallest true ones are a thousand times larger."""


@dataclass(frozen=True)
class Mesh:
    """A closed surface; triangles are counter-clockwise seen from outside."""

    vertices_mm: Array  # (V, 3)
    triangles: NDArray[np.int32]  # (T, 3)

    @cached_property
    def volume_mm3(self) -> float:
        """The enclosed volume, by the divergence theorem: what lies below each triangle, on the mean."""
        x, y, z = self.vertices_mm.T
        a, b, c = self.triangles.T
        doubled = (x[b] - x[a]) * (y[c] - y[a]) - (x[c] - x[a]) * (y[b] - y[a])
        return float(((z[a] + z[b] + z[c]) * doubled).sum() / 6)


@dataclass(frozen=True)
class Part:
    """What is printed: a body, and the ink on or in it (None where the pattern is paper or sheet)."""

    body: Mesh
    ink: Mesh | None
    fused: Mesh | None = None  # both in one, where one filament follows the other

    @property
    def as_printed(self) -> "Part":
        """As slicers take it: what a change of filament divides is one mesh to them."""
        return self if self.fused is None else Part(self.fused, None)

    def placed(self, place: Callable[[Array], Array]) -> "Part":
        """The part with its vertices elsewhere; an affine map keeps it closed and its triangles facing outwards."""

        def moved(mesh: Mesh) -> Mesh:
            return replace(mesh, vertices_mm=place(mesh.vertices_mm))

        ink, fused = (None if mesh is None else moved(mesh) for mesh in (self.ink, self.fused))
        return Part(moved(self.body), ink, fused)


@dataclass(frozen=True)
class ColouredMesh:
    """The surface of body and ink together."""

    surface: Mesh  # closed: first the body's triangles, then the ink's
    body_count: int  # of triangles

    @property
    def body(self) -> Ids:
        """Triangles of body colour.  # (T, 3)"""
        return self.surface.triangles[: self.body_count]

    @property
    def ink(self) -> Ids:
        """Those of ink.  # (T, 3)"""
        return self.surface.triangles[self.body_count :]


@dataclass(frozen=True)
class Hull:
    """The solid around the faces: what the face patterns are set into.

    `top` and `floor` are each face's outline at the surface and at the inlay's depth, as rows of `vertices_mm`;
    both are counter-clockwise from outside. `body_skin` closes the body beside the faces, `rim` closes the ink
    of a border there; both are empty where faces meet.
    """

    vertices_mm: Array  # (H, 3)
    top: Sequence[Ids] | Ids  # (F,) of (K,)
    floor: Sequence[Ids] | Ids  # (F,) of (K,)
    floor_outline_mm: Sequence[Array] | Array  # (F,) of (K, 2) the outline at the inlay's depth, in the face frame
    body_skin: Ids  # (T, 3)
    rim: Ids  # (T, 3)


def solid_hull(pattern: Pattern, solid: Solid | Faceted, inlay_mm: float, *, scale: float = 1.0) -> Hull:
    """The solid, and the smaller one on which the border's floor lies; without depth, both are alike.

    Raises:
        InputError: the border is too narrow for the inlay's depth.
    """
    inset_per_depth = solid.inset_per_depth
    inset = inset_per_depth * inlay_mm
    for face in pattern.faces if inlay_mm else ():
        if face.window is None:
            raise InputError("a solid needs a border; use one of at least two line widths")
        border = border_mm(face.outline, face.window[::-1])
        if border <= inset:
            raise InputError(
                f"border {border:.3g}mm is too narrow for an inlay {inlay_mm:g}mm deep, whose floor moves in by "
                f"{inset:.3g}mm; use an inlay of at most {round_down(INLAY_SHARE * border / inset_per_depth):g}mm "
                "or a wider border"
            )
    outer, inner = solid.corners_mm(scale=scale), solid.corners_mm(below_mm=inlay_mm, scale=scale)
    top = [np.array(face, dtype=np.int32) for face in solid.faces]
    floor = [face + len(outer) for face in top]
    frames = zip(pattern.target_from_face, solid.faces, strict=True)
    floor_outline = [(inner[list(face)] - frame[:3, 3]) @ frame[:3, :2] for frame, face in frames]
    nothing = [np.empty((0, 3), dtype=np.int32)]
    # Where a face with rings meets a bare one, the border's ink ends at the plane that halves their angle.
    beside = solid.beside
    ends = [
        (number, np.array([[k - 1, k]]) % len(face))
        for number, face in enumerate(solid.faces)
        for k in range(len(face))
        if inlay_mm and beside[face[k], face[k - 1]] >= len(solid.faces)
    ]
    rims = [wall_strip(top[number], floor[number], edge) for number, edge in ends]
    skin = [_fan(face) for face in solid.bare] + [rim[:, ::-1] for rim in rims]
    return Hull(
        np.concatenate([outer, inner]), top, floor, floor_outline, np.concatenate(nothing + skin),
        np.concatenate(nothing + rims),
    )  # fmt: skip


def plate_hull(pattern: Pattern, thickness_mm: float, inlay_mm: float) -> Hull:
    """The plate behind a single face, or between a front and a back.

    Raises:
        InputError: the inlay goes through the plate.
    """
    faces = pattern.faces
    if inlay_mm * len(faces) >= thickness_mm:
        both = " from both sides" * (len(faces) - 1)
        raise InputError(
            f"inlay {inlay_mm:g}mm{both} goes through a board {thickness_mm:g}mm thick; "
            f"use at most {thickness_mm / (2 * len(faces)):g}mm"
        )
    corners, has_border = len(faces[0].outline), faces[0].window is not None and inlay_mm != 0
    heights = (0.0, -inlay_mm, -thickness_mm, inlay_mm - thickness_mm)
    vertices = np.concatenate([np.column_stack([faces[0].outline, np.full(corners, z)]) for z in heights])
    top, floor, bottom, bottom_floor = _numbers(0, 4 * corners).reshape(4, corners)
    nothing = np.empty((0, 3), dtype=np.int32)
    rim = wall_strip(top, floor) if has_border else nothing
    upper = floor if has_border else top
    if len(faces) == 1:
        underside = triangulate([faces[0].outline])[:, ::-1] + 2 * corners
        skin = np.concatenate([wall_strip(upper, bottom), underside])
        return Hull(vertices, top[None], floor[None], faces[0].outline[None], skin, rim)
    # The back's corners run the other way, seen from the front.
    at_back = faces[1].outline @ pattern.target_from_face[1, :2, :2].T
    own = np.linalg.norm(at_back[:, None] - faces[0].outline, axis=2).argmin(axis=1)
    skin = wall_strip(upper, bottom_floor if has_border else bottom)
    rim = np.concatenate([rim, wall_strip(bottom_floor, bottom)]) if has_border else rim
    outlines = np.stack([face.outline for face in faces])
    return Hull(vertices, np.stack([top, bottom[own]]), np.stack([floor, bottom_floor[own]]), outlines, skin, rim)


def inlaid(pattern: Pattern, hull: Hull, inlay_mm: float) -> Part:
    """Set the pattern into the hull, `inlay_mm` deep."""
    vertices, body, ink = [hull.vertices_mm], [hull.body_skin], [hull.rim]
    count = len(hull.vertices_mm)
    flat = _Triangulator()
    for number, face in enumerate(pattern.faces):
        surfaces = _cut_face(face, hull.floor_outline_mm[number], pattern.stamps, flat)
        frame = pattern.target_from_face[number]
        at_top = surfaces.points_mm @ frame[:3, :2].T + frame[:3, 3]
        vertices += [at_top, at_top - inlay_mm * frame[:3, 2]]
        own = _numbers(count, count + len(at_top))
        top = np.concatenate([hull.top[number], own])
        floor = np.concatenate([hull.floor[number], own + len(own)])
        walls = wall_strip(top, floor, surfaces.edges)
        body += [top[surfaces.white], floor[surfaces.ink_floor], walls[:, ::-1]]
        ink += [top[surfaces.ink], floor[surfaces.ink_floor][:, ::-1], walls]
        count += 2 * len(own)
    everything = np.concatenate(vertices)
    hull_count = len(hull.vertices_mm)
    return Part(
        _without_unused(everything, hull_count, np.concatenate(body)),
        _without_unused(everything, hull_count, np.concatenate(ink)),
    )


def coloured(pattern: Pattern, hull: Hull) -> ColouredMesh:
    """The surface of a hull without depth, with the pattern on it."""
    vertices, body, ink = [hull.vertices_mm], [hull.body_skin], list[Ids]()
    count = len(hull.vertices_mm)
    flat = _Triangulator()
    for number, (face, frame) in enumerate(zip(pattern.faces, pattern.target_from_face, strict=True)):
        surfaces = _cut_face(face, face.outline, pattern.stamps, flat)
        vertices.append(surfaces.points_mm @ frame[:3, :2].T + frame[:3, 3])
        top = np.concatenate([hull.top[number], _numbers(count, count + len(vertices[-1]))])
        body.append(top[surfaces.white])
        ink.append(top[surfaces.ink])
        count += len(vertices[-1])
    surface = _without_unused(np.concatenate(vertices), len(hull.vertices_mm), np.concatenate([*body, *ink]))
    return ColouredMesh(surface, sum(map(len, body)))


def raised(pattern: Pattern, body_mm: float, height_mm: float) -> Part:
    """A plate of one face, `body_mm` thick, with the pattern on it; the face is the plane half-way up the walls.

    There an oblique camera sees the rings. The silhouette of a body that is symmetric about a point is symmetric
    about the point's image, and a ring with its walls is symmetric about the middle of its height.
    """
    fused = inlaid(pattern, plate_hull(pattern, body_mm, -height_mm), -height_mm)  # an inlay upwards, inside out
    assert fused.ink is not None  # noqa: S101 - a pattern has ink
    ink = replace(fused.ink, triangles=fused.ink.triangles[:, ::-1])
    body = plain_plate(pattern.faces[0].outline, body_mm)
    half_down = np.array([0.0, 0.0, -height_mm / 2])
    return Part(body, ink, fused.body).placed(lambda points: points + half_down)


def plain_solid(solid: Solid | Faceted, *, below_mm: float, scale: float) -> Mesh:
    """The bare solid, centred at the origin: what lies this deep and deeper below the faces."""
    faces = (_fan(face) for face in (*solid.faces, *solid.bare))
    return Mesh(solid.corners_mm(below_mm=below_mm, scale=scale), np.concatenate(list(faces)))


def _fan(face: Sequence[int]) -> Ids:
    """Triangles of a convex face.  # (K - 2, 3)"""
    return np.array([(face[0], face[k], face[k + 1]) for k in range(1, len(face) - 1)], dtype=np.int32)


def plain_plate(outline_mm: Contour, thickness_mm: float) -> Mesh:
    """The bare plate, its face at z = 0."""
    corners = len(outline_mm)
    vertices = np.concatenate([np.column_stack([outline_mm, np.full(corners, z)]) for z in (0.0, -thickness_mm)])
    top, bottom = _numbers(0, 2 * corners).reshape(2, corners)
    cap = triangulate([outline_mm])
    return Mesh(vertices, np.concatenate([cap, cap[:, ::-1] + corners, wall_strip(top, bottom)]).astype(np.int32))


@dataclass(frozen=True)
class _Surfaces:
    """A face cut into ink and white; numbers count the outline's corners first, then `points_mm`."""

    points_mm: Array  # (N, 2)
    ink: Ids  # (T, 3)
    ink_floor: Ids  # (T, 3) the same area at the inlay's depth, where the outline has moved in
    white: Ids  # (T, 3)
    edges: Ids  # (E, 2) of all contours but the outline, the ink on their left


@dataclass(frozen=True)
class _Loop:
    """A contour and the numbers of its points."""

    points: Contour  # (N, 2)
    ids: Ids  # (N,)

    def reversed(self) -> "_Loop":
        return _Loop(self.points[::-1], self.ids[::-1])

    @property
    def edges(self) -> Ids:
        return np.stack([self.ids, np.roll(self.ids, -1)], axis=1)


class _Triangulator:
    """Triangulates areas; an area that recurs, as the white around the rings does, is done once."""

    def __init__(self) -> None:
        self._done: dict[bytes, Ids] = {}

    def __call__(self, loops: list[_Loop]) -> Ids:
        """Triangles over the area on the left of all loops.  # (T, 3)"""
        key = b"|".join(loop.points.tobytes() for loop in loops)
        if key not in self._done:
            points = np.concatenate([loop.points for loop in loops])
            triangles = triangulate([loop.points for loop in loops]).astype(np.int32)
            self._done[key] = _without_slivers(points, triangles)
        ids: Ids = np.concatenate([loop.ids for loop in loops])
        return ids[self._done[key]]


def _cut_face(face: FacePattern, floor_outline: Contour, stamps: tuple[Stamp, ...], flat: _Triangulator) -> _Surfaces:
    """Cut one face into ink and white."""
    count = len(face.outline)
    outline = _Loop(face.outline, _numbers(0, count))
    points: list[Contour] = []

    def add(contour: Contour) -> _Loop:
        nonlocal count
        points.append(contour)
        count += len(contour)
        return _Loop(contour, _numbers(count - len(contour), count))

    window = None if face.window is None else add(face.window)
    dark, light = [add(c) for c in face.dark_text], [add(c) for c in face.light_text]
    ink = [flat([loop]) for loop in dark]
    white = [flat([loop.reversed()]) for loop in light]
    edges = [loop.edges for loop in (*([window] if window else []), *dark, *light)]
    rims: dict[int, _Loop] = {}
    for row, stamp in enumerate(stamps):
        (features,) = np.nonzero(face.stamp == row)
        at = face.position_mm[features]
        copies = _stamp_surfaces(stamp, flat)
        # Every copy is the first one, moved by its position and numbered on by its size.
        first = count + len(copies.points_mm) * _numbers(0, len(at))
        placed = add((at[:, None] + copies.points_mm).reshape(-1, 2))
        ink.append((copies.ink + first[:, None, None]).reshape(-1, 3))
        white.append((copies.white + first[:, None, None]).reshape(-1, 3))
        edges.append((copies.edges + first[:, None, None]).reshape(-1, 2))
        size, rim = len(copies.points_mm), len(stamp.rim)
        for place, feature in zip(range(0, len(placed.ids), size), features.tolist(), strict=True):
            rims[feature] = _Loop(placed.points[place : place + rim], placed.ids[place : place + rim])
    ink_floor = list(ink)
    if window is not None:
        ink.append(flat([outline, window, *light]))
        ink_floor.append(flat([_Loop(floor_outline, outline.ids), window, *light]))
    field = outline if window is None else window.reversed()
    # In the features' own order, so that faces which differ in rings and dots alone have the same white field.
    holes = [*dark, *(rims[feature] for feature in sorted(rims))]
    white.append(flat([field, *(loop.reversed() for loop in holes)]))
    ids = (np.concatenate(part) for part in (ink, ink_floor, white, edges))
    return _Surfaces(np.concatenate(points), *ids)


def _without_slivers(points: Contour, triangles: Ids) -> Ids:
    """Triangles over the same area without those whose corners lie on a line, which have no normal.

    The long side of such a triangle is flipped: its middle corner w is joined to the corner x across the side.
    """
    triangles = triangles.copy()
    area = _doubled_area(points, triangles)
    for _ in range(len(triangles)):
        (slivers,) = np.nonzero(area < _SLIVER_MM2)
        if not len(slivers):
            break
        flat = slivers[0]
        corners = points[triangles[flat]]
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        u, v, w = np.roll(triangles[flat], -int(np.argmax(lengths)))
        (across,) = np.nonzero((triangles == v) & (np.roll(triangles, -1, axis=1) == u))[0]
        (x,) = set(triangles[across].tolist()) - {int(u), int(v)}
        triangles[flat], triangles[across] = (u, x, w), (x, v, w)
        flipped = [flat, across]
        area[flipped] = _doubled_area(points, triangles[flipped])
    return triangles


def _doubled_area(points: Contour, triangles: Ids) -> Array:
    """Twice the signed area of each triangle.  # (T,)"""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    doubled: Array = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    return doubled


def _stamp_surfaces(stamp: Stamp, flat: _Triangulator) -> _Surfaces:
    """One ring or dot about the origin, numbered from 0."""
    rim = _Loop(stamp.rim, _numbers(0, len(stamp.rim)))
    if stamp.hole is None:
        ink = flat([rim])
        return _Surfaces(stamp.rim, ink, ink, np.empty((0, 3), dtype=np.int32), rim.edges)
    hole = _Loop(stamp.hole, _numbers(len(stamp.rim), len(stamp.rim) + len(stamp.hole)))
    edges = np.concatenate([rim.edges, hole.edges])
    ink = flat([rim, hole])
    return _Surfaces(np.concatenate([stamp.rim, stamp.hole]), ink, ink, flat([hole.reversed()]), edges)


def wall_strip(top: Ids, floor: Ids, edges: Ids | None = None) -> Ids:
    """Quads from `top` down to `floor` along edges that have the solid on their left, as triangles.

    Without `edges`, the walls go once around both.
    """
    if edges is None:
        around = _numbers(0, len(top))
        edges = np.stack([around, np.roll(around, -1)], axis=1)
    a, b = edges[:, 0], edges[:, 1]
    lower = np.stack([floor[a], floor[b], top[b]], axis=1)
    upper = np.stack([floor[a], top[b], top[a]], axis=1)
    return np.concatenate([lower, upper])


def _without_unused(vertices: Array, hull_count: int, triangles: Ids) -> Mesh:
    """Drop the hull's vertices that no triangle uses; those of the faces are all used."""
    used = np.zeros(hull_count, dtype=bool)
    used[triangles[triangles < hull_count]] = True
    renumber = _numbers(0, len(vertices)) - (hull_count - int(used.sum()))
    renumber[:hull_count] = np.cumsum(used) - 1
    return Mesh(np.concatenate([vertices[:hull_count][used], vertices[hull_count:]]), renumber[triangles])


def _numbers(start: int, stop: int) -> Ids:
    return np.arange(start, stop, dtype=np.int32)


CIRCLE_SEGMENTS = 48
"""Of bores, pins and cavities: a chord of a 40 mm circle strays by .04 mm."""


def solid_of(mesh: Mesh) -> Manifold:
    """A closed mesh as a solid.

    Raises:
        ValueError: the mesh is not closed.
    """
    vertices = np.ascontiguousarray(mesh.vertices_mm)
    solid = Manifold(Mesh64(vert_properties=vertices, tri_verts=np.ascontiguousarray(mesh.triangles, dtype=np.uint64)))
    if solid.status() != Error.NoError:
        raise ValueError(f"a mesh that is no solid: {solid.status().name}")
    return solid


def mesh_of(solid: Manifold) -> Mesh:
    """The surface of a solid."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties[:, :3], dtype=np.float64), mesh.tri_verts.astype(np.int32))


def placed(solid: Manifold, frame: Array) -> Manifold:
    """The solid moved by a rigid motion.  # (4, 4)"""
    return solid.transform(np.ascontiguousarray(frame[:3]))


def cylinder(radius_mm: float, low_mm: float, high_mm: float, at: tuple[float, float] = (0.0, 0.0)) -> Manifold:
    """A cylinder along z."""
    solid = Manifold.cylinder(high_mm - low_mm, radius_mm, circular_segments=CIRCLE_SEGMENTS)
    return solid.translate((at[0], at[1], low_mm))


def cone(low_radius_mm: float, high_radius_mm: float, height_mm: float) -> Manifold:
    """A cone's lower part, which stands on z = 0."""
    return Manifold.cylinder(height_mm, low_radius_mm, high_radius_mm, circular_segments=CIRCLE_SEGMENTS)


def prism(contours: tuple[Array, ...], low_mm: float, high_mm: float) -> Manifold:
    """Counter-clockwise contours in a plane of constant z, extruded along z."""
    section = CrossSection([np.ascontiguousarray(contour) for contour in contours])
    return Manifold.extrude(section, high_mm - low_mm).translate((0.0, 0.0, low_mm))


def union(solids: list[Manifold]) -> Manifold:
    """All solids as one; of none an empty one."""
    return Manifold.batch_boolean(solids, OpType.Add) if solids else Manifold()


def frame_along(axis: Array) -> Array:
    """A frame about the origin whose z runs along an axis.  # (4, 4)"""
    z = axis / np.linalg.norm(axis)
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = x, np.cross(z, x), z
    return frame
