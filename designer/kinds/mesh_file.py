"""A body's flat faces out of a mesh: `faces_of("part.stl", 1.0)`, read by trimesh (STL, OBJ, PLY, OFF, GLB).

What counts is the convex hull: its triangles are merged to flat faces, and those that the mesh covers may carry rings.
So an open mesh gets a closed body, doubled or turned triangles do no harm, and whatever lies inside is found out.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.solid import Faceted, plane_of
from designer.base.units import UNITS_MM

SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb")
MAX_BYTES = 100 * 2**20
MOST_TRIANGLES = 500_000
MOST_FACES = 200
"""Flat ones, with rings or without: more are of a curved surface."""
MOST_CORNERS = 64
LEAST_SIZE_MM, MOST_SIZE_MM = 1.0, 2_000.0
FLAT = 2e-4
"""How far corners of one flat face may lie off its plane, as a share of the body's size ..."""
LEAST_FLAT_MM = 0.005
"""... but no less than what files round off."""
COVERED = 0.98
"""Of a face's area, what the mesh must cover for rings on it."""


@dataclass(frozen=True, eq=False)
class ReadMesh:
    """A body about its centroid, and what was done to get it, a line each."""

    body: Faceted
    remarks: tuple[str, ...]


def faces_of(path: str | PathLike[str], unit_mm: float | None) -> ReadMesh:
    """The flat faces of a mesh in a file, the upper ones first.

    Args:
        path: the file.
        unit_mm: what its numbers are; None: nobody said, which is an error that tells how large they are.

    Raises:
        InputError: no mesh, or none whose faces can carry rings; one line says why, and what can.
    """
    place = place_of(path, "a mesh")
    corners = _triangles(place)
    if unit_mm is None:
        length = float(np.ptp(corners, axis=(0, 1)).max())
        units = " or ".join(UNITS_MM)
        raise InputError(f"{place}: a mesh says no unit, and this one is {length:.3g} long; give --unit {units}")
    corners = unit_mm * corners
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size_mm = float((high - low).max())
    if not LEAST_SIZE_MM <= size_mm <= MOST_SIZE_MM:
        raise InputError(
            f"{place}: is {size_mm:.3g}mm in size; it must be {LEAST_SIZE_MM:g} to {MOST_SIZE_MM:g}mm: check --unit"
        )
    flat_mm = max(FLAT * size_mm, LEAST_FLAT_MM)
    points = np.unique(np.round(corners.reshape(-1, 3), 6), axis=0)
    try:
        hull = ConvexHull(points - points.mean(axis=0))
    except (QhullError, ValueError):
        raise InputError(f"{place}: is flat or a line; for a plate use `design board`") from None
    if min(np.ptp(points, axis=0)) < flat_mm or hull.volume < flat_mm * hull.area / 2:
        raise InputError(f"{place}: is {2 * hull.volume / hull.area:.2g}mm thick; for a plate use `design board`")
    region, planes = _flat_regions(hull, flat_mm)
    count = len(planes)
    if count > MOST_FACES:
        raise InputError(
            f"{place}: has {count} flat faces, more than {MOST_FACES}; a curved surface has none that is flat: use a "
            "body of fewer, larger faces"
        )
    _check_on_hull(place, corners - points.mean(axis=0), planes, flat_mm)
    rows = _corners_in_order(hull, region, count)
    if max(map(len, rows)) > MOST_CORNERS:
        raise InputError(
            f"{place}: a face has {max(map(len, rows))} corners, more than {MOST_CORNERS}; use a coarser mesh"
        )
    slivers = InputError(
        f"{place}: has slivers between its faces about as thin as what counts for flat, {flat_mm:.2g}mm; use a mesh "
        "whose edges are sharp, or rounded by more"
    )
    if min(map(len, rows)) < 3:
        raise slivers
    covered, turned = _covered(corners - points.mean(axis=0), planes, rows, hull.points, flat_mm)
    if not (covered >= COVERED).any():
        raise InputError(f"{place}: covers no flat face of its hull as a whole; use one whose faces are closed")
    if turned > 0.5 and (covered < COVERED).any():
        raise InputError(
            f"{place}: its faces look inward, and rings are set on the outside; turn the triangles over for the outside"
        )
    try:
        return _body(hull, rows, planes, covered, flat_mm)
    except ValueError:  # they close no convex body
        raise slivers from None


def _triangles(place: Path) -> Array:
    """Corners of all triangles, in the file's unit.  # (T, 3, 3)"""
    import trimesh

    if place.suffix.lower() not in SUFFIXES:
        raise InputError(f"{place}: is no mesh; use one of {', '.join(one[1:].upper() for one in SUFFIXES)}")
    try:
        size = place.stat().st_size
    except OSError as error:
        raise InputError(f"{place}: {error.strerror or error}; check the name") from None
    if not place.is_file() or size > MAX_BYTES:
        what = f"{size / 2**20:.0f} MB" if place.is_file() else "no file"
        raise InputError(f"{place}: is {what}; use a mesh of at most {MAX_BYTES // 2**20} MB")
    try:
        # Materials of an OBJ name further files, which nobody asked for.
        mesh = trimesh.load_mesh(place, process=False, skip_materials=True)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
        corners = np.asarray(mesh.triangles, dtype=np.float64)
    except Exception as error:
        why = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"{place}: cannot be read as a mesh ({why}); export it again") from None
    if not len(corners):
        raise InputError(f"{place}: is damaged or holds no triangles; export it again, as a mesh")
    if len(corners) > MOST_TRIANGLES:
        raise InputError(f"{place}: has {len(corners)} triangles, more than {MOST_TRIANGLES}; use a coarser mesh")
    if not np.isfinite(corners).all():
        raise InputError(f"{place}: holds a number that is not finite; export it again")
    return corners


def _flat_regions(hull: ConvexHull, flat_mm: float) -> tuple[Rows, Array]:
    """The flat face of each of the hull's triangles, and the faces' outward planes.  # (T,), (F, 4)"""
    corner = hull.points[hull.simplices]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    region, planes = np.full(len(corner), -1), list[tuple[float, ...]]()
    for seed in np.argsort(-area, kind="stable").tolist():
        if region[seed] >= 0:
            continue
        normal, offset = hull.equations[seed, :3], hull.equations[seed, 3]
        region[seed], queue = len(planes), [seed]
        for row in queue:
            for other in hull.neighbors[row].tolist():
                if region[other] < 0 and np.abs(corner[other] @ normal + offset).max() <= flat_mm:
                    region[other] = len(planes)
                    queue.append(other)
        planes.append((*normal, -offset))
    return region, np.array(planes)


def _corners_in_order(hull: ConvexHull, region: Rows, count: int) -> list[tuple[int, ...]]:
    """Vertices where three faces or more meet, around each face, counter-clockwise from outside."""
    touching: dict[int, set[int]] = {}
    for row, triangle in zip(region.tolist(), hull.simplices.tolist(), strict=True):
        for vertex in triangle:
            touching.setdefault(vertex, set()).add(row)
    rows = []
    for face in range(count):
        own = [vertex for vertex, faces in touching.items() if face in faces and len(faces) > 2]
        normal = hull.equations[np.flatnonzero(region == face)[0], :3]
        point = hull.points[own]
        middle = point.mean(axis=0)
        x_axis = point[0] - middle
        y_axis = np.cross(normal, x_axis)
        rows.append(tuple(own[k] for k in np.argsort(np.arctan2((point - middle) @ y_axis, (point - middle) @ x_axis))))
    return rows


def _check_on_hull(place: Path, corners: Array, planes: Array, flat_mm: float) -> None:
    """All triangles must lie on the hull: what does not is a notch, an inner wall, or another part."""
    inside = np.full(len(corners), np.inf)
    for plane in planes:
        inside = np.minimum(inside, (plane[3] - corners @ plane[:3]).max(axis=1))
    if (bad := inside > 2 * flat_mm).any():
        raise InputError(
            f"{place}: is not convex, {int(bad.sum())} of {len(corners)} triangles lie up to {inside.max():.3g}mm "
            "inside its hull; use convex parts, each a target of its own, without holes, inner walls and crossing faces"
        )


def _covered(
    corners: Array, planes: Array, rows: list[tuple[int, ...]], points: Array, flat_mm: float
) -> tuple[Array, float]:
    """The share of each face that the mesh covers, by area, and the share of the mesh that looks inward.  # (F,)"""
    from shapely import Polygon, unary_union

    share, inward, whole = np.zeros(len(rows)), 0.0, 0.0
    for row, (plane, face) in enumerate(zip(planes, rows, strict=True)):
        normal = plane[:3]
        mine = corners[((plane[3] - corners @ normal) <= 2 * flat_mm).all(axis=1)]
        x_axis = points[face[1]] - points[face[0]]
        x_axis = x_axis - (x_axis @ normal) * normal
        axes = np.stack([x_axis, np.cross(normal, x_axis)], axis=1) / np.linalg.norm(x_axis)
        flat = mine @ axes
        doubled = (flat[:, 1, 0] - flat[:, 0, 0]) * (flat[:, 2, 1] - flat[:, 0, 1])
        doubled -= (flat[:, 1, 1] - flat[:, 0, 1]) * (flat[:, 2, 0] - flat[:, 0, 0])
        solid = flat[np.abs(doubled) > 1e-9]
        inward, whole = inward + float(-doubled[doubled < 0].sum()), whole + float(np.abs(doubled).sum())
        union = unary_union([Polygon(one) for one in solid])
        share[row] = union.area / Polygon(points[list(face)] @ axes).area
    return share, inward / max(whole, 1e-12)


def _body(hull: ConvexHull, rows: list[tuple[int, ...]], planes: Array, covered: Array, flat_mm: float) -> ReadMesh:
    """The body about its centroid, its faces from above to below."""
    used = sorted({vertex for face in rows for vertex in face})
    number = {vertex: row for row, vertex in enumerate(used)}
    vertices = hull.points[used]
    corner = hull.points[hull.simplices]
    volume = np.abs(np.linalg.det(corner))  # of the tetrahedra from the points' mean, which lies inside
    centroid = (volume[:, None] * corner.mean(axis=1) * 0.75).sum(axis=0) / volume.sum()
    vertices = np.round(vertices - centroid, 6)
    faces = [tuple(number[vertex] for vertex in face) for face in rows]
    off_mm = 0.0
    for corner in (vertices[list(face)] for face in faces):
        plane = plane_of(corner)
        off_mm = max(off_mm, float(np.abs(corner @ plane[:3] - plane[3]).max()))
    order = sorted(range(len(faces)), key=lambda row: _from_above(planes[row]))
    ringed = tuple(faces[row] for row in order if covered[row] >= COVERED)
    bare = tuple(faces[row] for row in order if covered[row] < COVERED)
    return ReadMesh(Faceted(vertices, ringed, bare), tuple(_remarks(len(faces), len(bare), off_mm)))


def _from_above(plane: Array) -> tuple[float, float]:
    x, y, z = np.round(plane[:3], 6).tolist()
    return -z, math.atan2(y, x) if abs(z) < 1 else 0.0


def _remarks(faces: int, bare: int, off_mm: float) -> Iterator[str]:
    yield f"mesh: {faces} flat faces"
    if off_mm > LEAST_FLAT_MM:
        yield f"mesh: faces are flat within {off_mm:.2g}mm; each is taken for the plane through its corners"
    if bare:
        yield f"mesh: open; closed by its hull, {bare} face{'s' * (bare > 1)} of which stay{'s' * (bare == 1)} bare"
